"""Solve a model for many parameter vectors, in parallel processes, into a store."""

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager

import numpy as np
from threadpoolctl import threadpool_limits

from dacore.algebra.threads import one_blas_thread
from dacore.core.arrays import Array
from dacore.core.model import ForwardModel, Trajectory
from dacore.core.parameters import ParameterSpace, Sampling
from dacore.errors import ConvergenceError, DacoreError, ShapeError
from dacore.io.snapshots import TrajectoryStore

Progress = Callable[[int, int], None]

_worker_model: list[ForwardModel] = []


def solve_all(
    model: ForwardModel,
    parameters: ParameterSpace,
    samples: Array,
    store: TrajectoryStore,
    workers: int = 1,
    progress: Progress | None = None,
) -> int:
    """Solve for every sample that the store does not hold yet.

    Parameters
    ----------
    model : ForwardModel
        Sent to each worker once; must be picklable if `workers` > 1.
    parameters : ParameterSpace
        Names the columns of `samples`.
    samples : (K, n_parameters) array
    store : TrajectoryStore
    workers : int
        Processes; each uses one BLAS thread.
    progress : callable, optional
        Called with (done, total).

    Returns
    -------
    int
        How many trajectories were solved now.

    Raises
    ------
    ConvergenceError
        Names the sample whose solve failed; what is done stays in the store.
    """
    missing = [index for index in range(len(samples)) if not store.intact(index)]
    done = len(samples) - len(missing)
    units = {field.name: field.unit for field in model.space.fields}
    if progress:
        progress(done, len(samples))

    def keep(index: int, trajectory: Trajectory) -> None:
        nonlocal done
        store.write(index, trajectory, samples[index], units)
        done += 1
        if progress:
            progress(done, len(samples))

    points = {index: parameters.as_mapping(samples[index]) for index in missing}
    if workers <= 1 or len(missing) <= 1:
        with one_blas_thread():
            for index in missing:
                keep(index, _named(index, points[index], model))
        return len(missing)
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(min(workers, len(missing)), context, _start_worker, (model,))
    failure: DacoreError | None = None
    try:
        with _deaf_children():
            pending = {pool.submit(_solve_in_worker, index, points[index]): index for index in missing}
        for future in as_completed(pending):
            if future.cancelled():
                continue
            try:
                keep(pending[future], future.result())
            except DacoreError as error:
                # What is being solved at this moment is still kept; the rest is not begun.
                failure = failure or error
                for other in pending:
                    other.cancel()
    except BrokenProcessPool as error:
        raise ConvergenceError(
            f"a worker died with {done} of {len(samples)} trajectories done (out of memory?); "
            "run again to go on from there, with fewer --workers"
        ) from error
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
    if failure is not None:
        raise failure
    return len(missing)


def draw(parameters: ParameterSpace, count: int, sampling: Sampling, seed: int) -> Array:
    """Draw (count, n_parameters) samples from a seed of their own."""
    return parameters.sample(np.random.default_rng(seed), count, sampling)


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


def _start_worker(model: ForwardModel) -> None:
    threadpool_limits(limits=1)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # If the parent is killed, a worker must not wait for it for ever.
    threading.Thread(target=_leave_with, args=(os.getppid(),), daemon=True).start()
    _worker_model[:] = [model]


def _leave_with(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(1.0)
    os._exit(1)


def _solve_in_worker(index: int, point: dict[str, float]) -> Trajectory:
    return _named(index, point, _worker_model[0])


def _named(index: int, point: dict[str, float], model: ForwardModel) -> Trajectory:
    """Solve, check what comes out, and name the sample in whatever goes wrong."""
    values = ", ".join(f"{name} = {value:.4g}" for name, value in point.items())
    where = f"sample {index} ({values})"
    try:
        trajectory = model.solve(point)
    except DacoreError as error:
        raise type(error)(f"{where}: {error}") from error
    except Exception as error:
        raise ConvergenceError(f"{where}: {type(error).__name__}: {error}") from error
    wanted = (model.space.n_dofs, len(model.times))
    if trajectory.states.shape != wanted or not np.array_equal(trajectory.times, model.times):
        raise ShapeError(
            f"{where}: the model gave states of shape {trajectory.states.shape} at {len(trajectory.times)} times, "
            f"expected {wanted} at the model's own times"
        )
    if not np.isfinite(trajectory.states).all():
        raise ConvergenceError(f"{where}: the model gave NaN or infinite states; check its parameters' ranges")
    return trajectory
