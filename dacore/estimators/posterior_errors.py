"""What the accuracy that a forward map states amounts to, beside the errors that its emulation is seen to make."""

from dataclasses import dataclass

import numpy as np

from dacore.core.arrays import Array
from dacore.core.background import Background
from dacore.estimators.posterior_emulator import Emulator

# Part of the variance of the map's own errors that may be in any direction.
_EVEN = 0.1


@dataclass(frozen=True, eq=False)
class ModelErrors:
    """Errors that a forward map states of itself.

    Parameters
    ----------
    even : list of (slice, float)
        For each field its rows, and a variance of all modes' coefficients, of what is of that field in them.
    growth : (r,) array
        Factors on the emulation's errors, so that they have the size of both.
    """

    even: list[tuple[slice, float]]
    growth: Array


def model_errors(emulator: Emulator, background: Background) -> ModelErrors:
    """Return what the accuracy that the map states amounts to, in the modes and beside the emulation's errors.

    A map that is off by some share of a field's norm is off in directions that nobody knows. What a reduced model
    misses looks much like what its emulation on fewer modes misses; a part is spread evenly over the modes.
    """
    even, growth = [], np.ones(len(emulator.scale))
    for field in background.space.fields:
        rows = background.block(field.name)
        spread = float((emulator.modes[rows] ** 2).sum())
        if background.forward is None or spread <= 0:
            continue
        size = float((background.coefficients[rows] ** 2).sum() / background.n_samples)
        stated = (background.forward.accuracy[field.name] * float(emulator.scale[rows][0])) ** 2 * size
        own = float(((emulator.errors[rows] * emulator.scale[rows, None, None]) ** 2).sum()) / background.n_samples
        share = _EVEN if own > 0 else 1.0
        even.append((rows, share * stated / spread))
        growth[rows] = np.sqrt(1.0 + (1.0 - share) * stated / own) if own > 0 else 1.0
    return ModelErrors(even, growth)
