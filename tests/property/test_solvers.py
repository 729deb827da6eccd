"""Linear solvers on random quasi-definite systems, against dense ones."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import csr_array

from dacore.algebra.elimination import Ordering
from tests.solvers import make_solver


@st.composite
def systems(draw):
    """A sparse quasi-definite matrix in a random order, its flags, and units up to twelve decades apart."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    first, second = draw(st.integers(1, 400)), draw(st.integers(0, 200))
    n = first + second
    density = draw(st.sampled_from([0.0, 0.5 / n, 2.0 / n, 0.2]))

    def sparse(rows, columns):
        return np.where(rng.random((rows, columns)) < density, rng.normal(size=(rows, columns)), 0.0)

    def definite_block(size):
        root = sparse(size, size)
        return root @ root.T + np.diag(rng.uniform(0.5, 2.0, size))

    coupling = sparse(second, first)
    matrix = np.block([[definite_block(first), coupling.T], [coupling, -definite_block(second)]])
    order = rng.permutation(n)
    decades = draw(st.integers(0, 12))
    units = 10.0 ** rng.uniform(-decades, decades, n)
    definite = (np.arange(n) < first)[order]
    return matrix[np.ix_(order, order)], definite, units, rng


@pytest.mark.parametrize("method", ["direct", "krylov", "auto"])
@settings(max_examples=40, deadline=None)
@given(system=systems(), columns=st.integers(1, 3))
def test_any_quasi_definite_system_in_any_units(method, system, columns):
    matrix, definite, units, rng = system
    wanted = rng.normal(size=(len(units), columns))
    scaled = csr_array(matrix * units * units[:, None])
    rhs = units[:, None] * (matrix @ wanted)
    solution = make_solver(scaled, definite, method, 1e-12).solve(rhs) * units[:, None]
    bound = 1e-10 * np.linalg.cond(matrix) * np.linalg.norm(wanted)
    assert np.linalg.norm(solution - wanted) <= bound


@settings(max_examples=40, deadline=None)
@given(system=systems())
def test_orderings_permute_and_nest(system):
    matrix, definite, _, _ = system
    ordering = Ordering.of(csr_array(matrix), definite)
    n = len(definite)
    np.testing.assert_array_equal(np.sort(ordering.permutation), np.arange(n))
    assert sum(front.size for front in ordering.fronts) == n
    for i, front in enumerate(ordering.fronts):
        split = definite[ordering.permutation[front.start : front.start + front.size]]
        assert split[: front.definite].all()
        assert not split[front.definite :].any()
        assert all(child < i for child in front.children)
    # Eliminating in this order fills nothing that no front has room for.
    permuted = (matrix != 0.0)[np.ix_(ordering.permutation, ordering.permutation)]
    for front in ordering.fronts:
        stop = front.start + front.size
        touched = np.flatnonzero(permuted[:, front.start : stop].any(axis=1))
        touched = touched[touched >= stop]
        assert np.isin(touched, front.rows).all()
        permuted[np.ix_(front.rows, front.rows)] = True
