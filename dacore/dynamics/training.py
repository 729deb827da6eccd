"""Solve a model for many parameter vectors, on as many workers as there are, into a store."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass

import numpy as np

from dacore.core.arrays import Array
from dacore.core.model import ForwardModel, Trajectory
from dacore.core.parameters import ParameterSpace, Sampling
from dacore.errors import ConvergenceError, DacoreError, ShapeError
from dacore.execution.foreach import for_each
from dacore.io.leftovers import present
from dacore.io.snapshots import TrajectoryStore

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Sample:
    """One parameter vector of a training set.

    Parameters
    ----------
    index : int
    point : dict of str to float
        Parameters by name.
    """

    index: int
    point: dict[str, float]

    def __str__(self) -> str:
        values = ", ".join(f"{name} = {value:.4g}" for name, value in self.point.items())
        return f"sample {self.index} ({values})"


def solve_all(
    model: ForwardModel,
    parameters: ParameterSpace,
    samples: Array,
    store: TrajectoryStore,
    workers: int = 1,
    progress: Progress | None = None,
    scheduler: str | None = None,
    only: Sequence[int] | None = None,
) -> int:
    """Solve for every sample that the store does not hold yet.

    Another process may fill the same store meanwhile: what it has finished is not begun here, and the
    two begin at different ends.

    Parameters
    ----------
    model : ForwardModel
        Sent to each worker once; must be picklable unless everything is solved in this process.
    parameters : ParameterSpace
        Names the columns of `samples`.
    samples : (K, n_parameters) array
    store : TrajectoryStore
    workers : int
        Processes; each uses one BLAS thread.
    progress : callable, optional
        Called with (done, total).
    scheduler : str, optional
        Of a dask cluster: ``tcp://host:port`` or the path of its scheduler file. Its workers solve, this
        process writes.
    only : sequence of int, optional
        Numbers of the samples to solve for; all by default.

    Returns
    -------
    int
        How many trajectories were solved now.

    Raises
    ------
    ConvergenceError
        Names the sample whose solve failed; what is done stays in the store.
    WorkerError
        If workers cannot be had or die at their work; what is done stays in the store.
    """
    wanted = range(len(samples)) if only is None else only
    total = len(wanted)
    missing = [
        Sample(index, dict(parameters.as_mapping(samples[index]))) for index in wanted if not store.intact(index)
    ]
    if progress:
        progress(total - len(missing), total)
    if not missing:
        return 0
    units = {field.name: field.unit for field in model.space.fields}
    names = [parameter.name for parameter in parameters.parameters]
    solved = found = 0

    def still_missing(order: Iterable[Sample]) -> Iterator[Sample]:
        nonlocal found
        for sample in order:
            if store.intact(sample.index):  # by now, through another process
                found += 1
            else:
                yield sample

    with (
        present(store.folder) as before,
        closing(
            for_each(_solve, model, still_missing(_apart(missing, before)), min(workers, len(missing)), scheduler, str)
        ) as results,
    ):
        for sample, trajectory in results:
            store.write(sample.index, trajectory, samples[sample.index], names, units)
            solved += 1
            if progress:
                progress(total - len(missing) + solved + found, total)
    return solved


def _apart(missing: Sequence[Sample], before: int) -> Sequence[Sample]:
    """The order of a process that finds `before` others at the same work, so that they meet late."""
    if before == 0:
        return missing
    if before % 2:
        return missing[::-1]
    middle = len(missing) // 2
    return [*missing[middle:], *missing[:middle]]


def draw(parameters: ParameterSpace, count: int, sampling: Sampling, seed: int) -> Array:
    """Draw (count, n_parameters) samples from a seed of their own."""
    return parameters.sample(np.random.default_rng(seed), count, sampling)


def _solve(model: ForwardModel, sample: Sample) -> Trajectory:
    """Solve, check what comes out, and name the sample in whatever goes wrong."""
    try:
        trajectory = model.solve(sample.point)
    except DacoreError as error:
        raise type(error)(f"{sample}: {error}") from error
    except Exception as error:
        raise ConvergenceError(f"{sample}: {type(error).__name__}: {error}") from error
    wanted = (model.space.n_dofs, len(model.times))
    if trajectory.states.shape != wanted or not np.array_equal(trajectory.times, model.times):
        raise ShapeError(
            f"{sample}: the model gave states of shape {trajectory.states.shape} at {len(trajectory.times)} times, "
            f"expected {wanted} at the model's own times"
        )
    if not np.isfinite(trajectory.states).all():
        raise ConvergenceError(f"{sample}: the model gave NaN or infinite states; check its parameters' ranges")
    return trajectory
