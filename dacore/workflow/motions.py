"""The full solves of reduced training: kept or solved now, by workers that stay for all of its rounds."""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager

from dacore.core.arrays import Array
from dacore.core.model import ForwardModel, Trajectory
from dacore.core.parameters import ParameterSpace
from dacore.dynamics.training import Solver, solving
from dacore.io.snapshots import TrajectoryStore
from dacore.reduction.greedy import Settings
from dacore.reduction.training import Solve
from dacore.workflow.trajectories import TrajectorySet

# No round has more to solve.
AT_ONCE = max(Settings.first, Settings.batch)


@contextmanager
def solved_or_kept(
    parameters: ParameterSpace, samples: Array, store: TrajectoryStore, workers: int, scheduler: str | None
) -> Iterator[Solve]:
    """What reads trajectories of a store, and solves those that it lacks.

    Parameters
    ----------
    parameters : ParameterSpace
        Names the columns of `samples`.
    samples : (K, n_parameters) array
    store : TrajectoryStore
    workers : int
        Processes, of which no more are started than a round can use.
    scheduler : str, optional
        Of a dask cluster instead.

    Yields
    ------
    callable
        Takes a model and numbers of samples; returns their trajectories. Workers that a model needed stay until the
        block ends.
    """
    with ExitStack() as crews:
        solvers: dict[ForwardModel, Solver] = {}

        def trajectories(model: ForwardModel, numbers: Sequence[int]) -> list[Trajectory]:
            if model not in solvers:
                crew = solving(model, parameters, samples, store, min(workers, AT_ONCE), scheduler)
                solvers[model] = crews.enter_context(crew)
            solve = solvers[model]
            kept = TrajectorySet(store, samples, solve(numbers), lambda: solve(numbers))
            return [kept[number] for number in numbers]

        yield trajectories
