"""One function, many items: results as they complete, wherever the work is done."""

from collections.abc import Callable, Generator, Iterable
from typing import TypeVar

from dacore.algebra.threads import one_blas_thread

Shared = TypeVar("Shared")
Item = TypeVar("Item")
Result = TypeVar("Result")


def for_each(
    function: Callable[[Shared, Item], Result],
    shared: Shared,
    items: Iterable[Item],
    workers: int = 1,
    scheduler: str | None = None,
    describe: Callable[[Item], str] = repr,
) -> Generator[tuple[Item, Result], None, None]:
    """Call ``function(shared, item)`` for every item; every call gives the same numbers wherever it is made.

    With one worker and no scheduler everything happens in this process, in order, and
    `dask.distributed` is not imported. Otherwise `shared` travels once to each worker, each worker
    uses one BLAS thread, and items are taken from `items` only as workers come free: two of them a
    worker are under way at most, and one result is in this process at a time. A worker that dies is
    replaced (here) or done without (on a cluster), and its work is done again.

    Parameters
    ----------
    function : callable
        Of a module, so that a worker can find it.
    shared : object
        What every call needs; can be pickled. It may be large.
    items : iterable
        Read lazily; each can be pickled and is small.
    workers : int
        Processes on this machine; ignored with a scheduler, which has its own.
    scheduler : str, optional
        ``tcp://host:port`` of a dask scheduler, or the path of its scheduler file.
    describe : callable
        What to call an item in an error.

    Yields
    ------
    (item, result)
        As they complete: in the order of `items` only with one worker.

    Raises
    ------
    Exception
        What `function` raised first. What workers are at is finished and yielded before; nothing
        else is begun.
    WorkerError
        If workers cannot be had, do not fit (another dacore, a plugin missing), die each time at one
        item, or all go away.

    Notes
    -----
    Close the iterator (``contextlib.closing``) to end the workers when leaving early. A script needs
    ``if __name__ == "__main__":`` around its work if `workers` is larger than one.
    """
    if workers <= 1 and scheduler is None:
        with one_blas_thread():
            for item in items:
                yield item, function(shared, item)
        return
    # Half a second that one process alone need not spend.
    from dacore.execution.cluster import connected, local
    from dacore.execution.stream import stream

    with connected(scheduler) if scheduler is not None else local(workers) as client:
        yield from stream(client, function, shared, items, describe, scheduler is None)
