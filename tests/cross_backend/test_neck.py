"""A neck that is not where the model believes: the same motion from every library, and from dense matrices by hand."""

import numpy as np
import pytest

from dacore.core.mesh import Mesh
from dacore.core.model import combine
from dacore.core.timegrid import TimeGrid
from dacore.dynamics.march import MarchedModel
from dacore_biot.model import Biot
from tests.backends import READY, backend
from tests.meshes import shuffled_box

GRID = TimeGrid(5e-4, 8)
SHIFT = 1e-3


def model(name, dim, order=1, **settings):
    unit = shuffled_box(dim, n=5 if dim == 2 else 3, seed=3, bumpy=True)
    mesh = Mesh(8.0 * unit.points, unit.cells, unit.facets, unit.facet_tags, unit.roles)
    physics = Biot(displacement_order=order, neck="left", ventricles="right", mre="side", **settings)
    return physics.build(lambda fields: backend(name).discretize(mesh, fields))


def dense_march(of, theta, grid):
    """Newmark with β = 1/2, γ = 1 and backward Euler from rest, written down once more for full matrices."""
    n, tau = of.space.n_dofs, grid.step
    mass, damping, stiffness = (
        combine(terms, theta, n).toarray() for terms in (of.second_order, of.first_order, of.zeroth_order)
    )
    held, free = of.constrained, ~of.constrained
    step = 2 / tau**2 * mass + damping / tau + stiffness
    y, v, out = np.zeros(n), np.zeros(n), []
    for time in tau * np.arange(1, grid.steps + 1):
        factors = of.amplitudes(theta) * [load.profile(np.array([time]))[0] for load in of.loads]
        force = sum(factor * load.force for factor, load in zip(factors, of.loads))
        new = np.zeros(n)
        new[held] = sum(factor * load.prescribed[held] for factor, load in zip(factors, of.loads))
        right = force + 2 / tau**2 * mass @ (y + tau * v) + damping @ y / tau - step[:, held] @ new[held]
        new[free] = np.linalg.solve(step[np.ix_(free, free)], right[free])
        # a = 2 (y1 − y0 − τ v0)/τ² and v1 = v0 + τ a, since 1 − 2β = 0 and γ = 1.
        y, v = new, v + 2 * (new - y - tau * v) / tau
        out.append(y)
    return np.stack(out, axis=1)


def gap(of, one, other):
    """Largest difference of each field relative to its largest value."""
    blocks = [of.space.layout.block(field) for field in ("u", "p")]
    return max(np.abs(one[rows] - other[rows]).max() / np.abs(other[rows]).max() for rows in blocks)


@pytest.mark.parametrize("direction", [(), (1.0, 0.0, -0.5)])
@pytest.mark.parametrize(("dim", "order"), [(2, 1), (2, 2), (3, 1), (3, 2)])
@pytest.mark.parametrize("name", READY)
def test_states_are_those_of_dense_matrices_and_base_plus_response(name, dim, order, direction):
    right = model(name, dim, order, neck_direction=direction[:dim])
    wrong = model(name, dim, order, neck_direction=direction[:dim], neck_displacement=SHIFT)
    marched, theta = MarchedModel(wrong, GRID, tolerance=1e-12), wrong.parameters.middle
    assert theta == right.parameters.middle | {"neck_displacement": SHIFT}
    states = marched.solve(theta).states
    mesh, layout = wrong.space.discretization.mesh, wrong.space.layout
    for axis in range(dim):
        held = states[layout.component("u", axis)][mesh.boundary_nodes("left", order)]
        assert np.all(held == SHIFT * (direction[axis] if direction else 1.0))
    assert gap(wrong, states, dense_march(wrong, theta, GRID)) < 1e-8
    base = MarchedModel(right, GRID, tolerance=1e-12).solve(right.parameters.middle).states
    response = marched.responses(theta).states[[load.name for load in wrong.loads].index("neck")]
    assert gap(wrong, base + SHIFT * response, states) < 1e-8
    assert gap(wrong, base, states) > 1e-3


@pytest.mark.parametrize("name", READY)
def test_from_a_steady_start_the_whole_body_is_shifted(name):
    """Nothing but the neck holds it, so that the static answer is a translation and no pressure."""
    states = []
    for shift in (0.0, SHIFT):
        one = model(name, 3, neck_displacement=shift, neck_direction=(1.0, -2.0, 0.5))
        states.append(MarchedModel(one, GRID, start="steady", tolerance=1e-12).solve(one.parameters.middle).states)
    moved, layout = states[1] - states[0], one.space.layout
    for axis, factor in enumerate((1.0, -2.0, 0.5)):
        np.testing.assert_allclose(moved[layout.component("u", axis)], SHIFT * factor, rtol=1e-7)
    assert np.abs(moved[layout.block("p")]).max() < 1e-8 * np.abs(states[0][layout.block("p")]).max()
