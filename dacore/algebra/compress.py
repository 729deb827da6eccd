"""From training trajectories to a Background: one POD for each field, the data read in passes."""

import itertools
import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from dacore.algebra.hapod import hapod
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
) -> Background:
    """Compress training trajectories field by field.

    The fields are decomposed apart, because a joint basis would have to choose the weight ζ
    between them before anyone knows what is measured; see `dacore.core.background`.

    Parameters
    ----------
    space : StateSpace
    trajectories : sequence of K Trajectory
        Read one at a time, once for each field and once more for the coefficients; never all held.
    parameters : ParameterSpace
    samples : (K, n_parameters) array
    tolerance : float
        Relative mean-square error of each field, checked on all the data.
    kind : {"l2", "h1"}
    threads : int
        Fields decomposed at the same time; the result does not depend on it.
    progress : callable, optional
        Called with (done, total) trajectories read, all passes together.

    Raises
    ------
    AccuracyError
        If the compression misses its tolerance.
    """
    if len(trajectories) == 0:
        raise ShapeError("training: got no trajectory, expected at least one")
    times = trajectories[0].times
    count = len(times) * len(trajectories)
    reads = itertools.count(1)
    total = len(trajectories) * (len(space.fields) + 1)

    def read() -> Iterator[Trajectory]:
        for trajectory in trajectories:
            yield trajectory
            done = next(reads)  # atomic, so that fields may be read at the same time
            if progress:
                progress(done, total)

    def decompose(name: str) -> ReducedSpace:
        block = space.layout.block(name)
        return hapod((trajectory.states[block] for trajectory in read()), products[name], tolerance, count)

    names = [field.name for field in space.fields]
    products = {name: space.field_product(name, kind) for name in names}
    with ThreadPoolExecutor(max_workers=threads) as pool:
        bases = dict(zip(names, pool.map(decompose, names), strict=True))
    coefficients = np.empty((sum(basis.dimension for basis in bases.values()), len(times), len(trajectories)))
    totals = dict.fromkeys(bases, 0.0)
    left = dict.fromkeys(bases, 0.0)
    for k, trajectory in enumerate(read()):
        start = 0
        for name, basis in bases.items():
            data = trajectory.states[space.layout.block(name)]
            part = basis.project(data)
            residual = data - basis.lift(part)
            totals[name] += float(np.einsum("ij,ij->", data, basis.product @ data))
            left[name] += float(np.einsum("ij,ij->", residual, basis.product @ residual))
            coefficients[start : start + basis.dimension, :, k] = part
            start += basis.dimension
    _warn_of_lost_variation(coefficients, bases, left)
    reached = {name: float(np.sqrt(left[name] / totals[name])) for name in bases}
    for name, error in reached.items():
        if error > 1.05 * tolerance:
            raise AccuracyError(
                f"compression of {name}: {bases[name].dimension} modes leave {error:.1e}, expected {tolerance:.1e}; "
                "raise training.tolerance"
            )
    return Background(space, bases, coefficients, times, parameters, samples, kind, reached)


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
