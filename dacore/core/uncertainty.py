"""How wrong an estimate may be: variances and quantiles of linear functionals of it."""

from abc import ABC, abstractmethod

import numpy as np
from scipy.stats import norm

from dacore.core.arrays import Array
from dacore.core.display import Displayed

# Functionals whose weights on whole trajectories are held at once.
_PORTION = 64


class Uncertainty(Displayed, ABC):
    """Covariance of the error of an estimate."""

    @abstractmethod
    def variance(self, on_modes: Array, on_correction: Array | None) -> Array:
        """Variance of linear functionals of the trajectory of each series.

        Parameters
        ----------
        on_modes : (s, t, r) array
            Weights on the coefficients of each step.
        on_correction : (s, t, m) array or None
            Weights on the correction's coefficients.

        Returns
        -------
        (s, k) array
        """

    def quantile(self, centre: Array, level: float, on_modes: Array, on_correction: Array | None) -> Array:
        """Quantiles (s, k) of linear functionals of the trajectory; Gaussian about `centre` unless it is known better.

        Parameters
        ----------
        centre : (s, k) array
            The functionals of the estimate itself.
        level : float
            Between 0 and 1.
        on_modes : (s, t, r) array
        on_correction : (s, t, m) array or None
            As `variance` takes them.

        Returns
        -------
        (s, k) array
        """
        return np.asarray(centre + float(norm.ppf(level)) * np.sqrt(self.variance(on_modes, on_correction)))

    def at(self, step: int, series: int, steps: int, on_modes: Array, on_correction: Array | None) -> Array:
        """Variance of many functionals of one state of one series: what a picture of a field's deviation needs.

        This puts them into weights on whole trajectories; whoever can see a step by itself does better.

        Parameters
        ----------
        step, series : int
            Which state, counted as the estimate's own.
        steps : int
            How many the estimate has.
        on_modes : (s, r) array
        on_correction : (s, m) array or None

        Returns
        -------
        (s,) array
        """
        out = np.empty(len(on_modes))
        for start in range(0, len(on_modes), _PORTION):
            part = slice(start, start + _PORTION)
            whole = np.zeros((len(on_modes[part]), steps, on_modes.shape[1]))
            whole[:, step] = on_modes[part]
            correction = None
            if on_correction is not None:
                correction = np.zeros((len(whole), steps, on_correction.shape[1]))
                correction[:, step] = on_correction[part]
            out[part] = self.variance(whole, correction)[:, series]
        return out
