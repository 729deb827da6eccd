"""The recorded times of a simulation."""

from dataclasses import dataclass

import numpy as np

from dacore.core.arrays import Array
from dacore.errors import ShapeError


@dataclass(frozen=True)
class TimeGrid:
    """Equal steps, of which the last ones are recorded.

    Parameters
    ----------
    step : float [s]
    steps : int
        Number of recorded steps.
    spin_up : int
        Steps taken before recording starts.
    """

    step: float
    steps: int
    spin_up: int = 0

    def __post_init__(self) -> None:
        if not (np.isfinite(self.step) and self.step > 0):
            raise ShapeError(f"time step: got {self.step}, expected a positive number of seconds")
        if self.steps < 1 or self.spin_up < 0:
            raise ShapeError(
                f"steps: got {self.steps} recorded after {self.spin_up}, expected at least 1 after 0 or more"
            )

    @property
    def times(self) -> Array:
        """Recorded times t_k = kτ (steps,) [s]; t = 0 is never among them."""
        return np.asarray(self.step * np.arange(self.spin_up + 1, self.spin_up + self.steps + 1), dtype=np.float64)
