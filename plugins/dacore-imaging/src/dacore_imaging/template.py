"""The outlines of brain and ventricles in the MNI152 template.

The template is the ICBM 2009a nonlinear symmetric average (Fonov et al. 2011, NeuroImage 54:313;
Fonov et al. 2009, NeuroImage 47:S102; Collins et al. 1999) on 1 mm voxels, as nilearn ships it: a
T1 image and maps of grey and white matter. Nothing is downloaded. Lengths here are mm in the
template's own (MNI) coordinates: x to the right, y to the front, z up.
"""

import importlib.util
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from dacore.core.arrays import Array, BoolArray
from dacore.errors import MeshError, MissingDependencyError
from dacore.geometry.sampled import SampledLevelSet, smooth_distance

_PAD = 10
"""Envelope voxels added on each side, so that nothing touches the edge of the grid."""
_STEM_SECTION = -68.0
"""Height [mm] of the brainstem's section that is drawn down to the cut."""
_VENTRICLE_BOX = ((-60.0, -80.0, -30.0), (60.0, 60.0, 50.0))
_LATERAL_SEED = ((5.0, -10.0, 15.0), (15.0, 10.0, 25.0))
"""A box in the body of the right lateral ventricle; the two ventricles are one component."""
_THIRD_BOX = ((-5.0, -27.0, -12.0), (5.0, 3.0, 8.0))


@dataclass(frozen=True, eq=False)
class Outlines:
    """Level sets [mm], negative inside, near the signed distance.

    Parameters
    ----------
    envelope : SampledLevelSet
        The brain with its fissures closed and the brainstem drawn down as a stub.
    ventricles : SampledLevelSet
        The two lateral ventricles and the third.
    """

    envelope: SampledLevelSet
    ventricles: SampledLevelSet


def outlines() -> Outlines:
    """Segment the template.

    Raises
    ------
    MissingDependencyError
        If nibabel or nilearn is not installed.
    MeshError
        If the template's files are not those this segmentation was made for.
    """
    tissue, origin = _tissue()
    envelope = _envelope(tissue, origin)
    return Outlines(envelope, _ventricles(tissue, origin, envelope))


def template_files() -> dict[str, Path]:
    """Paths of the template's T1, grey and white matter images, found without importing nilearn."""
    spec = importlib.util.find_spec("nilearn")
    if spec is None or not spec.submodule_search_locations:
        raise MissingDependencyError("the brain needs nilearn for its template; pip install nilearn")
    folder = Path(spec.submodule_search_locations[0]) / "datasets" / "data"
    files = {key: folder / f"mni_icbm152_{key}_tal_nlin_sym_09a_converted.nii.gz" for key in ("t1", "gm", "wm")}
    missing = [path.name for path in files.values() if not path.is_file()]
    if missing:
        raise MissingDependencyError(
            f"the brain needs {missing[0]}, which this nilearn does not ship; pip install 'nilearn>=0.10'"
        )
    return files


def _tissue() -> tuple[NDArray[np.float32], Array]:
    """Fraction of grey and white matter in each voxel, and the centre (3,) [mm] of the first one."""
    try:
        import nibabel
    except ImportError as error:
        raise MissingDependencyError("the brain needs nibabel to read its template; pip install nibabel") from error
    images: dict[str, Any] = {key: nibabel.load(path) for key, path in template_files().items()}
    affine = np.asarray(images["t1"].affine, dtype=np.float64)
    if not np.array_equal(affine[:3, :3], np.eye(3)) or images["t1"].shape != (197, 233, 189):
        raise MeshError(
            f"MNI152 template: got shape {images['t1'].shape} and affine {affine[:3].tolist()}, "
            "expected 197 x 233 x 189 voxels of 1 mm; install nilearn>=0.10"
        )
    voxels = {key: np.asarray(image.dataobj, dtype=np.float32) for key, image in images.items()}
    tissue = (voxels["gm"] + voxels["wm"]) / np.float32(255.0)
    tissue[voxels["t1"] == 0.0] = 0.0
    return tissue, affine[:3, 3].copy()


def _envelope(tissue: NDArray[np.float32], origin: Array) -> SampledLevelSet:
    """Outline of the brain on 2 mm voxels, fissures up to 10 mm wide closed."""
    a, b, c = (n // 2 for n in tissue.shape)
    blocks = tissue[: 2 * a, : 2 * b, : 2 * c].reshape(a, 2, b, 2, c, 2).mean(axis=(1, 3, 5))
    brain = np.pad(_largest(blocks > 0.5), _PAD)
    first = origin + 0.5 - 2.0 * _PAD
    brain = ndimage.binary_fill_holes(_closed(brain, 2.5))
    brain = _largest(_dilated(_eroded(brain, 1.5), 1.5))
    section = round((_STEM_SECTION - first[2]) / 2.0)
    brain[:, :, :section] = brain[:, :, section, None]
    return SampledLevelSet(2.0 * smooth_distance(brain, 1.25), first, 2.0)


def _ventricles(tissue: NDArray[np.float32], origin: Array, envelope: SampledLevelSet) -> SampledLevelSet:
    """Outline of the lateral and third ventricles on 1 mm voxels, of unchanged volume."""
    window = _window(_VENTRICLE_BOX, origin)
    first = origin + np.array([part.start for part in window])
    fluid = 1.0 - tissue[window]
    grid = np.stack(np.meshgrid(*(first[k] + np.arange(fluid.shape[k]) for k in range(3)), indexing="ij"), axis=-1)
    depth = -envelope(grid.reshape(-1, 3)).reshape(fluid.shape)
    label, count = ndimage.label((fluid > 0.5) & (depth > 12.0))
    votes = np.bincount(label[_window(_LATERAL_SEED, first)].ravel(), minlength=count + 1)
    votes[0] = 0
    lateral = label == votes.argmax()
    third = np.zeros_like(lateral)
    inside = _window(_THIRD_BOX, first)
    third[inside] = (fluid[inside] > 0.35) & (depth[inside] > 7.0)
    for plane in third:
        # The bridge of tissue between the thalami is a hole in the third ventricle.
        plane[:] = ndimage.binary_fill_holes(plane)
    both = _largest(_closed(lateral | _dilated(third, 1.0), 3.5))
    sigma = 1.5
    blurred = ndimage.gaussian_filter(both.astype(np.float32), sigma)
    level = float(np.sort(blurred, axis=None)[-int(both.sum())])
    return SampledLevelSet(smooth_distance(both, sigma, level), first, 1.0)


def _window(box: tuple[tuple[float, ...], tuple[float, ...]], origin: Array) -> tuple[slice, ...]:
    """Slices of the 1 mm voxels whose centres lie in a box [mm]."""
    low, high = (np.round(np.array(corner) - origin).astype(int) for corner in box)
    return tuple(slice(int(a), int(b) + 1) for a, b in zip(low, high, strict=True))


def _largest(mask: BoolArray) -> BoolArray:
    label, _ = ndimage.label(mask)
    size = np.bincount(label.ravel())
    size[0] = 0
    return np.asarray(label == size.argmax())


def _dilated(mask: BoolArray, radius: float) -> BoolArray:
    return np.asarray(ndimage.distance_transform_edt(~mask) <= radius)


def _eroded(mask: BoolArray, radius: float) -> BoolArray:
    return np.asarray(ndimage.distance_transform_edt(mask) > radius)


def _closed(mask: BoolArray, radius: float) -> BoolArray:
    return _eroded(_dilated(mask, radius), radius)
