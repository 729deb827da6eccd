"""Any model: parameters in, the same trajectory out, wherever and whenever it is asked."""

import pickle
from types import MappingProxyType

import numpy as np

from dacore.core.arrays import Array
from dacore.core.model import Trajectory
from dacore.core.parameters import ParameterSpace
from dacore.core.space import StateSpace
from dacore.testing.models.stand import Stand
from dacore.testing.suite import fail, require


def builds_a_model(stand: Stand) -> None:
    """`build` returns an `AffineModel` or a `ForwardModel` with a space, parameters and times."""
    space, parameters = stand.forward.space, stand.forward.parameters
    require(isinstance(space, StateSpace), f"{stand.name}: space is a {type(space).__name__}, expected StateSpace")
    good = isinstance(parameters, ParameterSpace)
    require(good, f"{stand.name}: parameters are a {type(parameters).__name__}, expected ParameterSpace")
    twice = [name for name in parameters.names if parameters.names.count(name) > 1]
    require(not twice, f"{stand.name}: the parameter {', '.join(sorted(set(twice)))} is there twice")
    nameless = [each.name for each in parameters.parameters if not each.unit]
    require(not nameless, f"{stand.name}: the parameter {', '.join(nameless)} has no unit; write '1' for none")


def times_stay(stand: Stand) -> None:
    """Recorded times rise and are the same for every parameter and each time they are asked for."""
    times = np.asarray(stand.forward.times)
    good = times.ndim == 1 and len(times) > 0 and times.dtype == np.float64 and bool((np.diff(times) > 0).all())
    require(good, f"{stand.name}: times are {times.tolist()}, expected rising numbers of seconds")
    for theta in stand.some(2):
        given = stand.forward.solve(theta).times
        require(np.array_equal(given, times), f"{stand.name}: a trajectory has times of its own, not the model's")
    require(np.array_equal(stand.forward.times, times), f"{stand.name}: times change after a solve")


def trajectories_fit_the_space(stand: Stand) -> None:
    """A trajectory has finite states (n_dofs, t), at the ends of all ranges too."""
    want = (stand.forward.space.n_dofs, len(stand.forward.times))
    for what, theta in (
        ("the lower ends", stand.at(0.0)),
        ("the upper ends", stand.at(1.0)),
        ("the middle", stand.at()),
    ):
        made = stand.forward.solve(theta)
        require(isinstance(made, Trajectory), f"{stand.name}: solve returns a {type(made).__name__}")
        where = f"{stand.name}: states at {what} of the ranges"
        require(made.states.shape == want, f"{where} have shape {made.states.shape}, expected {want}")
        require(bool(np.isfinite(made.states).all()), f"{where} hold NaN or infinite values")


def the_same_again(stand: Stand) -> None:
    """A solve does not depend on solves before it, nor on the order or kind of the mapping of parameters."""
    first, other = stand.some(2)
    want = stand.forward.solve(first).states.copy()
    stand.forward.solve(other)
    turned = dict(reversed(list(first.items())))
    for how, theta in (("after another", first), ("in another order", turned), ("read-only", MappingProxyType(first))):
        off = _gap(stand, stand.forward.solve(theta).states, want)
        require(off == 0.0, f"{stand.name}: states differ by {off:.1e} with parameters given {how}")
    stand.forward.solve(first).states[:] = np.nan
    off = _gap(stand, stand.forward.solve(first).states, want)
    require(off == 0.0, f"{stand.name}: a solve changes when an earlier trajectory is overwritten")


def parameters_stay(stand: Stand) -> None:
    """`solve` does not change the parameters it is given."""
    theta = stand.at()
    kept = dict(theta)
    stand.forward.solve(theta)
    require(theta == kept, f"{stand.name}: solve changes the parameters it is given: {_changed(kept, theta)}")


def every_free_parameter_matters(stand: Stand) -> None:
    """Each parameter with a range changes the trajectory."""
    middle = stand.forward.solve(stand.at()).states
    for parameter in stand.forward.parameters.free:
        off = _gap(stand, stand.forward.solve(stand.at({parameter.name: 1.0})).states, middle)
        require(off > 0.0, f"{stand.name}: the parameter {parameter.name} changes nothing")


def affine_in_its_loads(stand: Stand) -> None:
    """Where it is claimed of a parameter: the trajectory is affine in it, others fixed."""
    for name in stand.affine_in:
        parameter = stand.forward.parameters[name]
        low = parameter.low
        high = parameter.high if not parameter.fixed else low + max(1.0, abs(low))
        theta = stand.at()
        ends = [stand.forward.solve(theta | {name: value}).states for value in (low, high)]
        for share in (0.25, 0.7):
            given = stand.forward.solve(theta | {name: low + share * (high - low)}).states
            off = _gap(stand, given, (1 - share) * ends[0] + share * ends[1])
            require(
                off < 1e-6, f"{stand.name}: the trajectory is not affine in {name}, off by {off:.1e} between two values"
            )


def models_can_be_pickled(stand: Stand) -> None:
    """The model can be pickled to worker processes, before and after use, and the copy solves alike."""
    theta = stand.at()
    for when, model in (("as built", stand.marched(stand.build())), ("after a solve", stand.forward)):
        want = stand.forward.solve(theta).states
        try:
            copy = pickle.loads(pickle.dumps(model))
        except Exception as error:  # noqa: BLE001  pickle raises many kinds
            fail(
                f"{stand.name}: its model cannot be pickled {when}: {type(error).__name__}: {error}; "
                "use functions of a module or objects as coefficients, no lambdas"
            )
        off = _gap(stand, copy.solve(theta).states, want)
        require(off < 1e-7, f"{stand.name}: states differ by {off:.1e} after pickling {when}")


def built_the_same_again(stand: Stand) -> None:
    """Building again, also from pickled settings, gives a model that solves alike."""
    want = stand.forward.solve(stand.at()).states
    held = pickle.dumps(stand.physics)
    for how, physics in (("again", stand.physics), ("from pickled settings", pickle.loads(held))):
        again = stand.marched(physics.build(stand.discretize))
        off = _gap(stand, again.solve(stand.at()).states, want)
        require(off < 1e-7, f"{stand.name}: states differ by {off:.1e} when the model is built {how}")
    require(pickle.dumps(stand.physics) == held, f"{stand.name}: build changes the settings")


CHECKS = (
    builds_a_model, times_stay, trajectories_fit_the_space, the_same_again, parameters_stay,
    every_free_parameter_matters, affine_in_its_loads, models_can_be_pickled, built_the_same_again,
)  # fmt: skip


def _gap(stand: Stand, given: Array, want: Array) -> float:
    """Largest difference of any field as a part of that field's largest value; infinite for NaN."""
    if given.shape != want.shape or not np.isfinite(given).all():
        return float("inf")
    worst = 0.0
    for each in stand.forward.space.fields:
        rows = stand.forward.space.layout.block(each.name)
        size = float(np.abs(want[rows]).max()) or 1.0
        worst = max(worst, float(np.abs(given[rows] - want[rows]).max()) / size)
    return worst


def _changed(before: dict[str, float], after: dict[str, float]) -> str:
    names = [name for name in {**before, **after} if before.get(name) != after.get(name)]
    return ", ".join(f"{name} is {after.get(name)}, was {before.get(name)}" for name in names)
