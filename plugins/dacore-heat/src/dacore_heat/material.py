"""What the coefficients of the equation are made of, and what physics allows; all of the module, to be pickled."""

from dataclasses import dataclass
from math import prod

from dacore.core.parameters import Parameters
from dacore.errors import ShapeError

# Lowest value of a parameter, and whether it is allowed itself; by the name, or by what the name begins with.
_BOUNDS = {"conductivity": (0.0, False), "capacity": (0.0, False), "blood_capacity": (0.0, False)}
_BOUNDS |= {"perfusion": (0.0, True), "h": (0.0, True)}


@dataclass(frozen=True)
class Lowest:
    """Refuses values of a parameter that physics does not allow.

    Parameters
    ----------
    name : str
    low : float
    included : bool
        Whether `low` itself is allowed.
    """

    name: str
    low: float
    included: bool

    def __call__(self, value: float) -> float:
        """Return the value; ShapeError if it is too low."""
        if value > self.low or (self.included and value == self.low):
            return value
        bracket = "of at least" if self.included else "above"
        raise ShapeError(f"{self.name}: got {value:g}, expected a number {bracket} {self.low:g}")


def bound(name: str) -> Lowest | None:
    """Return what `Parameter.admissible` asks of a parameter; nothing for temperatures, fluxes and powers."""
    key = name if name in _BOUNDS else name.partition("_")[0]
    return Lowest(name, *_BOUNDS[key]) if key in _BOUNDS else None


@dataclass(frozen=True)
class Product:
    """The product of some parameters, as the coefficient of a term or the amplitude of a load.

    Parameters
    ----------
    names : tuple of str
    """

    names: tuple[str, ...]

    def __call__(self, parameters: Parameters) -> float:
        """Return the product at θ; ShapeError if physics does not allow one of them."""
        return prod(_checked(name, parameters[name]) for name in self.names)


def _checked(name: str, value: float) -> float:
    check = bound(name)
    return value if check is None else check(value)
