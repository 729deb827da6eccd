"""One function, many items: results as they complete, wherever the work is done."""

from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from typing import TypeVar

from dacore.algebra.threads import one_blas_thread

Shared = TypeVar("Shared")
Item = TypeVar("Item")
Result = TypeVar("Result")

Run = Callable[[Iterable[Item]], Generator[tuple[Item, Result], None, None]]


@contextmanager
def crew(
    function: Callable[[Shared, Item], Result],
    shared: Shared,
    workers: int = 1,
    scheduler: str | None = None,
    describe: Callable[[Item], str] = repr,
) -> Iterator[Run[Item, Result]]:
    """Workers that keep the shared object from one list of items to the next.

    With one worker and no scheduler everything happens in this process, in order, and
    `dask.distributed` is not imported. Otherwise workers are had, and `shared` travels once to each of
    them, when the first list is asked for. Each worker uses one BLAS thread, and items are taken from
    their list only as workers come free: two of them a worker are under way at most, and one result is
    in this process at a time. A worker that dies is replaced (here) or done without (on a cluster), and
    its work is done again. Workers of this machine end with the block, however it ends.

    Parameters
    ----------
    function : callable
        Of a module, so that a worker can find it.
    shared : object
        What every call needs; can be pickled. It may be large.
    workers : int
        Processes on this machine; ignored with a scheduler, which has its own.
    scheduler : str, optional
        ``tcp://host:port`` of a dask scheduler, or the path of its scheduler file.
    describe : callable
        What to call an item in an error.

    Yields
    ------
    callable
        Takes items, which are read lazily; each can be pickled and is small. Yields (item,
        ``function(shared, item)``) as they complete: in the order of the items only with one worker. One
        list at a time; close the iterator (``contextlib.closing``) when leaving it early. It raises what
        is said at `for_each`.

    Notes
    -----
    A script needs ``if __name__ == "__main__":`` around its work if `workers` is larger than one.
    """
    if workers <= 1 and scheduler is None:

        def here(items: Iterable[Item]) -> Generator[tuple[Item, Result], None, None]:
            with one_blas_thread():
                for item in items:
                    yield item, function(shared, item)

        yield here
        return
    with ExitStack() as stack:
        hired: list[Run[Item, Result]] = []

        def there(items: Iterable[Item]) -> Generator[tuple[Item, Result], None, None]:
            if not hired:
                # Half a second that one process alone need not spend.
                from dacore.execution.cluster import connected, local
                from dacore.execution.stream import instructed

                client = stack.enter_context(connected(scheduler) if scheduler is not None else local(workers))
                work = instructed(client, function, shared, describe, scheduler is None)
                hired.append(stack.enter_context(work))
            yield from hired[0](items)

        yield there


def for_each(
    function: Callable[[Shared, Item], Result],
    shared: Shared,
    items: Iterable[Item],
    workers: int = 1,
    scheduler: str | None = None,
    describe: Callable[[Item], str] = repr,
) -> Generator[tuple[Item, Result], None, None]:
    """Call ``function(shared, item)`` for every item; every call gives the same numbers wherever it is made.

    One list for a `crew`, which says where the work is done.

    Parameters
    ----------
    function, shared, workers, scheduler, describe
        As for `crew`.
    items : iterable
        Read lazily; each can be pickled and is small.

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
    Close the iterator (``contextlib.closing``) to end the workers when leaving early.
    """
    with crew(function, shared, workers, scheduler, describe) as run:
        yield from run(items)
