"""Pressures that oscillate on equal-order elements, and what each remedy is worth."""

import logging
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import eigh

import dacore
from dacore.core.timegrid import TimeGrid
from dacore.domains.ball import Ball
from dacore.dynamics.march import MarchedModel
from dacore_biot import material
from dacore_biot.cautions import Oscillation, cell_sizes
from dacore_biot.model import Biot
from dacore_biot.operators import biot_fields, biot_terms
from tests.backends import READY, backend
from tests.hazards.column import SUDDEN, Column, at, difference
from tests.hazards.manufactured import TISSUE, one_step, square

PLAIN, LUMPED, PROJECTED, QUADRATIC = (
    {}, {"stabilization": "lumped"}, {"stabilization": "projected"}, {"order": 2},
)  # fmt: skip
REMEDIES = [LUMPED, PROJECTED, QUADRATIC]


def inf_sup(cells, order=1, stabilization="none"):
    """Least eigenvalue of α² B A⁻¹ Bᵀ + stabilization against α²/(λ + 2μ_s) times the mass, constants left out.

    u is held on the whole rim and p nowhere, so that constant pressures do no work.
    """
    discretization = backend("skfem").discretize(square(cells, wild=True), biot_fields(2, order))
    layout, mesh = discretization.layout, discretization.mesh
    terms = biot_terms(discretization, stabilization)

    def dense(group, names):
        return sum(term.coefficient(TISSUE) * term.matrix.toarray() for term in group if term.name in names)

    u, p = layout.block("u"), layout.block("p")
    rim = mesh.boundary_nodes("rim", order)
    moving = np.setdiff1d(np.arange(u.stop), np.concatenate([layout.component("u", a).start + rim for a in range(2)]))
    elastic = dense(terms.zeroth_order, ("shear", "dilation"))[np.ix_(moving, moving)]
    swelling = dense(terms.first_order, ("swelling",))[p, moving]
    held = np.atleast_2d(dense(terms.first_order, ("stabilization",)) + np.zeros((layout.n_dofs,) * 2))
    answer = swelling @ np.linalg.solve(elastic, swelling.T) + held[p, p]
    mass = material.confined_swelling(TISSUE) * discretization.scalar_mass("p").toarray()
    return eigh(answer, mass, eigvals_only=True)[1]


def test_no_pressure_goes_unseen_with_a_remedy():
    assert inf_sup(8) < 1e-3 * min(inf_sup(8, **remedy) for remedy in REMEDIES)
    for remedy in REMEDIES:
        coarse, fine = inf_sup(6, **remedy), inf_sup(12, **remedy)
        assert fine > 0.15, f"{remedy}: {fine}"
        assert fine > 0.7 * coarse, f"{remedy}: {coarse} falls to {fine} as the mesh is refined"


@pytest.mark.parametrize("name", READY)
def test_overshoot_after_a_sudden_load(name):
    """The exact pressure lies between 0 and 1."""
    excess = {}
    for key, settings in {"plain": PLAIN, "lumped": LUMPED, "projected": PROJECTED, "P2": QUADRATIC}.items():
        pressure = Column(8, inertia=False, name=name, **settings).solve("load", SUDDEN)[1]
        excess[key] = max(pressure.max() - 1, -pressure.min())
    assert excess["plain"] > 1.0
    assert excess["lumped"] < 0.02
    assert excess["projected"] < 0.6
    assert excess["P2"] < 0.6


@pytest.mark.parametrize("remedy", REMEDIES)
def test_errors_fall_where_those_of_plain_elements_do_not(remedy):
    plain = [one_step(cells, wild=True, kappa=1e-14, nu=0.3) for cells in (8, 16, 32)]
    assert min(one.overshoot for one in plain) > 1
    assert plain[-1].pressure > 0.5
    cured = [one_step(cells, wild=True, kappa=1e-14, nu=0.3, **remedy) for cells in (8, 16, 32)]
    assert max(one.overshoot for one in cured) < 0.2
    assert np.log2(cured[-2].pressure / cured[-1].pressure) > 1.0, [one.pressure for one in cured]
    assert np.log2(cured[-2].displacement / cured[-1].displacement) > 1.8


@pytest.mark.parametrize("remedy", [LUMPED, PROJECTED])
def test_order_of_convergence_is_kept_where_no_remedy_is_needed(remedy):
    errors = [one_step(cells, wild=True, kappa=1e-5, nu=0.3, **remedy) for cells in (16, 32)]
    plain = one_step(32, wild=True, kappa=1e-5, nu=0.3)
    for quantity in ("displacement", "pressure"):
        coarse, fine = (getattr(one, quantity) for one in errors)
        assert np.log2(coarse / fine) > 1.8
        assert fine < 1.5 * getattr(plain, quantity)


def test_waves_pass_the_projected_remedy_and_not_the_lumped_one():
    """p − p(top) behind a jump of the pressure: a wave of compression, which needs the small storage of the tissue."""
    exact = Column(1000, width=1).solve("pressure", SUDDEN)

    def error(**settings):
        column = Column(16, **settings).solve("pressure", SUDDEN)
        pressure = at(column[0], exact)[0]
        return difference(column[1], pressure, pressure - 1)

    assert error() < 0.04
    assert error(**PROJECTED) < 0.04
    assert error(**QUADRATIC) < 0.04
    assert error(**LUMPED) > 0.12


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("dim", [2, 3])
def test_projection_sees_no_linear_pressure_and_none_exceeds_lumping(dim, order):
    from dacore.testing.meshes import shuffled_box
    from dacore_biot.stabilization import cell_mean_mass, less_than_lumped, projected_gradients

    mesh = shuffled_box(dim)
    mass = backend("skfem").discretize(mesh, biot_fields(dim, order)).scalar_mass("p")
    projected, lumped = projected_gradients(mesh), less_than_lumped(mass, cell_mean_mass(mesh))
    linear = np.column_stack([np.ones(len(mesh.points)), mesh.points])
    size = np.abs(projected).max()
    assert np.abs(projected @ linear).max() < 1e-12 * size
    assert np.abs(lumped @ linear[:, 0]).max() < 1e-12 * size
    values = np.linalg.eigvalsh(projected.toarray())
    assert values[0] > -1e-12 * size
    assert values[dim + 1] > 1e-4 * size, "more than the linear pressures go unseen"
    assert np.linalg.eigvalsh((lumped - projected).toarray())[0] > -1e-12 * size


def test_criterion_is_the_onset_of_oscillation():
    """Cells that are regular but for one axis of symmetry; quasi-static, so that the exact pressure has bounds."""
    column = Column(32, inertia=False)
    criterion = Oscillation(2, float(np.median(cell_sizes(column.mesh()))))
    unit = criterion.ratio(TISSUE, SUDDEN.step)

    def undershoot(ratio):
        pressure = column.solve("load", SUDDEN, kappa=TISSUE["kappa"] * ratio / unit)[1]
        return max(0.0, float((pressure - 1).max()))

    assert undershoot(2.0) < 1e-3
    assert undershoot(0.1) > 0.2


@pytest.mark.parametrize(
    ("settings", "heard"),
    [
        ({}, True),
        ({"stabilization": "lumped"}, False),
        ({"stabilization": "projected"}, False),
        ({"displacement_order": 2}, False),
        ({"ranges": {"kappa": (1e-4, 1e-3)}}, False),
    ],
)
def test_a_scene_that_may_oscillate_says_so(settings, heard):
    mesh = Ball(edge=2.0).mesh()
    model = Biot(**settings).build(lambda fields: backend("skfem").discretize(mesh, fields))
    said = MarchedModel(model, SUDDEN).cautions(model.parameters)
    assert any("oscillate" in line for line in said) == heard
    # Longer steps let more fluid seep.
    long = MarchedModel(model, replace(SUDDEN, step=50.0)).cautions(model.parameters)
    assert not any("oscillate" in line for line in long)


def test_the_warning_reaches_log_and_session(tmp_path, caplog):
    with caplog.at_level(logging.WARNING, "dacore"):
        said = dacore.open_scene("examples/toy/ball.toml", cache=tmp_path).cautions
    assert len(said) == 1
    assert "physics.stabilization" in said[0]
    assert sum("oscillate" in record.getMessage() for record in caplog.records) == 1


def test_remedies_on_a_ball_with_a_cavity():
    """The scene of examples/toy/ball.toml at soft tissue: pressures of 1.0e4 and 1.05e4 are given, the rest follows."""
    mesh = Ball(edge=1.6).mesh()
    spread = {}
    for key, settings in {
        "plain": {}, "projected": {"stabilization": "projected"}, "lumped": {"stabilization": "lumped"},
    }.items():  # fmt: skip
        model = Biot(**settings).build(lambda fields: backend("skfem").discretize(mesh, fields))
        theta = {p.name: 0.5 * (p.low + p.high) for p in model.parameters.parameters} | {"E": 1e5, "nu": 0.4}
        states = MarchedModel(model, TimeGrid(5e-4, 20)).solve(theta).states[model.space.layout.block("p")]
        spread[key] = (states - 1e4)[:, 10:].std()
    assert spread["plain"] > 1.6 * spread["projected"], spread
    assert spread["plain"] > 1.6 * spread["lumped"], spread
