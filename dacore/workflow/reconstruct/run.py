"""From files of measured data to an estimate: read, fit to the scene, check, estimate."""

import logging
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import numpy as np

from dacore.core.arrays import Array, IntArray
from dacore.core.data import Asked, Data, SensorData
from dacore.core.estimator import Estimate
from dacore.core.noise import SensorNoise, WhiteNoise
from dacore.errors import SceneError
from dacore.workflow.groundwork import GROUNDWORK
from dacore.workflow.reconstruct.images import fit_image
from dacore.workflow.reconstruct.noise import deviations
from dacore.workflow.reconstruct.plausible import better_reading, check_mean, check_size, level, seen_in_training
from dacore.workflow.reconstruct.read import Source, read_data
from dacore.workflow.reconstruct.result import Reconstruction
from dacore.workflow.reconstruct.sensors import fit_sensors
from dacore.workflow.reconstruct.steps import Used, choose, merge, on_steps, timed
from dacore.workflow.reconstruct.target import Fitted, Target, target_of
from dacore.workflow.session import Session


def reconstruct(
    session: Session,
    data: Path | str | Data | Sequence[Path | str | Data],
    *,
    asked: Asked | None = None,
    noise: str | float | None = None,
    estimator: str | None = None,
    tolerance: float | None = None,
) -> Reconstruction:
    """Reconstruct state and quantities from measured data.

    Nothing is written but the scene's own cache.

    Parameters
    ----------
    session : Session
        Of the scene; its training set is taken from the cache, or made.
    data : file, files or data
        `SensorData` or `ImageData`, one or several; or names of files.
    asked : Asked, optional
        What is said of files: unit, times, components …
    noise : str or float, optional
        "5%" of the largest value, "0.2 um", or a number in the data's unit; 0 for exact data. By default what the
        data say, or the scene's noise level if it has one.
    estimator : str, optional
        One of the scene's; its last by default.
    tolerance : float, optional [cm]
        How far sensors may be from where the scene has them.

    Returns
    -------
    Reconstruction

    Raises
    ------
    DacoreError
        If the data cannot be read, do not fit the scene, or contradict what was learned beyond all doubt.
    """
    started = time.perf_counter()
    given: list[Data] = []
    sources: list[Source] = []
    said = asked or Asked()
    several = [data] if isinstance(data, Path | str | Data) else list(data)
    files = [Path(each) for each in several if isinstance(each, Path | str)]
    if files and len(files) < len(several):
        raise SceneError("data: got files and values together; expected one of them")
    name = _estimator(session, estimator)
    if files:
        given, sources = read_data(files, said, session.builder.registry)
    else:
        given = [each for each in several if not isinstance(each, Path | str)]
    if not given:
        raise SceneError("data: got none; expected files or values")
    target = target_of(session)
    notes: list[str] = []
    warnings: list[str] = []
    fitted = [_fit(each, target, tolerance) for each in given]
    for each in fitted:
        notes += each.notes
        warnings += each.warnings
    parts = [(each.name, *on_steps(each, target, notes, warnings)) for each in fitted]
    used = choose(*merge(parts, target), target, warnings)
    unit = given[0].unit if len({each.unit for each in given}) == 1 else None
    levels = list(session.scene.noise.levels)
    asked_noise = None if noise is None else str(noise)
    sigma = deviations(used, asked_noise, levels, target.units, unit, notes)
    doubts = _checks(session, target, fitted, used, sigma, unit)
    with _listening() as heard:
        estimate = _estimate(session, name, used, sigma)
    # The estimator's own doubts about the data's size say less than ours.
    warnings += [*doubts, *(line for line in heard if not (doubts and line.startswith("data:")))]
    result = Reconstruction(
        session, name, estimate, target, used, sigma, given, sources, tuple(warnings), tuple(dict.fromkeys(notes)),
        time.perf_counter() - started,
    )  # fmt: skip
    return result


def _estimator(session: Session, name: str | None) -> str:
    known = list(session.scene.estimator)
    if name is None:
        return known[-1]
    if name not in known:
        raise SceneError(f"--estimator: got {name!r}, expected one of {', '.join(known)}")
    return name


def _fit(data: Data, target: Target, tolerance: float | None) -> Fitted:
    return fit_sensors(data, target, tolerance) if isinstance(data, SensorData) else fit_image(data, target)


def _checks(
    session: Session, target: Target, fitted: Sequence[Fitted], used: Used, sigma: Array, unit: str | None
) -> list[str]:
    """What is doubtful about the data; ShapeError if it is hopeless."""
    training = seen_in_training(session.background, target.functionals, used)
    units = [target.units[row] for row in np.flatnonzero(used.mask)]
    if len(used.steps) == len(target.times):
        fields = np.array(target.fields)
        means = [check_mean(used, fields == name, sigma, name) for name in session.scene.observed.less_mean]
        if any(means):
            return [line for line in means if line]
    found = [check_size(used, training, units, unit, level(sigma, used))] if len(set(units)) == 1 else []
    if found and found[0] is None and len(fitted) == 1:
        (one,) = fitted
        place = {int(step): k for k, step in enumerate(target.observed)}
        columns = [place[int(step)] for step in used.steps]

        def read(other: Callable[[IntArray], Array], rows: IntArray) -> Array:
            return timed(one, other(rows), target, [])[:, columns]

        found.append(better_reading(used, training, [(name, partial(read, other)) for name, other in one.others]))
    return [line for line in found if line]


def _estimate(session: Session, name: str, used: Used, sigma: Array) -> Estimate:
    """Estimate from the data that are used, with the scene's own prepared estimator where it is of these steps."""
    kept = sigma[used.mask]
    alike = bool(np.allclose(kept, kept[0], rtol=1e-12, atol=0.0))
    builder, background, functionals = session.builder, session.background, session.functionals
    observed = builder.observed(len(background.times))
    every = np.arange(len(background.times)) if observed is None else observed
    if alike and np.array_equal(every, used.steps):
        prepared, scale = session.prepared(name), float(kept[0])
    else:
        for stage in session.runner.pipeline[f"prepared.{name}"].needs:
            if stage.startswith(GROUNDWORK):
                session.runner[stage]
        if not alike and (kept == 0).any():
            raise SceneError("noise: some sensors are exact and others are not; give all of them a positive sigma")
        model = WhiteNoise(1.0) if alike else SensorNoise(np.where(used.mask, sigma, np.median(kept)))
        scale = float(kept[0]) if alike else 1.0
        with builder.blame(f"estimator.{name}"):
            prepared = builder.estimators[name].prepare(background, functionals, model, used.steps)
    values = np.where(used.mask[:, None], used.values, 0.0)
    mask = None if used.mask.all() else used.mask
    return prepared.estimate(values[:, :, None], noise_scale=scale, mask=mask)


@contextmanager
def _listening() -> Iterator[list[str]]:
    """Collect what dacore warns of, instead of showing it: it is a part of the result."""
    lines: list[str] = []

    class Collect(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            lines.append(record.getMessage())

    logger, handler = logging.getLogger("dacore"), Collect(logging.WARNING)
    before = logger.propagate
    logger.addHandler(handler)
    logger.propagate = False
    try:
        yield lines
    finally:
        logger.removeHandler(handler)
        logger.propagate = before
