"""What a reconstruction leaves behind: numbers, fields, images and a report, in a folder that appears whole."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse import csr_array

from dacore.core.arrays import Array
from dacore.core.data import ImageData
from dacore.errors import CapabilityError
from dacore.io.atomic import atomic_path, atomic_write
from dacore.io.fields import write_series, write_vtu
from dacore.io.folder import atomic_folder
from dacore.workflow.output import write_figures
from dacore.workflow.reconstruct.pictures import draw_all, shown_step
from dacore.workflow.reconstruct.read import Formats
from dacore.workflow.reconstruct.report import make_report
from dacore.workflow.reconstruct.result import Reconstruction
from dacore.workflow.reconstruct.tables import quantities_csv, residuals_csv, summary
from dacore.workflow.reconstruct.voxels import field_images
from dacore.workflow.report import write_report
from dacore.workflow.results import write_json

SIGN = "reconstruction.json"
_PORTION = 4096


def publish(result: Reconstruction, out: Path, command: str = "", scene_text: str = "") -> list[Path]:
    """Write everything into a folder; it appears whole, or what was there stays.

    Parameters
    ----------
    result : Reconstruction
    out : Path
        An earlier reconstruction there is replaced.
    command : str
        What was typed, for the record.
    scene_text : str
        The scene's TOML, for the report.

    Returns
    -------
    Files that a reader opens first.

    Raises
    ------
    StoreError
        If the folder holds something else, or cannot be written.
    """
    with atomic_folder(out, SIGN) as folder:
        found = summary(result, command)
        write_text(folder / "quantities.csv", quantities_csv(result))
        write_text(folder / "residuals.csv", residuals_csv(result))
        fields = write_fields(result, folder / "fields")
        images = [
            path for k, image in enumerate(result.images) for path in write_images(result, image, k, folder / "images")
        ]
        pictures = write_figures(draw_all(result), folder / "figures")
        write_report(folder / "report.html", make_report(result, pictures, found, scene_text))
        write_json(found, folder / SIGN)
    first = [
        folder / "report.html",
        folder / "quantities.csv",
        folder / "residuals.csv",
        folder / SIGN,
        *fields,
        *images,
    ]
    return [out / path.relative_to(folder) for path in first]


def write_text(path: Path, text: str) -> None:
    """Write a text file."""
    with atomic_write(path) as stream:
        stream.write(text)


def write_fields(result: Reconstruction, folder: Path) -> list[Path]:
    """All steps as XDMF, and the one that the report shows as VTU with deviations; NPZ of a space without cells."""
    space = result.session.background.space
    states = result.states
    if "cells" not in space.capabilities:
        path = folder / "estimate.npz"
        blocks: dict[str, Any] = {field.name: states[space.layout.block(field.name)] for field in space.fields}
        with atomic_path(path) as temporary:
            np.savez_compressed(temporary, times=result.times, **blocks)
        return [path]
    series, one = folder / "estimate.xdmf", folder / "state.vtu"
    write_series(space, {"estimate_": states}, result.times, series)
    step = shown_step(result)
    shown: dict[str, Array] = {"estimate_": states[:, step]}
    if result.estimate.uncertainty is not None:
        shown["deviation_"] = _deviations(result, step)
    write_vtu(space, shown, one)
    return [series, one]


def write_images(result: Reconstruction, image: ImageData, number: int, folder: Path) -> list[Path]:
    """Every field and its deviation on the grid of an image, in the format that it came in."""
    if "cells" not in result.session.background.space.capabilities or not image.source:
        return []
    writer = Formats(result.session.builder.registry).made(image.source)
    prefix = "" if len(result.images) == 1 else f"{number + 1}_"
    out = []
    for each in field_images(result, image):
        for what, values in (("", each.mean), ("_deviation", each.deviation)):
            if values is None:
                continue
            name = f"{prefix}{each.field}{what}"
            try:
                out.append(writer.write_image(folder / name, values, image, name, each.unit, result.times))
            except CapabilityError:
                return out
    return out


def _deviations(result: Reconstruction, step: int) -> Array:
    """Standard deviation (n_dofs,) of every degree of freedom of one state."""
    n = result.session.background.space.n_dofs
    out = np.empty(n)
    for start in range(0, n, _PORTION):
        size = min(_PORTION, n - start)
        rows = np.arange(size)
        some = csr_array((np.ones(size), (rows, start + rows)), shape=(size, n))
        out[start : start + size] = result.estimate.deviation(some, step, 0)
    return out


def files_of(paths: Sequence[Path]) -> list[Path]:
    """Those that a terminal names: the report, the tables, what ParaView opens and the folder of images."""
    shown = [path for path in paths if path.parent.name != "images"]
    images = [path.parent for path in paths if path.parent.name == "images"]
    return [*shown, *images[:1]]
