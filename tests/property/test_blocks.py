"""Matrices that fall apart into blocks: the same answers as dense algebra, each different block handled once."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse import csr_array

import dacore.algebra.gram as gram_module
from dacore.algebra.blocks import Blocks
from dacore.algebra.gram import RieszMap, lower_solve, lower_transpose_solve, orthonormaliser
from dacore.errors import ShapeError, UnstableError
from tests.spaces import Chain, functionals_of

SIZES = st.lists(st.tuples(st.integers(1, 6), st.integers(1, 3)), min_size=1, max_size=4)


def scattered(rng, sizes):
    """A symmetric positive definite matrix with blocks (size, copies) on shuffled rows."""
    total = sum(size * copies for size, copies in sizes)
    rows = rng.permutation(total)
    matrix, start = np.zeros((total, total)), 0
    for size, copies in sizes:
        root = rng.standard_normal((size, size + 2))
        for _ in range(copies):
            place = np.sort(rows[start : start + size])
            matrix[np.ix_(place, place)] = root @ root.T + np.eye(size)
            start += size
    return matrix


@given(seed=st.integers(0, 2**31), sizes=SIZES)
def test_blocks_are_found_and_put_together_again(seed, sizes):
    matrix = scattered(np.random.default_rng(seed), sizes)
    blocks = Blocks.of(matrix)
    assert np.array_equal(blocks.dense(), matrix)
    assert sum(len(places) for places, _ in blocks.parts) == sum(copies for _, copies in sizes)
    assert len(blocks.parts) == len(sizes)
    values = np.random.default_rng(seed).standard_normal((len(matrix), 2, 3))
    assert np.allclose(blocks @ values, np.tensordot(matrix, values, axes=1), atol=1e-10)


@given(seed=st.integers(0, 2**31), sizes=SIZES, masked=st.booleans())
def test_factor_solves_as_the_dense_one(seed, sizes, masked):
    rng = np.random.default_rng(seed)
    matrix = scattered(rng, sizes)
    labels = tuple(f"l{i}" for i in range(len(matrix)))
    mask = rng.random(len(matrix)) < 0.6 if masked else None
    if mask is not None:
        mask[rng.integers(len(mask))] = True
    part = matrix if mask is None else matrix[np.ix_(mask, mask)]
    factor = orthonormaliser(Blocks.of(matrix), labels, mask)
    dense = orthonormaliser(matrix, labels, mask)
    assert factor.shape == part.shape
    assert np.allclose(dense, np.linalg.cholesky(part), atol=1e-10)
    assert np.array_equal(factor.dense(), dense)
    for shape in ((), (4,), (2, 3)):
        values = rng.standard_normal((len(part), *shape))
        for solve in (lower_solve, lower_transpose_solve):
            assert np.allclose(solve(factor, values), solve(dense, values), atol=1e-9)


@pytest.mark.parametrize("kind", [np.asarray, Blocks.of])
def test_dependent_rows_are_named_the_closest_pair_of_all_blocks(kind):
    matrix = np.eye(6)
    matrix[0, 1] = matrix[1, 0] = 0.5
    matrix[3, 5] = matrix[5, 3] = 1.0 - 1e-16
    with pytest.raises(UnstableError, match=r"closest pair is d and f \(cosine 1\.000000000\); drop duplicates"):
        orthonormaliser(kind(matrix), tuple("abcdef"))
    mask = np.arange(6) != 5
    assert orthonormaliser(kind(matrix), tuple("abcdef"), mask).shape == (5, 5)


def test_a_chain_is_one_block():
    chain = 3.0 * np.eye(50) + np.eye(50, k=1) + np.eye(50, k=-1)
    assert [places.shape for places, _ in Blocks.of(chain).parts] == [(1, 50)]


def test_rows_left_out_or_named_twice_are_refused():
    with pytest.raises(ShapeError, match="their rows number 2, expected each of 3 once"):
        Blocks(3, [(np.array([[0, 1]]), np.eye(2))])
    with pytest.raises(ShapeError, match="triangular system: got 2 rows, expected 3"):
        lower_solve(orthonormaliser(Blocks.of(np.eye(3)), ("a", "b", "c")), np.ones(2))


WEIGHTS = {"u": 2.0, "p": 1e-3}


def exact_gram(space, functionals, weights):
    dense = functionals.matrix.toarray()
    return dense @ np.linalg.solve(space.inner_product(weights).toarray(), dense.T)


def image(space, rng, sites, components=(0, 1), field="u"):
    """The same scalar functionals on several components."""
    scalar = csr_array(rng.standard_normal((sites, space.layout.block("p").stop - space.layout.block("p").start)))
    return space.place(scalar, field, components)


def measured(*rows):
    return functionals_of(np.concatenate([each.toarray() for each in rows]))


@pytest.mark.parametrize("portion", [1, 2**24])
def test_gram_matrix_of_an_image_is_one_block_on_every_component(portion, monkeypatch):
    monkeypatch.setattr(gram_module, "_PORTION", portion)
    rng = np.random.default_rng(0)
    space = Chain(12)
    functionals = measured(image(space, rng, 5))
    riesz = RieszMap(space, functionals, WEIGHTS)
    assert [(places.shape, block.shape) for places, block in riesz.blocks.parts] == [((2, 5), (5, 5))]
    assert np.allclose(riesz.gram, exact_gram(space, functionals, WEIGHTS), rtol=1e-10)
    other = measured(image(space, rng, 3, (1,)))
    mass = space.inner_product(WEIGHTS).toarray()
    pair = other.matrix.toarray() @ np.linalg.solve(mass, functionals.matrix.toarray().T)
    assert np.allclose(riesz.pair(other), pair, atol=1e-10 * np.abs(pair).max())


def test_functionals_across_components_and_fields_join_their_blocks():
    """Directions see two components, one row sees both fields: blocks grow by what they share, no more."""
    rng = np.random.default_rng(1)
    space = Chain(12)
    n = space.layout.block("p").stop - space.layout.block("p").start
    slanted = csr_array(space.place(csr_array(rng.standard_normal((2, n))), "u", (0,))) + space.place(
        csr_array(rng.standard_normal((2, n))), "u", (1,)
    )
    pressure = space.place(csr_array(rng.standard_normal((3, n))), "p", (0,))
    apart = measured(image(space, rng, 4), slanted, pressure)
    riesz = RieszMap(space, apart, WEIGHTS)
    assert sorted(block.shape for _, block in riesz.blocks.parts) == [(3, 3), (10, 10)]
    exact = exact_gram(space, apart, WEIGHTS)
    size = np.sqrt(np.outer(np.diag(exact), np.diag(exact)))
    assert (np.abs(riesz.gram - exact) <= 1e-10 * size).all()
    both = slanted[[0]] + pressure[[0]]
    joined = measured(apart.matrix, both)
    riesz = RieszMap(space, joined, WEIGHTS)
    assert [block.shape for _, block in riesz.blocks.parts] == [(14, 14)]
    exact = exact_gram(space, joined, WEIGHTS)
    size = np.sqrt(np.outer(np.diag(exact), np.diag(exact)))
    assert (np.abs(riesz.gram - exact) <= 1e-10 * size).all()
    # A field's part of the matrix, and the parts of all fields add up.
    parts = riesz.field_gram("u").dense() + riesz.field_gram("p").dense()
    assert (np.abs(parts - riesz.gram) <= 1e-12 * size).all()
    z = rng.standard_normal((joined.count, 2))
    assert np.allclose(riesz.field_gram("p") @ z, riesz.field_gram("p").dense() @ z)
