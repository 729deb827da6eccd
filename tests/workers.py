"""A real dask cluster of processes, as somebody would start it by hand, and work to give it."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_info

ROOT = Path(__file__).resolve().parents[1]


@dataclass
class Cluster:
    """A scheduler, its file, and the workers started for it."""

    folder: Path
    file: Path
    processes: list[subprocess.Popen] = field(default_factory=list)

    def start(self, *command: object, path: Path | None = None) -> subprocess.Popen:
        """Start one of dask's commands, with `path` before everything that is installed."""
        places = [str(path)] if path is not None else []
        places += [str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(places)}
        log = (self.folder / f"{len(self.processes)}.log").open("w")
        with log:
            started = subprocess.Popen(
                [sys.executable, "-W", "ignore", "-m", *map(str, command)],
                stdout=log, stderr=log, cwd=self.folder, env=environment, start_new_session=True,
            )  # fmt: skip
        self.processes.append(started)
        return started

    def worker(self, *options: object, path: Path | None = None) -> subprocess.Popen:
        """Start a worker without a nanny: one process, which nobody starts again."""
        return self.start(
            "distributed.cli.dask_worker", "--scheduler-file", self.file, "--no-nanny", "--no-dashboard",
            "--memory-limit", 0, "--host", "127.0.0.1", *(options or ("--nthreads", 1)), path=path,
        )  # fmt: skip


@contextmanager
def cluster(folder: Path, workers: int = 0) -> Iterator[Cluster]:
    """Start a scheduler and some workers; whatever was started is gone in the end."""
    made = Cluster(folder, folder / "scheduler.json")
    try:
        made.start(
            "distributed.cli.dask_scheduler", "--scheduler-file", made.file, "--host", "127.0.0.1", "--port", 0,
            "--no-dashboard", "--dashboard-address", "127.0.0.1:0",
        )  # fmt: skip
        for _ in range(workers):
            made.worker()
        wait_for(lambda: made.file.exists() and made.file.stat().st_size > 0, made)
        yield made
    finally:
        for process in made.processes:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()


def wait_for(condition, made: Cluster | None = None, seconds: float = 120.0) -> None:
    """Wait for something that should come about; fail if it does not."""
    deadline = time.monotonic() + seconds
    while not condition():
        logs = [path.read_text()[-2000:] for path in made.folder.glob("*.log")] if made else []
        assert time.monotonic() < deadline, logs
        time.sleep(0.05)


class Shared:
    """Something large that notes in a file how often a process unpickled it."""

    def __init__(self, folder: Path, size: int = 1000):
        self.folder, self.values = folder, np.arange(float(size))

    def __setstate__(self, state):
        self.__dict__.update(state)
        with (self.folder / f"unpickled.{os.getpid()}").open("a") as stream:
            stream.write("x")


def add(shared, item):
    return os.getpid(), float(shared.values.sum()) + item


def slow(shared, item):
    time.sleep(0.3)
    (shared.folder / f"done.{item}").touch()
    return os.getpid(), item


def blas_threads(shared, item):
    np.ones((50, 50)) @ np.ones((50, 50))
    return max(library["num_threads"] for library in threadpool_info())


def die_once(shared, item):
    """The first worker that gets item 3 dies of it."""
    mark = shared.folder / "died"
    if item == 3 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return item


def die_always(shared, item):
    if item == 3:
        with (shared.folder / "deaths").open("a") as stream:
            stream.write("x")
        os.kill(os.getpid(), signal.SIGKILL)
    return item


class StrangeError(Exception):
    """Would come back from a pickle with another text."""

    def __init__(self, number):
        super().__init__(f"strange {number}")


def fail(shared, item):
    if item == 2:
        raise ValueError("two is too many")
    time.sleep(0.05)
    return item


def fail_strangely(shared, item):
    raise StrangeError(item)
