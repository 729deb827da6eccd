"""What a discretisation is besides its integrals: order of dofs, laziness, evaluation, errors."""

import numpy as np
import pytest
import skfem

from dacore.core.fields import Field
from dacore.core.mesh import Mesh
from dacore.errors import CapabilityError, MeshError, ShapeError
from dacore_skfem import integrals
from dacore_skfem.backend import SkfemBackend


def biot(mesh, order_u=2, order_p=1):
    return SkfemBackend().discretize(mesh, [Field("u", mesh.dim, order_u), Field("p", 1, order_p)])


def every_form(disc):
    return {
        "mass": disc.scalar_mass("p"),
        "stiffness": disc.scalar_stiffness("p"),
        "strain": disc.strain("u"),
        "divergence": disc.divergence("u"),
        "gradient": disc.gradient_coupling("p", "u"),
        "coupling": disc.divergence_coupling("u", "p"),
        "boundary mass": disc.scalar_boundary_mass("p", "left"),
        "boundary coupling": disc.boundary_coupling("p", "u", "side"),
    }


def test_backend_knows_its_version():
    assert SkfemBackend().version() == skfem.__version__
    assert SkfemBackend.name == "skfem"


@pytest.mark.parametrize("dim", [2, 3])
def test_forms_are_sorted_matrices_of_the_layouts_shape(shuffled_box, dim):
    disc = biot(shuffled_box(dim, n=2))
    n_p, n_u = disc.layout.nodes["p"], disc.layout.nodes["u"] * dim
    shapes = {
        "mass": (n_p, n_p), "stiffness": (n_p, n_p), "boundary mass": (n_p, n_p), "strain": (n_u, n_u),
        "divergence": (n_u, n_u), "gradient": (n_u, n_p), "coupling": (n_p, n_u), "boundary coupling": (n_u, n_p),
    }  # fmt: skip
    for name, form in every_form(disc).items():
        assert form.shape == shapes[name], name
        copy = form.copy()
        copy.sum_duplicates()
        np.testing.assert_array_equal(copy.indices, form.indices, err_msg=name)
        assert form.indices.dtype == np.int32, name


@pytest.mark.parametrize(("dim", "order_u", "order_p"), [(2, 2, 1), (3, 2, 1), (3, 1, 2)])
def test_renumbering_the_mesh_permutes_the_forms(shuffled_box, dim, order_u, order_p):
    mesh = shuffled_box(dim, n=2, seed=3, bumpy=True)
    rng = np.random.default_rng(4)
    number = rng.permutation(len(mesh.points))
    points = mesh.points[np.argsort(number)]
    turned = np.roll(mesh.cells, 1, axis=1) if dim == 2 else mesh.cells[:, [1, 2, 0, 3]]
    shuffle = rng.permutation(len(turned))
    other = Mesh(points, number[turned[shuffle]], number[mesh.facets[:, ::-1]], mesh.facet_tags, mesh.roles)

    def match(order):
        rows = {tuple(x): k for k, x in enumerate(np.round(other.nodes(order), 9).tolist())}
        return np.array([rows[tuple(x)] for x in np.round(mesh.nodes(order), 9).tolist()])

    to_p, scalar_u = match(order_p), match(order_u)
    to_u = np.concatenate([c * len(scalar_u) + scalar_u for c in range(dim)])
    ours, theirs = every_form(biot(mesh, order_u, order_p)), every_form(biot(other, order_u, order_p))
    where = {len(to_p): to_p, len(to_u): to_u}
    for name, form in ours.items():
        moved = theirs[name][where[form.shape[0]]][:, where[form.shape[1]]]
        assert abs(form - moved).max() < 1e-14, name


def test_results_do_not_depend_on_how_many_cells_are_integrated_at_once(shuffled_box, monkeypatch):
    mesh = shuffled_box(3, n=2, seed=6)
    whole = every_form(biot(mesh))
    monkeypatch.setattr(integrals, "CHUNK", 7)
    for name, form in every_form(biot(mesh)).items():
        assert abs(form - whole[name]).max() < 1e-15, name


def test_only_what_is_asked_for_is_assembled_and_only_once(shuffled_box, monkeypatch):
    calls = []
    original = skfem.BilinearForm.coo_data
    monkeypatch.setattr(
        skfem.BilinearForm, "coo_data", lambda self, *bases: calls.append(1) or original(self, *bases), raising=True
    )

    def assembled(ask):
        calls.clear()
        ask()
        return len(calls)

    disc = SkfemBackend().discretize(shuffled_box(3, n=2), [Field("u", 3), Field("p", 1), Field("T", 1)])
    assert assembled(lambda: disc.layout) == 0
    assert assembled(lambda: disc.scalar_mass("p")) == 1
    assert assembled(lambda: disc.scalar_mass("T")) == 0
    assert assembled(lambda: disc.scalar_stiffness("p")) == 3
    assert assembled(lambda: disc.strain("u")) == 3
    assert assembled(lambda: disc.divergence("u")) == 0
    assert assembled(lambda: disc.gradient_coupling("p", "u")) == 3
    assert assembled(lambda: disc.divergence_coupling("u", "T")) == 0
    assert disc.strain("u") is disc.strain("u")


def test_forms_do_not_share_memory(shuffled_box):
    disc = biot(shuffled_box(2, n=2), order_u=1)
    forms = list(every_form(disc).values())
    for k, one in enumerate(forms):
        for other in forms[:k]:
            assert not np.shares_memory(one.data, other.data)
            assert not np.shares_memory(one.indices, other.indices)


@pytest.mark.parametrize(("dim", "order"), [(2, 1), (2, 2), (3, 1), (3, 2)])
def test_evaluation_reproduces_polynomials_and_their_derivatives(shuffled_box, dim, order):
    mesh = shuffled_box(dim, n=3, seed=8)
    disc = biot(mesh, order_u=order)
    rng = np.random.default_rng(9)
    a, b = rng.normal(size=dim), rng.normal(size=(dim, dim)) * (order == 2)
    x = np.concatenate([rng.uniform(size=(200, dim)), mesh.points, mesh.points[mesh.facets].mean(axis=1)])
    nodes = mesh.nodes(order)
    values = 1.0 + nodes @ a + np.einsum("pi,ij,pj->p", nodes, b, nodes)
    matrix = disc.evaluation(x, "u")
    assert matrix.shape == (len(x), len(nodes))
    np.testing.assert_allclose(matrix @ values, 1.0 + x @ a + np.einsum("pi,ij,pj->p", x, b, x), atol=1e-12)
    np.testing.assert_allclose(matrix.sum(axis=1), 1.0, atol=1e-12)
    for axis in range(dim):
        slope = disc.evaluation(x, "u", axis) @ values
        np.testing.assert_allclose(slope, a[axis] + x @ (b + b.T)[axis], atol=1e-11)


def test_evaluation_at_the_nodes_is_the_identity(shuffled_box):
    mesh = shuffled_box(3, n=2, seed=10)
    matrix = biot(mesh).evaluation(mesh.nodes(2), "u")
    assert abs(matrix - np.eye(len(mesh.nodes(2)))).max() < 1e-13


def test_errors_name_what_was_given(shuffled_box):
    mesh = shuffled_box(2, n=2)
    disc = biot(mesh)
    for ask in (disc.strain, disc.divergence):
        with pytest.raises(ShapeError, match=r"field p: this form is for a vector field \(2 components\), got 1"):
            ask("p")
    with pytest.raises(ShapeError, match="field u: this form is for a scalar field"):
        disc.gradient_coupling("u", "u")
    with pytest.raises(ShapeError, match="field p: this form is for a vector field"):
        disc.boundary_coupling("p", "p", "left")
    with pytest.raises(CapabilityError, match="field 'T'"):
        disc.scalar_mass("T")
    with pytest.raises(MeshError, match="role 'neck': not on this mesh"):
        disc.scalar_boundary_mass("p", "neck")
    with pytest.raises(ShapeError, match=r"point 1 at \(2, 0.5\) lies outside"):
        disc.evaluation(np.array([[0.5, 0.5], [2.0, 0.5]]), "p")
    with pytest.raises(ShapeError, match="axis of the derivative: got 2, expected 0 to 1"):
        disc.evaluation(np.array([[0.5, 0.5]]), "p", 2)
    with pytest.raises(ShapeError, match="expected at least one"):
        SkfemBackend().discretize(mesh, [])


def test_local_nodes_are_matched_by_place_whatever_scikit_fems_order(monkeypatch):
    class Turned(skfem.ElementTriP2):
        doflocs = skfem.ElementTriP2.doflocs[::-1]

    monkeypatch.setattr(integrals, "_ELEMENTS", {(2, 2): Turned})
    order = integrals.local_order(2, 2)
    monkeypatch.undo()
    np.testing.assert_array_equal(order, integrals.local_order(2, 2)[::-1])


def test_a_surface_costs_only_its_own_cells(shuffled_box):
    mesh = shuffled_box(3, n=6)
    surface = integrals.FacetIntegrals(mesh, "left")
    assert surface._skfem.nelements == len(mesh.boundary_facets("left"))
