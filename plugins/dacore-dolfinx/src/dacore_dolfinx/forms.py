"""The weak forms in UFL, as a textbook writes them. Vector functions are a direction times a scalar function.

Block (a, b) of a vector form is the form for a test function along the unit vector a and a trial
function along b. The directions are constants of the compiled form, so that all blocks come of one
kernel, compiled once for each dimension and pair of orders.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import ufl


@dataclass(frozen=True)
class Form:
    """One weak form.

    Parameters
    ----------
    name : str
    integrand : callable
        ``integrand(p, q, a, b, n)`` with trial function p, test function q, directions a and b of
        vectors with them, and the outward normal n.
    degree : callable
        ``degree(trial, test)``: degree of the integrand's polynomial on affine cells; the quadrature is exact for it.
    symmetric : bool
        Block (i, j) is the transpose of block (j, i).
    """

    name: str
    integrand: Callable[[Any, Any, Any, Any, Any], Any]
    degree: Callable[[int, int], int]
    symmetric: bool = False


def _strain(v: Any) -> Any:
    return ufl.sym(ufl.grad(v))


MASS = Form("mass", lambda p, q, a, b, n: p * q, lambda i, j: i + j)
STIFFNESS = Form("stiffness", lambda p, q, a, b, n: ufl.inner(ufl.grad(p), ufl.grad(q)), lambda i, j: i + j - 2)
STRAIN = Form(
    "strain", lambda p, q, a, b, n: ufl.inner(_strain(p * b), _strain(q * a)), lambda i, j: i + j - 2, symmetric=True
)
DIVERGENCE = Form(
    "divergence", lambda p, q, a, b, n: ufl.div(p * b) * ufl.div(q * a), lambda i, j: i + j - 2, symmetric=True
)
GRADIENT_COUPLING = Form(
    "gradient coupling", lambda p, q, a, b, n: ufl.inner(ufl.grad(p), q * a), lambda i, j: i + j - 1
)
DIVERGENCE_COUPLING = Form("divergence coupling", lambda p, q, a, b, n: q * ufl.div(p * b), lambda i, j: i + j - 1)
BOUNDARY_MASS = Form("boundary mass", lambda p, q, a, b, n: p * q, lambda i, j: i + j)
BOUNDARY_COUPLING = Form("boundary coupling", lambda p, q, a, b, n: p * ufl.inner(q * a, n), lambda i, j: i + j)
