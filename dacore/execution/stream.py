"""Items to the workers of a dask client, no more at once than they can take, and results back."""

import os
import secrets
import time
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager
from itertools import count
from typing import Any

import cloudpickle
from distributed import Client, Future, KilledWorker, wait

from dacore.errors import WorkerError
from dacore.execution.interrupts import kept_interrupts
from dacore.execution.worker import Delivery, begun, call, refusal
from dacore.plugins.versions import fingerprints

PATIENCE = 60.0
"""Seconds [s] without a single worker after which a run gives up."""

_LOOK = 1.0  # seconds between two looks at which workers there are


@contextmanager
def instructed(
    client: Client, function: Callable[[Any, Any], Any], shared: Any, describe: Callable[[Any], str], beside: bool
) -> Iterator[Callable[[Iterable[Any]], Generator[tuple[Any, Any], None, None]]]:
    """Workers that hold the shared object; see `dacore.execution.foreach.crew`.

    Parameters
    ----------
    client : Client
    function, shared, describe
        As for `crew`.
    beside : bool
        Whether the workers are processes of this installation, whose versions need no comparing.

    Yields
    ------
    callable
        Takes items; yields (item, result) as they complete.
    """
    token, numbers = f"dacore-{secrets.token_hex(8)}", count()
    _Crew(client, token).wait_for_one()
    with kept_interrupts() as look, _packed(shared, beside) as payload:
        try:
            _deliver(client, token, payload, beside)
            del payload
            yield lambda items: _results(client, token, function, zip(numbers, items, strict=False), describe, look)
        finally:
            _take_back(client, token)


@contextmanager
def _packed(shared: Any, beside: bool) -> Iterator[bytes | str]:
    """The shared object as bytes for other machines, or as a file in memory that processes of this one read.

    Through the scheduler, which is a part of this process, it would be held several times. The file has
    no name that could be left behind.
    """
    if not beside:
        yield cloudpickle.dumps(shared)
        return
    with os.fdopen(os.memfd_create("dacore"), "wb") as file:
        cloudpickle.dump(shared, file)
        file.flush()
        yield f"/proc/{os.getpid()}/fd/{file.fileno()}"


def _deliver(client: Client, token: str, payload: bytes | str, beside: bool) -> None:
    try:
        client.register_plugin(Delivery(token, payload, {} if beside else fingerprints()), name=token)
        told = client.run(refusal, token)
    except Exception as error:
        reason = " ".join(f"{type(error).__name__}: {error}".split())[:300]
        raise WorkerError(
            f"a worker could not take the run's work ({reason}); it needs this version of dacore, and the same plugins"
        ) from error
    for address, text in told.items():
        if text:
            raise WorkerError(f"worker {address}: {text}")


def _results(
    client: Client, token: str, function: Callable[[Any, Any], Any], source: Iterator[tuple[int, Any]],
    describe: Callable[[Any], str], look: Callable[[], None],
) -> Generator[tuple[Any, Any], None, None]:  # fmt: skip
    """Results of (number, item): no number is given twice, since dask knows a task by it."""
    crew = _Crew(client, token)
    under_way: dict[Future, tuple[int, Any]] = {}
    failure: Exception | None = None
    exhausted = False
    while True:
        # Two a worker: the next is there when one ends, though this process is busy with a result.
        while not exhausted and failure is None and len(under_way) < 2 * max(1, crew.count()):
            try:
                number, item = next(source)
            except StopIteration:
                exhausted = True
                break
            future = client.submit(call, token, number, function, item, key=f"{token}-{number}", pure=False)
            under_way[future] = number, item
        if not under_way:
            break
        for future in _complete(crew, list(under_way), look):
            number, item = under_way.pop(future)
            outcome = _outcome(future, describe(item), crew)
            if isinstance(outcome, Exception):
                if failure is None:
                    failure = outcome
                    _cancel_idle(client, token, under_way)
            else:
                yield item, outcome[0]
            del future, outcome
    if failure is not None:
        raise failure


def _complete(crew: "_Crew", futures: list[Future], look: Callable[[], None]) -> list[Future]:
    """Wait until something is complete, no worker is left for too long, or Ctrl-C was pressed."""
    while True:
        look()
        try:
            with crew.client.as_current():
                return list(wait(futures, timeout=_LOOK, return_when="FIRST_COMPLETED").done)
        except TimeoutError:
            crew.count()
        except CancelledError as error:
            raise WorkerError(f"the scheduler at {crew.address} is gone; what is done is kept, run again") from error


def _outcome(future: Future, name: str, crew: "_Crew") -> tuple[Any] | Exception:
    """Return (result,) or what went wrong."""
    try:
        good, value = future.result()
    except KilledWorker as error:
        deaths = error.allowed_failures + 1
        return WorkerError(
            f"{name}: {deaths} workers died with this item on their hands (out of memory?); what is done is kept, "
            "run again with fewer workers or more memory"
        )
    except WorkerError as error:
        return WorkerError(f"{name}: a worker refused it: {error}")
    except Exception as error:  # noqa: BLE001
        reason = " ".join(f"{type(error).__name__}: {error}".split())[:300]
        return WorkerError(f"{name}: lost on its way ({reason}); is the scheduler still running at {crew.address}?")
    return (value,) if good else value


def _cancel_idle(client: Client, token: str, under_way: dict[Future, tuple[int, Any]]) -> None:
    """Cancel what no worker has begun."""
    at_work = {number for numbers in client.run(begun, token).values() for number in numbers}
    idle = [future for future, (number, _) in under_way.items() if number not in at_work and not future.done()]
    client.cancel(idle)
    for future in idle:
        del under_way[future]


def _take_back(client: Client, token: str) -> None:
    # The run is over; whatever prevents this (a scheduler gone, a closed client) frees the workers as well.
    try:
        client.unregister_worker_plugin(token)
    except Exception:  # noqa: BLE001
        return


class _Crew:
    """Which workers there are; asks at most once a second."""

    def __init__(self, client: Client, token: str) -> None:
        self.client, self.token = client, token
        self.address = client.scheduler.address if client.scheduler else "its address"
        self._asked, self._count = -_LOOK, 0
        self._seen = time.monotonic()

    def count(self) -> int:
        """How many workers there are; WorkerError if there has been none for too long."""
        now = time.monotonic()
        if now - self._asked >= _LOOK:
            self._asked = now
            try:
                self._count = len(self.client.nthreads())
            except (OSError, TimeoutError) as error:
                raise WorkerError(f"the scheduler at {self.address} is gone ({error}); what is done is kept") from error
            if self._count:
                self._seen = now
            elif now - self._seen > PATIENCE:
                raise WorkerError(
                    f"no worker at {self.address} for {PATIENCE:.0f} s; what is done is kept, "
                    "start workers and run again"
                )
        return self._count

    def wait_for_one(self) -> None:
        """Return as soon as there is a worker."""
        while not self.count():
            time.sleep(0.2)
