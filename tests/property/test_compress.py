"""Compression of training sets: the promised error, whatever the order and the width of the stream."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dacore.algebra.compress import compress
from dacore.algebra.hapod import hapod
from dacore.core.model import Trajectory
from dacore.core.parameters import Parameter, ParameterSpace
from dacore.errors import ShapeError
from tests.spaces import Chain

SPACE = ParameterSpace((Parameter("a", "1", 0.0, 1.0),))


def decaying(rng, n, count, decades):
    left = np.linalg.qr(rng.standard_normal((n, min(n, count))))[0]
    right = np.linalg.qr(rng.standard_normal((count, min(n, count))))[0]
    return (left * 10.0 ** -np.linspace(0, decades, min(n, count))) @ right.T


@given(seed=st.integers(0, 2**31), width=st.integers(5, 60), exponent=st.integers(-8, -2))
def test_hierarchical_pod_keeps_its_promise(seed, width, exponent):
    rng = np.random.default_rng(seed)
    space = Chain(15)
    product = space.field_product("u")
    data = decaying(rng, 30, 50, 12)
    tolerance = 10.0**exponent
    basis = hapod(iter(np.array_split(data, 9, axis=1)), product, tolerance, 50, width)
    residual = data - basis.lift(basis.project(data))
    error = np.sqrt(np.einsum("ij,ij->", residual, product @ residual) / np.einsum("ij,ij->", data, product @ data))
    assert error <= tolerance


@given(seed=st.integers(0, 2**31))
def test_fields_of_any_scale_are_kept_to_the_same_relative_error(seed):
    """p of 1e4 beside u of 1e-6: no weight between them is needed."""
    rng = np.random.default_rng(seed)
    space = Chain(12)
    scale = np.concatenate([np.full(24, 1e-6), np.full(12, 1e4)])[:, None]
    times = np.arange(1.0, 5.0)
    trajectories = [Trajectory(scale * decaying(rng, 36, 4, 3), times) for _ in range(10)]
    background = compress(space, trajectories, SPACE, rng.random((10, 1)), 1e-6, threads=2)
    for k, trajectory in enumerate(trajectories):
        found = background.lift(background.coefficients[:, :, k])
        for name in ("u", "p"):
            block = space.layout.block(name)
            left = np.linalg.norm(found[block] - trajectory.states[block])
            assert left <= 1e-4 * np.linalg.norm(trajectory.states[block])
    assert max(background.compression.values()) <= 1e-6


def test_weighted_norm_is_the_norm_of_scaled_coefficients():
    rng = np.random.default_rng(3)
    space = Chain(12)
    times = np.arange(1.0, 4.0)
    trajectories = [Trajectory(rng.standard_normal((36, 3)), times) for _ in range(5)]
    background = compress(space, trajectories, SPACE, rng.random((5, 1)), 1e-12)
    weights = {"u": 2.0, "p": 1e-9}
    product = space.inner_product(weights)
    state = trajectories[2].states[:, 1]
    scaled = background.scale(weights) * background.coefficients[:, 1, 2]
    assert np.isclose(state @ (product @ state), scaled @ scaled, rtol=1e-10)


def test_nothing_to_compress():
    with pytest.raises(ShapeError, match="got no trajectory"):
        compress(Chain(4), [], SPACE, np.zeros((0, 1)))


class Counted:
    """Trajectories that count how often each is read."""

    def __init__(self, trajectories):
        self.trajectories, self.reads = trajectories, [0] * len(trajectories)

    def __len__(self):
        return len(self.trajectories)

    def __getitem__(self, index):
        return self.trajectories[index]

    def __iter__(self):
        for k, trajectory in enumerate(self.trajectories):
            self.reads[k] += 1
            yield trajectory


def test_every_trajectory_is_passed_once_and_none_twice():
    rng = np.random.default_rng(6)
    space = Chain(12)
    times = np.arange(1.0, 5.0)
    counted = Counted([Trajectory(decaying(rng, 36, 4, 3), times) for _ in range(7)])
    told = []
    background = compress(space, counted, SPACE, rng.random((7, 1)), progress=lambda *done: told.append(done))
    assert counted.reads == [1] * 7
    assert told == [(k + 1, 7) for k in range(7)]
    for k, trajectory in enumerate(counted.trajectories):
        lifted = background.lift(background.coefficients[:, :, k])
        assert np.linalg.norm(lifted - trajectory.states) <= 1e-4 * np.linalg.norm(trajectory.states)


def test_threads_and_memory_change_nothing_but_the_width():
    rng = np.random.default_rng(7)
    space = Chain(3000)
    modes = rng.standard_normal((9000, 6))
    times = np.arange(1.0, 5.0)
    trajectories = [Trajectory(modes @ rng.standard_normal((6, 4)), times) for _ in range(10)]
    samples = rng.random((10, 1))
    plain = compress(space, trajectories, SPACE, samples, 1e-9)
    threads = compress(space, trajectories, SPACE, samples, 1e-9, threads=2)
    small = compress(space, trajectories, SPACE, samples, 1e-9, memory=0.004)
    assert np.array_equal(plain.coefficients, threads.coefficients)
    for background in (plain, small):
        assert background.coefficients.shape == (12, 4, 10)
        assert max(background.compression.values()) <= 1e-9
        lifted = background.lift(background.coefficients[:, :, 3])
        assert np.linalg.norm(lifted - trajectories[3].states) <= 1e-8 * np.linalg.norm(trajectories[3].states)


def test_a_memory_too_small_for_one_trajectory_and_a_trajectory_of_another_length_are_refused():
    rng = np.random.default_rng(8)
    space = Chain(12)
    times = np.arange(1.0, 5.0)
    trajectories = [Trajectory(rng.standard_normal((36, 4)), times) for _ in range(2)]
    with pytest.raises(ShapeError, match=r"memory: got 1e-07 GiB, and one trajectory alone takes .* raise"):
        compress(space, trajectories, SPACE, rng.random((2, 1)), memory=1e-7)
    trajectories.append(Trajectory(rng.standard_normal((36, 3)), times[:3]))
    with pytest.raises(ShapeError, match=r"trajectory 2 has states \(36, 3\), expected \(36, 4\)"):
        compress(space, trajectories, SPACE, rng.random((3, 1)))
