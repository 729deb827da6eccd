"""A small state space without meshes or PDEs, for tests of estimation."""

import numpy as np
from scipy.sparse import csr_array, diags_array

from dacore.algebra.compress import compress
from dacore.core.background import Background
from dacore.core.fields import Field, Layout
from dacore.core.model import Trajectory
from dacore.core.observation import Functionals
from dacore.core.parameters import Parameter, ParameterSpace
from dacore.core.space import StateSpace


class Chain(StateSpace):
    """A vector and a scalar field on the nodes of a chain, with a consistent mass matrix."""

    def __init__(self, nodes: int, components: int = 2) -> None:
        self._layout = Layout(
            [Field("u", components, unit="cm"), Field("p", 1, unit="dyn/cm^2")], {"u": nodes, "p": nodes}
        )

    @property
    def layout(self) -> Layout:
        return self._layout

    def scalar_product(self, field, kind="l2"):
        n = self.layout.nodes[field]
        mass = diags_array([np.full(n - 1, 1 / 6), np.full(n, 2 / 3), np.full(n - 1, 1 / 6)], offsets=[-1, 0, 1])
        if kind == "h1":
            mass = mass + diags_array([-np.ones(n - 1), np.full(n, 2.0), -np.ones(n - 1)], offsets=[-1, 0, 1])
        return csr_array(mass)


def functionals_of(matrix) -> Functionals:
    """Wrap a matrix as functionals without geometry."""
    m = matrix.shape[0]
    return Functionals(
        csr_array(matrix), tuple(f"l{i}" for i in range(m)), "cm", np.zeros((m, 1)), np.zeros((m, 1)), np.arange(m)
    )


def random_background(rng, space, samples=12, steps=5, decay=0.6, tolerance=1e-12) -> Background:
    """A training set of smooth random trajectories with a mean, coupled between the fields."""
    rank = 9
    modes = rng.standard_normal((space.n_dofs, rank)) * decay ** np.arange(rank)
    mean = rng.standard_normal((space.n_dofs, steps))
    weights = rng.standard_normal((rank, steps, samples))
    times = np.arange(1.0, steps + 1)
    trajectories = [Trajectory(mean + modes @ weights[:, :, k], times) for k in range(samples)]
    parameters = ParameterSpace((Parameter("a", "1", 0.0, 1.0),))
    return compress(space, trajectories, parameters, rng.random((samples, 1)), tolerance)


def random_functionals(rng, space, m=11) -> Functionals:
    """Functionals of u alone."""
    matrix = np.zeros((m, space.n_dofs))
    block = space.layout.block("u")
    matrix[:, block] = rng.standard_normal((m, block.stop - block.start))
    return functionals_of(matrix)
