"""Training by a reduced model: from samples to a background, with a few trajectories solved in full."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from dacore.core.arrays import Array, IntArray
from dacore.core.background import Background
from dacore.core.display import Card, Displayed, count, percent
from dacore.core.model import ForwardModel, Trajectory
from dacore.core.parameters import ParameterSpace
from dacore.dynamics.motions import Motions
from dacore.reduction.background import background_of
from dacore.reduction.forward import with_forward
from dacore.reduction.greedy import Round, Settings, train
from dacore.reduction.kinds import Reducible
from dacore.reduction.model import ReducedModel
from dacore.reduction.split import amplitudes_of

Solve = Callable[[ForwardModel, Sequence[int]], Sequence[Trajectory]]


@dataclass(frozen=True, eq=False, repr=False)
class Reduced(Displayed):
    """What reduced training leaves behind.

    Parameters
    ----------
    background : Background
        With the reduced model as its `forward`.
    model : ReducedModel
        Knows the background's bases (`ReducedModel.onto`).
    rounds : tuple of Round
        How the greedy went.
    solved : (k,) int array
        Samples solved in full.
    motions : int
        Motions that each of them took.
    estimates : (n_fields, K) array
        Estimated relative space–time error of each sample.
    """

    background: Background
    model: ReducedModel
    rounds: tuple[Round, ...]
    solved: IntArray
    motions: int
    estimates: Array

    def _card(self) -> Card:
        worst = ", ".join(
            f"{field.name} {percent(float(row.max()))}"
            for field, row in zip(self.background.space.fields, self.estimates, strict=True)
        )
        return Card(
            "Reduced",
            (
                ("samples", count(self.background.n_samples)),
                ("solved in full", f"{count(len(self.solved))}, {count(self.motions, 'motion')} each"),
                ("rounds", count(len(self.rounds))),
                ("largest estimated error", worst),
            ),
        )


def train_reduced(
    model: Reducible,
    parameters: ParameterSpace,
    samples: Array,
    solve: Solve,
    settings: Settings,
    compression: float,
    progress: Callable[[int, float], None] | None = None,
) -> Reduced:
    """Train a reduced model, march all samples with it, and compress their trajectories.

    Parameters
    ----------
    model : MarchedModel or HarmonicModel
    parameters : ParameterSpace
    samples : (K, n_parameters) array
    solve : callable
        Takes a model and numbers of samples; returns their trajectories, solved or read.
    settings : Settings
    compression : float
        Relative mean-square error that the background's POD of each field may leave.
    progress : callable, optional
        Called after each round with the number of full solves and the largest estimate.

    Raises
    ------
    AccuracyError
        If the most trajectories allowed do not reach the tolerance.
    CapabilityError
        If the model cannot be projected field by field.
    """
    motions = Motions(model, amplitudes_of(model.model, [parameters.as_mapping(row) for row in samples]))
    trained = train(
        model, motions, parameters, samples, lambda numbers: solve(motions, numbers), settings, progress
    )  # fmt: skip
    background, onto = background_of(
        model.space, trained.galerkin, trained.model.lift_products, trained.states, model.times, parameters, samples,
        compression,
    )  # fmt: skip
    reduced = trained.model.on(onto)
    return Reduced(
        with_forward(background, reduced, trained.estimates), reduced, trained.rounds, trained.solved,
        motions.parts.shape[1], trained.estimates,
    )  # fmt: skip
