"""What is scikit-fem's own: how forms are assembled and at what cost. The contract is in test_backend.py."""

import numpy as np
import pytest
import skfem

from dacore.core.fields import Field
from dacore.errors import CapabilityError, MeshError, ShapeError
from dacore.testing.meshes import shuffled_box
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


def test_results_do_not_depend_on_how_many_cells_are_integrated_at_once(monkeypatch):
    mesh = shuffled_box(3, n=2, seed=6)
    whole = every_form(biot(mesh))
    monkeypatch.setattr(integrals, "CHUNK", 7)
    for name, form in every_form(biot(mesh)).items():
        assert abs(form - whole[name]).max() < 1e-15, name


def test_only_what_is_asked_for_is_assembled_and_only_once(monkeypatch):
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


def test_errors_name_what_was_given():
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


def test_a_surface_costs_only_its_own_cells():
    mesh = shuffled_box(3, n=6)
    surface = integrals.FacetIntegrals(mesh, "left")
    assert surface._skfem.nelements == len(mesh.boundary_facets("left"))
