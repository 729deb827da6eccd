"""Bodies under conditions of any kind: what is held, what loads add up to, rigid plates, the brain as one of them."""

import numpy as np
import pytest

from dacore.core.model import Load, combine
from dacore.core.timegrid import TimeGrid
from dacore.domains.box import Box
from dacore.dynamics.march import MarchedModel
from dacore.dynamics.newmark import Newmark
from dacore.dynamics.profiles import Constant, Sine
from dacore.errors import CapabilityError, MeshError, ShapeError
from dacore_biot.conditions import (
    Conditions,
    body_force,
    fixed_parameters,
    normal_force,
    poroelastic,
    surface_force,
    tied,
)
from dacore_biot.model import Biot
from dacore_biot.operators import biot_fields

VALUES = {"E": 1e5, "nu": 0.2, "kappa": 1e-6, "density": 1.0, "viscosity": 1e-2, "alpha": 0.8, "skempton": 0.7}


def one(_):
    return 1.0


@pytest.fixture(params=[(2, 1), (2, 2), (3, 1)], ids=["2-D P1", "2-D P2", "3-D P1"])
def body(request, on):
    dim, order = request.param
    ends = (0.0,) * dim, (2.0, 3.0, 1.5)[:dim]
    sides = {side: (side,) for side in Box(*ends, (2,) * dim).sides}
    return on(Box(*ends, (3,) * dim, sides).mesh())(biot_fields(dim, order))


def test_components_are_held_where_said(body):
    mesh, layout = body.mesh, body.layout
    held = Conditions({"x-": (0,), "y+": (0, 1)}, ("x+",)).dofs(body)
    nodes = mesh.nodes(layout.field("u").order)
    np.testing.assert_array_equal(held[layout.component("u", 0)], (nodes[:, 0] == 0) | (nodes[:, 1] == 3))
    np.testing.assert_array_equal(held[layout.component("u", 1)], nodes[:, 1] == 3)
    np.testing.assert_array_equal(held[layout.block("p")], mesh.points[:, 0] == 2)
    assert not Conditions().dofs(body).any()


def test_forces_add_up_and_turn(body):
    """Resultant and moments of each load on a box of sides 2, 3 (and 1.5), against integrals by hand."""
    dim, layout = body.mesh.dim, body.layout
    nodes = body.mesh.nodes(layout.field("u").order)
    lengths = np.array((2.0, 3.0, 1.5)[:dim])
    area = lengths.prod() / 3.0
    pull, drag = normal_force(body, "y+"), surface_force(body, "y+", np.arange(1.0, dim + 1))
    weight = body_force(body, np.arange(1.0, dim + 1))
    uneven = surface_force(body, "y+", nodes[:, :1] * np.arange(1.0, dim + 1))
    for axis in range(dim):
        part = layout.component("u", axis)
        assert pull[part].sum() == pytest.approx(area if axis == 1 else 0.0, abs=1e-12)
        assert drag[part].sum() == pytest.approx((axis + 1) * area)
        assert drag[part] @ nodes[:, 0] == pytest.approx((axis + 1) * area * 1.0)
        assert weight[part].sum() == pytest.approx((axis + 1) * lengths.prod())
        assert weight[part] @ nodes[:, 1] == pytest.approx((axis + 1) * lengths.prod() * 1.5)
        # ∫ x · x over the side: the mean of x² is 4/3.
        assert uneven[part] @ nodes[:, 0] == pytest.approx((axis + 1) * area * 4 / 3)
    for force in (pull, drag, weight, uneven):
        assert not force[layout.block("p")].any()


def test_tractions_are_total(body):
    """A uniform pressure in a body pushes outwards on every wall: with its own reaction it is in balance."""
    model = poroelastic(body, fixed_parameters(VALUES), Conditions(), ())
    layout = body.layout
    uniform = np.zeros(layout.n_dofs)
    uniform[layout.block("p")] = 2.0
    stiffness = combine(model.zeroth_order, VALUES, layout.n_dofs)
    walls = sum(normal_force(body, role) for role in body.mesh.roles)
    np.testing.assert_allclose(stiffness @ uniform, -2.0 * VALUES["alpha"] * walls, atol=1e-12)


def test_the_brain_is_one_of_these_bodies(head, on):
    """Effective tractions are, as total ones, less by what the given pressures press on the walls."""
    biot = Biot(pressure_on_neck="csf").build(on(head()))
    body = biot.space.discretization
    theta = biot.parameters.middle
    grid = TimeGrid(5e-4, 6)
    expected = MarchedModel(biot, grid, tolerance=1e-12).solve(theta).states
    loads = {load.name: load for load in biot.loads}
    alpha, none = theta["alpha"], np.zeros(body.layout.n_dofs)
    conditions = Conditions({"neck": (0, 1, 2)}, ("mre", "neck", "ventricles"))
    again = (
        Load("pulse", one, Sine(50.0), theta["xi"] * loads["pulse"].force, none),
        Load(
            "csf", one, Constant(), -alpha * theta["p_csf"] * _pressed(body, loads["csf"]),
            theta["p_csf"] * loads["csf"].prescribed,
        ),
        Load(
            "ventricles", one, Constant(), -alpha * theta["p_ventricles"] * _pressed(body, loads["ventricles"]),
            theta["p_ventricles"] * loads["ventricles"].prescribed,
        ),
    )  # fmt: skip
    model = poroelastic(body, biot.parameters, conditions, again)
    np.testing.assert_array_equal(model.constrained, biot.constrained)
    states = MarchedModel(model, grid, tolerance=1e-12).solve(theta).states
    for field in ("u", "p"):
        rows = body.layout.block(field)
        assert np.abs(states[rows] - expected[rows]).max() < 1e-8 * np.abs(expected[rows]).max()


def _pressed(body, load):
    """∫ p v·n over all walls for the pressure 1 that a load prescribes."""
    pressure = load.prescribed[body.layout.block("p")]
    force = np.zeros(body.layout.n_dofs)
    force[body.layout.block("u")] = sum(body.boundary_coupling("p", "u", role) @ pressure for role in body.mesh.roles)
    return force


def test_tied_dofs_move_as_one_and_share_their_forces(body):
    """A plate on springs of tissue: the same motion as by a very stiff coupling of its nodes."""
    mesh, layout = body.mesh, body.layout
    bottom = {"y-": tuple(range(mesh.dim))}
    top = layout.component("u", 1).start + mesh.boundary_nodes("y+", layout.field("u").order)
    # A load on one node alone must move them all.
    force = np.zeros(layout.n_dofs)
    force[top[0]] = -50.0
    load = Load("push", one, Constant(), force, np.zeros(layout.n_dofs))
    model = poroelastic(body, fixed_parameters(VALUES), Conditions(bottom), (load,))
    rigid = tied(model, top)
    states = rigid.lift @ MarchedModel(rigid.model, TimeGrid(1e-3, 20), Newmark()).solve(VALUES).states
    assert (np.ptp(states[top], axis=0) == 0).all()
    assert states[top[0], -1] < 0
    # The plate's balance: the rows of its nodes add up to zero, each alone does not.
    matrices = [combine(terms, VALUES, layout.n_dofs) for terms in (model.first_order, model.zeroth_order)]
    inertia = combine(model.second_order, VALUES, layout.n_dofs)
    before = np.concatenate([np.zeros((layout.n_dofs, 2)), states], axis=1)
    rates = np.zeros_like(before)
    bends = np.zeros_like(before)
    for k in range(2, before.shape[1]):
        bends[:, k] = (before[:, k] - before[:, k - 1] - 1e-3 * rates[:, k - 1]) / (0.5 * 1e-6)
        rates[:, k] = rates[:, k - 1] + 1e-3 * bends[:, k]
    euler = np.diff(before, axis=1)[:, -1] / 1e-3
    residual = force - inertia @ bends[:, -1] - matrices[0] @ euler - matrices[1] @ before[:, -1]
    assert abs(residual[top].sum()) < 1e-7 * 50.0
    assert np.abs(residual[top]).max() > 1.0


def test_wrong_conditions_are_refused(body):
    mesh, model = body.mesh, poroelastic(body, fixed_parameters(VALUES), Conditions({"x-": (0,)}), ())
    with pytest.raises(ShapeError, match="held on x-: got component 3"):
        Conditions({"x-": (3,)}).dofs(body)
    with pytest.raises(MeshError, match="lid"):
        Conditions(drained=("lid",)).dofs(body)
    with pytest.raises(ShapeError, match="kappa missing"):
        fixed_parameters({name: value for name, value in VALUES.items() if name != "kappa"})
    with pytest.raises(ShapeError, match="nu"):
        fixed_parameters(VALUES | {"nu": 0.5})
    with pytest.raises(ShapeError, match="force"):
        surface_force(body, "x+", np.ones((5, mesh.dim)))
    with pytest.raises((ShapeError, CapabilityError), match="force"):
        body_force(body, np.ones(mesh.dim + 1))
    for dofs in (
        [],
        np.flatnonzero(model.constrained)[:1],
        [int(np.flatnonzero(~model.constrained)[0]), -1 % body.layout.n_dofs],
    ):
        with pytest.raises(ShapeError, match="tied dofs"):
            tied(model, np.array(dofs, dtype=int))
