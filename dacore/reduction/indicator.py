"""How large the error of a reduced trajectory is: random tests of the residual of every step.

A reduced state balances the equation of motion on the modes only; what is left over, the residual r_k of step k, makes
an error S⁻¹ r_k of that step, S the matrix of the step. For a random vector z of covariance M,
``E (z·S⁻¹r)² = ‖S⁻¹r‖²_M``; with y = S⁻ᵀz solved for once, (y·r)² costs nothing but small dense products,
and s tests give the mean to 1/√(2s) relative. Source of the idea: Smetana, Zahm and Patera, Randomized
residual-based error estimators for parametrized equations, SIAM J. Sci. Comput. 41 (2019) A900.

S is taken at the middle of the parameters' ranges, and errors of steps accumulate in a way that depends on the physics.
So the indicator is proportional to the error rather than equal to it; `dacore.reduction.greedy` measures the factor
on trajectories solved in full, as Drohmann and Carlberg do (SIAM/ASA J. Uncertain. Quantif. 3 (2015) 116).

A motion at one frequency is one step with complex S and r = r₀ − i r₁, balanced at its two phases. Real and imaginary
part of y test each phase: the sum of squares is ‖S⁻¹r₀‖² + ‖S⁻¹r₁‖², half that of r
and of its conjugate together.
"""

from dataclasses import dataclass

import numpy as np

from dacore.core.arrays import Array
from dacore.core.display import Displayed
from dacore.core.parameters import ParameterSpace
from dacore.reduction.galerkin import Sketch, Tested
from dacore.reduction.kinds import Reducible, dual_solutions
from dacore.reduction.solver import Balance
from dacore.reduction.split import SplitModel

TESTS = 16


def random_tests(
    model: Reducible, split: SplitModel, parameters: ParameterSpace, seed: int, tests: int = TESTS
) -> Sketch:
    """Return the model tested at random: `tests` vectors S⁻ᵀz for each field, one field after the other.

    Parameters
    ----------
    model : MarchedModel or HarmonicModel
    split : SplitModel
        Of the same model.
    parameters : ParameterSpace
        Their ranges, which need not be those that the model has by default.
    seed : int
    tests : int
    """
    layout = model.space.layout
    rng = np.random.default_rng([seed, 0x72657369])
    z = np.zeros((layout.n_dofs, tests * len(split.fields)))
    for k, name in enumerate(split.fields):
        dofs = np.arange(layout.n_dofs)[layout.block(name)][split.free[name]]
        # The diagonal stands for M: spectrally the same but for a factor, which is calibrated away.
        size = np.sqrt(split.products[name].diagonal())
        z[dofs, k * tests : (k + 1) * tests] = size[:, None] * rng.standard_normal((len(dofs), tests))
    y = dual_solutions(model, parameters.middle, z)
    if y.ndim == 3:  # complex: two real tests for one, which stay beside each other
        y = y.reshape(len(y), 2, len(split.fields), tests).transpose(0, 2, 1, 3).reshape(len(y), -1)
    return Sketch(split, split.free_parts(y))


@dataclass(frozen=True, eq=False, repr=False)
class Indicator(Displayed):
    """Random tests on the modes of a reduced model, and what turns them into errors.

    Parameters
    ----------
    tested : Tested
        The same number of tests for each field.
    factor : (n_fields,) array
        True error per indicator; NaN while unknown.
    """

    tested: Tested
    factor: Array

    def watch(self, coefficients: Array) -> "Watch":
        """Return what adds up local errors while samples with coefficients (n_terms, K) are marched."""
        return Watch(self, coefficients)


class Watch:
    """The running sum of one march; see `Indicator`."""

    def __init__(self, indicator: Indicator, coefficients: Array) -> None:
        self._indicator, self._coefficients = indicator, coefficients
        self._squares = np.zeros((len(indicator.tested.forces), coefficients.shape[1]))

    def __call__(self, part: slice, balance: Balance) -> None:
        """Add the local errors of one step of the samples in `part`."""
        residual = balance.residual(self._indicator.tested, self._coefficients[:, part])
        self._squares[:, part] += residual**2

    @property
    def values(self) -> Array:
        """Root of the summed squares of the local errors (n_fields, K)."""
        fields, count = len(self._indicator.factor), self._squares.shape[1]
        return np.asarray(np.sqrt(self._squares.reshape(fields, -1, count).mean(axis=1)))
