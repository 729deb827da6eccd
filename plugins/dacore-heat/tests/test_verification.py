"""Temperatures against formulas, on every library installed: series, steady states, rates in the mesh and the step."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from dacore.core.model import Load
from dacore.core.timegrid import TimeGrid
from dacore.domains.box import Box
from dacore.dynamics.generalized_alpha import GeneralizedAlpha
from dacore.dynamics.march import MarchedModel
from dacore.dynamics.newmark import Newmark
from dacore.dynamics.profiles import Course
from dacore_heat.analytic import biot_roots, cooling_slab, perfused_slab
from dacore_heat.model import Heat
from dacore_heat.parts import Exchange, Inclusion, Source

TISSUE = {"conductivity": (5e4, 5e4), "perfusion": (0.0, 0.0), "capacity": (4e7, 4e7)}
LENGTH, TRANSFER = 2.0, 5e4
BIOT = TRANSFER * LENGTH / 5e4


def solved(model, grid, scheme=None, start="zero"):
    return MarchedModel(model, grid, scheme, start, tolerance=1e-12).solve(model.parameters.middle).states


def along(model):
    disc = model.space.discretization
    return disc.mesh.nodes(disc.fields[0].order)[:, 0]


def l2(model, error):
    """Root mean square over the body: it may be a strip as thin as its cells."""
    product = model.space.field_product("T")
    return float(np.sqrt(error @ (product @ error) / product.sum()))


def test_roots_of_the_series():
    roots = biot_roots(2.0, 50)
    assert np.abs(roots * np.tan(roots) - 2.0).max() < 1e-8
    assert roots[0] == pytest.approx(1.0768739863, abs=1e-9)
    x = np.linspace(0.0, LENGTH, 9)
    assert np.abs(cooling_slab(x, np.array([0.5]), LENGTH, 1.25e-3, 2.0)[:-1] - 1).max() < 1e-6  # it was 1 everywhere


@pytest.mark.parametrize(("dim", "order"), [(2, 1), (2, 2), (3, 1)])
def test_a_slab_cools_as_the_series_says(slab, on, dim, order):
    """From an initial temperature, into surroundings of another one, by convection."""
    mesh = slab(dim, 16)
    physics = Heat(order, convection={"skin": Exchange(TRANSFER, 5.0)}, initial=25.0, ranges=TISSUE)
    model = physics.build(on(mesh))
    grid = TimeGrid(50.0, 40)
    states = solved(model, replace(grid, substeps=8), GeneralizedAlpha(0.5))
    wanted = 5.0 + 20.0 * cooling_slab(along(model), grid.times, LENGTH, 5e4 / 4e7, BIOT)
    error = np.abs(states - wanted)
    # From a sixteenth of L²/a on, of 20 K. Measured: 0.013 K (triangles), 0.021 K (tetrahedra), 0.0009 K for order 2.
    assert error[:, 3:].max() < (0.025 if order == 1 else 0.0015)


@pytest.mark.parametrize("scheme", [Newmark(), GeneralizedAlpha(0.5)], ids=lambda scheme: scheme.label)
def test_rates_in_the_step_from_an_initial_temperature(slab, on, scheme):
    """Backward Euler is of first order; generalised α of second, though the rates at t = 0 are not known."""
    model = Heat(1, convection={"skin": Exchange(TRANSFER, 0.0)}, initial=1.0, ranges=TISSUE).build(on(slab(2, 24)))
    grid = TimeGrid(200.0, 5)
    fine = solved(model, replace(grid, substeps=512), GeneralizedAlpha(0.5))[:, -1]
    errors = [l2(model, solved(model, replace(grid, substeps=n), scheme)[:, -1] - fine) for n in (2, 4, 8, 16)]
    rates = [np.log2(a / b) for a, b in pairwise(errors)]
    assert rates[-1] == pytest.approx(1.0 if isinstance(scheme, Newmark) else 2.0, abs=0.15)


@pytest.mark.parametrize("order", [1, 2])
def test_rates_in_the_mesh_of_a_steady_temperature(slab, on, order):
    """A perfused slab heated by a flux, cold at its core."""
    ranges = TISSUE | {"perfusion": (2e-3, 2e-3), "arterial": (3.0, 3.0)}
    physics = Heat(order, held={"core": 3.0}, fluxes={"skin": 4e4}, ranges=ranges)
    errors = []
    for cells in (4, 8, 16):
        model = physics.build(on(slab(2, cells)))
        states = solved(model, TimeGrid(10.0, 3), start="steady")
        assert np.ptp(states, axis=1).max() < 1e-8 * states.max()  # nothing moves
        wanted = perfused_slab(along(model), LENGTH, 5e4, 2e-3 * 3.9e7, 4e4, 3.0)
        errors.append(l2(model, states[:, -1] - wanted))
    rates = [np.log2(a / b) for a, b in pairwise(errors)]
    assert rates[-1] == pytest.approx(order + 1, abs=0.15)


@pytest.mark.parametrize(("dim", "order"), [(2, 1), (2, 2), (3, 1)])
def test_rates_in_the_mesh_of_a_made_up_temperature(on, dim, order):
    """T = cos(πx) cos(πy) (cos(πz)) exp(−t/τ) on an insulated, perfused box, by sources made for it."""
    decay, errors = 300.0, []
    for cells in (4, 8, 16) if dim == 2 else (3, 6, 12):
        mesh = Box((0.0,) * dim, (1.0,) * dim, (cells,) * dim).mesh()
        ranges = TISSUE | {"perfusion": (2e-3, 2e-3)}
        model = Heat(order, ranges=ranges, initial=1.0).build(on(mesh))
        disc = model.space.discretization
        shape = np.cos(np.pi * mesh.nodes(order)).prod(axis=1)
        strength = 4e7 / -decay + 5e4 * dim * np.pi**2 + 2e-3 * 3.9e7
        force = disc.scalar_mass("T") @ (strength * shape)
        loads = (Load("made up", one, Decay(decay), force, 0 * force), Load.at_start("start", one, shape))
        model = replace(model, loads=loads)
        grid = TimeGrid(20.0, 1, substeps=32)
        error = solved(model, grid, GeneralizedAlpha(0.5))[:, 0] - shape * np.exp(-20.0 / decay)
        errors.append(l2(model, error))
    # Against the nodal values, which elements of order 2 on regular meshes meet better than functions between them.
    rates = [np.log2(a / b) for a, b in pairwise(errors)]
    assert order + 0.8 < rates[-1] < order + 1.15 + (order == 2)


class Decay:
    def __init__(self, time):
        self.time = time

    def __call__(self, times):
        return np.exp(-times / self.time)


def one(_):
    return 1.0


@pytest.mark.parametrize(("dim", "order"), [(2, 1), (2, 2), (3, 1)])
def test_heat_is_neither_made_nor_lost(slab, on, dim, order):
    """Insulated, heated by a probe and a flux for a while: what went in is there, and no more comes afterwards."""
    physics = Heat(
        order, sources={"probe": Source((0.7,) * 1 + (0.0,) * (dim - 1), 0.3, 2e6)}, fluxes={"skin": 1e4}, initial=2.0,
        courses={"P_probe": Course("pulse", 30.0), "q_skin": Course("pulse", 50.0)}, ranges=TISSUE,
        inclusions=(Inclusion((1.5, *(0.0,) * (dim - 1)), 0.4, conductivity=5.0),),
    )  # fmt: skip
    mesh = slab(dim, 12)
    model = physics.build(on(mesh))
    states = solved(model, TimeGrid(10.0, 8))
    volume, area = mesh.volumes.sum(), mesh.volumes.sum() / LENGTH
    heat = 4e7 * (model.space.field_product("T") @ states).sum(axis=0)
    times = 10.0 * np.arange(1, 9)
    given = 2e6 * np.minimum(times, 30.0) + 1e4 * area * np.minimum(times, 50.0)
    np.testing.assert_allclose(heat, 4e7 * 2.0 * volume + given, rtol=1e-9)


@pytest.mark.parametrize("order", [1, 2])
def test_two_layers_conduct_as_resistances_in_series(slab, on, order):
    ball = Inclusion((3.0, 0.0), 1.9999, conductivity=4.0)
    ranges = TISSUE
    model = Heat(order, held={"core": 10.0, "skin": 0.0}, inclusions=(ball,), ranges=ranges).build(on(slab(2, 8)))
    states = solved(model, TimeGrid(1.0, 1), start="steady")[:, 0]
    x = along(model)
    drop = 10.0 / (1.0 + 1.0 / 4.0)
    wanted = np.where(x < 1.0, 10.0 - drop * x, 10.0 - drop - drop / 4.0 * (x - 1.0))
    assert np.abs(states - wanted).max() < 1e-9


def test_a_layer_stores_and_is_perfused_by_its_own_factors(slab, on):
    """Layers that do not conduct relax each at its own rate."""
    ranges = {"conductivity": (1e-6, 1e-6), "perfusion": (1e-2, 1e-2), "capacity": (4e7, 4e7)}
    ball = Inclusion((3.0, 0.0), 1.9999, capacity=2.0, perfusion=0.5)
    model = Heat(1, inclusions=(ball,), initial=8.0, ranges=ranges).build(on(slab(2, 32)))
    grid = TimeGrid(50.0, 2, substeps=64)
    states = solved(model, grid, GeneralizedAlpha(0.5))[:, -1]
    rate = 1e-2 * 3.9e7 / 4e7
    for where, factor in ((0.3, 1.0), (1.7, 0.25)):
        node = np.abs(along(model) - where).argmin()
        assert states[node] == pytest.approx(8.0 * np.exp(-factor * rate * 100.0), rel=1e-3)


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("dim", [2, 3])
def test_temperatures_leave_their_bounds_beside_a_jump_where_a_caution_says_so(on, dim, order):
    cells = 16 if dim == 2 else 6
    sides = Box((0.0,) * dim, (2.0,) * dim, (cells,) * dim).sides
    mesh = Box((0.0,) * dim, (2.0,) * dim, (cells,) * dim, {"core": ("x-",), "rest": sides[1:]}).mesh()
    model = Heat(order, held={"core": 1.0}, ranges=TISSUE).build(on(mesh))
    (caution,) = model.cautions
    needed = caution.shortest(model.parameters)
    long, short = (solved(model, TimeGrid(length, 1)) for length in (needed, 0.03 * needed))
    assert long.min() > -0.011
    assert short.min() < -0.1
    for length, warns in ((needed, False), (0.5 * needed, True)):
        assert bool(MarchedModel(model, TimeGrid(length, 1), Newmark()).cautions(model.parameters)) == warns


def test_no_caution_where_nothing_jumps(slab, on):
    rising = {"courses": {"T_core": Course("smooth_ramp", 100.0)}}
    for physics in (
        Heat(convection={"skin": Exchange(1e4, 1.0)}),
        Heat(held={"core": 0.0}),
        Heat(held={"core": 3.0}, initial=3.0),
        Heat(held={"core": 3.0}, **rising),
    ):
        model = physics.build(on(slab()))
        assert MarchedModel(model, TimeGrid(1e-3, 1)).cautions(model.parameters) == ()
    warm = Heat(held={"core": 3.0}, initial=3.0, ranges={"initial": (2.0, 3.0)}).build(on(slab()))
    assert "leaves its bounds" in MarchedModel(warm, TimeGrid(1e-3, 1)).cautions(warm.parameters)[0]
