"""Dask clients: of processes on this machine, and of a scheduler that runs elsewhere."""

import json
import logging
import os
import re
import signal
import threading
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import dask
from distributed import Client, LocalCluster
from distributed.versions import VersionMismatchWarning

from dacore.errors import WorkerError

logger = logging.getLogger(__name__)

CONNECT_SECONDS = 5
START_SECONDS = 120
_ADDRESS = re.compile(r"[a-z]+://\S+:\d+")

# Nothing is drawn, nothing is sampled, and a worker inside a long factorisation is not taken for dead.
_QUIET: dict[str, Any] = {
    "distributed.scheduler.worker-ttl": None,
    "distributed.scheduler.http.routes": [],
    "distributed.worker.http.routes": [],
    "distributed.worker.profile.enabled": False,
    "distributed.admin.system-monitor.gil.enabled": False,
    "distributed.admin.tick.limit": "1h",
}


@contextmanager
def local(workers: int) -> Iterator[Client]:
    """Processes on this machine, each with one thread, that listen on the loopback interface alone.

    They leave when the block ends, however it ends, and when this process dies.

    Parameters
    ----------
    workers : int

    Raises
    ------
    WorkerError
        If they cannot be started.
    """
    before = set(os.environ)
    with dask.config.set(_QUIET), _silent():
        cluster = None
        try:
            with _deaf_children():
                cluster = LocalCluster(
                    n_workers=workers, threads_per_worker=1, processes=True, host="127.0.0.1", memory_limit=None,
                    death_timeout=START_SECONDS,
                    dashboard_address="127.0.0.1:0", scheduler_kwargs={"dashboard": False},
                    silence_logs=logging.CRITICAL,
                )  # fmt: skip
            # Dask adds variables here for the sake of its processes, and again for each that it starts again.
            added = set(os.environ) - before
            _forget(added)
            client = Client(cluster, set_as_default=False, direct_to_workers=True)
        except (OSError, RuntimeError, TimeoutError) as error:
            if cluster is not None:
                _end(cluster)
            raise WorkerError(
                f"{workers} worker processes could not be started ({_line(error)}); use --workers 1, and in a script "
                'put if __name__ == "__main__": around its work'
            ) from error
        except BaseException:
            if cluster is not None:
                _end(cluster)
            raise
        try:
            yield client
        finally:
            # Ctrl-C again must not stop the ending half-way: it takes a second at most.
            with _deaf_children():
                client.close(timeout=1)
                _end(cluster)
            _forget(added)


@contextmanager
def connected(scheduler: str) -> Iterator[Client]:
    """A scheduler that somebody else started; it and its workers go on when the block ends.

    Parameters
    ----------
    scheduler : str
        ``tcp://host:port`` (or another protocol of dask), or the path of a scheduler file.

    Raises
    ------
    WorkerError
        If it cannot be read or reached.
    """
    address = address_of(scheduler)
    with _silent():
        try:
            with _versions_in_one_line(scheduler):
                client = Client(address, set_as_default=False, timeout=CONNECT_SECONDS)
        except (OSError, ValueError, TimeoutError, RuntimeError) as error:
            raise WorkerError(
                f"--scheduler {scheduler}: nobody answers at {address} ({_line(error)}); "
                "is the scheduler running, and reachable from here?"
            ) from error
        try:
            yield client
        finally:
            with suppress(OSError, TimeoutError):
                client.close(timeout=2)


def address_of(scheduler: str) -> str:
    """Address of a scheduler given by address or by its scheduler file; WorkerError if it is neither."""
    if _ADDRESS.fullmatch(scheduler):
        return scheduler
    try:
        address = str(json.loads(Path(scheduler).read_text(encoding="utf-8"))["address"])
    except OSError as error:
        raise WorkerError(
            f"--scheduler {scheduler}: neither an address nor a file ({error.strerror}); "
            "expected tcp://host:port, or the file of dask scheduler --scheduler-file"
        ) from error
    except (ValueError, KeyError, TypeError) as error:
        raise WorkerError(
            f"--scheduler {scheduler}: not a scheduler file; expected what dask scheduler --scheduler-file wrote"
        ) from error
    if not _ADDRESS.fullmatch(address):
        raise WorkerError(f"--scheduler {scheduler}: its address is {address!r}, expected tcp://host:port")
    return address


@contextmanager
def _versions_in_one_line(scheduler: str) -> Iterator[None]:
    """Dask warns of other versions with a table; whether they work together shows at once, so a line will do."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always", VersionMismatchWarning)
        yield
    for each in said:
        if issubclass(each.category, VersionMismatchWarning):
            logger.warning("--scheduler %s: its dask, or what dask uses, has other versions than here", scheduler)
        else:
            warnings.warn_explicit(each.message, each.category, each.filename, each.lineno)


@contextmanager
def _silent() -> Iterator[None]:
    """Nothing of dask's own log: what concerns the user comes as an error of ours."""
    names = [name for name in logging.root.manager.loggerDict if name.partition(".")[0] == "distributed"]
    before = {name: logging.getLogger(name).level for name in ("distributed", *names)}
    for name, level in before.items():
        if level != logging.NOTSET or name == "distributed":
            logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for name, level in before.items():
            logging.getLogger(name).setLevel(level)


def _end(cluster: Any) -> None:
    """Kill the workers, which hold nothing that is worth waiting for, and close the rest."""
    nannies = list(cluster.workers.values())
    for nanny in nannies:
        with suppress(AttributeError):
            nanny.close_gracefully()  # or it would start another
    deadline = time.monotonic() + 5
    for nanny in nannies:
        # One that is being started again has no number yet, and dask could not close it.
        while _being_started(nanny) and time.monotonic() < deadline:
            time.sleep(0.01)
        with suppress(AttributeError, OSError, TypeError):
            os.kill(nanny.pid, signal.SIGKILL)
    with suppress(OSError, TimeoutError):
        cluster.close(timeout=10)


def _being_started(nanny: Any) -> bool:
    process = getattr(getattr(nanny, "process", None), "process", None)
    return process is not None and process.pid is None


def _forget(names: set[str]) -> None:
    for name in names:
        os.environ.pop(name, None)


def _line(error: BaseException) -> str:
    return " ".join(str(error).split())[:300] or type(error).__name__


@contextmanager
def _deaf_children() -> Iterator[None]:
    """Processes begun here ignore Ctrl-C from their first moment: it is the parent's affair."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
