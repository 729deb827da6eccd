"""The pieces of the posterior: coordinates, polynomials, the search for modes, and weighted points."""

import numpy as np
import pytest
from scipy.stats import norm

from dacore.core.parameters import Parameter, ParameterSpace
from dacore.errors import ShapeError
from dacore.estimators.posterior_coordinates import Coordinates
from dacore.estimators.posterior_interpolant import MOST_NODES, Interpolant, interpolate, leja, polynomials
from dacore.estimators.posterior_modes import Gaussian, search, starts
from dacore.estimators.posterior_moments import moments
from dacore.estimators.posterior_sampling import Cloud, Mixture, Truncated, sample, uniform_points

SPACE = ParameterSpace(
    (
        Parameter("fixed", "1", 7.0, 7.0),
        Parameter("wide", "1", 1e-9, 1e-8),
        Parameter("narrow", "1", 0.4, 0.45),
        Parameter("log", "1", 2.0, 5.0, "log_uniform"),
        Parameter("signed", "1", -3.0, 9.0),
    )
)


def test_coordinates_go_to_parameters_and_back():
    c = Coordinates.of(SPACE)
    assert c.names == ("wide", "narrow", "log", "signed")
    np.testing.assert_array_equal(c.logarithmic, [True, False, True, False])
    points = SPACE.sample(np.random.default_rng(0), 50)
    x = c.of_points(points)
    assert np.abs(x).max() <= 1
    np.testing.assert_allclose(c.points(x), points, rtol=1e-12)
    np.testing.assert_allclose(c.values(np.array([[-1.0] * 4, [1.0] * 4])), [c.low, c.high])
    step = 1e-6
    slopes = (c.values(x + step) - c.values(x - step)) / (2 * step)
    np.testing.assert_allclose(c.slopes(x), slopes, rtol=1e-6)


def test_the_prior_in_the_coordinates_is_what_the_ranges_say():
    c = Coordinates.of(SPACE)
    drawn = SPACE.sample(np.random.default_rng(1), 2**14, "sobol")
    x = c.of_points(drawn)
    np.testing.assert_allclose(c.prior, drawn[:, c.free].std(axis=0), rtol=2e-3)
    mean, deviation = c.prior_of_coordinates
    np.testing.assert_allclose(mean, x.mean(axis=0), atol=2e-3)
    np.testing.assert_allclose(deviation, x.std(axis=0), rtol=2e-3)
    # Uniform points weighted with the density have the moments of drawn ones.
    flat = 2 * uniform_points(2**14, 4) - 1
    weight = np.exp(c.log_prior(flat))
    np.testing.assert_allclose(weight @ c.values(flat) / weight.sum(), drawn[:, c.free].mean(axis=0), rtol=2e-3)
    assert np.isneginf(c.log_prior(np.array([0.0, 0.0, 1.001, 0.0])))


def test_nothing_to_find_is_refused():
    with pytest.raises(ShapeError, match="none of them varies"):
        Coordinates.of(ParameterSpace((Parameter("a", "1", 1.0, 1.0),)))


def test_hierarchical_polynomials_are_one_at_their_node_and_zero_at_those_before():
    nodes = leja()
    values, _ = polynomials(nodes, MOST_NODES - 1)
    np.testing.assert_allclose(np.diag(values), 1.0, rtol=1e-10)
    np.testing.assert_array_equal(np.triu(values.T, 1).T[np.tril_indices(MOST_NODES, -1)] * 0, 0)
    assert np.abs(np.triu(values, 1)).max() == 0
    assert np.diff(np.sort(nodes)).min() > 1e-3


def test_polynomials_and_their_slopes_are_interpolated_exactly():
    # Span of a downward closed set, with different degrees in each direction.
    indices = np.array([(i, j, k) for i in range(4) for j in range(3) for k in range(2) if 2 * i + 3 * j + 4 * k < 9])
    rng = np.random.default_rng(2)
    weights = rng.standard_normal((len(indices), 2))

    def monomials(x):
        return np.prod(x[:, None, :] ** indices[None], axis=2) @ weights

    made, left = interpolate(monomials, lambda s: np.abs(s).max(axis=1), 3, 1e-3, 200)
    x = rng.uniform(-1, 1, (40, 3))
    assert left < 1e-3
    np.testing.assert_allclose(made(x), monomials(x), atol=1e-11)
    value, slopes = made.slopes(x)
    np.testing.assert_allclose(value, made.basis(x), atol=1e-14)
    for d in range(3):
        step = 1e-6 * np.eye(3)[d]
        numeric = (monomials(x + step) - monomials(x - step)) / 2e-6
        np.testing.assert_allclose(slopes[d] @ made.weights, numeric, atol=1e-7)


def test_interpolation_refines_where_a_function_bends():
    def bent(x):
        return np.stack([np.exp(2 * x[:, 0]) / (3 + x[:, 1]) + 0.1 * x[:, 2], np.sin(5 * x[:, 0])], axis=1)

    x = np.random.default_rng(3).uniform(-1, 1, (200, 3))
    errors, counts = [], []
    for tolerance in (1e-1, 1e-3, 1e-5):
        made, left = interpolate(bent, lambda s: np.abs(s).max(axis=1), 3, tolerance, 500)
        assert left <= tolerance
        errors.append(np.abs(made(x) - bent(x)).max())
        counts.append(len(made.indices))
    assert errors[0] < 2
    assert errors[1] < 1e-2
    assert errors[2] < 1e-4
    assert counts[0] < counts[1] < counts[2] < 400
    # Linear in the last direction: a few nodes beside the middle show that it is enough.
    degrees = made.indices.max(axis=0)
    assert degrees[0] > 8
    assert degrees[2] < 10
    few, left = interpolate(bent, lambda s: np.abs(s).max(axis=1), 3, 1e-5, 20)
    assert len(few.indices) == 20
    assert left > 1e-5


def test_the_search_finds_the_mode_of_a_gaussian_and_stops_at_the_box():
    rng = np.random.default_rng(4)
    matrix = rng.standard_normal((6, 3))
    prior = Gaussian(np.array([0.1, 0.0, -0.2]), np.array([0.5, 0.6, 0.4]))
    data = rng.standard_normal((20, 6)) * 1.5

    def residuals(x, rows):
        return x @ matrix.T - data[rows], np.broadcast_to(matrix, (len(x), 6, 3))

    x, cost, precision = search(residuals, prior, np.zeros((20, 3)))
    dense = matrix.T @ matrix + np.diag(prior.deviation**-2.0)
    np.testing.assert_allclose(precision, np.broadcast_to(dense, (20, 3, 3)))
    free = np.linalg.solve(dense, (data @ matrix + prior.mean / prior.deviation**2).T).T
    inside = (np.abs(free) < 1).all(axis=1)
    assert 0 < inside.sum() < 20
    np.testing.assert_allclose(x[inside], free[inside], atol=1e-8)
    # Outside, the mode is on the box, and its gradient points out of it.
    gradient = x @ dense - data @ matrix - prior.mean / prior.deviation**2
    for place, slope in zip(x[~inside], gradient[~inside], strict=True):
        held = np.abs(place) == 1
        assert held.any()
        np.testing.assert_allclose(slope[~held], 0, atol=1e-6)
        assert (slope[held] * place[held] <= 0).all()
    np.testing.assert_allclose(cost, 0.5 * (residuals(x, np.arange(20))[0] ** 2).sum(axis=1) + prior.cost(x))


def test_starts_are_near_in_the_data_and_apart_in_the_box():
    places = np.linspace(-1, 1, 41)[:, None]
    training = places**2  # two places for each datum
    begin = starts(np.array([[0.25]]), np.array([[1.0]]), training, places, 2)[0, :, 0]
    np.testing.assert_allclose(sorted(begin), [-0.5, 0.5])


@pytest.mark.parametrize("mean", [0.2, 0.99, 3.0, -2.0])
def test_a_truncated_normal_is_drawn_with_the_density_it_states(mean):
    root = np.array([[0.4, 0.0], [0.3, 0.2]])
    part = Truncated(np.array([mean, 0.3]), root @ root.T)
    uniform = uniform_points(2**14, 2)
    x = part.draw(uniform)
    assert np.abs(x).max() <= 1
    # E_q[1/q] over a set is its volume.
    grid = np.stack(np.meshgrid(*[(np.arange(400) + 0.5) / 200 - 1] * 2, indexing="ij"), axis=-1).reshape(-1, 2)
    mass = np.exp(part.log_density(grid)) / 200**2
    assert mass.sum() == pytest.approx(1, abs=0.02)
    np.testing.assert_allclose(x.mean(axis=0), mass @ grid / mass.sum(), atol=5e-3)


def test_weighted_points_have_the_moments_of_the_density():
    # Curved, and cut by the box.
    def log_density(x):
        return -0.5 * ((x[:, 0] - 0.7) / 0.3) ** 2 - 0.5 * ((x[:, 1] - x[:, 0] ** 2) / 0.1) ** 2

    grid = np.stack(np.meshgrid(*[(np.arange(600) + 0.5) / 300 - 1] * 2, indexing="ij"), axis=-1).reshape(-1, 2)
    weights = np.exp(log_density(grid))
    mean, covariance = Cloud(grid, weights / weights.sum()).moments
    cloud = sample(log_density, [(np.array([0.0, 0.5]), 0.1 * np.eye(2), 1.0)], 2048)
    assert cloud.effective > 600
    np.testing.assert_allclose(cloud.moments[0], mean, atol=5e-3)
    np.testing.assert_allclose(cloud.moments[1], covariance, atol=2e-3)


def test_both_of_two_modes_are_sampled():
    def log_density(x):
        left, right = (norm.logpdf(x[:, 0], at, 0.02) for at in (-0.5, 0.6))
        return np.logaddexp(left + np.log(0.25), right + np.log(0.75))

    parts = [(np.array([at]), np.array([[0.02**2]]), 0.5) for at in (-0.5, 0.6)]
    cloud = sample(log_density, parts, 2048)
    assert cloud.weights[cloud.points[:, 0] > 0].sum() == pytest.approx(0.75, abs=0.02)
    proposal = Mixture(parts)
    grid = ((np.arange(4000) + 0.5) / 2000 - 1)[:, None]
    assert np.exp(proposal.log_density(grid)).mean() * 2 == pytest.approx(1, abs=1e-3)


def test_points_that_miss_the_mass_are_moved_there():
    def log_density(x):
        return norm.logpdf(x, [0.5, -0.3], 0.004).sum(axis=1)

    cloud = sample(log_density, [(np.array([0.45, -0.27]), 0.02**2 * np.eye(2), 1.0)], 1024)
    assert cloud.effective > 400
    np.testing.assert_allclose(cloud.moments[0], [0.5, -0.3], atol=4e-4)


def test_an_interpolant_of_one_index_is_a_constant():
    constant = Interpolant(np.zeros((1, 2), dtype=np.int64), np.array([[3.0]]))
    np.testing.assert_array_equal(constant(np.ones((4, 2))), np.full((4, 1), 3.0))


def test_moments_of_parameters_are_those_of_the_prior_where_nothing_is_known_and_of_the_gaussian_where_much_is():
    c = Coordinates.of(SPACE)
    mean, deviation = c.prior_of_coordinates
    values, covariance = moments(c, mean[None], np.diag(deviation**2)[None])
    drawn = SPACE.sample(np.random.default_rng(5), 2**14, "sobol")[:, c.free]
    np.testing.assert_allclose(values[0], drawn.mean(axis=0), rtol=2e-3)
    np.testing.assert_allclose(np.sqrt(np.diag(covariance[0])), c.prior, rtol=1e-3)
    # Well determined, far from the ends: the parameters' slopes tell all.
    at, root = np.array([[0.2, -0.3, 0.4, 0.1]]), 1e-5 * np.random.default_rng(6).standard_normal((4, 4))
    values, covariance = moments(c, at, (root @ root.T)[None])
    turned = c.slopes(at)[0][:, None] * root
    np.testing.assert_allclose(values, c.values(at), rtol=1e-6)
    size = np.sqrt(np.diag(turned @ turned.T))
    np.testing.assert_allclose(
        covariance[0] / np.outer(size, size), turned @ turned.T / np.outer(size, size), atol=1e-4
    )


def test_moments_of_half_known_parameters_are_those_of_quadrature():
    c = Coordinates.of(SPACE)
    at, spread = np.array([[0.7, 0.9, -0.2, 0.0]]), np.array([0.4, 0.3, 0.5, 0.2])
    values, covariance = moments(c, at, np.diag(spread**2)[None])
    x = ((np.arange(20000) + 0.5) / 10000 - 1)[:, None]
    middle, wide = c.prior_of_coordinates
    likelihood = np.exp(-0.5 * ((x - at) / spread) ** 2 + 0.5 * ((x - middle) / wide) ** 2)
    weights = likelihood * np.exp(c.slope * x)
    weights /= weights.sum(axis=0)
    every = c.values(np.repeat(x, 4, axis=1))
    mean = (weights * every).sum(axis=0)
    np.testing.assert_allclose(values[0], mean, rtol=1e-6)
    dense = np.sqrt((weights * (every - mean) ** 2).sum(axis=0))
    np.testing.assert_allclose(np.sqrt(np.diag(covariance[0])), np.minimum(dense, c.prior), rtol=1e-5)
