"""From training trajectories to a Background: one POD for each field, the data read once."""

import itertools
import logging
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from dacore.algebra.stream import FLOOR, Decomposition, Stream
from dacore.core.arrays import Array
from dacore.core.background import Background
from dacore.core.model import Trajectory
from dacore.core.parameters import ParameterSpace
from dacore.core.reduced import ReducedSpace
from dacore.core.space import Product, StateSpace
from dacore.errors import AccuracyError, ShapeError

logger = logging.getLogger(__name__)

# A hundredth of what varies between samples may be lost without a word.
_LOST = 1e-2


def compress(
    space: StateSpace,
    trajectories: Sequence[Trajectory],
    parameters: ParameterSpace,
    samples: Array,
    tolerance: float = 1e-6,
    kind: Product = "l2",
    threads: int = 1,
    progress: Callable[[int, int], None] | None = None,
    memory: float | None = None,
) -> Background:
    """Compress training trajectories field by field.

    The fields are decomposed apart, because a joint basis would have to choose the weight ζ
    between them before anyone knows what is measured; see `dacore.core.background`.

    Parameters
    ----------
    space : StateSpace
    trajectories : sequence of K Trajectory
        Read one at a time and once; never all held.
    parameters : ParameterSpace
    samples : (K, n_parameters) array
    tolerance : float
        Relative mean-square error of each field, measured on all the data as they pass.
    kind : {"l2", "h1"}
    threads : int
        Fields decomposed at the same time; the result does not depend on it.
    progress : callable, optional
        Called with (done, total) trajectories read.
    memory : float, optional [GiB]
        Bound on what is held: the trajectory just read, the modes of all fields and the snapshots looked at
        together. The coefficients (r, t, K), which are returned, come on top. By default as much as the modes need.

    Raises
    ------
    ShapeError
        If there is no trajectory, one has another number of times or dofs, or the memory is too small for anything.
    AccuracyError
        If the compression misses its tolerance, or needs more modes than fit in the memory.
    """
    if len(trajectories) == 0:
        raise ShapeError("training: got no trajectory, expected at least one")
    times = trajectories[0].times
    count = len(times) * len(trajectories)
    names = [field.name for field in space.fields]
    parts = _parts(space, memory, len(times))
    streams = {
        name: Stream(space.field_product(name, kind), tolerance, count, memory=parts[name], keep=True) for name in names
    }
    with ThreadPoolExecutor(max_workers=threads) as pool:
        for k, trajectory in enumerate(trajectories):
            states = trajectory.states
            if states.shape != (space.n_dofs, len(times)):
                raise ShapeError(
                    f"training: trajectory {k} has states {states.shape}, expected {(space.n_dofs, len(times))}"
                )
            blocks = [states[space.layout.block(name)] for name in names]
            list(pool.map(lambda stream, block: stream.add(block), streams.values(), blocks))
            if progress:
                progress(k + 1, len(trajectories))
        found = dict(zip(names, pool.map(lambda name: streams.pop(name).finish(), names), strict=True))
    for name, one in found.items():
        if not one.limited and one.error > 1.01 * max(tolerance, FLOOR):
            raise AccuracyError(
                f"compression of {name}: {len(one.values)} modes leave {one.error:.1e}, expected {tolerance:.1e}; "
                "raise training.tolerance"
            )
    bases = {name: ReducedSpace(one.basis, one.values, space.field_product(name, kind)) for name, one in found.items()}
    coefficients = _stacked(list(found.values()), len(times))
    _warn_of_lost_variation(coefficients, bases, {name: one.error**2 * one.total for name, one in found.items()})
    return Background(
        space, bases, coefficients, times, parameters, samples, kind, {name: one.error for name, one in found.items()}
    )


def _parts(space: StateSpace, memory: float | None, steps: int) -> dict[str, float | None]:
    """Memory of each field [GiB]: the same number of columns for all, after one trajectory."""
    if memory is None:
        return {field.name: None for field in space.fields}
    left = memory - 8 * space.n_dofs * steps / 2**30
    sizes = {field.name: space.layout.block(field.name) for field in space.fields}
    shares = {name: (block.stop - block.start) / space.n_dofs for name, block in sizes.items()}
    if left <= 0:
        raise ShapeError(
            f"memory: got {memory:g} GiB, and one trajectory alone takes {memory - left:.2g} GiB; raise training.memory"
        )
    return {name: left * share for name, share in shares.items()}


def _stacked(found: Sequence[Decomposition], steps: int) -> Array:
    """Coefficients (r, t, K) of all fields."""
    parts = [one.coefficients for one in found if one.coefficients is not None]
    count = parts[0].shape[1] // steps
    out = np.empty((sum(len(part) for part in parts), steps, count))
    starts = itertools.accumulate((len(part) for part in parts), initial=0)
    for start, part in zip(starts, parts, strict=False):
        out[start : start + len(part)] = part.reshape(len(part), count, steps).swapaxes(1, 2)
    return out


def _warn_of_lost_variation(coefficients: Array, bases: Mapping[str, ReducedSpace], left: Mapping[str, float]) -> None:
    """Warn where the tolerance, which counts a field's constant part too, swallows what varies between samples.

    Parameters
    ----------
    coefficients : (r, t, K) array
    bases : mapping of str to ReducedSpace
    left : mapping of str to float
        Squared norm of what each field lost.
    """
    start = 0
    for name, basis in bases.items():
        part = coefficients[start : start + basis.dimension]
        start += basis.dimension
        varying = float(np.linalg.norm(part - part.mean(axis=2, keepdims=True)))
        lost = float(np.sqrt(left[name]))
        # One sample varies from nothing, and round-off is no variation.
        if part.shape[2] > 1 and lost > _LOST * varying and lost > 1e-13 * float(np.linalg.norm(part)):
            logger.warning(
                "compression of %s: it leaves out %.0f%% of what varies between samples, since the field's constant "
                "part is so much larger; lower training.tolerance", name, 100 * min(lost / max(varying, lost), 1.0),
            )  # fmt: skip
