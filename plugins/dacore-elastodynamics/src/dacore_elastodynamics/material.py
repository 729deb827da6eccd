"""Material laws: from the parameters to the coefficients of the equations; all of the module, to be pickled.

Parameters: E [dyn/cm²], nu, density [g/cm³], mass_damping [1/s], stiffness_damping [s].
"""

from functools import partial

from dacore.core.parameters import Parameters
from dacore.errors import ShapeError

# Bounds that physics puts on each parameter: lowest, highest, and whether the lowest is allowed.
_BOUNDS = {
    "E": (0.0, float("inf"), False),
    "nu": (-1.0, 0.5, False),
    "density": (0.0, float("inf"), False),
    "mass_damping": (0.0, float("inf"), True),
    "stiffness_damping": (0.0, float("inf"), True),
}


def check(name: str, value: float) -> float:
    """Return `value` of the parameter `name`; ShapeError if physics does not allow it."""
    low, high, included = _BOUNDS[name]
    if low < value < high or (included and value == low):
        return value
    raise ShapeError(f"{name}: got {value:g}, expected a value in {'[' if included else '('}{low:g}, {high:g})")


def bound(name: str) -> "partial[float] | None":
    """Return what `Parameter.admissible` asks of a parameter; nothing for those of loads."""
    return partial(check, name) if name in _BOUNDS else None


def density(parameters: Parameters) -> float:
    """ρ [g/cm³]."""
    return check("density", parameters["density"])


def twice_shear(parameters: Parameters) -> float:
    """2μ = E/(1 + ν) [dyn/cm²], the factor of ε:ε in Hooke's law."""
    return check("E", parameters["E"]) / (1 + check("nu", parameters["nu"]))


def lame(parameters: Parameters) -> float:
    """λ = Eν/((1 + ν)(1 − 2ν)) [dyn/cm²]; negative for ν < 0."""
    ratio = check("nu", parameters["nu"])
    return twice_shear(parameters) * ratio / (1 - 2 * ratio)


def drag(parameters: Parameters) -> float:
    """Drag a ρ [g/(cm³ s)], damping that is proportional to mass."""
    return check("mass_damping", parameters["mass_damping"]) * density(parameters)


def shear_viscosity(parameters: Parameters) -> float:
    """Viscosity b 2μ [P], damping that is proportional to stiffness."""
    return check("stiffness_damping", parameters["stiffness_damping"]) * twice_shear(parameters)


def volume_viscosity(parameters: Parameters) -> float:
    """Viscosity b λ [P]."""
    return check("stiffness_damping", parameters["stiffness_damping"]) * lame(parameters)


def shear_speed(parameters: Parameters) -> float:
    """√(μ/ρ) [cm/s]."""
    return float((twice_shear(parameters) / (2 * density(parameters))) ** 0.5)


def pressure_speed(parameters: Parameters) -> float:
    """√((λ + 2μ)/ρ) [cm/s]."""
    return float(((lame(parameters) + twice_shear(parameters)) / density(parameters)) ** 0.5)
