"""Training: what is solved, resumed and reported."""

import numpy as np
import pytest

from dacore.core.model import ForwardModel, Trajectory
from dacore.core.parameters import Parameter, ParameterSpace
from dacore.dynamics.training import draw, solve_all, solving
from dacore.errors import ConvergenceError, ShapeError
from dacore.io.snapshots import TrajectoryStore
from tests.spaces import Chain

PARAMETERS = ParameterSpace((Parameter("a", "cm", 1.0, 2.0), Parameter("b", "1", 3.0, 3.0)))


class Line(ForwardModel):
    """States a·t + b; fails above a limit."""

    def __init__(self, limit=np.inf):
        self.chain, self.limit, self.calls = Chain(4), limit, []

    space = property(lambda self: self.chain)
    parameters = property(lambda self: PARAMETERS)
    times = property(lambda self: np.array([0.5, 1.0]))

    def solve(self, parameters):
        self.calls.append(parameters["a"])
        if parameters["a"] > self.limit:
            raise ConvergenceError("residual 1, wanted 1e-10")
        states = np.outer(np.ones(self.space.n_dofs), parameters["a"] * self.times + parameters["b"])
        return Trajectory(states, self.times)


def test_workers_give_the_same_files(tmp_path):
    samples = draw(PARAMETERS, 5, "sobol", 3)
    one, two = TrajectoryStore(tmp_path / "one", "k"), TrajectoryStore(tmp_path / "two", "k")
    assert solve_all(Line(), PARAMETERS, samples, one) == 5
    assert solve_all(Line(), PARAMETERS, samples, two, workers=2) == 5
    for index in range(5):
        assert np.array_equal(one.read(index)[0].states, two.read(index)[0].states)
        assert np.array_equal(one.read(index)[1], samples[index])


def test_only_what_is_missing_is_solved(tmp_path):
    samples = draw(PARAMETERS, 6, "uniform", 1)
    store = TrajectoryStore(tmp_path, "k")
    solve_all(Line(), PARAMETERS, samples[:4], store)
    model, seen = Line(), []
    assert solve_all(model, PARAMETERS, samples, store, progress=lambda done, total: seen.append((done, total))) == 2
    assert model.calls == samples[4:, 0].tolist()
    assert seen[0] == (4, 6)
    assert seen[-1] == (6, 6)


def test_several_lists_of_samples_solve_each_once(tmp_path):
    samples = draw(PARAMETERS, 6, "uniform", 1)
    store, model = TrajectoryStore(tmp_path, "k"), Line()
    with solving(model, PARAMETERS, samples, store) as solve:
        assert [solve(numbers) for numbers in ([4, 1], [1], [], [0, 4, 5])] == [2, 0, 0, 2]
    assert model.calls == samples[[4, 1, 0, 5], 0].tolist()
    assert solve_all(model, PARAMETERS, samples, store, workers=2) == 2
    assert {index for index in range(6) if index in store} == set(range(6))


def test_two_at_once_share_the_work(tmp_path):
    """The second begins at the other end, and neither solves what the other has finished."""
    samples = draw(PARAMETERS, 8, "uniform", 1)
    store, outer, inner = TrajectoryStore(tmp_path, "k"), Line(), Line()

    def meanwhile(done, _total):
        if done == 2:
            solve_all(inner, PARAMETERS, samples[2:], Shifted(store), progress=stop)

    def stop(done, _total):
        if done == 3:
            raise KeyboardInterrupt

    class Shifted:
        """The store as seen by somebody whose first sample is number 2."""

        def __init__(self, store):
            self.store, self.folder = store, store.folder

        def intact(self, index):
            return self.store.intact(index + 2)

        def write(self, index, *rest):
            self.store.write(index + 2, *rest)

    with pytest.raises(KeyboardInterrupt):
        solve_all(outer, PARAMETERS, samples, store, progress=meanwhile)
    assert inner.calls == samples[:4:-1, 0].tolist()
    assert solve_all(outer, PARAMETERS, samples, store) == 3
    assert outer.calls == samples[:5, 0].tolist()
    assert {path.suffix for path in tmp_path.iterdir()} == {".h5"}


@pytest.mark.parametrize("workers", [1, 2])
def test_a_failure_names_the_sample_and_keeps_what_is_done(tmp_path, workers):
    samples = np.array([[1.1, 3.0], [1.2, 3.0], [1.9, 3.0], [1.3, 3.0]])
    store = TrajectoryStore(tmp_path, "k")
    with pytest.raises(ConvergenceError, match=r"sample 2 \(a = 1.9, b = 3\): residual 1"):
        solve_all(Line(limit=1.5), PARAMETERS, samples, store, workers)
    assert 0 in store
    assert 2 not in store


def test_samples_are_seeded_in_range_and_leave_fixed_parameters_alone():
    for sampling in ("uniform", "latin_hypercube", "sobol"):
        values = draw(PARAMETERS, 33, sampling, 7)
        assert np.array_equal(values, draw(PARAMETERS, 33, sampling, 7))
        assert not np.array_equal(values, draw(PARAMETERS, 33, sampling, 8))
        assert (values[:, 1] == 3.0).all()
        assert ((values[:, 0] >= 1) & (values[:, 0] <= 2)).all()
    strata = np.sort(np.floor((draw(PARAMETERS, 20, "latin_hypercube", 1)[:, 0] - 1) * 20))
    assert np.array_equal(strata, np.arange(20))
    with pytest.raises(ShapeError, match="samples: got 0"):
        draw(PARAMETERS, 0, "uniform", 1)


def test_log_uniform_parameters_fill_the_decades():
    space = ParameterSpace((Parameter("k", "cm^2", 1e-9, 1e-5, "log_uniform"),))
    values = np.log10(draw(space, 4000, "uniform", 2)[:, 0])
    counts, _ = np.histogram(values, bins=[-9, -8, -7, -6, -5])
    assert counts.sum() == 4000
    assert (np.abs(counts - 1000) < 150).all()
