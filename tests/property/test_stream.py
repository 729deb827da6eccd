"""POD of a stream: the promised error whatever the spectrum, the order and the width; memory by counting bytes."""

import tracemalloc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse import csr_array, diags_array

from dacore.algebra.hapod import hapod
from dacore.algebra.pod import pod
from dacore.algebra.stream import Stream, room
from dacore.errors import AccuracyError, ShapeError

GIB = 2**30


def mass(n, rng):
    """A random symmetric positive definite tridiagonal matrix, badly scaled."""
    size = 10.0 ** rng.uniform(-2, 2, n)
    off = 0.3 * np.sqrt(size[1:] * size[:-1])
    return csr_array(diags_array([off, size, off], offsets=[-1, 0, 1]))


def orthonormal(n, r, product, rng):
    modes = rng.standard_normal((n, r))
    for _ in range(2):
        modes = np.linalg.solve(np.linalg.cholesky(modes.T @ (product @ modes)), modes.T).T
    return modes


SPECTRA = {
    "exponential": lambda r: 10.0 ** -np.linspace(0, 13, r),
    "flat": lambda r: np.ones(r),
    "slow": lambda r: 1.0 / np.arange(1, r + 1),
    "one mode and a floor": lambda r: np.concatenate([[1.0], np.full(r - 1, 1e-7)]),
    "steps": lambda r: np.repeat(10.0 ** -np.arange(0.0, 16.0, 4.0), -(-r // 4))[:r],
}
ORDERS = {
    "as drawn": lambda data, rng: data,
    "smallest first": lambda data, rng: data[:, np.argsort(np.linalg.norm(data, axis=0))],
    "largest first": lambda data, rng: data[:, np.argsort(-np.linalg.norm(data, axis=0))],
    "growing by sixteen decades": lambda data, rng: data * 10.0 ** np.linspace(-12, 4, data.shape[1]),
    "one direction at a time": lambda data, rng: np.linalg.qr(data)[0] * np.linspace(1e-9, 1, min(data.shape)),
    "each twice": lambda data, rng: np.repeat(data, 2, axis=1),
    "zeros between": lambda data, rng: data * (np.arange(data.shape[1]) % 3 == 2),
}


def norm(data, product):
    return np.sqrt(max(np.einsum("ij,ij->", data, product @ data), 0.0))


def hostile(rng, n, count, spectrum, order):
    product = mass(n, rng)
    r = min(n, count)
    data = (orthonormal(n, r, product, rng) * SPECTRA[spectrum](r)) @ np.linalg.qr(rng.standard_normal((count, r)))[0].T
    return product, ORDERS[order](data, rng)


@given(
    seed=st.integers(0, 2**31),
    spectrum=st.sampled_from(sorted(SPECTRA)),
    order=st.sampled_from(sorted(ORDERS)),
    width=st.integers(1, 70),
    exponent=st.floats(-11, -1),
    cuts=st.integers(1, 12),
)
def test_the_error_is_kept_and_told_whatever_comes_in_whatever_order(seed, spectrum, order, width, exponent, cuts):
    rng = np.random.default_rng(seed)
    product, data = hostile(rng, 40, 60, spectrum, order)
    before = data.copy()
    tolerance = 10.0**exponent
    stream = Stream(product, tolerance, data.shape[1], width, keep=True)
    for block in np.array_split(data, cuts, axis=1):
        stream.add(block)
    found = stream.finish()
    size = norm(data, product)
    assert np.array_equal(data, before)
    assert found.coefficients.shape == (found.basis.shape[1], data.shape[1])
    told = norm(data - found.basis @ found.coefficients, product) / size
    projected = norm(data - found.basis @ (found.basis.T @ (product @ data)), product) / size
    assert projected <= told * (1 + 1e-6) + 1e-14
    # What is told bounds the error, and is kept; only cuts and drops in the same direction make them equal.
    assert told <= found.error * (1 + 1e-9) + 1e-14  # round-off
    assert found.error <= tolerance
    assert found.error <= 2.5 * told + 2e-7
    assert np.isclose(found.total, size**2, rtol=1e-10)
    gram = found.basis.T @ (product @ found.basis)
    assert np.abs(gram - np.eye(len(gram))).max() < 1e-11


@given(seed=st.integers(0, 2**31), spectrum=st.sampled_from(sorted(SPECTRA)), width=st.integers(1, 70))
def test_singular_values_are_those_of_the_whole_set_to_round_off(seed, spectrum, width):
    rng = np.random.default_rng(seed)
    product, data = hostile(rng, 40, 60, spectrum, "as drawn")
    values = hapod(np.array_split(data, 7, axis=1), product, 0.0, 60, width).singular_values
    exact = np.linalg.svd(np.linalg.cholesky(product.toarray()).T @ data, compute_uv=False)
    assert np.abs(values - exact[: len(values)]).max() <= 2e-14 * exact[0]
    assert (exact[len(values) :] <= 1e-13 * exact[0]).all()


@given(seed=st.integers(0, 2**31), order=st.sampled_from(sorted(ORDERS)), exponent=st.integers(-8, -2))
def test_streamed_and_at_once_are_equal_within_the_tolerance(seed, order, exponent):
    rng = np.random.default_rng(seed)
    product, data = hostile(rng, 40, 60, "exponential", order)
    tolerance = 10.0**exponent
    streamed = hapod(np.array_split(data, 13, axis=1), product, tolerance, data.shape[1], 8)
    at_once = pod(data, product, tolerance)
    size = norm(data, product)
    k = min(streamed.dimension, at_once.dimension)
    # Weyl: what each leaves out moves singular values by no more than itself.
    off = np.abs(streamed.singular_values[:k] - at_once.singular_values[:k])
    assert off.max() <= 2.0 * tolerance * size
    # No more modes than half the tolerance takes at best.
    exact = np.linalg.svd(np.linalg.cholesky(product.toarray()).T @ data, compute_uv=False)
    tails = np.sqrt(np.append(np.cumsum(exact[::-1] ** 2)[::-1], 0.0))
    best = int(np.argmax(tails <= 0.5 * tolerance * size))
    assert streamed.dimension <= max(best, 1)
    assert at_once.dimension <= max(best, 1)


@pytest.mark.parametrize("steps", [1, 10, 61, 10**6])
def test_a_wrong_number_of_snapshots_costs_no_accuracy(steps):
    rng = np.random.default_rng(5)
    product, data = hostile(rng, 40, 60, "exponential", "as drawn")
    found = hapod(np.array_split(data, 9, axis=1), product, 1e-6, steps, 10)
    assert norm(data - found.lift(found.project(data)), product) <= 1e-6 * norm(data, product)


class Many:
    """Snapshots of length n made on the way, so that only the method holds any."""

    def __init__(self, n, count, rank, smallest=1e-12):
        rng = np.random.default_rng(1)
        self.product = mass(n, rng)
        self.modes = orthonormal(n, rank, self.product, rng)
        self.values = smallest ** np.linspace(0, 1, rank)
        self.right = np.linalg.qr(rng.standard_normal((count, rank)))[0]
        self.count, self.n = count, n

    def blocks(self, width):
        for start in range(0, self.count, width):
            yield (self.modes * self.values) @ self.right[start : start + width].T

    def peak(self, width, **settings):
        """Bytes held at the most, and what came out."""
        tracemalloc.start()
        try:
            found = hapod(self.blocks(width), self.product, steps=self.count, **settings)
            return tracemalloc.get_traced_memory()[1], found
        finally:
            tracemalloc.stop()


def test_memory_does_not_grow_with_the_number_of_snapshots():
    n, block = 20_000, 20
    few, many = Many(n, 400, 60), Many(n, 1600, 60)
    peaks = [each.peak(block, tolerance=1e-6)[0] for each in (few, many)]
    assert peaks[1] <= 1.1 * peaks[0]
    # Room for 64 snapshots, 64 modes and a few more of either, the block that comes, and what its making takes.
    assert peaks[1] <= 8 * n * (64 + 64 + 64 + 32 + block + 60)
    assert peaks[1] <= 0.2 * 8 * n * many.count


@pytest.mark.parametrize("memory", [0.02, 0.03, 0.05])
def test_memory_stays_within_its_bound(memory):
    n, block = 20_000, 10
    many = Many(n, 800, 60)
    peak, found = many.peak(block, tolerance=1e-6, memory=memory)
    # Beside the bound, the block that has just come and the product it is made of.
    assert peak <= memory * GIB + 8 * n * (block + 60)
    residual = [part - found.lift(found.project(part)) for part in many.blocks(100)]
    assert norm(np.concatenate(residual, axis=1), many.product) <= 1e-6 * np.linalg.norm(many.values)


def test_more_modes_than_fit_are_refused_and_say_so():
    many = Many(5_000, 400, 60, smallest=0.5)
    with pytest.raises(AccuracyError, match=r"0\.003 GiB have room for \d+ .* raise the memory or the tolerance"):
        hapod(many.blocks(20), many.product, 1e-6, 400, memory=0.003)


def test_a_memory_for_nothing_is_refused_at_once():
    with pytest.raises(ShapeError, match=r"memory: got 0\.0001 GiB, expected at least .* raise it"):
        room(1e-4, 100_000)


def test_modes_that_turn_out_small_are_dropped_on_the_way():
    """Small snapshots first, each new; then a large one beside which none counts: they do not stay in memory."""
    rng = np.random.default_rng(2)
    n = 600
    product = mass(n, rng)
    small = 1e-9 * orthonormal(n, 300, product, rng)
    large = orthonormal(n, 2, product, rng)
    stream = Stream(product, 1e-4, 302, 20)
    stream.add(small)
    assert stream.count >= 250
    stream.add(np.repeat(large, 300, axis=1) + 1e-3 * orthonormal(n, 1, product, rng))
    for _ in range(20):
        stream.add(large[:, [0]] + 1e-2 * orthonormal(n, 20, product, rng))
    assert stream.finish().basis.shape[1] < 450


@pytest.mark.parametrize("width", [0, -3])
def test_a_width_of_nothing_is_refused(width):
    with pytest.raises(ShapeError, match="width: got"):
        hapod([np.ones((3, 1))], csr_array(np.eye(3)), 1e-6, 1, width)


def test_useless_streams_are_refused():
    eye = csr_array(np.eye(4))
    with pytest.raises(ShapeError, match="got none"):
        hapod([], eye, 1e-6, 0)
    with pytest.raises(ShapeError, match="sum of their squares is 0"):
        hapod([np.zeros((4, 3))], eye, 1e-6, 3)
    with pytest.raises(ShapeError, match="finite values only"):
        hapod([np.ones((4, 3)), np.full((4, 1), np.nan)], eye, 1e-6, 4)
    with pytest.raises(ShapeError, match=r"got shape \(5, 2\), expected \(4, k\)"):
        hapod([np.ones((5, 2))], eye, 1e-6, 2)
