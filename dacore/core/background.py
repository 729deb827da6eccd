"""What training leaves behind: a basis for each field and the training set in its coordinates.

The basis is block diagonal (orthonormal field by field), so no weight ζ between the fields
enters it. Every choice made later, ζ, centring, one space for the cycle or one per phase,
works on the small array of coefficients alone: weighting a field by ζ is scaling its
coefficients by √ζ.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dacore.core.arrays import Array, Sparse
from dacore.core.display import Card, Displayed, Rows, count, listed, moments, unit_text
from dacore.core.parameters import ParameterSpace
from dacore.core.reduced import ReducedSpace
from dacore.core.space import Product, StateSpace
from dacore.errors import CapabilityError, ShapeError


class ParametricMap(ABC):
    """From parameters to trajectories in a background's bases: a reduced model, or an interpolation of one."""

    @abstractmethod
    def coefficients(self, points: Array) -> Array:
        """Trajectories (r, t, k), in the bases and at the times of the background, of parameters (k, n_parameters).

        Parameters
        ----------
        points : (k, n_parameters) array

        Returns
        -------
        (r, t, k) array
        """

    @property
    @abstractmethod
    def accuracy(self) -> Mapping[str, float]:
        """For each field, the relative space–time error that is to be expected of a trajectory."""

    def coarse(self, points: Array, tolerance: float) -> "ParametricMap":
        """Return a cheaper map that differs by about a share of what trajectories vary; the same one if there is none.

        Parameters
        ----------
        points : (k, n_parameters) array
            Reaching as far as those that the map will be asked for.
        tolerance : float

        Returns
        -------
        ParametricMap
        """
        return self


@dataclass(frozen=True, eq=False, repr=False)
class Background(Displayed):
    """Compressed training set.

    Parameters
    ----------
    space : StateSpace
    bases : mapping of str to ReducedSpace
        For each field, modes (n_field, r_f) orthonormal in that field's inner product.
    coefficients : (r, t, K) array
        Training snapshots in the bases, r = Σ_f r_f, fields in the order of ``space.fields``.
    times : (t,) array [s]
    parameters : ParameterSpace
    samples : (K, n_parameters) array
        Parameters of the training trajectories.
    kind : {"l2", "h1"}
        Inner product of the bases.
    compression : mapping of str to float
        For each field, the relative error of the compression in the mean-square sense.
    forward : ParametricMap, optional
        What makes further trajectories from parameters, where training left it behind.
    """

    space: StateSpace
    bases: Mapping[str, ReducedSpace]
    coefficients: Array
    times: Array
    parameters: ParameterSpace
    samples: Array
    kind: Product
    compression: Mapping[str, float]
    forward: ParametricMap | None = None

    def __post_init__(self) -> None:
        r = sum(self.bases[field.name].dimension for field in self.space.fields)
        expected = (r, len(self.times), len(self.samples))
        if self.coefficients.shape != expected:
            raise ShapeError(f"training coefficients: got shape {self.coefficients.shape}, expected {expected}")

    def _card(self) -> Card:
        rows = tuple(
            (f.name, unit_text(f.unit), count(self.bases[f.name].dimension), f"{self.compression[f.name]:.1e}")
            for f in self.space.fields
        )
        return Card(
            "Background",
            (
                ("training set", count(self.n_samples, "trajectory", "trajectories")),
                ("times", moments(self.times)),
                ("parameters", listed([each.name for each in self.parameters.free])),
                ("product", {"l2": "L²", "h1": "H¹"}.get(self.kind, self.kind)),
                ("degrees of freedom", count(self.space.n_dofs)),
                ("forward map", "" if self.forward is None else "from parameters to trajectories"),
            ),
            (Rows(("field", "unit", "modes", "error of compression"), rows),),
        )

    @property
    def dimension(self) -> int:
        """Number r of modes of all fields together."""
        return int(self.coefficients.shape[0])

    @property
    def n_samples(self) -> int:
        """Number K of training trajectories."""
        return int(self.coefficients.shape[2])

    def block(self, field: str) -> slice:
        """Rows of the coefficients that belong to `field`.

        Parameters
        ----------
        field : str

        Returns
        -------
        slice

        Raises
        ------
        ShapeError
            If the background has no such field.
        """
        start = 0
        for each in self.space.fields:
            size = self.bases[each.name].dimension
            if each.name == field:
                return slice(start, start + size)
            start += size
        raise ShapeError(f"field {field!r}: not in this background")

    def scale(self, weights: Mapping[str, float]) -> Array:
        """Square roots (r,) of the field weights: scaled coefficients have the weighted norm.

        Parameters
        ----------
        weights : mapping of str to float
            One for each field.

        Returns
        -------
        (r,) array
        """
        out = np.empty(self.dimension)
        for field in self.space.fields:
            out[self.block(field.name)] = np.sqrt(weights[field.name])
        return out

    def mean(self) -> Array:
        """Coefficients (r, t) of the training mean of each time step: the prior guess.

        Returns
        -------
        (r, t) array
        """
        return np.asarray(self.coefficients.mean(axis=2))

    def without_mean(self, coefficients: Array, fields: Sequence[str]) -> Array:
        """Coefficients (r, t, k) of trajectories less their mean over the steps, for some fields.

        Parameters
        ----------
        coefficients : (r, t, k) array
        fields : sequence of str

        Returns
        -------
        (r, t, k) array
        """
        out = np.array(coefficients)
        for name in fields:
            out[self.block(name)] -= out[self.block(name)].mean(axis=1, keepdims=True)
        return out

    def less_mean(self, fields: Sequence[str]) -> "Background":
        """Return the background of trajectories less their mean over the steps, for some fields.

        Parameters
        ----------
        fields : sequence of str

        Returns
        -------
        Background
        """
        forward = None if self.forward is None else _LessMean(self, self.forward, tuple(fields))
        return replace(self, coefficients=self.without_mean(self.coefficients, fields), forward=forward)

    def parametric(self, message: str) -> ParametricMap:
        """Return the map from parameters to trajectories; CapabilityError with a message if training left none.

        Parameters
        ----------
        message : str
            What needs the map, for the error.

        Returns
        -------
        ParametricMap

        Raises
        ------
        CapabilityError
            If training left no map.
        """
        if self.forward is None:
            raise CapabilityError(f"{message}; train with training.method = 'reduced'")
        return self.forward

    def observe(self, matrix: Sparse) -> Array:
        """Functionals (m, n_dofs) applied to every mode: (m, r).

        Parameters
        ----------
        matrix : (m, n_dofs) csr_array

        Returns
        -------
        (m, r) array
        """
        out = np.zeros((matrix.shape[0], self.dimension))
        for field in self.space.fields:
            columns = matrix[:, self.space.layout.block(field.name)]
            if columns.nnz:
                out[:, self.block(field.name)] = columns @ self.bases[field.name].basis
        return out

    def project(self, states: Array) -> Array:
        """Coefficients (r, ...) of the best approximation of states (n_dofs, ...), field by field.

        Parameters
        ----------
        states : (n_dofs, ...) array

        Returns
        -------
        (r, ...) array
        """
        parts = [self.bases[f.name].project(states[self.space.layout.block(f.name)]) for f in self.space.fields]
        return np.concatenate(parts)

    def lift(self, coefficients: Array, fields: tuple[str, ...] | None = None) -> Array:
        """States (n_dofs, ...) of coefficients (r, ...); fields left out are zero.

        Parameters
        ----------
        coefficients : (r, ...) array
        fields : tuple of str, optional
            All by default.

        Returns
        -------
        (n_dofs, ...) array
        """
        names = tuple(f.name for f in self.space.fields) if fields is None else fields
        shape = (self.space.n_dofs, *coefficients.shape[1:])
        flat = coefficients.reshape(len(coefficients), -1)
        make = np.empty if len(set(names)) == len(self.space.fields) else np.zeros
        out = make((self.space.n_dofs, flat.shape[1]))
        for name in names:
            # Straight into its rows: a state is written once.
            np.matmul(self.bases[name].basis, flat[self.block(name)], out=out[self.space.layout.block(name)])
        return out.reshape(shape)


@dataclass(frozen=True, eq=False)
class _LessMean(ParametricMap):
    """Trajectories of another map, less their mean over the steps."""

    background: Background
    forward: ParametricMap
    fields: tuple[str, ...]

    def coefficients(self, points: Array) -> Array:
        """Trajectories of the other map, some fields less their mean."""
        return self.background.without_mean(self.forward.coefficients(points), self.fields)

    def coarse(self, points: Array, tolerance: float) -> ParametricMap:
        """Coarsen the other map."""
        return replace(self, forward=self.forward.coarse(points, tolerance))

    @property
    def accuracy(self) -> Mapping[str, float]:
        """Error of each field relative to what is left of it without its mean, over the training set."""
        out = dict(self.forward.accuracy)
        whole = self.background.coefficients
        left = self.background.without_mean(whole, self.fields)
        for name in self.fields:
            block = self.background.block(name)
            size = float(np.linalg.norm(left[block]))
            out[name] *= float(np.linalg.norm(whole[block])) / size if size > 0 else 1.0
        return out
