"""Put values of sensors on the functionals they are of: by label, or by place and direction."""

import numpy as np
from scipy.spatial import cKDTree

from dacore.core.arrays import Array, IntArray
from dacore.core.data import SensorData
from dacore.errors import ShapeError
from dacore.io.units import factor
from dacore.workflow.reconstruct.target import CONJUGATE, Fitted, Target

# Without a tolerance: this part of the least distance between two sites, or of the extent where there is one.
_NEAR = 0.01
_ALONG = 1e-3
_SHOWN = 3


def fit_sensors(data: SensorData, target: Target, tolerance: float | None = None) -> Fitted:
    """Find the functional of each sensor.

    Parameters
    ----------
    data : SensorData
    target : Target
    tolerance : float, optional [cm]
        How far a sensor may be from where the scene has it; 1% of the least distance between sites by default.

    Raises
    ------
    ShapeError
        If no sensor is one of the scene's, a sensor may be several, or two are the same; names them.
    SceneError
        If their unit is unknown, or does not measure what the scene measures.
    """
    warnings: list[str] = []
    # Labels that somebody gave sensors of his own are names only, where there are positions.
    if data.labels and (data.places is None or set(data.labels) & set(target.functionals.labels)):
        rows, sign, lost = _by_label(data, target, tolerance)
    else:
        rows, sign, lost = _by_place(data, target, tolerance)
    known = np.flatnonzero(rows >= 0)
    if not len(known):
        raise ShapeError(f"{data.name}: none of {len(rows)} sensors is one of the scene's; {lost[0]}")
    if lost:
        more = f" and {len(lost) - _SHOWN} more" if len(lost) > _SHOWN else ""
        warnings.append(
            f"{data.name}: {len(lost)} of {len(rows)} sensors are none of the scene's and are left out: "
            f"{'; '.join(lost[:_SHOWN])}{more}"
        )
    where, count = np.unique(rows[known], return_counts=True)
    if (count > 1).any():
        row = where[count > 1][0]
        names = ", ".join(_name(data, int(k)) for k in np.flatnonzero(rows == row))
        raise ShapeError(f"{data.name}: {names} are the same measurement, {target.functionals.labels[row]}; keep one")
    scale = sign * _factors(data, target, rows)
    values = np.full((target.count, data.values.shape[1]), np.nan, dtype=data.values.dtype)
    values[rows[known]] = scale[known, None] * data.values[known]
    sigma = None
    if data.sigma is not None:
        sigma = np.full(values.shape, np.nan)
        sigma[rows[known]] = np.abs(scale[known, None]) * data.sigma[known]
        gaps = np.isnan(sigma) & ~np.isnan(values)
        if gaps.any():
            raise ShapeError(f"{data.name}: {int(gaps.sum())} values have no sigma and others have; give all or none")
    given = int((~np.isnan(data.values)).sum())
    others = [(CONJUGATE, np.conj(values).__getitem__)] if np.iscomplexobj(values) else []
    return Fitted(data.name, values, data.times, sigma, data.frequency, given, list(data.notes), warnings, others)


def _name(data: SensorData, k: int) -> str:
    if data.labels:
        return repr(data.labels[k])
    place = data.places[k] if data.places is not None else np.empty(0)
    return f"sensor {k + 1} at ({', '.join(f'{x:.6g}' for x in place)}) cm"


def _by_label(data: SensorData, target: Target, tolerance: float | None) -> tuple[IntArray, Array, list[str]]:
    number = {label: k for k, label in enumerate(target.functionals.labels)}
    rows = np.array([number.get(label, -1) for label in data.labels], dtype=np.int64)
    first = target.functionals.labels[0]
    lost = [f"{data.labels[k]!r}" for k in np.flatnonzero(rows < 0)]
    if lost:
        lost[0] += f" (the scene's labels are such as {first!r})"
    known = np.flatnonzero(rows >= 0)
    return rows, _agreed(data, target, rows, known, tolerance), lost


def _agreed(data: SensorData, target: Target, rows: IntArray, known: IntArray, tolerance: float | None) -> Array:
    """Signs (n,) of sensors with labels; ShapeError if what is said beside a label is not what the label means."""
    sign, mine = np.ones(len(rows)), rows[known]
    if data.fields:
        for k in known:
            if data.fields[k] not in ("", target.fields[rows[k]]):
                name, of = _name(data, int(k)), target.fields[rows[k]]
                raise ShapeError(f"{data.name}: {name} is of {data.fields[k]}, the scene's of {of}")
    centres = target.functionals.centres
    if data.places is not None and data.places.shape[1] == centres.shape[1]:
        away = np.linalg.norm(data.places[known] - centres[mine], axis=1)
        if (away > (_tolerance(centres) if tolerance is None else tolerance)).any():
            worst = int(away.argmax())
            raise ShapeError(
                f"{data.name}: {_name(data, int(known[worst]))} is {away[worst]:.3g} cm from where the scene has it; "
                "correct the position or its unit, leave it out, or give --tolerance"
            )
    if data.directions is not None and data.directions.shape[1] == centres.shape[1]:
        given = data.directions[known].any(axis=1)
        along = np.einsum("kd,kd->k", data.directions[known], target.functionals.directions[mine])
        if (given & (np.abs(np.abs(along) - 1.0) > _ALONG)).any():
            k = int(known[np.flatnonzero(given & (np.abs(np.abs(along) - 1.0) > _ALONG))[0]])
            raise ShapeError(
                f"{data.name}: {_name(data, k)} is not measured along the direction that the scene measures there; "
                "correct the component or the direction, or leave it out"
            )
        sign[known] = np.where(given, np.sign(along), 1.0)
    return sign


def _by_place(data: SensorData, target: Target, tolerance: float | None) -> tuple[IntArray, Array, list[str]]:
    centres, places = target.functionals.centres, data.places
    if places is None or places.shape[1] != centres.shape[1]:
        got = "none" if places is None else str(places.shape[1])
        raise ShapeError(f"{data.name}: positions of {got} coordinates, expected {centres.shape[1]} as the scene has")
    near = _tolerance(centres) if tolerance is None else tolerance
    tree = cKDTree(centres)
    distance, _ = tree.query(places)
    found = tree.query_ball_point(places, near)
    names = np.array(target.fields)
    rows, sign = np.full(len(places), -1), np.ones(len(places))
    lost = []
    for k, candidates in enumerate(found):
        some = np.array(candidates, dtype=np.int64)
        if data.fields and data.fields[k]:
            some = some[names[some] == data.fields[k]]
        direction = data.directions[k] if data.directions is not None else np.zeros(centres.shape[1])
        if direction.any() and len(some):
            along = target.functionals.directions[some] @ direction
            some, along = some[np.abs(np.abs(along) - 1.0) < _ALONG], along[np.abs(np.abs(along) - 1.0) < _ALONG]
            sign[k] = np.sign(along[0]) if len(along) else 1.0
        if len(some) > 1:
            labels = ", ".join(target.functionals.labels[row] for row in some[:_SHOWN])
            raise ShapeError(
                f"{data.name}: {_name(data, k)} may be {labels}; say which with a column component or field"
            )
        if len(some) == 1:
            rows[k] = some[0]
        elif distance[k] > near:
            lost.append(f"{_name(data, k)}, {distance[k]:.3g} cm from the nearest of the scene's")
        else:
            lost.append(f"{_name(data, k)}: the scene measures no such component or field there")
    if lost and (rows < 0).all() and (distance > near).any():
        lost[0] += _reading(tree, places, near)
    return rows, sign, lost


def _reading(tree: cKDTree, places: Array, near: float) -> str:
    """Say how places that fit nowhere would fit: in another unit, or with axes exchanged."""
    for unit, scale in (("mm", 0.1), ("m", 100.0), ("um", 1e-4)):
        if (tree.query(scale * places)[0] <= near).mean() > 0.5:
            return f"; they fit if positions are in {unit}: say so in the header, as 'x [{unit}]'"
    d = places.shape[1]
    orders = [(1, 0)] if d == 2 else [(1, 0, 2), (2, 1, 0), (0, 2, 1), (1, 2, 0), (2, 0, 1)]
    for order in orders:
        if (tree.query(places[:, order])[0] <= near).mean() > 0.5:
            return f"; they fit with the columns in the order {', '.join('xyz'[k] for k in order)}"
    return ""


def _tolerance(centres: Array) -> float:
    sites = np.unique(centres.round(9), axis=0)
    if len(sites) == 1:
        return max(_NEAR * float(np.linalg.norm(sites[0])), 1e-6)
    return _NEAR * float(cKDTree(sites).query(sites, k=2)[0][:, 1].min())


def _factors(data: SensorData, target: Target, rows: IntArray) -> Array:
    if data.unit is None:
        wanted = target.units[rows[rows >= 0][0]]
        raise ShapeError(
            f"{data.name}: nobody says the unit of its values (the scene's is {wanted}); "
            "write it into the header, as 'value [mm]', or give --unit"
        )
    known = {unit: factor(data.unit, unit, data.name) for unit in {target.units[row] for row in rows if row >= 0}}
    return np.array([known[target.units[row]] if row >= 0 else 1.0 for row in rows])
