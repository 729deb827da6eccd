"""Coefficients of the equations, and the printed formulas that are wrong."""

import numpy as np
import pytest

from dacore.errors import ShapeError
from dacore_biot import material
from dacore_biot.model import Biot

THETA = {
    "E": 4e5, "nu": 0.3, "alpha": 0.7, "skempton": 0.8, "density": 1.1, "viscosity": 2e-2, "kappa": 3e-9,
}  # fmt: skip


def energy(model, gradient):
    """½ uᵀ A u per volume for the displacement u = (gradient) x."""
    layout, mesh = model.space.layout, model.space.discretization.mesh
    state = np.zeros(layout.n_dofs)
    state[layout.block("u")] = (mesh.points @ gradient.T).T.ravel()
    terms = sum(t.coefficient(THETA) * (state @ (t.matrix @ state)) for t in model.zeroth_order)
    return 0.5 * terms / mesh.volumes.sum()


def test_hooke_of_a_uniaxial_stretch_and_a_shear(head, on):
    """The weak form is printed with 2E(ε, ε); Hooke's law of the same paper has 2μ_s = E/(1 + ν)."""
    model, e, nu = Biot().build(on(head())), THETA["E"], THETA["nu"]
    # Constrained stretch: the oedometer modulus E(1 − ν)/((1 + ν)(1 − 2ν)), written without Lamé's constants.
    oedometer = e * (1 - nu) / ((1 + nu) * (1 - 2 * nu))
    assert energy(model, np.diag([0.1, 0, 0])) == pytest.approx(0.5 * oedometer * 0.1**2, rel=1e-12)
    # Free stretch: the sides contract by ν, and Young's modulus is what is left.
    assert energy(model, 0.1 * np.diag([1, -nu, -nu])) == pytest.approx(0.5 * e * 0.1**2, rel=1e-12)
    # Simple shear: E/(2(1 + ν)).
    shear = np.zeros((3, 3))
    shear[0, 1] = 0.1
    assert energy(model, shear) == pytest.approx(0.5 * e / (2 * (1 + nu)) * 0.1**2, rel=1e-12)
    assert energy(model, np.array([[0, 0.1, 0], [-0.1, 0, 0], [0, 0, 0]])) == pytest.approx(0, abs=1e-8 * e)


def test_mass_balance_has_alpha(head, on):
    """Swelling at the rate ∇·u̇ = 3 takes up 3α of fluid per volume; printed without α."""
    model = Biot().build(on(head()))
    layout, mesh = model.space.layout, model.space.discretization.mesh
    rate = np.zeros(layout.n_dofs)
    rate[layout.block("u")] = mesh.points.T.ravel()
    fluid = sum(t.coefficient(THETA) * (t.matrix @ rate)[layout.block("p")].sum() for t in model.first_order)
    assert fluid == pytest.approx(3 * THETA["alpha"] * mesh.volumes.sum(), rel=1e-12)


def test_storage_and_mobility():
    assert material.storage(THETA) == pytest.approx(3 * 0.7 * (1 - 0.7 * 0.8) * (1 - 0.6) / (0.8 * 4e5))
    assert material.storage(THETA | {"alpha": 1.0, "skempton": 1.0}) == 0.0
    assert material.mobility(THETA) == pytest.approx(1.5e-7)


@pytest.mark.parametrize(
    ("name", "value", "allowed"),
    [
        ("nu", 0.5, r"\(-1, 0.5\)"),
        ("nu", -1.0, r"\(-1, 0.5\)"),
        ("E", 0.0, r"\(0, inf\)"),
        ("E", -1.0, r"\(0, inf\)"),
        ("E", float("nan"), r"\(0, inf\)"),
        ("skempton", 0.0, r"\(0, 1\]"),
        ("skempton", 1.1, r"\(0, 1\]"),
        ("alpha", 1.5, r"\(0, 1\]"),
        ("density", 0.0, r"\(0, inf\)"),
        ("viscosity", 0.0, r"\(0, inf\)"),
        ("kappa", -1e-9, r"\[0, inf\)"),
    ],
)
def test_values_outside_physics_are_refused(name, value, allowed):
    functions = (material.density, material.alpha, material.lame, material.storage, material.mobility)
    refused = 0
    for function in functions:
        try:
            function(THETA | {name: value})
        except ShapeError as error:
            refused += 1
            message = str(error)
    assert refused
    with pytest.raises(ShapeError, match=f"{name}: got .*, expected a value in {allowed}"):
        raise ShapeError(message)
    if np.isfinite(value):
        with pytest.raises(ShapeError, match=f"{name}: got"):
            Biot(ranges={name: (value, value)})
