"""What a study works with: the scene's results, its variants, and workers."""

from collections.abc import Callable
from dataclasses import dataclass

from dacore.workflow.session import Session

Progress = Callable[[int, int], None]


@dataclass(frozen=True, eq=False)
class Bench:
    """A study's place of work.

    Parameters
    ----------
    session : Session
        The scene and its results.
    variant : callable
        Name of a variant -> its session; results it shares with the scene are read, not made again.
    workers : int
        Processes the study may use.
    scheduler : str, optional
        Of a dask cluster to use instead.
    progress : callable, optional
        Takes (done, total).
    """

    session: Session
    variant: Callable[[str], Session]
    workers: int = 1
    scheduler: str | None = None
    progress: Progress | None = None

    def tell(self, done: int, total: int) -> None:
        """Show how far the study is."""
        if self.progress:
            self.progress(done, total)
