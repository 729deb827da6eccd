"""Material laws: from the parameters to the coefficients of the equations.

All functions are of the module, so that models can be pickled. Parameters: E [dyn/cm²], nu,
alpha (Biot–Willis), skempton, density [g/cm³], viscosity [P], kappa [cm²], loss.
"""

from collections.abc import Callable
from functools import partial

from dacore.core.parameters import Parameters
from dacore.errors import ShapeError

# Bounds that physics puts on each parameter: lowest, highest, and whether the ends are allowed.
_BOUNDS = {
    "E": (0.0, float("inf"), False, False),
    "nu": (-1.0, 0.5, False, False),
    "kappa": (0.0, float("inf"), True, False),
    "density": (0.0, float("inf"), False, False),
    "viscosity": (0.0, float("inf"), False, False),
    "alpha": (0.0, 1.0, False, True),
    "skempton": (0.0, 1.0, False, True),
    "loss": (0.0, float("inf"), True, False),
}


def check(name: str, value: float) -> float:
    """Return `value` of the parameter `name`; ShapeError if physics does not allow it."""
    low, high, low_allowed, high_allowed = _BOUNDS[name]
    inside = (low < value or (low_allowed and value == low)) and (value < high or (high_allowed and value == high))
    if not inside:
        brackets = ("[" if low_allowed else "(", "]" if high_allowed else ")")
        raise ShapeError(f"{name}: got {value:g}, expected a value in {brackets[0]}{low:g}, {high:g}{brackets[1]}")
    return value


def bounded() -> tuple[str, ...]:
    """Names of the parameters that physics bounds."""
    return tuple(_BOUNDS)


def admissible(name: str) -> Callable[[float], float] | None:
    """Return what `Parameter.admissible` asks of a parameter; nothing for those that physics does not bound."""
    return partial(check, name) if name in _BOUNDS else None


def density(parameters: Parameters) -> float:
    """ρ [g/cm³]."""
    return check("density", parameters["density"])


def alpha(parameters: Parameters) -> float:
    """α, the Biot–Willis coefficient."""
    return check("alpha", parameters["alpha"])


def shear(parameters: Parameters) -> float:
    """μ_s = E/(2(1 + ν)) [dyn/cm²]."""
    return check("E", parameters["E"]) / (2 * (1 + check("nu", parameters["nu"])))


def twice_shear(parameters: Parameters) -> float:
    """2μ_s = E/(1 + ν) [dyn/cm²], the factor of ε:ε in Hooke's law (the paper's weak form prints 2E)."""
    return 2 * shear(parameters)


def lame(parameters: Parameters) -> float:
    """λ = Eν/((1 + ν)(1 − 2ν)) [dyn/cm²]."""
    modulus, ratio = check("E", parameters["E"]), check("nu", parameters["nu"])
    return modulus * ratio / ((1 + ratio) * (1 - 2 * ratio))


def storage(parameters: Parameters) -> float:
    """S = 3α(1 − αB)(1 − 2ν)/(BE) [cm²/dyn]; zero for αB = 1, an incompressible fluid and solid."""
    coupling, ratio = check("alpha", parameters["alpha"]), check("nu", parameters["nu"])
    skempton = check("skempton", parameters["skempton"])
    bulk = 3 * coupling * (1 - coupling * skempton) * (1 - 2 * ratio)
    return bulk / (skempton * check("E", parameters["E"]))


def confined_swelling(parameters: Parameters) -> float:
    """α²/(λ + 2μ_s) [cm²/dyn]: by what confined tissue swells for a rise of its pressure, times α."""
    return alpha(parameters) ** 2 / (lame(parameters) + twice_shear(parameters))


def mobility(parameters: Parameters) -> float:
    """κ/μ_f [cm⁴/(dyn s)]."""
    return check("kappa", parameters["kappa"]) / check("viscosity", parameters["viscosity"])


def loss(parameters: Parameters) -> float:
    """η of E(1 + iη) in motions at one frequency: the ratio of loss and storage modulus of the drained skeleton."""
    return check("loss", parameters["loss"])
