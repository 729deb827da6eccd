"""The command line: parse, call, print. Heavy modules are imported by the commands that need them."""

import logging
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn, cast

import typer

from dacore import __version__
from dacore.cli.reconstruct import reconstruct
from dacore.errors import DacoreError, MissingDependencyError, SceneError

if TYPE_CHECKING:
    from dacore.workflow.comparison.measure import Depth

INTERRUPTED = 130

app = typer.Typer(
    name="dacore",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="From a few measurements of a physical system to its whole state, with honest uncertainty.",
)

SceneFile = Annotated[Path, typer.Argument(metavar="SCENE", help="a scene in TOML, see examples/")]
Changes = Annotated[list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="change a key of the scene")]
Out = Annotated[Path | None, typer.Option("--out", metavar="DIR", help="where results go [runs/NAME]")]
Workers = Annotated[int | None, typer.Option("--workers", metavar="N", min=1, help="processes for solving [all cores]")]
Scheduler = Annotated[
    str | None,
    typer.Option("--scheduler", metavar="ADDRESS", help="tcp://host:port or scheduler file of a dask cluster to use"),
]
Fresh = Annotated[
    str | None, typer.Option("--fresh", metavar="A,B", help="stages to make anew whatever is kept, or all")
]
_KINDS_HELP = (
    "model, observation, quantity, estimator, solver, domain, backend, format or study [model and observation]"
)
Cache = Annotated[Path | None, typer.Option("--cache", metavar="DIR", help="where stages are kept [OUT/cache]")]


def _version(asked: bool) -> None:
    if asked:
        typer.echo(f"dacore {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    debug: Annotated[bool, typer.Option("--debug", help="show the traceback of an error")] = False,
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="print the version and leave")
    ] = False,
) -> None:
    logging.basicConfig(level=logging.ERROR, format="%(levelname)s: %(message)s")
    logging.getLogger("dacore").setLevel(logging.DEBUG if debug else logging.WARNING)


@app.command()
def run(
    scene: SceneFile,
    out: Out = None,
    cache: Cache = None,
    changes: Changes = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
    fresh: Fresh = None,
) -> None:
    """Run a scene: results.json, figures, fields for ParaView and report.html."""
    from dacore.cli.progress import RichBoard
    from dacore.workflow.run import run_scene

    with RichBoard() as board:
        finished = run_scene(scene, changes or [], _out(scene, out), cache, workers, board, scheduler, _stages(fresh))
    board.show(finished.tables, finished.files)


@app.command()
def plan(
    scene: SceneFile,
    out: Out = None,
    cache: Cache = None,
    changes: Changes = None,
    workers: Workers = None,
    fresh: Fresh = None,
) -> None:
    """Say which stages would run, which are kept, which are skipped, why, and what each would take."""
    from dacore.cli.progress import print_plan
    from dacore.workflow.run import plan_scene

    print_plan(plan_scene(scene, changes or [], _out(scene, out), cache, workers, _stages(fresh)))


@app.command()
def compare(
    scene: SceneFile,
    backends: Annotated[str | None, typer.Option("--backends", metavar="A,B", help="finite element libraries")] = None,
    solvers: Annotated[str | None, typer.Option("--solvers", metavar="A,B", help="linear solvers")] = None,
    observations: Annotated[
        str | None, typer.Option("--observations", metavar="A,B+C", help="observations of the scene, one or several")
    ] = None,
    estimators: Annotated[
        str | None, typer.Option("--estimators", metavar="A,B", help="estimators of the scene")
    ] = None,
    vary: Annotated[
        list[str] | None, typer.Option("--vary", metavar="KEY=A,B", help="values of any key of the scene")
    ] = None,
    until: Annotated[
        str, typer.Option("--until", metavar="WHAT", help="how far: matrices, trajectory or estimate")
    ] = "estimate",
    rounds: Annotated[int, typer.Option("--rounds", metavar="N", help="how often costs are measured")] = 3,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="where results go [runs/NAME-compare]")
    ] = None,
    cache: Cache = None,
    changes: Changes = None,
    workers: Workers = None,
) -> None:
    """Run variants of a scene side by side: agreement, cost, memory and errors of each."""
    from dacore.cli.progress import RichBoard
    from dacore.workflow.comparison.variants import Axis, axis_of, names

    lists = {"backends": backends, "solvers": solvers, "observations": observations, "estimators": estimators}
    axes = [Axis(key, names(text)) for key, text in lists.items() if text is not None]
    axes += [axis_of(text) for text in vary or []]
    folder = out if out is not None else Path("runs") / f"{scene.stem}-compare"

    from dacore.io.atomic import make_folder
    from dacore.workflow.comparison.output import publish, tables
    from dacore.workflow.comparison.run import compare as run_comparison

    with RichBoard() as board:
        found = run_comparison(
            scene, axes, changes or [], cache or folder / "cache", cast("Depth", until), rounds, workers, board
        )
        make_folder(folder)
        files = publish(found, folder, " ".join(["dacore", *sys.argv[1:]]))
    board.show(tables(found), files)
    failed = [variant for variant in found.variants if variant.error]
    for variant in failed:
        typer.echo(f"error: {variant.label}: {variant.error}", err=True)
    if failed:
        raise typer.Exit(1)


@app.command()
def bench(
    scene: SceneFile,
    sizes: Annotated[
        str | None, typer.Option("--sizes", metavar="KEY=A,B", help="a key that makes the mesh finer, finest last")
    ] = None,
    larger: Annotated[
        str | None, typer.Option("--growth", metavar="KEY=A,B", help="sizes whose costs alone are measured")
    ] = None,
    vary: Annotated[
        list[str] | None,
        typer.Option("--vary", metavar="KEY=A,B", help="one more key to vary; 'K=A,B; L=C,D': all combinations"),
    ] = None,
    only: Annotated[
        list[str] | None, typer.Option("--only", metavar="WHAT", help="forward, voxels, estimate, or a sweep's name")
    ] = None,
    reference: Annotated[
        list[str] | None, typer.Option("--reference", metavar="KEY=VALUE", help="what the reference has instead")
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", metavar="DIR", help="where results go [runs/NAME-bench]")] = None,
    cache: Cache = None,
    changes: Changes = None,
    workers: Workers = None,
) -> None:
    """Measure error against cost over a scene's settings, and say which to take for a wanted error."""
    from dacore.cli.progress import RichBoard
    from dacore.io.atomic import make_folder
    from dacore.workflow.bench.output import publish, tables
    from dacore.workflow.bench.run import bench as run_bench
    from dacore.workflow.bench.sweeps import axes_of
    from dacore.workflow.comparison.variants import axis_of

    folder = out if out is not None else Path("runs") / f"{scene.stem}-bench"
    with RichBoard() as board:
        found = run_bench(
            scene, changes or [], axis_of(sizes) if sizes else None, [axes_of(text) for text in vary or []], only or [],
            cache or folder / "cache", workers, board, [axis_of(text) for text in reference or []],
            axis_of(larger) if larger else None,
        )  # fmt: skip
        make_folder(folder)
        files = publish(found, folder, " ".join(["dacore", *sys.argv[1:]]))
    board.show(tables(found), files)
    for name, error in found.failures.items():
        typer.echo(f"error: {name}: {error}", err=True)
    if found.failures:
        raise typer.Exit(1)


@app.command()
def stress(
    scene: SceneFile,
    themes: Annotated[str | None, typer.Option("--themes", metavar="A,B", help="physics, data, noise …")] = None,
    case: Annotated[str, typer.Option("--case", metavar="TEXT", help="cases whose name contains this")] = "",
    page: Annotated[
        Path | None, typer.Option("--page", metavar="FILE", help="a Markdown page whose tables are replaced")
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="where results go [runs/NAME-stress]")
    ] = None,
    cache: Cache = None,
    changes: Changes = None,
    workers: Workers = None,
) -> None:
    """Try hard cases on a scene: which are answered, which are refused, and whether an error goes unsaid."""
    from dacore.cli.progress import RichBoard
    from dacore.io.atomic import make_folder
    from dacore.workflow.comparison.variants import names
    from dacore.workflow.stress.catalogue import chosen
    from dacore.workflow.stress.output import publish, tables, update
    from dacore.workflow.stress.run import stress as run_catalogue

    cases = chosen(names(themes or ""), case)
    folder = out if out is not None else Path("runs") / f"{scene.stem}-stress"
    with RichBoard() as board:
        make_folder(folder)
        found = run_catalogue(scene, cases, changes or [], cache or folder / "cache", workers or 1, board)
        files = publish(found, folder, " ".join(["dacore", *sys.argv[1:]]))
        if page is not None:
            update(found, page)
    board.show(tables(found), files)
    for each in found.failed:
        typer.echo(f"error: {each.case.name}: {each.verdict}: {each.said}", err=True)
    if found.failed:
        raise typer.Exit(1)


app.command()(reconstruct)


@app.command()
def plugins(
    scene: Annotated[Path | None, typer.Argument(metavar="SCENE", help="list its plugin files too")] = None,
) -> None:
    """List what is installed, what failed and why, what is missing and how to install it."""
    from dacore.cli.progress import print_plugins
    from dacore.plugins.registry import load

    found = load()
    if scene is not None:
        from dacore.io.scene import plugin_files
        from dacore.plugins.files import located, with_files

        found = with_files(found, located(plugin_files(scene), scene.parent))
    print_plugins(found.table())


@app.command("new-plugin")
def new_plugin(
    name: Annotated[str, typer.Argument(metavar="NAME", help="of the distribution, such as dacore-tumour")],
    kinds: Annotated[
        list[str] | None,
        typer.Option("--kind", metavar="KIND", help=_KINDS_HELP),
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", metavar="DIR", help="where the folder NAME goes [.]")] = None,
) -> None:
    """Write an installable plugin to begin with: working code, tests, and a scene that uses it."""
    from dacore.scaffold.kinds import DEFAULT
    from dacore.scaffold.write import new_plugin as write

    asked = [each.strip() for text in kinds or DEFAULT for each in text.split(",") if each.strip()]
    folder = write(name, asked, out)
    typer.echo(f"{folder}: a plugin with {', '.join(asked)}. Next:")
    for line in (f"cd {folder}", "pip install -e '.[test]'", "pytest", "dacore run scene.toml"):
        typer.echo(f"  {line}")
    if not kinds:
        typer.echo("Other kinds: --kind quantity --kind estimator, and so on; see dacore new-plugin --help")


def _stages(text: str | None) -> list[str]:
    return [name.strip() for name in (text or "").split(",") if name.strip()]


def _out(scene: Path, out: Path | None) -> Path:
    return out if out is not None else Path("runs") / scene.stem


def main(arguments: list[str] | None = None) -> Any:
    """Run the command line; exit code 2 for a bad scene or command, 1 for another failure."""
    arguments = sys.argv[1:] if arguments is None else arguments
    try:
        app(args=arguments)
    except DacoreError as error:
        if "--debug" in arguments:
            raise
        typer.echo(f"error: {' '.join(str(error).split())}", err=True)
        sys.exit(2 if isinstance(error, SceneError | MissingDependencyError) else 1)
    except KeyboardInterrupt:
        _interrupted()
    except SystemExit as stop:
        if stop.code == INTERRUPTED:
            _interrupted()
        raise


def _interrupted() -> NoReturn:
    typer.echo("interrupted; what was finished is kept, run again to go on", err=True)
    sys.exit(INTERRUPTED)
