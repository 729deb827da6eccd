"""The steps of a simulation and its recorded times."""

from dataclasses import dataclass, replace

import numpy as np

from dacore.core.arrays import Array, BoolArray
from dacore.errors import ShapeError

_UNITS = ((1 / 604800, "week"), (1 / 86400, "day"), (1 / 3600, "h"), (1.0, "s"), (1e3, "ms"), (1e6, "µs"))


def time_unit(seconds: float) -> tuple[float, str]:
    """Return the unit that suits times up to `seconds`, and how many of it a second is.

    Units longer than a second suit only what lasts some of them.

    Parameters
    ----------
    seconds : float
        The longest time.

    Returns
    -------
    factor : float
        How many of the unit a second is.
    unit : str
    """
    for factor, unit in _UNITS:
        if abs(seconds) * factor >= (4.0 if factor < 1 else 1.0):
            return factor, unit
    return 1.0, "s"


@dataclass(frozen=True)
class TimeGrid:
    """Equal recorded steps, which may be marched in shorter ones.

    Parameters
    ----------
    step : float [s]
        Between recorded times.
    steps : int
        Number of recorded steps.
    spin_up : int
        Steps taken before recording starts.
    substeps : int
        Equal parts in which every step is marched.
    graded : int
        How often the very first of these parts is halved: n halvings march it in parts of
        2⁻ⁿ, 2⁻ⁿ, 2¹⁻ⁿ, …, 1/2 of its length. Each length needs a factorisation of its own.
    """

    step: float
    steps: int
    spin_up: int = 0
    substeps: int = 1
    graded: int = 0

    def __post_init__(self) -> None:
        if not (np.isfinite(self.step) and self.step > 0):
            raise ShapeError(f"time step: got {self.step}, expected a positive number of seconds")
        if self.steps < 1 or self.spin_up < 0:
            raise ShapeError(
                f"steps: got {self.steps} recorded after {self.spin_up}, expected at least 1 after 0 or more"
            )
        if self.substeps < 1:
            raise ShapeError(f"substeps: got {self.substeps}, expected 1 or more")
        if not 0 <= self.graded <= 30:
            raise ShapeError(f"graded: got {self.graded}, expected 0 to 30 halvings of the first step")

    @property
    def times(self) -> Array:
        """Recorded times t_k = kτ (steps,) [s]; t = 0 is never among them."""
        return np.asarray(self.step * np.arange(self.spin_up + 1, self.spin_up + self.steps + 1), dtype=np.float64)

    @property
    def lengths(self) -> Array:
        """Length (n,) [s] of every step that is marched."""
        part = self.step / self.substeps
        regular = np.full((self.spin_up + self.steps) * self.substeps - 1, part)
        return np.concatenate([part * np.diff(self._fractions, prepend=0.0), regular])

    @property
    def ends(self) -> Array:
        """Time (n,) [s] at the end of every step that is marched."""
        count = (self.spin_up + self.steps) * self.substeps
        later = self.step * (np.arange(2, count + 1) / self.substeps)
        return np.concatenate([self.step * (self._fractions / self.substeps), later])

    @property
    def recorded(self) -> BoolArray:
        """Whether the state after each marched step (n,) is recorded."""
        flags = np.zeros((self.spin_up + self.steps) * self.substeps, dtype=bool)
        flags[(self.spin_up + 1) * self.substeps - 1 :: self.substeps] = True
        return np.concatenate([np.zeros(self.graded, dtype=bool), flags])

    @property
    def _fractions(self) -> Array:
        """Ends of the parts of the first step, in units of its length."""
        return np.asarray(0.5 ** np.arange(self.graded, -1, -1.0))

    def divided(self, factor: int) -> "TimeGrid":
        """Return the grid with the same recorded times and `factor` times as many steps.

        Parameters
        ----------
        factor : int

        Returns
        -------
        TimeGrid
        """
        return replace(self, substeps=self.substeps * factor)
