"""The map from parameters to trajectories that reduced training leaves with its background."""

import numpy as np
import pytest

from dacore.core.timegrid import TimeGrid
from dacore.dynamics.march import MarchedModel
from dacore.dynamics.newmark import Newmark
from dacore.dynamics.training import draw
from dacore.errors import ShapeError
from dacore.reduction.forward import ReducedForward
from dacore.reduction.greedy import Settings
from dacore.reduction.kept import read_reduced, write_reduced
from dacore.reduction.training import train_reduced
from tests.rods import rod


@pytest.fixture(scope="module")
def trained():
    model = MarchedModel(rod(40), TimeGrid(0.02, 20), Newmark(), "zero", tolerance=1e-12)
    samples = draw(model.parameters, 30, "latin_hypercube", 3)

    def solve(motions, numbers):
        return [motions.solve(model.parameters.as_mapping(samples[number])) for number in numbers]

    return model, train_reduced(model, model.parameters, samples, solve, Settings(1e-5), 1e-9)


def test_it_makes_the_trajectories_of_the_training_set(trained):
    _, reduced = trained
    b = reduced.background
    again = b.forward.coefficients(b.samples)
    assert again.shape == b.coefficients.shape
    np.testing.assert_allclose(again, b.coefficients, atol=1e-12 * np.abs(b.coefficients).max())


def test_it_is_as_accurate_as_it_says_on_unseen_parameters(trained):
    model, reduced = trained
    b = reduced.background
    points = draw(model.parameters, 4, "uniform", 9)
    lifted = b.lift(b.forward.coefficients(points))
    for k, row in enumerate(points):
        truth = model.solve(model.parameters.as_mapping(row)).states
        for name in ("u", "p"):
            block, product = b.space.layout.block(name), b.space.field_product(name, "l2")
            error, size = (np.einsum("ij,ij->", x[block], product @ x[block]) for x in (lifted[:, :, k] - truth, truth))
            assert np.sqrt(error / size) < 10 * b.forward.accuracy[name] < 1e-5


def test_points_that_differ_in_loads_only_are_solved_as_well_together_as_alone(trained):
    _, reduced = trained
    b = reduced.background
    points = np.repeat(b.samples[:3], 2, axis=0)
    points[1::2, b.parameters.names.index("inflow")] = 4.25
    together = b.forward.coefficients(points)
    alone = np.concatenate([b.forward.coefficients(row[None]) for row in points], axis=2)
    np.testing.assert_allclose(together, alone, atol=1e-11 * np.abs(alone).max())


def test_it_is_there_again_when_the_training_is_read(trained, tmp_path):
    model, reduced = trained
    write_reduced(reduced, tmp_path / "r.h5")
    b = read_reduced(tmp_path / "r.h5", model, model.parameters).background
    points = draw(model.parameters, 2, "uniform", 4)
    np.testing.assert_array_equal(b.forward.coefficients(points), reduced.background.forward.coefficients(points))
    assert b.forward.accuracy == reduced.background.forward.accuracy


def test_wrong_points_and_a_model_without_a_background_are_refused(trained):
    model, reduced = trained
    with pytest.raises(ShapeError, match=r"points: got shape \(2, 3\), expected \(any, 8\)"):
        reduced.background.forward.coefficients(np.zeros((2, 3)))
    with pytest.raises(ShapeError, match="knows no background"):
        ReducedForward(reduced.model.on(None), model.parameters, {})


@pytest.mark.parametrize("tolerance", [1e-2, 1e-4])
def test_fewer_modes_make_nearly_the_same_trajectories(trained, tolerance):
    _, reduced = trained
    b = reduced.background
    fewer = b.forward.coarse(b.samples[::2], tolerance)
    assert fewer.model.dimension <= b.forward.model.dimension
    points = draw(b.parameters, 10, "uniform", 8)
    made, whole = fewer.coefficients(points), b.forward.coefficients(points)
    for name in ("u", "p"):
        rows = b.block(name)
        varied = b.coefficients[rows] - b.mean()[rows][:, :, None]
        size = np.sqrt((varied**2).sum() / b.n_samples)
        assert np.sqrt(((made - whole)[rows] ** 2).sum() / 10) < 2 * tolerance * size
    # A field less its mean is coarsened beneath, and the errors that a model states are those of fewer modes, too.
    less = b.less_mean(["p"]).forward.coarse(b.samples[::2], tolerance)
    np.testing.assert_allclose(less.coefficients(points), b.without_mean(made, ["p"]), atol=1e-12 * np.abs(made).max())
    states, errors = fewer.model.estimate([b.parameters.as_mapping(row) for row in points])
    assert np.isfinite(errors).all()
    norms = fewer.model.norms(states) / b.forward.model.norms(b.forward.model.solve(
        [b.parameters.as_mapping(row) for row in points]
    ))  # fmt: skip
    np.testing.assert_allclose(norms, 1.0, atol=tolerance)


def test_coarser_models_are_smaller(trained):
    _, reduced = trained
    b = reduced.background
    sizes = [b.forward.coarse(b.samples, tolerance).model.dimension for tolerance in (1e-1, 1e-3, 1e-12)]
    assert sizes[0] < sizes[1] <= sizes[2] <= b.forward.model.dimension
