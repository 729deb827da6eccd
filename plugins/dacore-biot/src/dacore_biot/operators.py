"""The parameter-free matrices of dynamic poroelasticity in (u, p).

Weak form, tested with v and q (the paper, section 2, with 2μ_s in place of the printed 2E and with α
in the mass balance)::

    ρ(ü, v) + 2μ_s(ε(u), ε(v)) + λ(∇·u, ∇·v) + α(∇p, v) = (g, v)
    S(ṗ, q) + α(∇·u̇, q) + (κ/μ_f)(∇p, ∇q) = 0

They are seven, and one or two more with a stabilization of `dacore_biot.stabilization`.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.sparse import block_diag, csr_array

from dacore.core.arrays import Array, BoolArray, Sparse
from dacore.core.discretization import Discretization
from dacore.core.fields import Field
from dacore.core.model import AffineTerm, Coefficient
from dacore.errors import ShapeError
from dacore_biot import material
from dacore_biot.stabilization import cell_mean_mass, less_than_lumped, projected_gradients

DISPLACEMENT, PRESSURE = "u", "p"

Stabilization = Literal["none", "lumped", "projected"]


def biot_fields(dim: int, displacement_order: int = 1) -> tuple[Field, Field]:
    """Displacement (d components) and pressure (order 1)."""
    return (
        Field(DISPLACEMENT, dim, displacement_order, "cm"),
        Field(PRESSURE, 1, 1, "dyn/cm^2"),
    )


@dataclass(frozen=True, eq=False)
class BiotTerms:
    """Terms of M, C and A, and the rows of the flow equation.

    Parameters
    ----------
    second_order, first_order, zeroth_order : tuple of AffineTerm
    flow : (n_dofs,) bool array
    """

    second_order: tuple[AffineTerm, ...]
    first_order: tuple[AffineTerm, ...]
    zeroth_order: tuple[AffineTerm, ...]
    flow: BoolArray


def biot_terms(
    discretization: Discretization, stabilization: Stabilization = "none", stiffness: Array | None = None
) -> BiotTerms:
    """Assemble the matrices once for a mesh.

    Parameters
    ----------
    discretization : Discretization
        Of the fields of `biot_fields`.
    stabilization : {"none", "lumped", "projected"}
        A remedy of `dacore_biot.stabilization`; "none" for the seven matrices alone.
    stiffness : (c,) array, optional
        Factor of E on each cell; what has E in its denominator is divided by it.

    Returns
    -------
    BiotTerms

    Raises
    ------
    ShapeError
        If the stabilization does not go with the order of u, or a factor is not positive.
    """
    softness = None if stiffness is None else _inverse(stiffness)
    layout = discretization.layout
    n, u, p = layout.n_dofs, layout.block(DISPLACEMENT), layout.block(PRESSURE)
    flow = np.zeros(n, dtype=bool)
    flow[p] = True

    def term(name: str, coefficient: Coefficient, matrix: Sparse, rows: slice, columns: slice) -> AffineTerm:
        return AffineTerm(name, _place(matrix, rows, columns, n), coefficient)

    storage = [
        term("storage", material.storage, discretization.scalar_mass(PRESSURE, softness), p, p),
        term("swelling", material.alpha, discretization.divergence_coupling(DISPLACEMENT, PRESSURE), p, u),
    ]
    for name, coefficient, matrix in _remedy(discretization, stabilization, softness):
        storage.append(term(name, coefficient, matrix, p, p))
    components = layout.field(DISPLACEMENT).components
    inertia = csr_array(block_diag([discretization.scalar_mass(DISPLACEMENT)] * components, format="csr"))
    return BiotTerms(
        second_order=(term("inertia", material.density, inertia, u, u),),
        first_order=tuple(storage),
        zeroth_order=(
            term("shear", material.twice_shear, discretization.strain(DISPLACEMENT, stiffness), u, u),
            term("dilation", material.lame, discretization.divergence(DISPLACEMENT, stiffness), u, u),
            term("pressure gradient", material.alpha, discretization.gradient_coupling(PRESSURE, DISPLACEMENT), u, p),
            term("seepage", material.mobility, discretization.scalar_stiffness(PRESSURE), p, p),
        ),
        flow=flow,
    )


def _inverse(stiffness: Array) -> Array:
    if not (stiffness > 0).all():
        raise ShapeError(f"stiffness: got {stiffness.min():g} on a cell, expected positive factors of E")
    return np.asarray(1.0 / stiffness)


def _remedy(
    discretization: Discretization, stabilization: Stabilization, softness: Array | None
) -> list[tuple[str, Coefficient, Sparse]]:
    """Return name, coefficient and matrix (n_p, n_p) of each term of the stabilization."""
    equal = discretization.layout.field(DISPLACEMENT).order == 1
    if stabilization == "none":
        return []
    if stabilization == "projected":
        if not equal:
            raise ShapeError(
                "stabilization: got 'projected' with u of order 2, which needs none; expected 'none' or 'lumped'"
            )
        return [("stabilization", material.confined_swelling, projected_gradients(discretization.mesh, softness))]
    mass = discretization.scalar_mass(PRESSURE, softness)
    seen = cell_mean_mass(discretization.mesh, softness) if equal else mass
    return [
        ("stabilization", material.confined_swelling, less_than_lumped(mass, seen)),
        ("lumping", material.storage, less_than_lumped(mass, mass)),
    ]


def _place(block: Sparse, rows: slice, columns: slice, n: int) -> Sparse:
    """Put a block with sorted indices into an (n, n) matrix that shares its values: copies of all would be 0.1 GiB."""
    starts = np.pad(block.indptr, (rows.start, n - rows.stop), mode="edge")
    shifted = block.indices + columns.start if columns.start else block.indices
    return csr_array((block.data, shifted, starts), shape=(n, n))
