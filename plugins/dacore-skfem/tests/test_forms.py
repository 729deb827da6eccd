"""Scalar blocks put together are what scikit-fem's own vector elements give."""

import numpy as np
import pytest

from dacore.core.fields import Field
from dacore.testing.meshes import shuffled_box
from dacore_skfem.backend import SkfemBackend


@pytest.mark.parametrize(("dim", "order"), [(2, 1), (2, 2), (3, 1), (3, 2)])
def test_agrees_with_vector_elements_of_scikit_fem(dim, order):
    import skfem
    from skfem.helpers import ddot, div, sym_grad

    mesh = shuffled_box(dim, n=2, seed=2, bumpy=True)
    disc = SkfemBackend().discretize(mesh, [Field("u", dim, order)])
    kind = {2: "Tri", 3: "Tet"}[dim]
    element = skfem.ElementVector(getattr(skfem, f"Element{kind}P{order}")())
    basis = skfem.Basis(getattr(skfem, f"Mesh{kind}")(mesh.points.T.copy(), mesh.cells.T.copy()), element, intorder=4)
    # Vector element dofs are found again by place and component: scikit-fem numbers them in its own way.
    place = np.round(mesh.nodes(order), 9)
    node = {tuple(x): k for k, x in enumerate(place.tolist())}
    number = np.empty(basis.N, dtype=int)
    for local in range(basis.Nbfun):
        for dof in basis.element_dofs[local]:
            number[dof] = local % dim * len(place) + node[tuple(np.round(basis.doflocs[:, dof], 9).tolist())]
    for form, ours in [
        (lambda u, v, w: ddot(sym_grad(u), sym_grad(v)), disc.strain("u")),
        (lambda u, v, w: div(u) * div(v), disc.divergence("u")),
    ]:
        theirs = skfem.BilinearForm(form).assemble(basis).toarray()
        assert abs(ours[number][:, number].toarray() - theirs).max() < 1e-13
