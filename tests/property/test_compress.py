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
