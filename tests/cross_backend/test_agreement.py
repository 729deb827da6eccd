"""The same answer whatever the library: matrices, trajectories, functionals, estimates.

Meshes are perturbed, renumbered and shuffled at random. Every backend is held against scikit-fem.
"""

from functools import cache

import numpy as np
import pytest

from dacore.algebra.compress import compress
from dacore.core.mesh import Mesh
from dacore.core.noise import WhiteNoise
from dacore.core.timegrid import TimeGrid
from dacore.dynamics.march import MarchedModel
from dacore.dynamics.newmark import Newmark
from dacore.estimators.minimum_variance import MinimumVariance
from dacore.estimators.pbdw import PBDW
from dacore.workflow.comparison.agreement import relative_difference
from dacore_biot.model import Biot
from dacore_imaging.points import PointSensors
from dacore_imaging.quantities import BoundaryMean
from dacore_imaging.voxels import Voxels
from tests.backends import READY, backend
from tests.meshes import shuffled_box

OTHERS = [name for name in READY if name != "skfem"]
CASES = [(dim, order, seed) for dim in (2, 3) for order in (1, 2) for seed in (1, 2)]
SIDE = 8.0

pytestmark = pytest.mark.skipif(len(READY) < 2, reason="one backend is installed: nothing to compare")


def test_every_required_backend_is_among_those_compared():
    import os

    required = {name for name in os.environ.get("DACORE_REQUIRE", "").split(",") if name}
    assert required <= set(READY)


@cache
def mesh(dim, seed):
    """A cube of 8 cm, its boundary bumpy."""
    unit = shuffled_box(dim, n=6 if dim == 2 else 3, seed=seed, bumpy=True)
    return Mesh(SIDE * unit.points, unit.cells, unit.facets, unit.facet_tags, unit.roles)


@cache
def model(name, dim, order, seed):
    physics = Biot(displacement_order=order, neck="left", ventricles="right", mre="side")
    return physics.build(lambda fields: backend(name).discretize(mesh(dim, seed), fields))


@cache
def marched(name, dim, order, seed):
    return MarchedModel(model(name, dim, order, seed), TimeGrid(5e-4, 12), Newmark(), tolerance=1e-12)


def middle(of):
    return of.parameters.middle


@pytest.mark.parametrize(("dim", "order", "seed"), CASES)
@pytest.mark.parametrize("name", OTHERS)
def test_matrices_loads_and_products_agree(name, dim, order, seed):
    ours, theirs = model("skfem", dim, order, seed), model(name, dim, order, seed)
    for group in ("second_order", "first_order", "zeroth_order"):
        for mine, other in zip(getattr(ours, group), getattr(theirs, group), strict=True):
            assert mine.name == other.name
            assert relative_difference(other.matrix, mine.matrix) < 1e-12, mine.name
    for mine, other in zip(ours.loads, theirs.loads, strict=True):
        for part in ("force", "prescribed"):
            assert relative_difference(getattr(other, part), getattr(mine, part)) < 1e-12, (mine.name, part)
    for field in ("u", "p"):
        for kind in ("l2", "h1"):
            mine, other = (each.space.scalar_product(field, kind) for each in (ours, theirs))
            assert relative_difference(other, mine) < 1e-12, (field, kind)


@pytest.mark.parametrize(("dim", "order", "seed"), CASES)
@pytest.mark.parametrize("name", OTHERS)
def test_functionals_agree(name, dim, order, seed):
    rng = np.random.default_rng(seed)
    axes = "xyz"[:dim]
    places = tuple(map(tuple, rng.uniform(0.2 * SIDE, 0.8 * SIDE, size=(30, dim)).tolist()))
    operators = [
        Voxels(field="u", size=1.7, coverage=0.3),
        Voxels(field="p", size=2.3, coverage=0.5),
        PointSensors(positions=places, field="u", components=(axes[-1],)),
        PointSensors(positions=places, field="p"),
        BoundaryMean(role="right", field="p"),
        BoundaryMean(role="side", field="u"),
    ]
    spaces = [model(each, dim, order, seed).space for each in ("skfem", name)]
    for operator in operators:
        mine, other = (operator.functionals(space) for space in spaces)
        assert mine.labels == other.labels
        assert relative_difference(other.matrix, mine.matrix) < 1e-12, operator
    for axis in range(dim):
        mine, other = (space.evaluation(np.array(places), "u", axis) for space in spaces)
        assert relative_difference(other, mine) < 1e-12, axis


@pytest.mark.parametrize(("dim", "order", "seed"), [case for case in CASES if case[2] == 1])
@pytest.mark.parametrize("name", OTHERS)
def test_trajectories_agree(name, dim, order, seed):
    ours, theirs = marched("skfem", dim, order, seed), marched(name, dim, order, seed)
    mine, other = (each.solve(middle(each)).states for each in (ours, theirs))
    for field in ("u", "p"):
        block = ours.space.layout.block(field)
        assert relative_difference(other[block], mine[block]) < 1e-9, field
    steady = [
        MarchedModel(each.model, TimeGrid(5e-4, 3), Newmark(), "steady", tolerance=1e-12) for each in (ours, theirs)
    ]
    mine, other = (each.solve(middle(each)).states for each in steady)
    assert relative_difference(other, mine) < 1e-9


@cache
def trained(name, dim, order):
    """Background, functionals, quantity and the data of one unseen case."""
    forward = marched(name, dim, order, 1)
    space = forward.space
    rng = np.random.default_rng(5)
    samples = forward.parameters.sample(rng, 9)
    trajectories = [forward.solve(forward.parameters.as_mapping(row)) for row in samples]
    background = compress(space, trajectories[:-1], forward.parameters, samples[:-1], 1e-13)
    functionals = Voxels(field="u", size=2.0, coverage=0.3).functionals(space)
    return background, functionals, functionals(trajectories[-1].states)[:, :, None], trajectories[-1].states


ESTIMATORS = {
    "PBDW, one space": PBDW(n=6, weights={"p": 1e-18}, spaces="cycle", centring="none"),
    "PBDW, a space a phase": PBDW(n=4, weights={"p": 1e-18}, spaces="phase", centring="phase"),
    "minimum variance": MinimumVariance(),
}


@pytest.mark.parametrize("settings", ESTIMATORS.values(), ids=ESTIMATORS)
@pytest.mark.parametrize(("dim", "order"), [(2, 2), (3, 1)])
@pytest.mark.parametrize("name", OTHERS)
def test_estimates_and_the_pressure_in_the_cavity_agree(name, dim, order, settings):
    found = []
    for each in ("skfem", name):
        background, functionals, data, truth = trained(each, dim, order)
        prepared = settings.prepare(background, functionals, WhiteNoise(1.0))
        estimate = prepared.estimate(data, 0.0 if isinstance(settings, PBDW) else 1e-6 * np.abs(data).max())
        found.append((prepared, estimate, estimate.state(series=0), estimate.quantity(BoundaryMean("right", "p"))))
    (prepared, estimate, mine, mine_value), (_, _, other, other_value) = found
    for space in prepared.spaces():
        # At a fixed n with a gap in the spectrum the space itself is determined by the data.
        assert (
            space.n == len(space.inf_sup) or space.singular_values[space.n - 1] > 1.05 * space.singular_values[space.n]
        )
    # An error of the data is magnified by at most 1/β; minimum variance has no such constant, its noise bounds it.
    beta = np.nanmin(prepared.inf_sup) if isinstance(settings, PBDW) else 1.0
    layout = estimate.background.space.layout
    for field in ("u", "p"):
        block = layout.block(field)
        assert beta * relative_difference(other[block], mine[block]) < 1e-8, field
    assert beta * relative_difference(other_value, mine_value) < 1e-8
    # The agreement is that of estimates, not of zeros or of the mean.
    truth = trained("skfem", dim, order)[3]
    assert np.linalg.norm(mine - truth) < 0.5 * np.linalg.norm(truth)
    assert np.ptp(mine_value) >= 0.0
