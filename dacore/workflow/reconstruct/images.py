"""Put the voxels of an image on the functionals they are of, and say how far a grid is off that does not fit."""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from itertools import permutations, product

import numpy as np

from dacore.core.arrays import Array, BoolArray, IntArray
from dacore.core.data import ImageData, Values
from dacore.errors import ShapeError
from dacore.io.units import factor
from dacore.workflow.reconstruct.target import CONJUGATE, Fitted, Target

# A centre this part of a voxel away is the same: headers hold single precision.
_NEAR = 0.02
_EDGES = 2e-3
_NONE = 1e-9
_LETTERS = "ijk"
# Between any two of m, cm, mm and um.
_SCALES = (10.0, 0.1, 100.0, 0.01, 1e3, 1e-3, 1e4, 1e-4, 1e6, 1e-6)


def fit_image(data: ImageData, target: Target) -> Fitted:
    """Find the voxel of each functional.

    Parameters
    ----------
    data : ImageData
        Whose grid must be that of the scene's observation: same voxels, in any order of the array's axes that its
        affine says.
    target : Target

    Returns
    -------
    Fitted
        With the same image read with axes exchanged or turned round among `others`.

    Raises
    ------
    ShapeError
        If the grids differ: says by how much and along which axis, and how the image would fit.
    SceneError
        If the unit is unknown, or does not measure what the scene measures.
    """
    rows = target.rows(data.field, data.name)
    where = target.functionals.centres[rows]
    if data.dim != where.shape[1]:
        raise ShapeError(f"{data.name}: an image of {data.dim} dimensions, but the scene has {where.shape[1]}")
    data = _stated(data, target, rows)
    affine = data.affine if target.to_scene is None else target.to_scene @ data.affine
    index = to_index(affine, where)
    numbers = np.round(index).astype(np.int64)
    away = index - numbers
    if np.abs(away).max() > _NEAR:
        raise ShapeError(f"{data.name}: {_mismatch(data, affine, where, away, target)}")
    _same_edges(data, target, numbers)
    inside = _inside(numbers, data.shape)
    warnings = [] if inside.all() else [_outside(data, numbers, inside)]
    warnings += _empty(data, numbers[inside])
    weights = _weights(data, target, rows)
    units = {target.units[row] for row in rows}
    if data.unit is None:
        raise ShapeError(
            f"{data.name}: nobody says the unit of its values (the scene's is {units.pop()}); give --unit, as mm or um"
        )
    scales = {unit: factor(data.unit, unit, data.name) for unit in units}
    scale = np.array([scales[target.units[row]] for row in rows])

    place = np.full(target.count, -1)
    place[rows] = np.arange(len(rows))

    def read(image: Values, at: IntArray, weights: Array, wanted: IntArray) -> Array:
        """Values (k, t) of some functionals in an image, whose voxels `at` (n, d) are those of `rows`."""
        out = np.full((len(wanted), image.shape[-2]), np.nan, dtype=image.dtype)
        mine = place[wanted]
        here = np.flatnonzero((mine >= 0) & _inside(at[mine], image.shape[: data.dim]))
        mine = mine[here]
        used = np.where(weights[mine, None, :] != 0, weights[mine, None, :] * image[tuple(at[mine].T)], 0.0)
        out[here] = scale[mine, None] * used.sum(axis=2)
        return out

    every = np.arange(target.count)
    values = read(data.values, numbers, weights, every)
    if np.isnan(values).all():
        raise ShapeError(
            f"{data.name}: no voxel that the scene measures has a value; check the mask, the affine and the placement"
        )
    sigma = None if data.sigma is None else np.where(np.isnan(values), np.nan, 0.0)
    if sigma is not None and data.sigma is not None:
        length = np.linalg.norm(weights, axis=1)
        sigma[rows] += (scale * length)[:, None] * data.sigma
    others = [(name, partial(read, turned, numbers, weights)) for name, turned in _turned_arrays(data)]
    others += [(name, partial(read, data.values, numbers, other)) for name, other in _components(data, weights)]
    others += [(name, partial(read, data.values, moved, weights)) for name, moved in _shifted(data, numbers)]
    others += [(name, partial(read, data.values, numbers, other)) for name, other in _frames(data, target, rows)]
    if np.iscomplexobj(data.values):
        others.append((CONJUGATE, partial(read, np.conj(data.values), numbers, weights)))
    given = int((~np.isnan(values)).sum())
    return Fitted(data.name, values, data.times, sigma, data.frequency, given, list(data.notes), warnings, others)


def to_index(affine: Array, points: Array) -> Array:
    """Voxel coordinates (n, d), whole at the centres, of points (n, d) in the space that the affine leads to."""
    dim = len(affine) - 1
    return np.asarray(np.linalg.solve(affine[:dim, :dim], (points - affine[:dim, dim]).T).T)


def _stated(data: ImageData, target: Target, rows: IntArray) -> ImageData:
    """The image with the component of a single volume, if nobody said it and the scene leaves no doubt."""
    name = target.fields[rows[0]]
    count = target.components[name]
    if data.components != (-1,):
        if max(data.components) >= count or min(data.components) < 0:
            raise ShapeError(f"{data.name}: components {list(data.components)}, but {name} has {count}")
        return data
    if count == 1:
        return replace(data, components=(0,))
    weights = np.abs(target.functionals.directions[rows])
    seen = np.flatnonzero((weights > _NONE).any(axis=0))
    if len(seen) != 1:
        raise ShapeError(
            f"{data.name}: one volume, but {name} has {count} components; give a file for each, or say which it is "
            "with --components, as y"
        )
    return replace(data, components=(int(seen[0]),))


def _weights(data: ImageData, target: Target, rows: IntArray) -> Array:
    """Weight (k, c) of each of the image's components in each functional; NaN where one that it needs is not there."""
    directions = target.functionals.directions[rows]
    if not directions.any():
        if len(data.components) > 1:
            raise ShapeError(
                f"{data.name}: {len(data.components)} components of {target.fields[rows[0]]}, which is measured "
                "without directions; give one of them, with --components"
            )
        return np.ones((len(rows), 1))
    turn = np.eye(data.dim)
    if target.to_scene is not None:
        turn = target.to_scene[: data.dim, : data.dim]
    if data.frame == "voxel":
        turn = turn @ data.axes
    every = directions @ turn  # (k, d): on each component in the image's frame
    every[np.abs(every) < _NONE] = 0.0
    absent = np.setdiff1d(np.arange(data.dim), data.components)
    out = every[:, list(data.components)]
    out[(every[:, absent] != 0).any(axis=1)] = np.nan
    return np.asarray(out)


def _frames(data: ImageData, target: Target, rows: IntArray) -> Iterator[tuple[str, Array]]:
    """Weights of the image's components, with these along the other axes: those of the image, or of the world."""
    if target.functionals.directions[rows].any() and not np.allclose(data.axes, np.eye(data.dim), atol=1e-6):
        world = data.frame == "voxel"
        other = replace(data, frame="world" if world else "voxel")
        name = "the world's axes (no --frame voxel)" if world else "the image's own axes (--frame voxel)"
        yield f"its components along {name}", _weights(other, target, rows)


def _inside(numbers: IntArray, shape: tuple[int, ...]) -> BoolArray:
    return np.asarray(((numbers >= 0) & (numbers < np.array(shape))).all(axis=1))


def _same_edges(data: ImageData, target: Target, numbers: IntArray) -> None:
    """Raise ShapeError for voxels whose centres are right and whose edges are not: three times as fine, say."""
    spacing = target.functionals.spacing
    if spacing:
        mine, theirs = np.sort(data.size), np.sort(np.array(spacing))
        if np.abs(mine / theirs - 1.0).max() > _EDGES:
            raise ShapeError(f"{data.name}: {_edges(data.size)}, the scene's have {_lengths(np.array(spacing))}")
    for axis in range(data.dim):
        steps = np.diff(np.unique(numbers[:, axis]))
        if steps.size and steps.min() > 1:
            raise ShapeError(
                f"{data.name}: {_edges(data.size)}; along its axis {_LETTERS[axis]} the scene measures every "
                f"{steps.min()}th voxel only, so that its voxels are larger or apart; resample the image"
            )


def _outside(data: ImageData, numbers: IntArray, inside: BoolArray) -> str:
    """Note of functionals that no voxel reaches; ShapeError if another order of the axes would reach far more."""
    share = float(inside.mean())
    best, name = share, ""
    for order in permutations(range(data.dim)):
        there = float(_inside(numbers[:, list(order)], data.shape).mean())
        if there > best + 1e-12:
            best, name = there, f"{', '.join(_LETTERS[k] for k in order)}"
    if name and best > 2.0 * share:
        raise ShapeError(
            f"{data.name}: {' × '.join(map(str, data.shape))} voxels reach {share:.0%} of what the scene measures; "
            f"with the array's axes in the order ({name}) it would be {best:.0%}: were they exchanged in writing?"
        )
    if not inside.any():
        raise ShapeError(f"{data.name}: lies where the scene measures nothing; check its affine and the placement")
    return (
        f"{data.name}: {int((~inside).sum())} of {len(inside)} measurements lie outside the image "
        f"({1 - share:.0%}); they are taken for missing"
    )


def _empty(data: ImageData, numbers: IntArray) -> list[str]:
    """Warning of voxels that the scene measures and that hold one number alone, as many programs fill gaps.

    Of one component zero alone is told from what does not change; integers that are scaled may hold no zero.
    """
    voxels = np.unique(numbers, axis=0)
    inside = data.values[tuple(voxels.T)]
    gap = (inside == 0) | ((inside == inside[:, :1, :1]) if inside.shape[2] > 1 else False)
    zero = int(gap.all(axis=(1, 2)).sum())
    if zero in (0, len(voxels)):
        return []
    return [
        f"{data.name}: {zero} of {len(voxels)} voxels that the scene measures hold one number alone, such as 0, and "
        "are taken as measured: if nothing was measured there, say so with --mask, or with NaN"
    ]


def _mismatch(data: ImageData, affine: Array, where: Array, away: Array, target: Target) -> str:
    """Say how the image's grid differs from the scene's."""
    dim = data.dim
    turned = _turned(data, where, target)
    if turned:
        return turned
    spacing = np.array(target.functionals.spacing)
    if spacing.size and np.abs(np.sort(data.size) / np.sort(spacing) - 1.0).max() > _EDGES:
        ratio = float(np.median(np.sort(data.size) / np.sort(spacing)))
        guess = next(
            (f"; is its affine in {unit}?" for unit, f in (("mm", 10.0), ("m", 0.001), ("cm", 0.1), ("um", 1000.0))
             if abs(ratio / f - 1.0) < 0.01), "",
        )  # fmt: skip
        return f"{_edges(data.size)}, the scene's have {_lengths(spacing)}; resample it or change the scene{guess}"
    if scale := _scaled(data, where, target):
        return (
            f"{_edges(data.size)}; its voxels would be the scene's with all lengths of its affine times {scale:g}: "
            "correct the affine or its unit"
        )
    # A shift shows as one fraction for all centres.
    phase = np.exp(2j * np.pi * away)
    shift = np.angle(phase.mean(axis=0)) / (2 * np.pi)
    left = np.abs(away - shift - np.round(away - shift)).max()
    if left <= _NEAR:
        along = ", ".join(
            f"{_LETTERS[k]} by {shift[k]:+.2f} voxels ({10 * shift[k] * data.size[k]:+.3g} mm)"
            for k in range(dim) if abs(shift[k]) > _NEAR / 2
        )  # fmt: skip
        return f"the scene's voxels are shifted against the image's along {along}; correct its affine or the scene"
    worst = int(np.abs(away).max(axis=0).argmax())
    axes = affine[:dim, :dim] / np.linalg.norm(affine[:dim, :dim], axis=0)
    tilt = np.degrees(np.arccos(np.clip(np.abs(axes).max(axis=0), 0, 1)))
    if not spacing.size and tilt.max() < 0.05:
        return "the scene's measurements lie on no grid like the image's; observe the image itself (kind = 'image')"
    return (
        f"its grid is turned or stretched against the scene's: centres are up to {np.abs(away).max():.2f} voxels off, "
        f"most along its axis {_LETTERS[worst]} ({10 * np.abs(away[:, worst]).max() * data.size[worst]:.3g} mm); "
        f"its axes are {', '.join(f'{t:.1f}' for t in tilt)} degrees from the scene's"
    )


def _turned(data: ImageData, where: Array, target: Target) -> str:
    """How the image would fit with the world's axes exchanged or turned round; nothing if it would not."""
    dim = data.dim
    best, found = 0.0, ""
    for order, signs in product(permutations(range(dim)), product((1, -1), repeat=dim)):
        turn = np.eye(dim + 1)
        turn[:dim, :dim] = np.eye(dim)[list(order)] * np.array(signs)[:, None]
        affine = turn @ data.affine
        index = to_index(affine if target.to_scene is None else target.to_scene @ affine, where)
        if np.abs(index - np.round(index)).max() > _NEAR:
            continue
        share = float(_inside(np.round(index).astype(np.int64), data.shape).mean())
        if share > best:
            best = share
            found = ", ".join(("-" if s < 0 else "") + "xyz"[k] for k, s in zip(order, signs, strict=True))
    if best < 0.5:
        return ""
    return (
        f"its voxels are not the scene's, but would be with the world's axes read as ({found}): {best:.0%} of what is "
        "measured then lies inside; correct its affine"
    )


def _scaled(data: ImageData, where: Array, target: Target) -> float | None:
    """What the affine's lengths are multiplied with so that the image fits, where its unit is another; or None."""
    for scale in _SCALES:
        affine = data.affine.copy()
        affine[: data.dim] *= scale
        index = to_index(affine if target.to_scene is None else target.to_scene @ affine, where)
        numbers = np.round(index).astype(np.int64)
        if np.abs(index - numbers).max() <= _NEAR and _inside(numbers, data.shape).mean() > 0.5:
            return scale
    return None


def _turned_arrays(data: ImageData) -> Iterator[tuple[str, Values]]:
    """The array with its axes exchanged or turned round, where that leaves its shape."""
    dim, own = data.dim, tuple(range(data.dim))
    for order, signs in product(permutations(own), product((1, -1), repeat=dim)):
        same = tuple(data.shape[k] for k in order) == data.shape
        wide = all(sign > 0 or data.shape[k] > 1 for k, sign in zip(order, signs, strict=True))
        if same and wide and (order != own or min(signs) < 0):
            name = ", ".join(("-" if s < 0 else "") + _LETTERS[k] for k, s in zip(order, signs, strict=True))
            turned = data.values.transpose(*order, dim, dim + 1)
            yield f"the array's axes read as ({name})", turned[tuple(slice(None, None, sign) for sign in signs)]


def _shifted(data: ImageData, numbers: IntArray) -> Iterator[tuple[str, IntArray]]:
    """Numbers of the voxels beside those that the affine says: where one counts from 0 and another from 1."""
    for axis, by in product(range(data.dim), (1, -1)):
        if data.shape[axis] > 1:
            yield (
                f"its voxels shifted by {by:+d} along {_LETTERS[axis]}",
                numbers + by * np.eye(data.dim, dtype=int)[axis],
            )


def _components(data: ImageData, weights: Array) -> Iterator[tuple[str, Array]]:
    """Weights of the image's components, with these in another order or of another sign."""
    count = len(data.components)
    for order, signs in product(permutations(range(count)), product((1.0, -1.0), repeat=count)):
        own = order == tuple(range(count)) and min(signs) > 0
        if count > 1 and not own and max(signs) > 0:
            parts = zip(order, signs, strict=True)
            name = ", ".join(("-" if s < 0 else "") + "xyz"[data.components[k]] for k, s in parts)
            other = np.empty_like(weights)
            other[:, list(order)] = weights * np.array(signs)
            yield f"its components read as ({name})", other


def _edges(size: Array) -> str:
    return f"its voxels have {_lengths(size)}"


def _lengths(size: Array) -> str:
    return f"edges of {' × '.join(f'{10 * edge:.4g}' for edge in size)} mm"
