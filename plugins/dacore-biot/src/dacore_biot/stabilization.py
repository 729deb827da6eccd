"""Remedies for pressures that oscillate from node to node on elements of equal order.

Where little fluid seeps in a time step, ``κτ/μ_f ≪ h²/(λ + 2μ_s)``, a step asks the pressure to answer a change
of volume at once. Confined tissue answers with ``∇·u = α p/(λ + 2μ_s)``, so that the flow equation holds, besides
``S(p, q)``, a mass matrix with the factor α²/(λ + 2μ_s). With u of order 2 that is the mass matrix itself. With u
and p of order 1 the divergence is constant on a cell, and it is ``∫ Π₀p Π₀q``, Π₀ the mean over a cell: pressures
alternating from node to node have no weight in it. A remedy gives them some. C_K being the covariance of the
corners of a cell K, a matrix of order h², two are offered, both symmetric, positive semidefinite, on any simplices,
and without a mesh size to choose:

lumped
    α²/(λ + 2μ_s) Σ_K ∫_K ∇ṗ·C_K ∇q, which is α²/(λ + 2μ_s) (L(ṗ, q) − ∫ Π₀ṗ Π₀q) with the lumped mass L: what the
    pressure of confined tissue is multiplied with becomes a diagonal matrix, as S's mass is made, so that
    consolidation keeps its bounds: exactly in one dimension, to a hundredth in two. In one dimension it is the
    h²/(4(λ + 2μ_s)) (∇ṗ, ∇q) of Rodrigo, Gaspar, Hu and Zikatanov, *Stability and monotonicity for some
    discretizations of the Biot's consolidation model*, CMAME 298, 2016; on any simplex (d + 2) times the polynomial
    pressure projection of Bochev, Dohrmann and Gunzburger (SINUM 44, 2006). A smooth pressure is seen too: it acts
    as a storage of order h²|∇p|²/(λ + 2μ_s), which is much where S is small, and slows waves of compression.
projected
    α²/(λ + 2μ_s) Σ_K ∫_K (∇ṗ − Π∇ṗ)·C_K ∇q with Π the projection onto continuous vectors of order 1, itself lumped
    (orthogonal subscales: Codina, *Stabilization of incompressibility and convection through orthogonal sub-scales*,
    CMAME 190, 2000). Where ∇p is smooth it vanishes to a higher order, so that waves pass; it bounds
    oscillations as Taylor–Hood elements do, and removes no overshoot next to a jump.
"""

import numpy as np
from scipy.sparse import bsr_array, csr_array, dia_array

from dacore.core.arrays import Array, IntArray, Sparse
from dacore.core.mesh import Mesh
from dacore.core.simplex import barycentric_gradients


def less_than_lumped(mass: Sparse, seen: Sparse) -> Sparse:
    """Lumped mass L (the row sums of `mass`) less what is `seen` of the mass: (n_p, n_p)."""
    return csr_array(_diagonal(np.asarray(mass.sum(axis=1)).ravel()) - seen)


def cell_mean_mass(mesh: Mesh, weight: Array | None = None) -> Sparse:
    """∫ Π₀p Π₀q for elements of order 1, Π₀ the mean over a cell, times a weight (c,): (n_nodes, n_nodes)."""
    start = np.arange(len(mesh.cells) + 1) * (mesh.dim + 1)
    shares = np.full(mesh.cells.size, 1.0 / (mesh.dim + 1))
    means = csr_array((shares, mesh.cells.ravel(), start), shape=(len(mesh.cells), len(mesh.points)))
    return csr_array(means.T @ (_diagonal(_volumes(mesh, weight)) @ means))


def projected_gradients(mesh: Mesh, weight: Array | None = None) -> Sparse:
    """Σ_K ∫_K (∇p − Π∇p)·C_K ∇q for elements of order 1, C_K times a weight (c,): (n_nodes, n_nodes).

    With V the lumped mass of vectors weighted by C_K and G the gradient coupling so weighted it is
    ``K − Gᵀ V⁻¹ G``, not negative since lumping makes a mass of order 1 larger.
    """
    cells, n, dim = mesh.cells, len(mesh.points), mesh.dim
    gradients = barycentric_gradients(mesh.points, cells)[0]
    corners = mesh.points[cells] - mesh.points[cells].mean(axis=1, keepdims=True)
    weights = np.einsum("c,cki,ckj->cij", _volumes(mesh, weight) / (dim + 1), corners, corners)  # |K| C_K
    weighted = np.einsum("cij,cbj->cib", weights, gradients)
    stiffness = _gather(np.einsum("cai,cib->cab", gradients, weighted), cells, cells, (n, n))
    # A node's share of the cell is the same for all its corners.
    components = (cells[:, :, None] * dim + np.arange(dim)).reshape(len(cells), -1)
    coupling = _gather(np.tile(weighted / (dim + 1), (1, dim + 1, 1)), components, cells, (n * dim, n))
    lumped = np.stack(
        [
            np.bincount(cells.ravel(), np.repeat(weights[:, i, j] / (dim + 1), dim + 1), n)
            for i in range(dim)
            for j in range(dim)
        ],
        axis=1,
    ).reshape(n, dim, dim)
    inverse = csr_array(bsr_array((np.linalg.inv(lumped), np.arange(n), np.arange(n + 1)), shape=(n * dim,) * 2))
    smooth = csr_array(coupling.T @ (inverse @ coupling))
    return csr_array(stiffness - 0.5 * (smooth + smooth.T))


def _volumes(mesh: Mesh, weight: Array | None) -> Array:
    return mesh.volumes if weight is None else mesh.volumes * weight


def _gather(values: Array, rows: IntArray, columns: IntArray, shape: tuple[int, int]) -> Sparse:
    """Sum of cell matrices (c, r, k) with the row and column numbers (c, r) and (c, k) of each."""
    row, column = np.broadcast_arrays(rows[:, :, None], columns[:, None, :])
    return csr_array((values.ravel(), (row.ravel(), column.ravel())), shape=shape)


def _diagonal(values: Array) -> Sparse:
    return csr_array(dia_array((values[None, :], [0]), shape=(len(values), len(values))))
