"""What one step makes of an unforced motion: its amplification and the spectral radius.

The operator acts on what a scheme carries from step to step (y, ẏ, ÿ for Newmark) on the free dofs, with all
loads off. A motion dies or stays bounded exactly if no eigenvalue is larger than 1 in modulus.
"""

import numpy as np
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigs

from dacore.algebra.solvers import Auto
from dacore.core.arrays import Array
from dacore.core.parameters import Parameters
from dacore.core.solver import SolverMethod
from dacore.dynamics.scheme import Scheme
from dacore.dynamics.system import StepSystem
from dacore.errors import ConvergenceError

_LARGEST_DENSE = 4000


class Amplification:
    """The operator of one regular step at one parameter vector.

    Parameters
    ----------
    system : StepSystem
    parameters : mapping of str to float
    method : SolverMethod, optional
        The built-in choice by default.
    tolerance : float
        Relative residual of every solve.
    """

    def __init__(
        self,
        system: StepSystem,
        parameters: Parameters,
        method: SolverMethod | None = None,
        tolerance: float = 1e-12,
    ) -> None:
        self.system, self._step = system, system.at(parameters)
        self._solver = (method or Auto()).prepare(self._step.matrix, system.definite, tolerance)
        n_dofs = system.free.size + system.constrained.size
        self._shape = (system.scheme.carried, n_dofs)
        self._still = np.zeros((system.prescribed.shape[1], 1))

    @property
    def size(self) -> int:
        """Number of unknowns of the operator: arrays a scheme carries times free dofs."""
        return self._shape[0] * self.system.free.size

    def apply(self, motions: Array) -> Array:
        """Return motions (size, k) one step later; the arrays of a motion stand one after the other."""
        scheme, step = self.system.scheme, self.system.step
        count = motions.shape[1]
        full = np.zeros((*self._shape, count))
        full[:, self.system.free] = motions.reshape(self._shape[0], self.system.free.size, count)
        still = np.repeat(self._still, count, axis=1)
        new = self._step.take(self._solver, scheme.joined(tuple(full), step), still, still, step)
        return np.concatenate([part[self.system.free] for part in scheme.parts(new)])

    def dense(self) -> Array:
        """Return the matrix (size, size)."""
        return self.apply(np.eye(self.size))

    def radius(self) -> float:
        """Return the spectral radius: dense for small systems, by Arnoldi's method for large ones.

        Raises
        ------
        ConvergenceError
            If Arnoldi's method does not find the largest eigenvalue.
        """
        if self.size <= _LARGEST_DENSE:
            return float(np.abs(np.linalg.eigvals(self.dense())).max())
        operator = LinearOperator(
            (self.size, self.size), matvec=lambda x: self.apply(x.reshape(-1, 1))[:, 0], dtype=np.float64
        )
        start = np.random.default_rng(0).standard_normal(self.size)
        try:
            values = eigs(operator, k=2, which="LM", v0=start, tol=1e-4, return_eigenvectors=False)
        except ArpackNoConvergence as error:
            raise ConvergenceError(f"spectral radius: {error}; take a smaller system") from error
        return float(np.abs(values).max())


def mode_radii(
    scheme: Scheme, step: float, mass: Array, stiffness: Array, coupling: Array, storage: Array, mobility: Array
) -> Array:
    """Spectral radii of the smallest coupled systems ``m ü + k u − b p = 0, S ṗ + b u̇ + κ p = 0``, or of one mode.

    Parameters
    ----------
    scheme : Scheme
    step : float [s]
    mass, stiffness, coupling, storage, mobility : (n,) arrays
        m, k, b, S and κ of n systems. Those of a mode φ of the displacement, of the generalised eigenproblem
        K φ = k M φ with φᵀ M φ = 1, are m = 1, k, and the flow it causes.

    Returns
    -------
    (n,) array
    """
    numbers = np.broadcast_arrays(mass, stiffness, coupling, storage, mobility)
    parts, n = scheme.carried, len(numbers[0])
    size = 2 * parts
    m, k, b, s, q = (np.repeat(each, size) for each in numbers)
    units = np.tile(np.eye(size).reshape(parts, 2, size), n)
    old, rule = scheme.joined(tuple(units), step), scheme.regular(step)
    a, c = rule.mass_factor, rule.rate_factor
    history = scheme.rate_history(old, step)
    first = m * scheme.mass_history(old, step)[0]
    second = b * history[0] + s * history[1]
    matrix = ((a * m + k, -b), (c * b, c * s + q))
    determinant = matrix[0][0] * matrix[1][1] - matrix[0][1] * matrix[1][0]
    value = (
        np.stack([matrix[1][1] * first - matrix[0][1] * second, matrix[0][0] * second - matrix[1][0] * first])
        / determinant
    )
    new = np.stack(scheme.parts(scheme.advance(old, value, step)))
    steps = new.reshape(size, n, size).transpose(1, 0, 2)
    return np.asarray(np.abs(np.linalg.eigvals(steps)).max(axis=1))
