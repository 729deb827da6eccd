"""The integrands, as scikit-fem's bilinear forms: u is the trial function, v the test function."""

from typing import Any

from skfem import BilinearForm


def product() -> BilinearForm:
    """∫ a b."""
    return BilinearForm(lambda u, v, w: u * v)


def second(i: int, j: int) -> BilinearForm:
    """∫ ∂_i a ∂_j b, a the test function."""
    return BilinearForm(lambda u, v, w: v.grad[i] * u.grad[j])


def first(j: int) -> BilinearForm:
    """∫ a ∂_j b, a the test function."""
    return BilinearForm(lambda u, v, w: v * u.grad[j])


def normal(i: int) -> BilinearForm:
    """∫ a b n_i over a boundary, n the outward normal."""

    def integrand(u: Any, v: Any, w: Any) -> Any:
        return u * v * w.n[i]

    return BilinearForm(integrand)
