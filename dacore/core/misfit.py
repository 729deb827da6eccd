"""Whether data contradict what an estimator supposes: the chi-squared statistic of what it leaves of them."""

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from dacore.core.arrays import Array, BoolArray
from dacore.core.display import Card, Displayed, count

# Nominal share of false alarms among series whose model and noise are right. Distributions are matched to what few
# training samples show: with 20 of them and next to no noise a few in a hundred are false, with 100 one in a thousand.
ALARM = 1e-4


@dataclass(frozen=True, eq=False, repr=False)
class Misfit(Displayed):
    """Squared residuals in units of their expected deviation, series by series.

    Parameters
    ----------
    statistic : (k,) array
        Chi-squared distributed where model, training set and noise are right.
    freedom : (k,) array
        Degrees of freedom.
    """

    statistic: Array
    freedom: Array

    def _card(self) -> Card:
        return Card("Misfit", (("series", count(len(self.statistic))), ("verdict", self.verdict)))

    @property
    def verdict(self) -> str:
        """What it says in a few words."""
        ratio, alarms, series = self.ratio, int(self.alarm.sum()), len(self.statistic)
        if series == 1:
            found = "the data contradict the model or the noise" if alarms else "no alarm"
            return f"{found}: residuals {ratio[0]:.3g} times what is expected"
        found = f"{alarms} alarms" if alarms != 1 else "1 alarm"
        return (
            f"{found} of {series} series: residuals {np.median(ratio):.3g} (at most {ratio.max():.3g}) times expected"
        )

    @property
    def ratio(self) -> Array:
        """Root mean square (k,) of the residuals over what was expected of them: 1 where all is right."""
        return np.asarray(np.sqrt(self.statistic / self.freedom))

    @property
    def probability(self) -> Array:
        """Probability (k,) of a misfit as large or larger."""
        return np.asarray(chi2.sf(self.statistic, self.freedom))

    @property
    def alarm(self) -> BoolArray:
        """Series (k,) whose data contradict the model, the training set or the stated noise."""
        return np.asarray(self.probability < ALARM)
