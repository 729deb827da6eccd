"""``dacore reconstruct``: measured data in, state and quantities out."""

import sys
from pathlib import Path
from typing import Annotated, Literal, cast

import typer

from dacore.errors import SceneError


def reconstruct(
    scene: Annotated[Path, typer.Argument(metavar="SCENE", help="a scene in TOML, see examples/")],
    more: Annotated[list[Path] | None, typer.Argument(metavar="[FILE ...]", help="more files of data")] = None,
    data: Annotated[
        list[Path] | None,
        typer.Option("--data", metavar="FILE", help="CSV, NPZ, HDF5 or NIfTI; several files may follow one another"),
    ] = None,
    unit: Annotated[
        str | None, typer.Option("--unit", metavar="UNIT", help="of the values, if no file says it")
    ] = None,
    noise: Annotated[
        str | None, typer.Option("--noise", metavar="SIGMA", help="'0.2 um', or '5%' of the largest value; 0: exact")
    ] = None,
    times: Annotated[
        str | None, typer.Option("--times", metavar="T1,T2", help="of the volumes, as '0.5,1,1.5 ms' [s]")
    ] = None,
    frequency: Annotated[
        str | None, typer.Option("--frequency", metavar="HZ", help="of the drive, for complex data")
    ] = None,
    phase: Annotated[
        list[Path] | None,
        typer.Option("--phase", metavar="FILE", help="phases [rad] of amplitudes, one a file of data"),
    ] = None,
    mask: Annotated[
        Path | None, typer.Option("--mask", metavar="FILE", help="image, zero where nothing is measured")
    ] = None,
    components: Annotated[
        str | None, typer.Option("--components", metavar="X,Y", help="components of the files, in their order")
    ] = None,
    field: Annotated[str | None, typer.Option("--field", metavar="NAME", help="which field was measured")] = None,
    frame: Annotated[
        str, typer.Option("--frame", metavar="WHICH", help="axes of an image's vectors: world or voxel")
    ] = "world",
    estimator: Annotated[
        str | None, typer.Option("--estimator", metavar="NAME", help="one of the scene's [its last]")
    ] = None,
    tolerance: Annotated[
        str | None, typer.Option("--tolerance", metavar="LENGTH", help="how far sensors may be off, as '1 mm' [cm]")
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="where results go [runs/NAME-reconstruction]")
    ] = None,
    cache: Annotated[
        Path | None, typer.Option("--cache", metavar="DIR", help="where stages are kept [runs/NAME/cache]")
    ] = None,
    changes: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="change a key of the scene")
    ] = None,
    workers: Annotated[
        int | None, typer.Option("--workers", metavar="N", min=1, help="processes for solving [all cores]")
    ] = None,
) -> None:
    """Reconstruct state and quantities from measured data: fields, tables and report.html."""
    files = [*(data or []), *(more or [])]
    if not files:
        raise SceneError("--data: missing; expected at least one file of measured values")
    if frame not in ("world", "voxel"):
        raise SceneError(f"--frame: got {frame!r}, expected world or voxel")
    from dacore.cli.progress import RichBoard
    from dacore.core.data import Asked
    from dacore.io.units import parse_quantity
    from dacore.workflow.reconstruct.command import components_of, reconstruct_files, times_of

    asked = Asked(
        unit,
        None if times is None else times_of(times),
        None if frequency is None else parse_quantity(frequency, "Hz", "--frequency"),
        field,
        () if components is None else components_of(components),
        cast(Literal["world", "voxel"], frame),
        mask,
        tuple(phase or ()),
    )
    near = None if tolerance is None else parse_quantity(tolerance, "cm", "--tolerance")
    folder = out if out is not None else Path("runs") / f"{scene.stem}-reconstruction"
    with RichBoard() as board:
        tables, paths = reconstruct_files(
            scene, files, changes or [], folder, cache, workers, board, asked, noise, estimator, near,
            " ".join(["dacore", *sys.argv[1:]]),
        )  # fmt: skip
    board.show(tables, paths)
