"""Solve a model for many parameter vectors, on as many workers as there are, into a store."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass

import numpy as np

from dacore.core.arrays import Array
from dacore.core.model import ForwardModel, Trajectory
from dacore.core.parameters import ParameterSpace, Sampling
from dacore.errors import ConvergenceError, DacoreError, ShapeError
from dacore.execution.foreach import Run, crew
from dacore.execution.worker_frames import place_of
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


class Solver:
    """Solves for samples that a store does not hold yet, as often as it is asked; `solving` makes it.

    Parameters
    ----------
    run : callable
        Takes samples; yields each with its trajectory.
    parameters : ParameterSpace
        Names the columns of `samples`.
    samples : (K, n_parameters) array
    store : TrajectoryStore
    units : dict of str to str
        Of the fields.
    """

    def __init__(
        self,
        run: Run[Sample, Trajectory],
        parameters: ParameterSpace,
        samples: Array,
        store: TrajectoryStore,
        units: dict[str, str],
    ) -> None:
        self._run, self._parameters, self._samples = run, parameters, samples
        self._store, self._units = store, units

    def __call__(self, numbers: Sequence[int], progress: Progress | None = None) -> int:
        """Solve for the samples of these numbers that the store lacks.

        Parameters
        ----------
        numbers : sequence of int
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
        WorkerError
            If workers cannot be had or die at their work; what is done stays in the store.
        """
        store, total = self._store, len(numbers)
        missing = [self._sample(number) for number in numbers if not store.intact(number)]
        if progress:
            progress(total - len(missing), total)
        if not missing:
            return 0
        names = [parameter.name for parameter in self._parameters.parameters]
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
            closing(self._run(still_missing(_apart(missing, before)))) as results,
        ):
            for sample, trajectory in results:
                store.write(sample.index, trajectory, self._samples[sample.index], names, self._units)
                solved += 1
                if progress:
                    progress(total - len(missing) + solved + found, total)
        return solved

    def _sample(self, number: int) -> Sample:
        return Sample(number, dict(self._parameters.as_mapping(self._samples[number])))


@contextmanager
def solving(
    model: ForwardModel,
    parameters: ParameterSpace,
    samples: Array,
    store: TrajectoryStore,
    workers: int = 1,
    scheduler: str | None = None,
) -> Iterator[Solver]:
    """Workers that hold a model, for several lists of samples; none is started before something is missing.

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
        Processes; each uses one BLAS thread. They end with the block.
    scheduler : str, optional
        Of a dask cluster: ``tcp://host:port`` or the path of its scheduler file. Its workers solve, this
        process writes.

    Yields
    ------
    Solver
    """
    units = {field.name: field.unit for field in model.space.fields}
    with crew(_solve, model, workers, scheduler, str) as run:
        yield Solver(run, parameters, samples, store, units)


def solve_all(
    model: ForwardModel,
    parameters: ParameterSpace,
    samples: Array,
    store: TrajectoryStore,
    workers: int = 1,
    progress: Progress | None = None,
    scheduler: str | None = None,
) -> int:
    """Solve for every sample that the store does not hold yet; see `solving` and `Solver`.

    Parameters
    ----------
    model, parameters, samples, store, workers, scheduler
        As for `solving`; no more workers are started than trajectories are missing.
    progress : callable, optional
        Called with (done, total).

    Returns
    -------
    int
        How many trajectories were solved now.
    """
    everything = range(len(samples))
    missing = sum(not store.intact(number) for number in everything)
    with solving(model, parameters, samples, store, min(workers, missing), scheduler) as solve:
        return solve(everything, progress)


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
        raise ConvergenceError(f"{sample}: {type(error).__name__}: {error} ({place_of(error)})") from error
    wanted = (model.space.n_dofs, len(model.times))
    if trajectory.states.shape != wanted or not np.array_equal(trajectory.times, model.times):
        raise ShapeError(
            f"{sample}: the model gave states of shape {trajectory.states.shape} at {len(trajectory.times)} times, "
            f"expected {wanted} at the model's own times"
        )
    if not np.isfinite(trajectory.states).all():
        raise ConvergenceError(f"{sample}: the model gave NaN or infinite states; check its parameters' ranges")
    return trajectory
