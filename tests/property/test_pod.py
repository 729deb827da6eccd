"""POD in any inner product: orthonormality, optimality, tolerance."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse import csr_array, diags_array

from dacore.algebra.pod import pod
from dacore.core.reduced import ReducedSpace
from dacore.errors import AccuracyError, ShapeError


def product(n: int, rng: np.random.Generator) -> csr_array:
    """A random symmetric positive definite tridiagonal matrix, badly scaled."""
    size = 10.0 ** rng.uniform(-2, 2, n)
    off = 0.3 * np.sqrt(size[1:] * size[:-1])
    return csr_array(diags_array([off, size, off], offsets=[-1, 0, 1]))


@given(n=st.integers(2, 30), count=st.integers(1, 25), seed=st.integers(0, 2**31))
def test_modes_are_orthonormal_and_optimal(n, count, seed):
    rng = np.random.default_rng(seed)
    mass = product(n, rng)
    data = rng.standard_normal((n, count)) * 10.0 ** rng.uniform(-3, 3, count)
    space = pod(data, mass)
    gram = space.basis.T @ (mass @ space.basis)
    assert np.abs(gram - np.eye(space.dimension)).max() < 1e-10
    half = np.linalg.cholesky(mass.toarray())
    exact = np.linalg.svd(half.T @ data, compute_uv=False)
    k = min(len(exact), space.dimension)
    assert np.allclose(space.singular_values[:k], exact[:k], atol=1e-9 * exact[0])
    residual = data - space.lift(space.project(data))
    assert np.linalg.norm(half.T @ residual) <= 1e-9 * np.linalg.norm(half.T @ data)


@given(seed=st.integers(0, 2**31), exponent=st.floats(-9, -1))
def test_tolerance_is_met_below_what_one_gram_matrix_resolves(seed, exponent):
    rng = np.random.default_rng(seed)
    n, count = 60, 40
    mass = product(n, rng)
    left, _ = np.linalg.qr(rng.standard_normal((n, count)))
    right, _ = np.linalg.qr(rng.standard_normal((count, count)))
    data = (left * 10.0 ** -np.linspace(0, 13, count)) @ right.T
    space = pod(data, mass, 10.0**exponent)
    residual = data - space.lift(space.project(data))
    total = np.sqrt(np.einsum("ij,ij->", data, mass @ data))
    assert np.sqrt(max(np.einsum("ij,ij->", residual, mass @ residual), 0)) <= 10.0**exponent * total * 1.02


@given(seed=st.integers(0, 2**31), n=st.integers(1, 6))
def test_projection_is_idempotent_and_leaves_a_residual_orthogonal_to_the_space(seed, n):
    rng = np.random.default_rng(seed)
    mass = product(15, rng)
    space = pod(rng.standard_normal((15, 9)), mass).truncate(n)
    state = rng.standard_normal((15, 3))
    projected = space.lift(space.project(state))
    scale = np.sqrt(np.einsum("ij,ij->j", state, mass @ state)).max()
    assert np.abs(space.project(projected) - space.project(state)).max() < 1e-10 * scale
    assert np.abs(space.basis.T @ (mass @ (state - projected))).max() < 1e-10 * scale


def test_modes_follow_the_corrected_shape_not_the_printed_one():
    """Φ = A B Λ^(−1/2) spans the snapshots; the printed Λ^(−1/2) A B does not even have their shape."""
    rng = np.random.default_rng(0)
    data = rng.standard_normal((12, 5))
    mass = csr_array(np.eye(12))
    values, vectors = np.linalg.eigh(data.T @ data)
    ours = np.abs(pod(data, mass).basis.T @ (data @ vectors / np.sqrt(values))[:, ::-1])
    assert np.allclose(ours, np.eye(5), atol=1e-10)
    with pytest.raises(ValueError, match="matmul"):
        np.diag(values**-0.5) @ data @ vectors


def test_identical_snapshots_leave_one_mode():
    data = np.outer(np.arange(1.0, 9.0), np.ones(6))
    assert pod(data, csr_array(np.eye(8)), 1e-10).dimension == 1


def test_max_rank_and_tails():
    rng = np.random.default_rng(1)
    space = pod(rng.standard_normal((20, 10)), csr_array(np.eye(20)), max_rank=3)
    assert space.dimension == 3
    full = pod(rng.standard_normal((20, 10)), csr_array(np.eye(20)))
    assert full.tails[0] == 1.0
    assert full.tails[-1] == 0.0
    assert (np.diff(full.tails) <= 0).all()


@pytest.mark.parametrize("bad", [np.zeros((4, 3)), np.full((4, 3), np.nan), np.zeros((4, 0))])
def test_useless_snapshots_are_refused(bad):
    with pytest.raises(ShapeError, match="snapshots"):
        pod(bad, csr_array(np.eye(4)))


def test_a_basis_that_is_not_orthonormal_is_refused():
    with pytest.raises(AccuracyError, match="orthonormal"):
        ReducedSpace(np.ones((3, 2)), np.ones(2), csr_array(np.eye(3)))


@pytest.mark.parametrize("seed", range(4))
def test_what_is_left_over_of_dependent_snapshots_is_not_taken_for_modes(seed):
    """Held nodes make the rank smaller than the number of nodes; beyond it there is only round-off."""
    rng = np.random.default_rng(seed)
    free, held, count = 32, 17, 96
    moving = rng.normal(size=(free, free)) * 10.0 ** -np.linspace(0.0, 4.0, free) @ rng.normal(size=(free, count))
    boundary = np.where(np.arange(held)[:, None] < 8, 1e4, rng.uniform(1e4, 1.1e4, count))
    snapshots = np.concatenate([1e4 + moving, boundary])
    off = np.full(free + held - 1, 0.2)
    mass = csr_array(diags_array([off, np.ones(free + held), off], offsets=[-1, 0, 1]))
    space = pod(snapshots, mass, 1e-13)
    assert space.dimension == free + 2
    np.testing.assert_allclose(space.basis.T @ (mass @ space.basis), np.eye(space.dimension), atol=1e-12)
