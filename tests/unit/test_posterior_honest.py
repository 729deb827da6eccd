"""Claims without noise: exact data of cases solved in full, unseen by the emulation and the reduced model."""

import numpy as np
import pytest
from scipy.sparse import csr_array

from dacore.core.noise import WhiteNoise
from dacore.core.timegrid import TimeGrid
from dacore.dynamics.march import MarchedModel
from dacore.dynamics.newmark import Newmark
from dacore.dynamics.training import draw
from dacore.estimators.posterior import Posterior
from dacore.estimators.posterior_data import shrunk
from dacore.estimators.posterior_smooth import fitted, of_degree
from dacore.reduction.greedy import Settings
from dacore.reduction.training import train_reduced
from dacore.testing.backgrounds import Weighted, functionals_of
from tests.rods import rod

N, CASES = 30, 40


@pytest.fixture(scope="module", params=[(1e-3, 64), (1e-5, 120)], ids=["coarse", "fine"])
def hard(request):
    """Wide ranges and few trajectories."""
    reduction, count = request.param
    wide = rod(N, {"modulus": (2.0, 200.0), "mobility": (0.001, 1.0)})
    model = MarchedModel(wide, TimeGrid(0.02, 15), Newmark(), "zero", tolerance=1e-12)
    samples = draw(model.parameters, count, "latin_hypercube", 3)

    def solve(motions, numbers):
        return [motions.solve(model.parameters.as_mapping(samples[number])) for number in numbers]

    b = train_reduced(model, model.parameters, samples, solve, Settings(reduction), 1e-9).background
    points = draw(model.parameters, CASES, "uniform", 5)
    truth = np.stack([model.solve(model.parameters.as_mapping(row)).states for row in points], axis=2)
    return b, truth, functionals_of(np.eye(2 * N)[[6, 12, 18, 24, 29]])


@pytest.mark.parametrize(("kind", "solves"), [("laplace", 1000), ("laplace", 40), ("sampled", 40)])
def test_exact_data_do_not_make_it_claim_more_than_it_knows(kind, solves, hard):
    b, truth, functionals = hard
    estimate = Posterior(kind, solves=solves).prepare(b, functionals, WhiteNoise(1.0)).estimate(functionals(truth), 0.0)
    weights = np.zeros((2, 2 * N))
    weights[0, N:], weights[1, N + 7] = 1.0 / N, 1.0
    quantity, want = Weighted(weights), np.tensordot(weights, truth, axes=1).mean(axis=1)
    error = estimate.quantity(quantity) - want
    low, high = estimate.interval(quantity, 0.9)
    assert 0.3 < np.sqrt(((error / estimate.standard_deviation(quantity)) ** 2).mean()) < 1.5
    assert ((low <= want) & (want <= high)).mean() > 0.8
    # Every value of the state at one time, in u and in p.
    off = (estimate.state(step=9) - truth[:, 9])[:, :12]
    claimed = np.stack([estimate.deviation(csr_array(np.eye(2 * N)), 9, k) for k in range(12)], axis=1)
    for rows in (slice(1, N), slice(N + 1, 2 * N - 1)):
        ratio = off[rows] / claimed[rows]
        assert 0.3 < np.sqrt((ratio**2).mean()) < 1.5
        assert (np.abs(ratio) < 1.645).mean() > 0.8


def test_a_shrunk_covariance_is_nearer_to_the_true_one_and_never_singular():
    rng = np.random.default_rng(1)
    root = rng.standard_normal((40, 40)) * 0.7 ** np.arange(40)
    true = root @ root.T
    few = root @ rng.standard_normal((40, 30))
    made, plain = shrunk(few), few @ few.T / 30
    assert np.linalg.norm(made - true) <= 1.02 * np.linalg.norm(plain - true)
    assert np.linalg.eigvalsh(made)[0] > 1e-4 * np.trace(true) / 40
    np.testing.assert_allclose(np.trace(made), np.trace(plain))
    many = root @ rng.standard_normal((40, 200_000))
    np.testing.assert_allclose(shrunk(many), true, atol=0.02 * np.abs(true).max())


def test_a_smooth_fit_says_how_wrong_it_is_about_each_point():
    rng = np.random.default_rng(2)
    x, a = rng.uniform(-1, 1, (90, 2)), rng.uniform(-1, 1, (90, 1))

    def smooth(x, a):
        return np.stack([x[:, 0] ** 2 + a[:, 0] * x[:, 1], 1 - 2 * x[:, 0] * x[:, 1]], axis=1)

    found, left = fitted(x, a, smooth(x, a))
    assert np.abs(left).max() < 1e-10
    y, b = rng.uniform(-1, 1, (5, 2)), rng.uniform(-1, 1, (5, 1))
    parts = found(y).reshape(5, 2, 2)
    np.testing.assert_allclose(parts[:, 0] + b * parts[:, 1], smooth(y, b), atol=1e-10)
    # With noise, errors left out are those of a fit without the point.
    noisy = smooth(x, a) + 0.1 * rng.standard_normal((90, 2))
    found, left = fitted(x, a, noisy)
    indices = found.indices
    assert len(indices) == len(of_degree(2, int(indices.sum(axis=1).max())))
    for k in (0, 50):
        rest = np.delete(np.arange(90), k)
        basis = np.concatenate([found.basis(x), a * found.basis(x)], axis=1)
        weights = np.linalg.lstsq(basis[rest], noisy[rest], rcond=None)[0]
        np.testing.assert_allclose(left[k], noisy[k] - basis[k] @ weights, atol=1e-9)
    # Noise alone is left as it is, or a mean is taken off.
    found, _ = fitted(x, a, rng.standard_normal((90, 2)))
    assert found is None or len(found.indices) == 1
