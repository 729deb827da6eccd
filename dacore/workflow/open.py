"""Open a scene: read it, check it, and put its stages together."""

from collections.abc import Collection, Sequence
from pathlib import Path

from dacore.errors import DacoreError, SceneError
from dacore.io.scene import read_scene
from dacore.pipeline.runner import Runner
from dacore.workflow.board import ProgressBoard
from dacore.workflow.build import Builder
from dacore.workflow.laws import sizes_of
from dacore.workflow.session import Session
from dacore.workflow.stages import scene_pipeline


def open_scene(
    path: str | Path,
    changes: Sequence[str] = (),
    cache: str | Path | None = None,
    workers: int = 1,
    board: ProgressBoard | None = None,
    scheduler: str | None = None,
    fresh: Collection[str] = (),
) -> Session:
    """Open a scene for use from Python.

    Parameters
    ----------
    path : str or Path
        The scene in TOML.
    changes : sequence of str
        ``"key=value"`` changes to it, as ``--set`` on the command line.
    cache : str or Path, optional
        Folder of kept results; ``runs/NAME/cache``, as on the command line, by default.
    workers : int
        Processes for solving. A script that asks for more than one needs
        ``if __name__ == "__main__":`` around its work.
    board : ProgressBoard, optional
        Where progress is shown.
    scheduler : str, optional
        ``tcp://host:port`` or the scheduler file of a dask cluster whose workers solve instead of processes here.
    fresh : collection of str
        Stages to make anew whatever is kept, "all" for all of them; what is made replaces what was kept.

    Returns
    -------
    Session

    Raises
    ------
    SceneError
        Names the key, what was given and what is allowed.
    """
    file = Path(path)
    builder = Builder(read_scene(file, changes), str(file), file.parent)
    builder.check()
    show = board or ProgressBoard()
    folder = Path(cache) if cache is not None else Path("runs") / file.stem / "cache"
    pipeline = scene_pipeline(builder, workers, show, scheduler)
    try:
        runner = Runner(pipeline, folder, show.stage, fresh, sizes_of(builder.scene, builder.domain, workers))
    except DacoreError as error:
        raise SceneError(f"--{error}") from error
    return Session(builder, runner)
