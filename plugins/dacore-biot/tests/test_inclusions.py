"""Stiffness that differs from place to place: against uniform tissue, a layered column by formula, and the settings."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from dacore.core.model import Load, combine
from dacore.core.timegrid import TimeGrid
from dacore.domains.box import Box
from dacore.dynamics.march import MarchedModel
from dacore.dynamics.profiles import Constant
from dacore.errors import SceneError, ShapeError
from dacore.geometry.balls import cell_factors
from dacore.plugins.settings import build
from dacore.testing import model_suite
from dacore_biot import material
from dacore_biot.conditions import Conditions, fixed_parameters, normal_force, poroelastic
from dacore_biot.inclusions import Inclusion
from dacore_biot.model import Biot
from dacore_biot.operators import biot_fields
from dacore_skfem.backend import SkfemBackend

GRID = TimeGrid(5e-4, 8)
BALL = Inclusion((1.0, 2.5, 2.5), 1.2, 4.0)

test_keeps_the_promises_of_a_model = model_suite(
    Biot(inclusions=(Inclusion((0.75, 0.75, 0.75), 0.5, 3.0),), neck="z-", ventricles="", mre="z+"),
    Box(divisions=(2, 2, 2), roles={"z-": ("z-",), "z+": ("z+", "x-", "x+", "y-", "y+")}).mesh,
    GRID,
    affine_in=("xi", "p_csf", "neck_displacement"),
).as_test()


@pytest.mark.parametrize(
    ("order", "stabilization"), [(1, "none"), (1, "lumped"), (1, "projected"), (2, "none"), (2, "lumped")]
)
@pytest.mark.parametrize("dim", [2, 3])
def test_an_inclusion_that_is_everywhere_is_another_modulus(head, on, dim, order, stabilization):
    """Also in the storage and the stabilization, which have E in their denominators."""
    settings = Biot(displacement_order=order, stabilization=stabilization, skempton=0.9)
    everywhere = Inclusion((2.5,) * dim, 9.0, 3.0)
    mesh = head(dim)
    plain, full = (each.build(on(mesh)) for each in (settings, replace(settings, inclusions=(everywhere,))))
    theta = plain.parameters.middle
    n = plain.space.n_dofs
    for group in ("second_order", "first_order", "zeroth_order"):
        mine, other = getattr(full, group), getattr(plain, group)
        assert [term.name for term in mine] == [term.name for term in other]
        wanted = combine(other, theta | {"E": 3.0 * theta["E"]}, n)
        assert abs(combine(mine, theta, n) - wanted).max() < 1e-13 * abs(wanted).max()
        # Each term alone: one that dominates hides the others.
        for one, two in zip(mine, other, strict=True):
            factor = two.coefficient(theta | {"E": 3.0 * theta["E"]}) / one.coefficient(theta)
            assert abs(one.matrix - factor * two.matrix).max() < 1e-12 * abs(one.matrix).max(), one.name


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("dim", [2, 3])
def test_a_column_of_two_layers_is_compressed_as_springs_in_series(dim, order):
    """Drained, confined, pulled at its top: u = t z/M below and t (h/M + (z − h)/(s M)) above the joint at h."""
    height, joint, factor, pull = 3.0, 1.0, 5.0, 70.0
    sides = [f"{axis}{end}" for axis in "xyz"[: dim - 1] for end in "-+"]
    roles = {side: (side,) for side in sides} | {"bottom": ("yz"[dim - 2] + "-",), "top": ("yz"[dim - 2] + "+",)}
    mesh = Box((0.0,) * dim, (1.0,) * (dim - 1) + (height,), (2,) * (dim - 1) + (6,), roles).mesh()
    disc = SkfemBackend().discretize(mesh, biot_fields(dim, order))
    values = {"E": 1e4, "nu": 0.3, "kappa": 1e-8, "density": 1.0, "viscosity": 0.01, "alpha": 1.0, "skempton": 0.9}
    held = {side: ("xyz".index(side[0]),) for side in sides} | {"bottom": (dim - 1,)}
    layout = disc.layout
    load = Load("pull", lambda theta: pull, Constant(), normal_force(disc, "top"), np.zeros(layout.n_dofs))
    above = mesh.points[mesh.cells].mean(axis=1)[:, -1] > joint
    model = poroelastic(
        disc, fixed_parameters(values), Conditions(held, tuple(mesh.roles)), [load],
        stiffness=np.where(above, factor, 1.0),
    )  # fmt: skip
    states = MarchedModel(model, TimeGrid(1e-3, 1), start="steady", tolerance=1e-12).solve(values).states[:, -1]
    confined = material.lame(values) + material.twice_shear(values)
    z = mesh.nodes(order)[:, -1]
    wanted = pull / confined * (np.minimum(z, joint) + np.maximum(z - joint, 0.0) / factor)
    np.testing.assert_allclose(states[layout.component("u", dim - 1)], wanted, atol=1e-9 * wanted.max())


def test_a_ball_holds_the_cells_whose_centroids_it_holds_and_the_last_one_counts(head):
    mesh = head()
    first, second = BALL, Inclusion((2.0, 2.5, 2.5), 1.0, 0.5)
    factors = cell_factors(mesh, (first, second), "stiffness")
    centroids = mesh.points[mesh.cells].mean(axis=1)
    in_first, in_second = (np.linalg.norm(centroids - b.centre, axis=1) <= b.radius for b in (first, second))
    assert (in_first & in_second).any()
    np.testing.assert_array_equal(factors, np.where(in_second, 0.5, np.where(in_first, 4.0, 1.0)))
    assert cell_factors(mesh, (), "stiffness") is None


def test_a_stiff_ball_gives_way_less_and_a_soft_one_more(head, on):
    """Work of the static load on what it moves, which falls wherever stiffness grows."""
    work = []
    for stiffness in (0.25, 1.0, 4.0):
        model = Biot(inclusions=(replace(BALL, stiffness=stiffness),), ventricles="ventricles").build(on(head()))
        theta = model.parameters.middle | {"p_csf": 0.0, "p_ventricles": 0.0, "xi": 1.0}
        free = ~model.constrained & ~model.antisymmetric
        stiff = combine(model.zeroth_order, theta, model.space.n_dofs)[free][:, free].toarray()
        force = model.loads[0].force[free]
        work.append(force @ np.linalg.solve(stiff, force))
    assert work[0] > 1.01 * work[1]
    assert work[1] > 1.001 * work[2]


def test_trajectories_are_those_of_dense_matrices(head, on):
    """A step of Newmark with β = 1/2, γ = 1 and backward Euler from rest, solved in full."""
    model = Biot(inclusions=(replace(BALL, centre=(1.0, 2.5)),)).build(on(head(2)))
    theta, n = model.parameters.middle, model.space.n_dofs
    states = MarchedModel(model, TimeGrid(5e-4, 1), tolerance=1e-12).solve(theta).states[:, 0]
    groups = (model.second_order, model.first_order, model.zeroth_order)
    mass, damping, stiff = (combine(terms, theta, n).toarray() for terms in groups)
    step = 2 / 5e-4**2 * mass + damping / 5e-4 + stiff
    factors = model.amplitudes(theta) * [load.profile(np.array([5e-4]))[0] for load in model.loads]
    wanted = sum(f * load.prescribed for f, load in zip(factors, model.loads))
    force = sum(f * load.force for f, load in zip(factors, model.loads)) - step @ wanted
    free = ~model.constrained
    wanted[free] = np.linalg.solve(step[np.ix_(free, free)], force[free])
    for field in ("u", "p"):
        rows = model.space.layout.block(field)
        assert np.abs(states[rows] - wanted[rows]).max() < 1e-8 * np.abs(wanted[rows]).max()


def test_a_soft_ball_is_where_pressures_oscillate_first(head, on):
    plain, soft = (
        Biot(inclusions=balls).build(on(head())).cautions[0] for balls in ((), (replace(BALL, stiffness=0.1),))
    )
    assert (plain.stiffness, soft.stiffness) == ((1.0, 1.0), (0.1, 1.0))
    space = Biot(ranges={"kappa": (1e-7, 1e-7), "E": (1e5, 1e5), "nu": (0.4, 0.4)}).parameters
    lag = 2.0 / plain.ratio(space.middle, 1.0)  # twice what is needed
    assert plain(space, lag) == ""
    assert "what seeps in a step is 0.2 to 2" in soft(space, lag)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"radius": 0.0}, "got radius 0.0, expected a positive number"),
        ({"stiffness": -1.0}, "got stiffness -1.0, expected a positive number"),
        ({"stiffness": float("inf")}, "got stiffness inf"),
        ({"centre": (0.0, float("nan"), 0.0)}, "expected finite coordinates"),
    ],
)
def test_what_is_no_ball_is_refused(change, message):
    with pytest.raises(ShapeError, match=message):
        replace(BALL, **change)


def test_balls_that_do_not_fit_the_mesh_are_refused(head, on):
    with pytest.raises(ShapeError, match="inclusion 0: got a centre of 3 coordinates, expected 2"):
        Biot(inclusions=(BALL,)).build(on(head(2)))
    lost = replace(BALL, centre=(9.0, 2.5, 2.5))
    with pytest.raises(ShapeError, match=r"inclusion 1: no cell's centroid lies within 1.2 cm of \[9.0, .*; move it"):
        Biot(inclusions=(BALL, lost)).build(on(head()))


def test_factors_that_are_not_positive_are_refused(head):
    disc = SkfemBackend().discretize(head(2), biot_fields(2))
    values = {"E": 1e4, "nu": 0.3, "kappa": 1e-8, "density": 1.0, "viscosity": 0.01, "alpha": 1.0, "skempton": 0.9}
    make = partial(poroelastic, disc, fixed_parameters(values), Conditions({"neck": (0, 1)}), [])
    with pytest.raises(ShapeError, match="stiffness: got 0 on a cell, expected positive factors of E"):
        make(stiffness=np.zeros(len(disc.mesh.cells)))


def test_a_scene_gives_a_list_of_tables():
    table = {"inclusions": [{"centre": [1, 2.5, 2.5], "radius": 1.2, "stiffness": 4}]}
    assert build(Biot, table, "scene: physics").inclusions == (BALL,)
    with pytest.raises(SceneError, match=r"physics.inclusions\[0\].radius: missing; expected a number"):
        build(Biot, {"inclusions": [{"centre": [0, 0, 0], "stiffness": 2}]}, "scene: physics")
