"""What the command line does: files in, a folder of results out."""

from collections.abc import Sequence
from pathlib import Path

from dacore.algebra.threads import one_blas_thread
from dacore.core.data import Asked
from dacore.errors import SceneError
from dacore.io.folder import check_folder
from dacore.io.units import parse_quantity
from dacore.workflow.board import ProgressBoard
from dacore.workflow.machine import usable_cores
from dacore.workflow.open import open_scene
from dacore.workflow.reconstruct.output import SIGN, files_of, publish
from dacore.workflow.reconstruct.read import digest
from dacore.workflow.reconstruct.run import reconstruct
from dacore.workflow.reconstruct.tables import notes_table, parameter_table, quantity_table
from dacore.workflow.report_parts import Table


def reconstruct_files(
    path: Path,
    files: Sequence[Path],
    changes: Sequence[str],
    out: Path,
    cache: Path | None = None,
    workers: int | None = None,
    board: ProgressBoard | None = None,
    asked: Asked | None = None,
    noise: str | None = None,
    estimator: str | None = None,
    tolerance: float | None = None,
    command: str = "",
) -> tuple[list[Table], list[Path]]:
    """Reconstruct from files and write the results.

    Parameters
    ----------
    path : Path
        The scene.
    files : sequence of Path
    changes : sequence of str
        ``"key=value"`` changes to the scene.
    out : Path
        Folder of the results.
    cache : Path, optional
        Folder of kept stages; that of ``dacore run`` by default.
    workers : int, optional
    board : ProgressBoard, optional
    asked, noise, estimator, tolerance
        As `dacore.workflow.reconstruct.run.reconstruct` takes them.
    command : str
        What was typed, for the record.

    Returns
    -------
    tables : list of Table
        For a terminal.
    files : list of Path
    """
    # What cannot end well ends before anything is trained.
    check_folder(out, SIGN)
    for each in files:
        digest(each)
    session = open_scene(path, changes, cache, workers or usable_cores(), board)
    with one_blas_thread():
        result = reconstruct(
            session, list(files), asked=asked, noise=noise, estimator=estimator, tolerance=tolerance
        )  # fmt: skip
        text = path.read_text(encoding="utf-8") + "".join(f"\n# --set {change}" for change in changes)
        written = publish(result, out, command, text)
    found = [quantity_table(result), parameter_table(result), notes_table(result), _verdict(result.verdict)]
    return [table for table in found if table is not None], files_of(written)


def _verdict(text: str) -> Table:
    return Table(["does it fit?"], [[text]])


def times_of(text: str) -> tuple[float, ...]:
    """Times [s] as they are typed: "0.5,1,1.5 ms"."""
    parts = [part.strip() for part in text.split(",")]
    unit = parts[-1].partition(" ")[2].strip()
    return tuple(
        parse_quantity(part if " " in part or not unit else f"{part} {unit}", "s", "--times") for part in parts
    )


def components_of(text: str) -> tuple[int, ...]:
    """Components as they are typed: "x,z" or "0,2"."""
    out = []
    for part in (each.strip() for each in text.split(",")):
        if part in ("x", "y", "z"):
            out.append("xyz".index(part))
        elif part.isdigit():
            out.append(int(part))
        else:
            raise SceneError(f"--components: got {part!r}, expected x, y, z or numbers from 0, as x,y")
    return tuple(out)
