"""The model of the brain: boundary conditions, loads, parameters, and motions on a small head."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from dacore.core.mesh import Mesh
from dacore.core.timegrid import TimeGrid
from dacore.domains.box import Box
from dacore.dynamics.march import MarchedModel
from dacore.dynamics.newmark import Newmark
from dacore.dynamics.system import StepSystem
from dacore.errors import MeshError, ShapeError
from dacore_biot.model import Biot

GRID = TimeGrid(0.02 / 40, 12)


def middle(model):
    return {p.name: 0.5 * (p.low + p.high) for p in model.parameters.parameters}


def test_defaults_are_the_table_of_the_paper():
    space = Biot().parameters
    assert [p.name for p in space.free] == ["kappa", "E", "nu", "p_ventricles"]
    assert [(p.low, p.high) for p in space.free] == [(1e-9, 1e-8), (1e5, 1e6), (0.40, 0.45), (1.0e4, 1.1e4)]
    fixed = {p.name: p.low for p in space.parameters if p.fixed}
    assert fixed == {
        "p_csf": 1e4, "xi": -500.0, "density": 1.0, "alpha": 1.0, "skempton": 0.99, "viscosity": 1e-2,
        "neck_displacement": 0.0,
    }  # fmt: skip
    assert Biot().frequency == 50.0


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("dim", [2, 3])
def test_what_is_held_and_where(head, on, dim, order):
    mesh = head(dim)
    model = Biot(displacement_order=order).build(on(mesh))
    layout, held = model.space.layout, model.constrained
    neck, mre, inside = (mesh.boundary_nodes(role) for role in ("neck", "mre", "ventricles"))
    for axis in range(dim):
        u = held[layout.component("u", axis)]
        assert set(np.flatnonzero(u)) == set(mesh.boundary_nodes("neck", order))
        assert np.allclose(mesh.nodes(order)[u][:, -1], 0.0)
    p = held[layout.block("p")]
    assert set(np.flatnonzero(p)) == set(mre) | set(inside)
    ring = np.intersect1d(neck, mre)
    assert ring.size
    assert p[ring].all()
    assert not p[np.setdiff1d(neck, mre)].any()
    loads = {load.name: load for load in model.loads}
    assert list(loads) == ["pulse", "csf", "ventricles", "neck"]
    assert np.array_equal(np.flatnonzero(loads["csf"].prescribed[layout.block("p")]), mre)
    assert np.array_equal(np.flatnonzero(loads["ventricles"].prescribed[layout.block("p")]), inside)


def test_pressure_on_the_neck_as_in_the_published_input_files(head, on):
    mesh = head()
    model = Biot(pressure_on_neck="csf").build(on(mesh))
    csf = next(load for load in model.loads if load.name == "csf").prescribed[model.space.layout.block("p")]
    outside = np.union1d(mesh.boundary_nodes("neck"), mesh.boundary_nodes("mre"))
    assert np.array_equal(np.flatnonzero(csf), outside)


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("dim", [2, 3])
def test_pulse_is_full_at_the_back_and_gone_at_the_front(head, on, dim, order):
    """Total force ∫ s over mre, and its moment, against integrals by hand on the cube of side 5."""
    model = Biot(displacement_order=order, pulse_axis=dim - 2).build(on(head(dim)))
    layout = model.space.layout
    force = model.loads[0].force
    rows = layout.component("u", dim - 2)
    assert not np.delete(force, np.r_[rows]).any()
    # Back: s = 1. Front: s = 0. Sides and top (parallel to the axis): mean of s is 1/2.
    parallel = 1 if dim == 2 else 3
    area = 5.0 ** (dim - 1)
    assert force[rows].sum() == pytest.approx(area * (1 + 0.5 * parallel), rel=1e-12)
    across = model.space.discretization.mesh.nodes(order)[:, dim - 2]
    # ∫ s y: nothing at the back (y = 0) and front (s = 0), 5/6 on average between.
    assert force[rows] @ across == pytest.approx(area * parallel * 5 / 6, rel=1e-12)
    assert model.loads[0].profile(np.array([0.005]))[0] == pytest.approx(1.0)


def test_wrong_neck_condition_is_a_load_of_its_own(head, on):
    """Also where the default range of the parameter, zero, is changed after the model was built."""
    model = Biot().build(on(head()))
    states = MarchedModel(model, GRID).solve(middle(model) | {"neck_displacement": 1e-4}).states
    mesh, layout = model.space.discretization.mesh, model.space.layout
    for axis in range(3):
        assert np.all(states[layout.component("u", axis)][mesh.boundary_nodes("neck")] == 1e-4)


def test_a_domain_without_ventricles(on):
    model = Biot(ventricles="").build(on(Box(divisions=(3, 3, 3)).mesh()))
    assert [load.name for load in model.loads] == ["pulse", "csf", "neck"]
    assert "p_ventricles" not in model.parameters.names
    states = MarchedModel(model, GRID, start="steady").solve(middle(model) | {"xi": 0.0}).states
    np.testing.assert_allclose(states[model.space.layout.block("p")], 1e4, rtol=1e-8)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"displacement_order": 3}, "displacement_order"),
        ({"stabilization": "some"}, "'none', 'lumped' or 'projected'"),
        ({"stabilization": "projected", "displacement_order": 2}, "which needs none"),
        ({"pressure_on_neck": "both"}, "pressure_on_neck"),
        ({"frequency": 0.0}, "frequency"),
        ({"neck": "mre"}, "three different"),
        ({"ranges": {"youngs": (1, 2)}}, "youngs"),
        ({"log_uniform": ("permeability",)}, "permeability"),
        ({"ranges": {"nu": (0.4, 0.5)}}, "nu: got 0.5"),
        ({"skempton": 1.0, "ranges": {"kappa": (0.0, 1e-8)}}, "storage vanishes"),
        ({"ranges": {"E": (2.0, 1.0)}}, "low <= high"),
        ({"neck_direction": (0.0, 0.0, 0.0)}, r"neck_direction: got \[0.0, 0.0, 0.0\], expected .* not all zero"),
        ({"neck_direction": (float("nan"), 1.0)}, "neck_direction: got"),
        ({"rollers": {"neck": (0,)}}, "held already; leave it out"),
        ({"rollers": {"midplane": ()}}, r"got \[\] on midplane, expected different components"),
        ({"rollers": {"midplane": (0, 0)}}, r"got \[0, 0\] on midplane"),
        ({"rollers": {"midplane": (-1,)}}, r"got \[-1\] on midplane"),
        ({"rollers": {"mre": (0, 1)}}, "component 1 on mre is the one that the traction pulls"),
    ],
)
def test_settings_are_checked_when_made(settings, message):
    with pytest.raises(ShapeError, match=message):
        Biot(**settings)


def halves(whole):
    """A mesh with a role at x = 0, and it together with its mirror image."""
    side = (whole.points[whole.facets][:, :, 0] == 0).all(axis=1)
    tags = np.where(side, 9, whole.facet_tags)
    half = Mesh(whole.points, whole.cells, whole.facets, tags, {**whole.roles, "midplane": 9})
    n = len(half.points)
    plane = half.points[:, 0] == 0
    # Points of the plane are their own image.
    image = np.where(plane, np.arange(n), n - 1 + np.cumsum(~plane))
    points = np.concatenate([half.points, half.points[~plane] * np.where(np.arange(half.dim) == 0, -1.0, 1.0)])
    mirrored = image[half.cells]
    mirrored[:, [0, 1]] = mirrored[:, [1, 0]]
    facets, kept = half.facets[~side], half.facet_tags[~side]
    both = Mesh(
        points, np.concatenate([half.cells, mirrored]), np.concatenate([facets, image[facets]]),
        np.concatenate([kept, kept]), whole.roles,
    )  # fmt: skip
    return half, both, image


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("dim", [2, 3])
def test_half_a_body_on_rollers_moves_as_the_whole_one(head, on, dim, order):
    """The plane of symmetry: no motion across it, no flux through it, no friction along it."""
    half, both, image = halves(head(dim))
    settings = Biot(displacement_order=order, pulse_axis=1)
    whole = settings.build(on(both))
    part = replace(settings, rollers={"midplane": (0,)}).build(on(half))
    found, expected = (MarchedModel(model, GRID, tolerance=1e-12).solve(middle(part)).states for model in (part, whole))
    n = len(half.points)
    for field in ("p", *range(dim)):
        mine, all_ = (
            states[model.space.layout.block("p") if field == "p" else model.space.layout.component("u", field)]
            for states, model in ((found, part), (expected, whole))
        )
        # The vertices of half a body are numbered as in the whole one.
        scale = np.abs(all_).max()
        assert np.abs(mine[:n] - all_[:n]).max() < 1e-8 * scale
        sign = -1.0 if field == 0 else 1.0
        assert np.abs(all_[image] - sign * all_[:n]).max() < 1e-8 * scale
    nodes = half.boundary_nodes("midplane", order)
    layout = part.space.layout
    assert not found[layout.component("u", 0)][nodes].any()
    free = np.setdiff1d(nodes, half.boundary_nodes("neck", order))
    assert np.abs(found[layout.component("u", 1)][free]).min(axis=0).max() > 0.0
    assert not part.constrained[layout.component("u", 1)][free].any()


def test_where_rollers_meet_the_neck_its_displacement_holds(head, on):
    half, _, _ = halves(head())
    model = Biot(rollers={"midplane": (0,)}).build(on(half))
    states = MarchedModel(model, GRID).solve(middle(model) | {"neck_displacement": 1e-4}).states
    across = states[model.space.layout.component("u", 0)]
    assert np.all(across[half.boundary_nodes("neck")] == 1e-4)
    assert not across[np.setdiff1d(half.boundary_nodes("midplane"), half.boundary_nodes("neck"))].any()


def test_rollers_on_a_role_or_component_that_is_not_there_are_refused(head, on):
    with pytest.raises(MeshError, match="the mesh has no role midplane"):
        Biot(rollers={"midplane": (0,)}).build(on(head()))
    half, _, _ = halves(head(2))
    with pytest.raises(ShapeError, match="rollers: got component 2 on midplane, expected 0 to 1"):
        Biot(rollers={"midplane": (2,)}).build(on(half))
    with pytest.raises(MeshError, match="nothing is held on the boundary midplane"):
        Biot().build(on(half))


def test_ranges_replace_defaults():
    model = Biot(ranges={"xi": (-600.0, -400.0), "E": (3e5, 3e5)}, log_uniform=("kappa",))
    assert {p.name for p in model.parameters.free} == {"kappa", "nu", "p_ventricles", "xi"}
    assert model.parameters["kappa"].distribution == "log_uniform"


def test_meshes_that_do_not_fit_are_refused(head, on):
    mesh = head()
    with pytest.raises(MeshError, match="no role chiasm"):
        Biot(ventricles="chiasm", mre="ventricles").build(on(mesh))
    tags = mesh.facet_tags.copy()
    tags[np.flatnonzero(tags == 3)[:5]] = 4
    loose = Mesh(mesh.points, mesh.cells, mesh.facets, tags, {**mesh.roles, "scar": 4})
    with pytest.raises(MeshError, match="nothing is held on the boundary scar"):
        Biot().build(on(loose))
    with pytest.raises(ShapeError, match="pulse_axis"):
        Biot(pulse_axis=2).build(on(head(2)))
    with pytest.raises(ShapeError, match="neck_direction: got 3 numbers, expected 2"):
        Biot(neck_direction=(1.0, 0.0, 0.0)).build(on(head(2)))


@pytest.mark.parametrize("pressure", ["none", "csf"])
def test_direct_solve_equals_superposition_for_every_ventricular_pressure(head, on, pressure):
    model = MarchedModel(Biot(pressure_on_neck=pressure).build(on(head())), GRID)
    theta = middle(model)
    responses = model.responses(theta)
    for change in ({"p_ventricles": 1.1e4}, {"p_ventricles": 1.0e4, "xi": -900.0}, {"p_csf": 9e3}):
        expected = model.solve(theta | change).states
        states = responses.superpose(model.model.amplitudes(theta | change)).states
        for field in ("u", "p"):
            rows = model.space.layout.block(field)
            assert np.abs(states[rows] - expected[rows]).max() < 1e-8 * np.abs(expected[rows]).max()


def test_steady_start_is_an_equilibrium(head, on):
    model = MarchedModel(Biot().build(on(head())), GRID, start="steady")
    theta = middle(model) | {"xi": 0.0}
    states = model.solve(theta).states
    for field in ("u", "p"):
        rows = states[model.space.layout.block(field)]
        assert np.ptp(rows, axis=1).max() < 1e-7 * np.abs(rows).max()
    p = states[model.space.layout.block("p")]
    assert p.min() > 0.999e4
    assert p.max() < 1.051e4
    equal = model.solve(theta | {"p_ventricles": 1e4}).states
    np.testing.assert_allclose(equal[model.space.layout.block("p")], 1e4, rtol=1e-8)
    assert np.abs(equal[model.space.layout.block("u")]).max() < 1e-8 * np.abs(states).max()


@pytest.mark.parametrize("start", ["zero", "steady"])
def test_si_and_cgs_are_the_same_physics(head, on, start):
    """Lengths in m, pressures in Pa, permeability in m², density in kg/m³, viscosity in Pa s."""
    cgs = MarchedModel(Biot().build(on(head())), GRID, start=start)
    factors = {"kappa": 1e-4, "E": 0.1, "p_ventricles": 0.1, "p_csf": 0.1, "xi": 0.1, "density": 1e3, "viscosity": 0.1}
    ranges = {
        p.name: (p.low * factors.get(p.name, 1), p.high * factors.get(p.name, 1)) for p in cgs.parameters.parameters
    }
    si = MarchedModel(Biot(ranges=ranges).build(on(head(length=0.05))), GRID, start=start)
    one, other = cgs.solve(middle(cgs)).states, si.solve(middle(si)).states
    for field, factor in (("u", 1e-2), ("p", 0.1)):
        rows = cgs.space.layout.block(field)
        assert np.abs(one[rows] * factor - other[rows]).max() < 1e-7 * np.abs(other[rows]).max()


def test_corners_of_the_ranges_and_beyond_are_solved(head, on):
    """Residual of every step in the scaled system, recomputed here, at all corners and at extreme values."""
    model = Biot().build(on(head(cells=4 + 1)))
    system = StepSystem(model, Newmark(), GRID.step)
    free = [p for p in model.parameters.free if p.name != "p_ventricles"]
    corners = [
        dict(zip([p.name for p in free], values, strict=True)) for values in product(*[(p.low, p.high) for p in free])
    ]
    extremes = [{"nu": 0.4999}, {"kappa": 1e-14}, {"kappa": 1e-2}, {"E": 1e2}, {"E": 1e8}, {"skempton": 1.0}]
    for change in corners + extremes:
        theta = middle(model) | change
        step = system.at(theta)
        states = MarchedModel(model, replace(GRID, steps=3), tolerance=1e-10).solve(theta).states
        weights = (model.amplitudes(theta) * [load.profile(GRID.times[:1])[0] for load in model.loads])[:, None]
        right = step.loads @ weights
        scale = 1 / np.sqrt(np.abs(step.matrix.diagonal()))
        residual = scale * (step.matrix @ states[system.free, 0] - right[:, 0])
        assert np.linalg.norm(residual) < 1.1e-10 * np.linalg.norm(scale * right[:, 0]), change
