"""Thin decompositions: right for every shape, and not given up where one method fails."""

import numpy as np
import pytest
import scipy.linalg

from dacore.algebra.svd import condensed, left_svd, thin_svd


@pytest.mark.parametrize("shape", [(40, 7), (7, 40), (9, 9), (1, 5), (12, 8)])
def test_factors_are_orthonormal_and_multiply_to_the_matrix(shape):
    matrix = np.random.default_rng(0).normal(size=shape)
    u, s, vt = thin_svd(matrix)
    k = min(shape)
    assert (u.shape, s.shape, vt.shape) == ((shape[0], k), (k,), (k, shape[1]))
    assert np.allclose(u.T @ u, np.eye(k), atol=1e-13)
    assert np.allclose(vt @ vt.T, np.eye(k), atol=1e-13)
    assert np.allclose((u * s) @ vt, matrix, atol=1e-12)
    assert (np.diff(s) <= 0).all()


@pytest.mark.parametrize("shape", [(6, 50), (50, 6)])
def test_left_vectors_are_those_of_the_whole_decomposition(shape):
    # Singular values over twelve decades: a Gram matrix would lose half of them.
    rng = np.random.default_rng(1)
    left, right = (np.linalg.qr(rng.normal(size=(n, 6)))[0] for n in shape)
    values = 10.0 ** -np.linspace(0, 12, 6)
    u, s = left_svd((left * values) @ right.T)
    assert np.allclose(s, values, rtol=1e-3)
    assert np.allclose(np.abs(np.sum(u * left, axis=0)), 1.0, atol=1e-3)


def test_a_method_that_does_not_converge_is_replaced(monkeypatch):
    original, used = scipy.linalg.svd, []

    def stubborn(*arguments, lapack_driver="gesdd", **options):
        used.append(lapack_driver)
        if lapack_driver == "gesdd":
            raise np.linalg.LinAlgError("SVD did not converge")
        return original(*arguments, lapack_driver=lapack_driver, **options)

    monkeypatch.setattr(scipy.linalg, "svd", stubborn)
    matrix = np.random.default_rng(0).normal(size=(5, 4))
    u, s, vt = thin_svd(matrix)
    assert used == ["gesdd", "gesvd"]
    assert np.allclose((u * s) @ vt, matrix)


def test_condensing_keeps_everything_but_round_off():
    rng = np.random.default_rng(3)
    matrix = rng.normal(size=(30, 4)) @ rng.normal(size=(4, 20))
    q, parts = condensed(matrix)
    assert parts.shape == (4, 20)
    assert np.allclose(q @ parts, matrix, atol=1e-12)
    assert condensed(np.zeros((5, 3)))[1].shape[1] == 3
