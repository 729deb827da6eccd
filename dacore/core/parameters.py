"""Parameters of a model, how they are sampled, and what is found of them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from inspect import signature
from typing import Literal

import numpy as np

from dacore.core.arrays import Array
from dacore.core.display import Card, Displayed, Rows, count, number, unit_text
from dacore.errors import ShapeError

Sampling = Literal["uniform", "latin_hypercube", "sobol"]
Parameters = Mapping[str, float]


@dataclass(frozen=True)
class Parameter:
    """One parameter and its range.

    Parameters
    ----------
    name, unit : str
    low, high : float
        Range of the distribution; equal for a fixed parameter.
    distribution : {"uniform", "log_uniform"}
    admissible : callable, optional
        Takes a value and raises ShapeError if the model cannot have it; asked for both ends of the range.
    """

    name: str
    unit: str
    low: float
    high: float
    distribution: Literal["uniform", "log_uniform"] = "uniform"
    admissible: Callable[[float], object] | None = None

    def __post_init__(self) -> None:
        if not (np.isfinite([self.low, self.high]).all() and self.low <= self.high):
            raise ShapeError(f"parameter {self.name}: got the range [{self.low}, {self.high}], expected low <= high")
        if self.distribution == "log_uniform" and self.low <= 0:
            raise ShapeError(f"parameter {self.name}: log_uniform needs low > 0, got {self.low}")
        if self.admissible is not None:
            for end in (self.low, self.high):
                self.admissible(end)

    @property
    def fixed(self) -> bool:
        """Whether the parameter has one value only."""
        return self.low == self.high

    def quantile(self, unit_interval: Array) -> Array:
        """Map numbers of [0, 1] to values of the parameter.

        Parameters
        ----------
        unit_interval : array

        Returns
        -------
        array of the same shape
        """
        if self.distribution == "log_uniform":
            return np.asarray(self.low * (self.high / self.low) ** unit_interval)
        return np.asarray(self.low + (self.high - self.low) * unit_interval)


@dataclass(frozen=True, repr=False)
class ParameterSpace(Displayed):
    """All parameters of a model, in a fixed order.

    Parameters
    ----------
    parameters : tuple of Parameter
    """

    parameters: tuple[Parameter, ...]

    def _card(self) -> Card:
        rows = tuple(
            (p.name, unit_text(p.unit), number(p.low), "", "fixed")
            if p.fixed
            else (p.name, unit_text(p.unit), number(p.low), number(p.high), p.distribution.replace("_", " "))
            for p in (*self.free, *(p for p in self.parameters if p.fixed))
        )
        facts = (("parameters", f"{count(len(self.parameters))}, {count(len(self.free))} of them free"),)
        return Card("ParameterSpace", facts, (Rows(("name", "unit", "low", "high", "law"), rows),))

    @classmethod
    def of(
        cls,
        every: Mapping[str, tuple[str, tuple[float, float]]],
        ranges: Mapping[str, tuple[float, float]],
        log_uniform: Sequence[str] = (),
        admissible: Callable[[str], Callable[[float], object] | None] = lambda name: None,
        what: str = "parameters",
    ) -> "ParameterSpace":
        """Return the space of a physics whose scene may give ranges of its own.

        Parameters
        ----------
        every : mapping of str to (unit, (low, high))
            All parameters with their default ranges.
        ranges : mapping of str to (low, high)
            In place of the defaults.
        log_uniform : sequence of str
            Parameters that are uniform in their logarithm.
        admissible : callable
            Name -> `Parameter.admissible`, or None.
        what : str
            What to call them in messages.

        Returns
        -------
        ParameterSpace

        Raises
        ------
        ShapeError
            If a name is unknown, or a parameter cannot have its range.
        """
        if unknown := [name for name in (*ranges, *log_uniform) if name not in every]:
            raise ShapeError(f"{what}: got {', '.join(unknown)}, expected any of {', '.join(every)}")
        return cls(
            tuple(
                Parameter(
                    name,
                    unit,
                    *ranges.get(name, bounds),
                    "log_uniform" if name in log_uniform else "uniform",
                    admissible(name),
                )
                for name, (unit, bounds) in every.items()
            )
        )

    @property
    def names(self) -> tuple[str, ...]:
        """Names in order."""
        return tuple(parameter.name for parameter in self.parameters)

    @property
    def free(self) -> tuple[Parameter, ...]:
        """The parameters that vary."""
        return tuple(parameter for parameter in self.parameters if not parameter.fixed)

    @property
    def middle(self) -> dict[str, float]:
        """Every parameter at the middle of its distribution."""
        return {parameter.name: float(parameter.quantile(np.array(0.5))) for parameter in self.parameters}

    def __getitem__(self, name: str) -> Parameter:
        for parameter in self.parameters:
            if parameter.name == name:
                return parameter
        raise ShapeError(f"parameter {name!r}: this model has {', '.join(self.names)}")

    def restrict(self, ranges: Mapping[str, tuple[float, float]]) -> "ParameterSpace":
        """Return the space with other ranges for some parameters (low = high fixes one).

        Parameters
        ----------
        ranges : mapping of str to (float, float)

        Returns
        -------
        ParameterSpace

        Raises
        ------
        ShapeError
            If there is no such parameter, or it cannot have that range.
        """
        for name in ranges:
            self[name]
        return ParameterSpace(
            tuple(
                replace(p, low=ranges[p.name][0], high=ranges[p.name][1]) if p.name in ranges else p
                for p in self.parameters
            )
        )

    def sample(self, rng: np.random.Generator, count: int, method: Sampling = "uniform") -> Array:
        """Draw parameter vectors.

        Parameters
        ----------
        rng : numpy.random.Generator
        count : int
        method : {"uniform", "latin_hypercube", "sobol"}

        Returns
        -------
        (count, n_parameters) array
            Columns in the order of `names`; only free parameters consume random numbers.
        """
        if count < 1:
            raise ShapeError(f"samples: got {count}, expected at least 1")
        dim = len(self.free)
        if method == "uniform" or dim == 0:
            unit = rng.random((count, dim))
        else:
            from scipy.stats import qmc

            # scipy 1.15 renamed the argument.
            source = {"rng" if "rng" in signature(qmc.Sobol).parameters else "seed": rng}
            if method == "sobol":
                sampler: qmc.QMCEngine = qmc.Sobol(dim, scramble=True, **source)
                unit = sampler.random_base2(int(np.ceil(np.log2(count))))[:count]
            elif method == "latin_hypercube":
                unit = qmc.LatinHypercube(dim, **source).random(count)
            else:
                raise ShapeError(f"sampling: got {method!r}, expected uniform, latin_hypercube or sobol")
        columns = iter(unit.T)
        values = [np.full(count, p.low) if p.fixed else p.quantile(next(columns)) for p in self.parameters]
        return np.stack(values, axis=1)

    def as_mapping(self, values: Sequence[float] | Array) -> dict[str, float]:
        """Name the entries of one parameter vector (n_parameters,).

        Parameters
        ----------
        values : (n_parameters,) array

        Returns
        -------
        dict of str to float

        Raises
        ------
        ShapeError
            If there are more or fewer values.
        """
        if len(values) != len(self.parameters):
            raise ShapeError(f"parameter vector: got {len(values)} values, expected {len(self.parameters)}")
        return {name: float(value) for name, value in zip(self.names, values, strict=True)}


@dataclass(frozen=True, eq=False, repr=False)
class ParameterEstimate(Displayed):
    """What was found of a model's parameters, beside the state.

    Parameters
    ----------
    names : tuple of str
        The parameters that vary, p of them.
    values : (p, k) array
    covariance : (k, p, p) array
    prior : (p,) array
        Standard deviation of each before anything was measured.
    """

    names: tuple[str, ...]
    values: Array
    covariance: Array
    prior: Array

    def _card(self) -> Card:
        series = self.values.shape[1]
        deviation, learned = self.deviation, np.clip(self.learned, 0.0, 1.0)
        middle = [np.median(each, axis=1) for each in (self.values, deviation, learned)]
        rows = tuple(
            (name, f"{value:.4g} ± {spread:.2g}", f"{prior:.2g}", f"{100 * share:.0f}%")
            for name, value, spread, prior, share in zip(self.names, *middle[:2], self.prior, middle[2], strict=True)
        )
        value = "value" if series == 1 else f"median of {series} series"
        table = Rows(("parameter", f"{value} ± deviation", "deviation before", "variance learned"), rows)
        return Card("ParameterEstimate", (("series", count(series)),), (table,))

    @property
    def deviation(self) -> Array:
        """Standard deviation (p, k)."""
        return np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2)).T

    @property
    def learned(self) -> Array:
        """1 − posterior variance / prior variance (p, k): 1 where the data say all, 0 where they say nothing."""
        return np.asarray(1.0 - (self.deviation / self.prior[:, None]) ** 2)
