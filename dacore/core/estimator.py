"""Estimators: settings, and the prepared (offline) half; what comes out is in `dacore.core.estimate`."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar

from dacore.core.arrays import Array, BoolArray, IntArray
from dacore.core.background import Background
from dacore.core.checks import check_data as check_data
from dacore.core.checks import check_mask as check_mask
from dacore.core.checks import check_scale as check_scale
from dacore.core.checks import observed_steps as observed_steps
from dacore.core.display import Card, Displayed, moments
from dacore.core.estimate import Estimate as Estimate
from dacore.core.estimate import Readout as Readout
from dacore.core.estimate import Riesz as Riesz
from dacore.core.estimate import weights_of as weights_of
from dacore.core.fields import Layout
from dacore.core.misfit import Misfit as Misfit
from dacore.core.noise import NoiseModel
from dacore.core.observation import Functionals
from dacore.core.parameters import ParameterEstimate as ParameterEstimate
from dacore.core.quantity import QuantityOfInterest
from dacore.core.reduced import BackgroundSpace as BackgroundSpace
from dacore.core.uncertainty import Uncertainty as Uncertainty
from dacore.errors import CapabilityError


class PreparedEstimator(Displayed, ABC):
    """The offline half done: fast for any number of data sets, and nothing changes it."""

    def _card(self) -> Card:
        # What every estimator of dacore keeps, where one of somebody else's keeps it too; spaces may cost something.
        known = vars(self)
        background, functionals, steps = (known.get(name) for name in ("background", "functionals", "steps"))
        facts = [("settings", f"{known['settings']!r}" if "settings" in known else "")]
        if isinstance(functionals, Functionals):
            facts.append(("measured", functionals._card().facts[0][1]))
        if isinstance(background, Background):
            times = background.times if steps is None else background.times[steps]
            facts += [("observed times", moments(times)), ("training set", background._card().facts[0][1])]
        return Card(type(self).__name__, tuple(facts))

    def spaces(self) -> tuple[BackgroundSpace, ...]:
        """Background spaces in use: one, one for each observed step, or none for an estimator without.

        Returns
        -------
        tuple of BackgroundSpace
        """
        return ()

    @property
    @abstractmethod
    def inf_sup(self) -> Array:
        """Stability constants β (t,) of each observed step; NaN where the estimator has none."""

    @abstractmethod
    def estimate(self, data: Array, noise_scale: Array | float = 1.0, mask: BoolArray | None = None) -> Estimate:
        """Estimate states from data.

        Parameters
        ----------
        data : (m, t, k) array
            Raw measured values of k series; (m, t) of one.
        noise_scale : float or (k,) array
            Factor on the prepared noise's standard deviation, for each series; 0 means exact data.
        mask : (m,) bool array, optional
            Which functionals are valid; None for all.

        Returns
        -------
        Estimate
        """

    def readout(self, quantity: QuantityOfInterest, noise_scale: float = 1.0, mask: BoolArray | None = None) -> Readout:
        """Return what takes data straight to a quantity, for an estimator that is affine in the data.

        Parameters
        ----------
        quantity : QuantityOfInterest
        noise_scale : float
            As `estimate` takes it, one for all series that will be read.
        mask : (m,) bool array, optional
            As `estimate` takes it.

        Returns
        -------
        Readout

        Raises
        ------
        CapabilityError
            If the estimator has none.
        """
        raise CapabilityError(f"{type(self).__name__} has no readout; use estimate(data).quantity(quantity)")


class Estimator(ABC):
    """Frozen settings of an estimator; a plugin class of the hook ``dacore_estimators``.

    Attributes
    ----------
    needs_forward : bool
        Whether it needs the map from parameters to trajectories, which reduced training leaves.
    """

    needs_forward: ClassVar[bool] = False

    def check(self, layout: Layout, samples: int) -> None:  # noqa: B027 (most estimators take any space)
        """Raise ShapeError for settings that cannot work, before anything is trained.

        Parameters
        ----------
        layout : Layout
            Fields of the state.
        samples : int
            Number of training trajectories.
        """

    @abstractmethod
    def prepare(
        self, background: Background, functionals: Functionals, noise: NoiseModel, steps: IntArray | None = None
    ) -> PreparedEstimator:
        """Do everything that does not depend on data.

        Parameters
        ----------
        background : Background
        functionals : Functionals
        noise : NoiseModel
            Of the raw values, up to the factor that `PreparedEstimator.estimate` takes.
        steps : (t,) int array, optional
            Which of the background's times are observed; None for all.

        Returns
        -------
        PreparedEstimator
        """

    def groundwork(self) -> Mapping[str, Any] | None:
        """Settings (JSON values) of what `prepare` makes of a background alone; None if that is not worth keeping.

        Returns
        -------
        mapping or None
        """
        return None

    def pack(self, background: Background) -> tuple[Mapping[str, Any], Mapping[str, Any]]:
        """Make it, and return it as named arrays and facts (JSON values); CapabilityError if there is none.

        Parameters
        ----------
        background : Background

        Returns
        -------
        arrays : mapping of str to array
        facts : mapping of str

        Raises
        ------
        CapabilityError
            If the estimator keeps nothing.
        """
        raise CapabilityError(f"{type(self).__name__} keeps nothing of a background")

    def unpack(self, arrays: Mapping[str, Array], facts: Mapping[str, Any], background: Background) -> None:
        """Take what `pack` returned as made, so that `prepare` with this very background does not make it again.

        Parameters
        ----------
        arrays, facts : mappings of str
            As `pack` returned them.
        background : Background

        Raises
        ------
        KeyError, ValueError
            If parts of it are missing, or it is of another background.
        """
        raise CapabilityError(f"{type(self).__name__} keeps nothing of a background")
