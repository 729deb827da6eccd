"""What comes out of an estimator: states as coefficients until asked for, quantities, their uncertainty."""

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from dacore.core.arrays import Array, BoolArray, IntArray, Sparse
from dacore.core.background import Background
from dacore.core.checks import check_data
from dacore.core.display import Card, Displayed, count, moments, unit_text
from dacore.core.misfit import Misfit
from dacore.core.observation import Functionals
from dacore.core.parameters import ParameterEstimate
from dacore.core.quantity import QuantityOfInterest
from dacore.core.uncertainty import Uncertainty
from dacore.errors import ShapeError

# Representers whose states are held at once.
_PORTION = 64


class Riesz(ABC):
    """Representers of functionals, computed only when a state or a quantity asks for them."""

    @abstractmethod
    def lift(self, weights: Array) -> Array:
        """States M⁻¹ℓᵀ z (n_dofs, ...) of weights z (m, ...) on the raw functionals.

        Parameters
        ----------
        weights : (m, ...) array

        Returns
        -------
        (n_dofs, ...) array
        """

    @abstractmethod
    def pair(self, functionals: Functionals) -> Array:
        """Q M⁻¹ ℓᵀ as an (s, m) array; zero where q and ℓ see no common field.

        Parameters
        ----------
        functionals : Functionals
            The s rows of Q.

        Returns
        -------
        (s, m) array
        """


@dataclass(frozen=True, eq=False, repr=False)
class Estimate(Displayed):
    """States of k series over t steps, kept as coefficients until asked for.

    Parameters
    ----------
    background : Background
    steps : (t,) int array
        Which of the background's times the states are of: those observed, or more where the estimator knows
        how times go together.
    coefficients : (r, t, k) array
        In the background's bases.
    correction : (m, t, k) array, optional
        Weights z of the representers: the state is Φa + M⁻¹ℓᵀz.
    riesz : Riesz, optional
        Needed where there is a correction.
    uncertainty : Uncertainty, optional
    misfit : Misfit, optional
        Whether the data contradict what the estimator supposes.
    parameters : ParameterEstimate, optional
        Of an estimator that finds the model's parameters, too.

    Raises
    ------
    ShapeError
        If the coefficients are not those of the background's modes at these steps.
    """

    background: Background
    steps: IntArray
    coefficients: Array
    correction: Array | None = None
    riesz: Riesz | None = None
    uncertainty: Uncertainty | None = None
    misfit: Misfit | None = None
    parameters: ParameterEstimate | None = None

    def __post_init__(self) -> None:
        modes, steps = len(self.background.coefficients), len(self.steps)
        if np.ndim(self.coefficients) != 3 or self.coefficients.shape[:2] != (modes, steps):
            raise ShapeError(
                f"estimate: got coefficients of shape {np.shape(self.coefficients)}, expected "
                f"({modes} modes, {steps} steps, series)"
            )

    def _card(self) -> Card:
        space, parameters = self.background.space, self.parameters
        size = f"{self.coefficients.shape[0]} modes"
        if self.correction is not None:
            size += f" and {count(len(self.correction), 'representer')}"
        return Card(
            "Estimate",
            (
                ("times", moments(self.times)),
                ("series", count(self.n_series)),
                ("fields", ", ".join(f"{each.name} [{unit_text(each.unit)}]" for each in space.fields)),
                ("made of", size),
                ("uncertainty", "none" if self.uncertainty is None else "yes"),
                ("misfit", "" if self.misfit is None else self.misfit.verdict),
            ),
            () if parameters is None else parameters._card().tables,
        )

    @property
    def n_series(self) -> int:
        """Number k of series."""
        return int(self.coefficients.shape[2])

    @property
    def times(self) -> Array:
        """Times (t,) [s] of the states."""
        return np.asarray(self.background.times[self.steps])

    def nearest(self, time: float) -> int:
        """Return which of the estimate's steps is nearest to a time.

        Parameters
        ----------
        time : float [s]

        Returns
        -------
        int
            As `state` and `deviation` take it.
        """
        return int(np.argmin(np.abs(self.times - time)))

    def field(self, name: str, series: int | slice = slice(None), step: int | slice = slice(None)) -> Array:
        """Nodal values of one field; only that field is lifted.

        Parameters
        ----------
        name : str
        series, step : int or slice
            As `state` takes them; `nearest` says which step is next to a time.

        Returns
        -------
        (c, n_nodes, ...) array [unit of the field]
            Component by component, with the axes left after indexing (t, k).

        Raises
        ------
        CapabilityError
            If the state has no such field.
        """
        layout = self.background.space.layout
        components, block = layout.field(name).components, layout.block(name)
        values = self.background.lift(self.coefficients[:, step, series], (name,))[block]
        if self.correction is not None and self.riesz is not None:
            values = values + self.riesz.lift(self.correction[:, step, series])[block]
        return np.asarray(values.reshape(components, -1, *values.shape[1:]))

    def state(self, series: int | slice = slice(None), step: int | slice = slice(None)) -> Array:
        """Lift to states: (n_dofs, ...) with the axes left after indexing (t, k).

        Parameters
        ----------
        series, step : int or slice
            Which of the k series and of the t steps; all by default.

        Returns
        -------
        (n_dofs, ...) array
        """
        out = self.background.lift(self.coefficients[:, step, series])
        if self.correction is not None and self.riesz is not None:
            out += self.riesz.lift(self.correction[:, step, series])
        return out

    def functional(self, functionals: Functionals) -> Array:
        """Values (s, t, k) of functionals in space, without lifting a state.

        Parameters
        ----------
        functionals : Functionals

        Returns
        -------
        (s, t, k) array
        """
        reduced = self.background.observe(functionals.matrix)
        out = np.tensordot(reduced, self.coefficients, axes=1)
        if self.correction is not None and self.riesz is not None:
            pairing = self.riesz.pair(functionals)
            if pairing.any():
                out += np.tensordot(pairing, self.correction, axes=1)
        return np.asarray(out)

    def quantity(self, quantity: QuantityOfInterest) -> Array:
        """Values (s, k) of a quantity; s counts its functionals times its outputs in time.

        Parameters
        ----------
        quantity : QuantityOfInterest

        Returns
        -------
        (s, k) array
        """
        values = self.functional(quantity.functionals(self.background.space))
        weights = quantity.time_weights(values.shape[1])
        every = np.asarray(np.einsum("ot,stk->sok", weights, values))
        return every.reshape(every.shape[0] * every.shape[1], self.n_series)

    def standard_deviation(self, quantity: QuantityOfInterest) -> Array:
        """Standard deviation (s, k) of `quantity`; ShapeError if the estimator gives none.

        Parameters
        ----------
        quantity : QuantityOfInterest

        Returns
        -------
        (s, k) array

        Raises
        ------
        ShapeError
            If the estimator gives none.
        """
        uncertainty, on_modes, on_correction = self._uncertain(quantity)
        return np.asarray(np.sqrt(uncertainty.variance(on_modes, on_correction)))

    def deviation(self, functionals: Sparse, step: int, series: int) -> Array:
        """Standard deviation (s,) of functionals in space (s, n_dofs) of one state; ShapeError if there is none.

        Parameters
        ----------
        functionals : (s, n_dofs) csr_array
            Point values, for instance.
        step, series : int
            Which state, as `state` counts them.

        Returns
        -------
        (s,) array
        """
        if self.uncertainty is None:
            raise ShapeError("this estimate carries no uncertainty; use an estimator that gives one")
        pairing = None
        if self.correction is not None and self.riesz is not None:
            m = len(self.correction)
            pairing = np.empty((functionals.shape[0], m))
            for start in range(0, m, _PORTION):
                some = np.eye(m, min(_PORTION, m - start), -start)
                pairing[:, start : start + _PORTION] = functionals @ self.riesz.lift(some)
        variance = self.uncertainty.at(
            step, series, len(self.steps), self.background.observe(functionals),
            pairing if pairing is not None and pairing.any() else None,
        )  # fmt: skip
        return np.asarray(np.sqrt(variance))

    def interval(self, quantity: QuantityOfInterest, level: float = 0.9) -> tuple[Array, Array]:
        """Central interval of `quantity` as (low, high), each (s, k); Gaussian unless the estimator knows better.

        Parameters
        ----------
        quantity : QuantityOfInterest
        level : float
            Between 0 and 1.

        Returns
        -------
        low : (s, k) array
        high : (s, k) array

        Raises
        ------
        ShapeError
            If the estimate has no uncertainty, or the level is none.
        """
        if not 0 < level < 1:
            raise ShapeError(f"level: got {level}, expected between 0 and 1")
        uncertainty, on_modes, on_correction = self._uncertain(quantity)
        centre = self.quantity(quantity)
        low, high = (
            uncertainty.quantile(centre, tail, on_modes, on_correction) for tail in (0.5 - level / 2, 0.5 + level / 2)
        )
        return low, high

    def _uncertain(self, quantity: QuantityOfInterest) -> tuple[Uncertainty, Array, Array | None]:
        if self.uncertainty is None:
            raise ShapeError("this estimate carries no uncertainty; use an estimator that gives one")
        riesz = self.riesz if self.correction is not None else None
        return self.uncertainty, *weights_of(quantity, self.background, len(self.steps), riesz)


def weights_of(
    quantity: QuantityOfInterest, background: Background, steps: int, riesz: Riesz | None = None
) -> tuple[Array, Array | None]:
    """Weights with which a quantity takes an estimate over `steps` steps.

    Parameters
    ----------
    quantity : QuantityOfInterest
    background : Background
    steps : int
    riesz : Riesz, optional
        Of an estimate with a correction.

    Returns
    -------
    on_modes : (s, t, r) array
        On the coefficients.
    on_correction : (s, t, m) array or None
        On the correction; None where the quantity does not see it.
    """
    functionals = quantity.functionals(background.space)
    reduced = background.observe(functionals.matrix)
    weights = quantity.time_weights(steps)
    on_modes = np.einsum("ot,sr->sotr", weights, reduced).reshape(-1, steps, reduced.shape[1])
    pairing = riesz.pair(functionals) if riesz is not None else None
    if pairing is None or not pairing.any():
        return on_modes, None
    return on_modes, np.einsum("ot,sm->sotm", weights, pairing).reshape(-1, steps, pairing.shape[1])


@dataclass(frozen=True, eq=False, repr=False)
class Readout(Displayed):
    """A quantity straight from the data: gain · data + offset, for many series and at once.

    Parameters
    ----------
    gain : (s, m, t) array
        Zero where the mask leaves a functional out.
    offset : (s,) array
    deviation : (s,) array
        Standard deviation at the noise that the readout was made for; the data do not change it. NaN where the
        estimator gives none.
    mask : (m,) bool array, optional
        Which functionals are used; None for all.
    """

    gain: Array
    offset: Array
    deviation: Array
    mask: BoolArray | None = None

    def __call__(self, data: Array) -> Array:
        """Values (s, k) of data (m, t, k), or (m, t) of one series; ShapeError as `PreparedEstimator.estimate`."""
        s, m, t = self.gain.shape
        values = check_data(data, m, t, self.mask)
        return np.asarray(self.gain.reshape(s, m * t) @ values.reshape(m * t, -1) + self.offset[:, None])
