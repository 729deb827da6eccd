"""What a user writes, as a type checker sees it: lines with ``reveal_type`` say what is expected of it."""

from typing import reveal_type

import numpy as np

import dacore
from dacore import DacoreError, Session, open_scene
from dacore.plotting import plot_errors, plot_estimate, plot_quantity, plot_slice

scene = open_scene("ball.toml", ["training.samples=8"])
reveal_type(scene)  # R: Session
reveal_type(dacore.open_scene)  # R: -> Session

truth = scene.truth[0]
reveal_type(truth)  # R: Trajectory
data, sigma = scene.observe(truth, noise=0.1, rng=np.random.default_rng(0))
reveal_type(data)  # R: ndarray[
reveal_type(sigma)  # R: float

estimate = scene.estimate("minimum_variance", data, sigma)
reveal_type(estimate)  # R: Estimate
reveal_type(estimate.times)  # R: ndarray[
reveal_type(estimate.field("p", series=0))  # R: ndarray[

for name, quantity in scene.quantities.items():
    reveal_type(quantity)  # R: QuantityOfInterest
    low, high = estimate.interval(quantity, level=0.95)
    reveal_type(low)  # R: ndarray[
    values = quantity.of(truth.states, scene.model.space)
    reveal_type(plot_quantity(estimate, quantity, truth, name=name))  # R: Axes

if estimate.misfit is not None:
    reveal_type(estimate.misfit.verdict)  # R: str
if estimate.parameters is not None:
    reveal_type(estimate.parameters.names)  # R: tuple[str, ...]

reveal_type(plot_slice(scene, estimate.state(0, 3), "u", component="y", axis="z"))  # R: Axes
reveal_type(plot_errors(scene.validation))  # R: Axes
plot_estimate(estimate, "p", truth)[0].set_title("mine")


def worst(session: Session) -> float:
    """The largest error of the best estimator, infinite where the scene cannot be run."""
    try:
        validation = session.validation
    except DacoreError:
        return float("inf")
    best = validation.best(list(session.scene.estimator), 0.0)
    return float(best.space_time[validation.headline].max())


print(worst(scene))
