"""Reconstructed fields as averages over the voxels of an image."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array, diags_array

from dacore.core.arrays import Array, IntArray, Sparse
from dacore.core.data import ImageData
from dacore.core.observation import Functionals
from dacore.core.space import StateSpace
from dacore.errors import SceneError
from dacore.geometry.clip import box_integrals
from dacore.io.units import factor
from dacore.workflow.reconstruct.images import to_index
from dacore.workflow.reconstruct.result import Reconstruction

# A voxel counts as the domain's if so much of it lies inside.
_COVERED = 0.5
# Voxels whose functionals are held at once.
_PORTION = 20_000


@dataclass(frozen=True, eq=False)
class FieldImage:
    """Average of a field over each voxel of an image's grid, and its standard deviation.

    Parameters
    ----------
    field, unit : str
        The unit is that of the image's values where the field can be measured in it, else the scene's.
    mean : (n_1, ..., n_d, t, c) array
        In the image's frame; NaN outside the domain.
    deviation : (n_1, ..., n_d, t, c) array or None
        None where the estimator gives none.
    """

    field: str
    unit: str
    mean: Array
    deviation: Array | None


def field_images(result: Reconstruction, image: ImageData) -> list[FieldImage]:
    """Every field of the estimate on the grid of an image, at every step of the estimate."""
    space = result.session.background.space
    affine = image.affine if result.target.to_scene is None else result.target.to_scene @ image.affine
    return [_field_image(result, image, affine, space, each.name) for each in space.fields]


def voxel_means(space: StateSpace, field: str, affine: Array, shape: tuple[int, ...]) -> tuple[IntArray, Sparse]:
    """Averages of one component over the voxels that the domain covers by half.

    Parameters
    ----------
    space : StateSpace
    field : str
    affine : (d + 1, d + 1) array
        From voxel numbers to centres in the scene [cm]; any, for an average does not change under an affine map.
    shape : tuple of int

    Returns
    -------
    numbers : (n, d) int array
    means : (n, n_nodes) csr_array
    """
    geometry = space.cells()
    # In these coordinates voxel i is the box from i to i + 1.
    points = to_index(affine, geometry.points) + 0.5
    lower = np.clip(np.floor(points.min(axis=0)).astype(np.int64), 0, None)
    upper = np.minimum(np.ceil(points.max(axis=0)).astype(np.int64), shape)
    nodes, order = geometry.nodes[field], geometry.orders[field]
    if (upper <= lower).any():
        return np.empty((0, len(shape)), dtype=np.int64), csr_array((0, int(nodes.max()) + 1))
    integrals = box_integrals(points, geometry.cells, nodes, order, lower, upper)
    fill = np.asarray(integrals.sum(axis=1)).ravel()
    kept = np.flatnonzero(fill >= _COVERED)
    numbers = np.stack(np.unravel_index(kept, tuple((upper - lower).tolist())), axis=1) + lower
    return numbers, csr_array(diags_array(1.0 / fill[kept]) @ csr_array(integrals[kept]))


def _field_image(result: Reconstruction, image: ImageData, affine: Array, space: StateSpace, name: str) -> FieldImage:
    field = space.layout.field(name)
    numbers, means = voxel_means(space, name, affine, image.shape)
    count, dim, steps = field.components, image.dim, len(result.times)
    turn = _turn(result, image) if count == dim else np.eye(count)
    shape = (*image.shape, steps, count)
    mean = np.full(shape, np.nan)
    deviation = np.full(shape, np.nan) if result.estimate.uncertainty is not None else None
    for start in range(0, len(numbers), _PORTION):
        some = numbers[start : start + _PORTION]
        part = space.place(csr_array(means[start : start + _PORTION]), name, range(count))
        n = len(some)
        # Rows are components of the scene: turned into those of the image.
        rows = _turned(part, turn, n)
        values = result.estimate.functional(_bare(rows, dim))[:, :, 0]
        mean[tuple(some.T)] = values.reshape(count, n, steps).transpose(1, 2, 0)
        if deviation is not None:
            for step in range(steps):
                spread = result.estimate.deviation(rows, step, 0).reshape(count, n)
                deviation[(*some.T, np.full(n, step))] = spread.T
    unit, scale = _unit(field.unit, image)
    return FieldImage(name, unit, scale * mean, None if deviation is None else scale * deviation)


def _unit(unit: str, image: ImageData) -> tuple[str, float]:
    """Unit of a field beside an image, and the factor to it: that of the data, if it measures the same."""
    if image.unit is None:
        return unit, 1.0
    try:
        return image.unit, factor(unit, image.unit, image.name)
    except SceneError:
        return unit, 1.0


def _turn(result: Reconstruction, image: ImageData) -> Array:
    """Components in the image's frame of a vector of the scene, (d, d)."""
    dim = image.dim
    turn = np.eye(dim) if result.target.to_scene is None else result.target.to_scene[:dim, :dim].T
    return np.asarray(np.linalg.inv(image.axes) @ turn if image.frame == "voxel" else turn)


def _turned(rows: Sparse, turn: Array, n: int) -> Sparse:
    """Functionals (c · n, n_dofs), component by component, with components in another frame."""
    if np.array_equal(turn, np.eye(len(turn))):
        return rows
    from scipy.sparse import eye_array, kron

    return csr_array(kron(csr_array(turn), eye_array(n), format="csr") @ rows)


def _bare(rows: Sparse, dim: int) -> Functionals:
    m = rows.shape[0]
    return Functionals(rows, ("",) * m, "", np.zeros((m, dim)), np.zeros((m, dim)), np.arange(m))
