"""Reduced models: exact where nothing is left out, as accurate as they say elsewhere, and few full solves."""

from dataclasses import replace
from operator import itemgetter

import numpy as np
import pytest

from dacore.core.model import Load
from dacore.core.timegrid import TimeGrid
from dacore.dynamics.generalized_alpha import GeneralizedAlpha
from dacore.dynamics.march import MarchedModel
from dacore.dynamics.motions import Motions
from dacore.dynamics.newmark import Newmark
from dacore.dynamics.profiles import Sine
from dacore.dynamics.training import draw
from dacore.errors import AccuracyError, CapabilityError, ShapeError, StoreError
from dacore.reduction.coarse import coarse
from dacore.reduction.galerkin import Galerkin
from dacore.reduction.greedy import Settings
from dacore.reduction.indicator import random_tests
from dacore.reduction.kept import read_reduced, write_reduced
from dacore.reduction.model import ReducedModel
from dacore.reduction.sampling import features, spread
from dacore.reduction.split import SplitModel
from dacore.reduction.training import train_reduced
from tests.rods import rod

GRID = TimeGrid(0.02, 30)
SCHEMES = [Newmark(), Newmark(0.25, 0.5, "newmark"), GeneralizedAlpha(0.5), GeneralizedAlpha(1.0)]
GRIDS = [GRID, TimeGrid(0.02, 10, spin_up=7), TimeGrid(0.02, 10, substeps=3), TimeGrid(0.02, 10, graded=4)]


def marched(start="zero", scheme=None, grid=GRID, **changes):
    model = rod(**changes)
    if start == "warm":  # a state of its own at t = 0, on constrained dofs too, as large as the storage says
        shape = np.cos(np.linspace(0.0, 5.0, model.space.n_dofs))
        model = replace(model, loads=(*model.loads, Load.at_start("warm", itemgetter("storage"), 20.0 * shape)))
    return MarchedModel(model, grid, scheme or Newmark(), "zero" if start == "warm" else start, tolerance=1e-12)


def reduced_of(model, galerkin):
    sketch = random_tests(model, galerkin.split, model.parameters, 1).tested(galerkin)
    return ReducedModel.of(model, galerkin, sketch, np.ones(2))


def complete(model, kind="l2"):
    """A Galerkin model that leaves nothing out."""
    return complete_of(model.model, kind)


def complete_of(affine, kind="l2"):
    galerkin = Galerkin(SplitModel(affine, kind))
    for name in ("u", "p"):  # one field after the other, and in pieces, as it grows in training
        identity = np.eye(len(galerkin.split.free[name]))
        for part in np.array_split(identity, 3, axis=1):
            galerkin.extend({name: part})
    return galerkin


def lifted(model, galerkin, states):
    """Full states (n_dofs, t) of reduced ones (r + n_loads, t)."""
    layout, r = model.space.layout, galerkin.dimension
    out = np.zeros((model.space.n_dofs, states.shape[1]))
    start = 0
    for name, basis in galerkin.bases.items():
        block = layout.block(name)
        part = galerkin.split.prescribed[name] @ states[r:]
        part[galerkin.split.free[name]] += basis @ states[start : start + basis.shape[1]]
        out[block] = part
        start += basis.shape[1]
    return out


def flat(values):
    return values.reshape(len(values), -1)


def relative(error, truth, model, kind="l2"):
    """Relative space–time error of each field."""
    out = []
    for name in ("u", "p"):
        block, product = model.space.layout.block(name), model.space.field_product(name, kind)
        size = [np.einsum("ij,ij->", part, product @ part) for part in (flat(each[block]) for each in (error, truth))]
        out.append(np.sqrt(size[0] / size[1]))
    return np.array(out)


def trained(model, count=40, tolerance=1e-4, compression=1e-9, drawn=3, **settings):
    parameters = model.parameters
    samples = draw(parameters, count, "latin_hypercube", drawn)
    solved = []

    def solve(motions, numbers):
        solved.extend(numbers)
        return [motions.solve(parameters.as_mapping(samples[number])) for number in numbers]

    reduced = train_reduced(model, parameters, samples, solve, Settings(tolerance, **settings), compression)
    return reduced, samples, solved


@pytest.fixture(scope="module")
def training():
    # Hardly damped: waves of different speeds, which no few modes hold.
    model = marched(scheme=GeneralizedAlpha(0.9), grid=TimeGrid(0.01, 60), n=200)
    return (model, *trained(model, tolerance=1e-5, first=1, batch=1))


@pytest.mark.parametrize("start", ["zero", "steady", "warm"])
@pytest.mark.parametrize("scheme", SCHEMES, ids=lambda scheme: scheme.label)
@pytest.mark.parametrize("grid", GRIDS, ids=["plain", "spin-up", "substeps", "graded"])
def test_with_all_modes_the_reduced_model_is_the_full_one(start, scheme, grid):
    model = marched(start, scheme, grid, n=15)
    galerkin = complete(model)
    points = [model.parameters.as_mapping(row) for row in draw(model.parameters, 3, "uniform", 1)]
    states, estimates = reduced_of(model, galerkin).estimate(points)
    for k, point in enumerate(points):
        truth = model.solve(point).states
        assert relative(lifted(model, galerkin, states[:, :, k]) - truth, truth, model).max() < 1e-9
    # Nothing is left out, so the residual is round-off.
    assert estimates.max() < 1e-8


def test_norms_are_those_of_the_lifted_states():
    model = marched("steady", n=15)
    galerkin = complete(model, "h1")
    galerkin = galerkin.turned(some_columns(galerkin, 9))
    reduced = reduced_of(model, galerkin)
    states = np.random.default_rng(0).normal(size=(reduced.dimension + 3, 4, 2))
    for k in range(2):
        full = lifted(model, galerkin, states[:, :, k])
        for row, name in enumerate(("u", "p")):
            part, product = full[model.space.layout.block(name)], model.space.field_product(name, "h1")
            assert reduced.norms(states)[row, k] == pytest.approx(np.sqrt(np.einsum("ij,ij->", part, product @ part)))


def some_columns(galerkin, count):
    """Orthonormal columns for each field."""
    rng = np.random.default_rng(1)
    return {name: np.linalg.qr(rng.normal(size=(r, count)))[0] for name, r in galerkin.sizes.items()}


def test_a_turned_model_is_the_projection_on_the_turned_modes():
    model = marched(n=15)
    whole = complete(model)
    before = {name: basis.copy() for name, basis in whole.bases.items()}
    turned, fresh = whole.turned(some_columns(whole, 6)), Galerkin(SplitModel(model.model))
    fresh.bases = {name: basis[:, :0] for name, basis in turned.bases.items()}
    fresh.extend(turned.bases)
    for name, basis in turned.bases.items():
        assert np.allclose(fresh.bases[name], basis, atol=1e-12)
    for mine, other in zip(turned.tested().terms, fresh.tested().terms, strict=True):
        for pair, block in mine.blocks.items():
            assert np.abs(block - other.blocks[pair]).max() < 1e-10 * max(np.abs(block).max(), 1.0)
    assert all(np.array_equal(whole.bases[name], before[name]) for name in before)


@pytest.mark.parametrize("start", ["zero", "steady", "warm"])
@pytest.mark.parametrize("grid", GRIDS, ids=["plain", "spin-up", "substeps", "graded"])
def test_motions_superpose_to_every_trajectory(start, grid):
    model = marched(start, grid=grid, n=15)
    samples = draw(model.parameters, 4, "uniform", 1)
    points = [model.parameters.as_mapping(row) for row in samples]
    motions = Motions(model, np.stack([model.model.amplitudes(point) for point in points], axis=1))
    # The constant loads together, each varying one alone.
    assert motions.parts.shape == ((4, 3) if start == "warm" else (3, 2))
    solved = motions.solve(points[0])
    assert solved.states.shape == (30, len(motions.times))
    for point in points:
        amplitudes = model.model.amplitudes(point)
        truth = model.motions(points[0], amplitudes[:, None])[0]
        found = motions.superpose(solved, amplitudes)
        assert np.abs(found - truth).max() < 1e-8 * np.abs(truth).max()


def test_loads_that_were_not_moved_are_refused():
    model = marched(n=15, ranges={"outflow": (0.0, 0.0)})
    amplitudes = np.array([[-2.0, -2.0], [4.0, 6.0], [0.0, 0.0]])
    motions = Motions(model, amplitudes)
    point = model.parameters.as_mapping(draw(model.parameters, 1, "uniform", 1)[0])
    with pytest.raises(ShapeError, match="not moved in training"):
        motions.superpose(motions.solve(point), np.array([-2.0, 5.0, 1.0]))


def test_a_few_full_solves_stand_for_all(training):
    _, reduced, samples, solved = training
    assert len(set(solved)) == len(reduced.solved) < len(samples) / 2
    assert reduced.estimates.shape == (2, len(samples))
    assert reduced.estimates.max() <= 1e-5


def test_unseen_errors_are_within_the_tolerance_and_near_their_estimates(training):
    model, reduced, *_ = training
    points = [model.parameters.as_mapping(row) for row in draw(model.parameters, 12, "uniform", 9)]
    states, estimates = reduced.model.estimate(points)
    coefficients = np.tensordot(reduced.model.onto, states, axes=1)
    for k, point in enumerate(points):
        truth = model.solve(point).states
        errors = relative(reduced.background.lift(coefficients[:, :, k]) - truth, truth, model)
        assert errors.max() < 1e-5
        # Where the last samples show nothing but what the modes leave, the estimate is far on the safe side.
        assert (estimates[:, k] > 0.7 * errors).all()
        assert (estimates[:, k] < 1e3 * errors).all()


def test_the_greedy_knows_true_errors_before_it_uses_them(training):
    *_, reduced, _, _ = training
    first, *later = reduced.rounds
    assert np.isnan(first.true).all()
    assert all(np.isfinite(each.true).all() for each in later)
    assert later[-1].true.max() < 0.1 * max(each.true.max() for each in later)


def test_full_and_reduced_training_give_the_same_background(training):
    model, reduced, samples, _ = training
    for k in (0, 17, 39):
        truth = model.solve(model.parameters.as_mapping(samples[k])).states
        found = reduced.background.lift(reduced.background.coefficients[:, :, k])
        assert relative(found - truth, truth, model).max() < 1e-5
    assert reduced.background.n_samples == 40
    assert max(reduced.background.compression.values()) <= 1e-9


@pytest.mark.parametrize("start", ["zero", "steady", "warm"])
@pytest.mark.parametrize("grid", [TimeGrid(0.02, 12, spin_up=20), TimeGrid(0.04, 12, substeps=2, graded=3)])
def test_what_comes_before_the_recorded_steps_is_trained_too(start, grid):
    model = marched(start, GeneralizedAlpha(0.5), grid)
    reduced, _, _ = trained(model, tolerance=1e-3)
    point = model.parameters.as_mapping(draw(model.parameters, 1, "uniform", 5)[0])
    truth = model.solve(point).states
    found = reduced.background.lift(np.tensordot(reduced.model.onto, reduced.model.solve([point]), axes=1)[:, :, 0])
    assert relative(found - truth, truth, model).max() < 1e-3


def test_what_modes_leave_is_measured_where_other_samples_amplify_it():
    """Calibrated on four samples with small errors, the estimate alone was a fifth of the tolerance, the error five."""
    wide = {
        "modulus": (71.28, 3452.1), "mobility": (1.345e-5, 7.94e-4), "storage": (1.53e-3, 0.301), "alpha": (0.2, 1.0),
    }  # fmt: skip
    model = marched(scheme=GeneralizedAlpha(0.9), grid=TimeGrid(0.01, 20), n=100, ranges=wide)
    tolerance = 3.55e-5
    reduced, samples, _ = trained(model, count=30, tolerance=tolerance, seed=6212, drawn=6212)
    for k in range(30):
        truth = model.solve(model.parameters.as_mapping(samples[k])).states
        found = reduced.background.lift(reduced.background.coefficients[:, :, k])
        assert relative(found - truth, truth, model).max() < tolerance


def test_modes_that_no_trajectory_needs_are_dropped():
    model = marched(scheme=GeneralizedAlpha(0.9), grid=TimeGrid(0.01, 20), n=60)
    reduced, samples, _ = trained(model, count=140, tolerance=1e-4)
    assert reduced.model.dimension < sum(reduced.rounds[-1].modes.values())
    for k in range(0, 140, 20):
        truth = model.solve(model.parameters.as_mapping(samples[k])).states
        found = reduced.background.lift(reduced.background.coefficients[:, :, k])
        assert relative(found - truth, truth, model).max() < 1e-4


def test_training_is_the_same_twice(training):
    model, reduced, *_ = training
    again, *_ = trained(model, tolerance=1e-5, first=1, batch=1)
    assert np.array_equal(again.solved, reduced.solved)
    assert np.array_equal(again.background.coefficients, reduced.background.coefficients)


def test_too_few_trajectories_are_an_error_that_says_what_was_reached():
    with pytest.raises(AccuracyError, match=r"5 trajectories leave an estimated error .* raise training.reduction"):
        trained(marched(scheme=GeneralizedAlpha(0.9), n=200), tolerance=1e-13, first=1, batch=1, most=5)


def test_too_small_a_limit_is_refused():
    with pytest.raises(ShapeError, match=r"training\.most: got 7, expected at least 8"):
        Settings(most=7)


def test_too_few_samples_are_refused():
    with pytest.raises(CapabilityError, match=r"got 7 samples, expected at least 8 .* training.method = 'full'"):
        trained(marched(n=15), count=7)


def test_a_field_of_both_kinds_of_rows_is_refused():
    model = rod(n=15)
    mixed = model.antisymmetric.copy()
    mixed[-3] = False
    with pytest.raises(CapabilityError, match="only some rows of p are antisymmetric"):
        SplitModel(replace(model, antisymmetric=mixed))


def test_a_field_that_is_prescribed_everywhere_is_refused():
    model = rod(n=15)
    with pytest.raises(CapabilityError, match="every dof of p is prescribed"):
        SplitModel(replace(model, constrained=model.constrained | model.antisymmetric))


def test_features_see_ratios_and_leave_out_what_is_fixed():
    found = features(np.array([[1.0, 10.0, 100.0], [3.0, 3.0, 3.0], [0.0, -1.0, 1.0]]))
    assert np.allclose(found, [[0.0, 0.5, 1.0], [0.5, 0.0, 1.0]])


def test_features_have_no_unit():
    # Coefficients as small as a storage in cgs units vary too, though one of them is zero.
    row = np.array([0.0, 1.0, 4.0])
    assert np.array_equal(features(1e-15 * row[None, :]), features(row[None, :]))
    assert features(np.full((1, 3), -1e-15)).shape == (0, 3)


def test_the_residual_is_tested_in_the_middle_of_the_ranges_that_are_trained_on():
    mine = {"modulus": (800.0, 900.0), "mobility": (1e-4, 2e-4)}
    default, given = marched(n=15), marched(n=15, ranges=mine)
    tests = [
        random_tests(model, SplitModel(model.model), given.parameters, 1).tested(complete(model))
        for model in (default, given)
    ]
    assert np.array_equal(tests[0].forces, tests[1].forces)
    other = random_tests(default, SplitModel(default.model), default.parameters, 1).tested(complete(default))
    assert not np.allclose(other.forces, tests[0].forces, rtol=0.1)


@pytest.mark.parametrize("mix", [(1.0, 0.0), (1 / 3, 1 / 3), (1.0, 1e-12)])
def test_loads_that_prescribe_what_others_do_add_no_directions(mix):
    loads = rod(n=60).loads
    values = mix[0] * loads[1].prescribed + mix[1] * loads[2].prescribed
    extra = Load("more", lambda point: 0.1 * point["modulus"], Sine(1.0), loads[1].force, values)
    model = marched(loads=(*loads, extra))
    reduced, samples, _ = trained(model, tolerance=1e-3, compression=1e-13)
    truth = model.solve(model.parameters.as_mapping(samples[7])).states
    found = reduced.background.lift(reduced.background.coefficients[:, :, 7])
    assert relative(found - truth, truth, model).max() < 1e-3


def test_points_are_spread_from_the_middle_to_the_corners():
    grid = np.stack(np.meshgrid(np.linspace(0, 1, 5), np.linspace(0, 1, 5)), axis=0).reshape(2, 25)
    chosen = spread(grid, 5)
    assert chosen[0] == 12
    assert sorted(chosen[1:]) == [0, 4, 20, 24]
    assert set(spread(grid, 30, chosen)) == set(range(25)) - set(chosen)


def test_a_reduced_training_comes_back_from_disk(training, tmp_path):
    model, reduced, *_ = training
    path = tmp_path / "training.h5"
    write_reduced(reduced, path)
    back = read_reduced(path, model, model.parameters)
    point = [model.parameters.as_mapping(draw(model.parameters, 1, "uniform", 5)[0])]
    for mine, other in zip(reduced.model.estimate(point), back.model.estimate(point), strict=True):
        assert np.array_equal(mine, other)
    assert np.array_equal(back.background.coefficients, reduced.background.coefficients)
    assert np.array_equal(back.solved, reduced.solved)
    assert back.rounds[1].modes == reduced.rounds[1].modes
    assert np.array_equal(back.rounds[1].true, reduced.rounds[1].true)
    assert back.motions == reduced.motions == 2


def test_an_initial_state_comes_back_from_disk_and_on_fewer_coordinates(tmp_path):
    model = marched("warm", GeneralizedAlpha(0.5))
    reduced, samples, _ = trained(model, tolerance=1e-4)
    path = tmp_path / "training.h5"
    write_reduced(reduced, path)
    back = read_reduced(path, model, model.parameters)
    points = [model.parameters.as_mapping(row) for row in samples]
    assert np.array_equal(back.model.solve(points[:2]), reduced.model.solve(points[:2]))
    fewer = coarse(reduced.model, points, 1e-4)
    assert fewer.dimension < reduced.model.dimension
    truth = model.solve(points[1]).states
    for each, tolerance in ((back.model, 1e-4), (fewer, 3e-3)):
        found = reduced.background.lift(np.tensordot(each.onto, each.solve(points[1:2]), axes=1)[:, :, 0])
        assert relative(found - truth, truth, model).max() < tolerance


def test_the_training_of_another_model_is_refused(training, tmp_path):
    model, reduced, *_ = training
    path = tmp_path / "training.h5"
    write_reduced(reduced, path)
    with pytest.raises(StoreError, match="damaged or of another model"):
        read_reduced(path, marched(n=20), model.parameters)
