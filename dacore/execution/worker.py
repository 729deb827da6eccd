"""What happens on a worker: it takes the shared object once, then calls the function for items."""

import pickle
import platform
import signal
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cloudpickle
from distributed.diagnostics.plugin import WorkerPlugin
from threadpoolctl import threadpool_limits

from dacore.errors import WorkerError
from dacore.execution.worker_frames import keep_frames
from dacore.plugins.versions import fingerprints

_held: dict[str, "Held"] = {}


@dataclass
class Held:
    """What a worker keeps for one run.

    Parameters
    ----------
    shared : object
    refusal : str
        Why this worker cannot take part; empty if it can.
    begun : set of int
        Numbers of the items that were begun here.
    """

    shared: Any
    refusal: str
    begun: set[int]


class Delivery(WorkerPlugin):  # type: ignore[misc]
    """Brings the shared object to every worker, also to those that join later or come back.

    Parameters
    ----------
    token : str
        Which run it is for.
    payload : bytes or str
        The shared object, pickled, or the path of a file with it: unpickled here, where what goes wrong can
        be told.
    wanted : dict of str to str
        Fingerprints of dacore and its plugins where the run was started; empty for processes beside it.
    """

    def __init__(self, token: str, payload: bytes | str, wanted: dict[str, str]) -> None:
        self.token, self.payload, self.wanted = token, payload, wanted

    def setup(self, worker: Any) -> None:
        """Take the shared object, or remember why not."""
        _held[self.token] = Held(None, "", set())
        refusal = self._unfit(worker)
        if not refusal:
            try:
                _held[self.token].shared = _unpacked(self.payload)
            except Exception as error:  # noqa: BLE001
                refusal = _unreadable(error)
        _held[self.token].refusal = refusal
        self.payload = b""
        if not self.wanted and threading.current_thread() is threading.main_thread():
            # Ctrl-C is the affair of the process that started this one.
            signal.signal(signal.SIGINT, signal.SIG_IGN)

    def teardown(self, worker: Any) -> None:
        """Let go of the shared object."""
        _held.pop(self.token, None)

    def _unfit(self, worker: Any) -> str:
        if worker.state.nthreads != 1:
            return f"it has {worker.state.nthreads} threads, expected 1; start it with --nthreads 1"
        here = fingerprints() if self.wanted else {}
        for name, wanted in self.wanted.items():
            # A plugin that is missing here matters only if the shared object needs it.
            if here.get(name, wanted) != wanted:
                return f"it has {name} {here[name]}, this run has {wanted}; install the same version there"
        return ""


def call(token: str, number: int, function: Callable[[Any, Any], Any], item: Any) -> tuple[bool, Any]:
    """Return (True, result) or (False, exception of the function); WorkerError if this worker is unfit."""
    held = _held.get(token)
    if held is None:
        raise WorkerError("it does not have what the run shares; stop it and start it again")
    if held.refusal:
        raise WorkerError(held.refusal)
    held.begun.add(number)
    # OpenMP keeps its limit for each thread, so it is set in the one that works.
    with threadpool_limits(limits=1):
        try:
            return True, function(held.shared, item)
        except Exception as error:  # noqa: BLE001
            keep_frames(error)
            return False, _portable(error)


def refusal(token: str) -> str:
    """Why this worker cannot take part; empty if it can."""
    return _held[token].refusal if token in _held else "it does not have what the run shares"


def begun(token: str) -> list[int]:
    """Return the numbers of the items that were begun here."""
    return sorted(_held[token].begun) if token in _held else []


def _unpacked(payload: bytes | str) -> Any:
    if isinstance(payload, bytes):
        return pickle.loads(payload)
    with Path(payload).open("rb") as file:
        return pickle.load(file)


def _unreadable(error: Exception) -> str:
    if isinstance(error, ModuleNotFoundError) and error.name:
        package = error.name.partition(".")[0]
        return f"it lacks {package!r}, which this run needs; install the same packages there"
    reason = " ".join(f"{type(error).__name__}: {error}".split())
    return f"it cannot read what the run shares ({reason}); install the same versions there"


def _portable(error: Exception) -> Exception:
    """The error itself if it can travel, or its text."""
    with suppress(Exception):
        # An exception with an __init__ of its own may come back with another text, or not at all.
        if str(pickle.loads(cloudpickle.dumps(error))) == str(error):
            return error
    return WorkerError(" ".join(f"{type(error).__name__}: {error}".split()) + f" (on {platform.node()})")
