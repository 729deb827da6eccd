"""Estimators that are wrong in one way each: minimum variance, changed."""

from dataclasses import dataclass, replace

import numpy as np

from dacore.core.estimator import BackgroundSpace, Estimator, PreparedEstimator, Riesz, Uncertainty, check_data
from dacore.core.noise import WhiteNoise
from dacore.errors import CapabilityError, DacoreError, ShapeError
from dacore.estimators.minimum_variance import MinimumVariance
from dacore.testing.estimators import estimator_suite
from tests.conformance.mutants import Mutant

MUTANTS = []


def caught_by(check, says="", also=()):
    def declare(cls):
        MUTANTS.append(Mutant(cls.__name__, lambda: estimator_suite(cls(), deviations=True), (check, *also), says))
        return cls

    return declare


class Prepared(PreparedEstimator):
    """Passes on to minimum variance, and lets its settings change what goes in and comes out."""

    def __init__(self, settings, inner):
        self.settings, self.inner, self.calls = settings, inner, 0

    def spaces(self):
        return self.settings.spaces(self.inner)

    @property
    def inf_sup(self):
        return self.settings.constants(self.inner)

    def estimate(self, data, noise_scale=1.0, mask=None):
        self.calls += 1
        return self.settings.change(self, data, noise_scale, mask)

    def readout(self, quantity, noise_scale=1.0, mask=None):
        return self.settings.readout(self, quantity, noise_scale, mask)


@dataclass(frozen=True)
class Sound(Estimator):
    def prepare(self, background, functionals, noise, steps=None):
        return Prepared(self, MinimumVariance().prepare(background, functionals, noise, steps))

    def spaces(self, inner):
        return ()

    def constants(self, inner):
        return inner.inf_sup

    def change(self, prepared, data, scale, mask):
        return prepared.inner.estimate(data, scale, mask)

    def readout(self, prepared, quantity, scale, mask):
        raise CapabilityError("what is wrong elsewhere would show here, too")


class Changed(Uncertainty):
    """The variance of another uncertainty after a function."""

    def __init__(self, inner, function):
        self.inner, self.function = inner, function

    def variance(self, on_modes, on_correction):
        return self.function(self.inner.variance(on_modes, on_correction))


def with_deviations(estimate, function):
    return replace(estimate, uncertainty=Changed(estimate.uncertainty, function))


def moved(estimate, factor):
    return replace(estimate, coefficients=factor * estimate.coefficients)


@caught_by("affine_in_the_data", "is it affine in the data")
class Clips(Sound):
    def change(self, prepared, data, scale, mask):
        return prepared.inner.estimate(data if mask is not None else np.clip(data, -2.0, 2.0), scale, mask)


@caught_by("affine_in_the_data", "is it affine in the data")
class ShrinksLargeStates(Sound):
    def change(self, prepared, data, scale, mask):
        found = prepared.inner.estimate(data, scale, mask)
        return moved(found, 1.0 / (1.0 + 1e-6 * (found.coefficients**2).sum(axis=0)))


@caught_by("deviations_hold", "is a variance taken for a deviation")
class DeviationsTooSmall(Sound):
    def change(self, prepared, data, scale, mask):
        return with_deviations(prepared.inner.estimate(data, scale, mask), lambda v: v / 25.0)


@caught_by("deviations_hold", "errors of four quantities")
class DeviationsTooLarge(Sound):
    def change(self, prepared, data, scale, mask):
        return with_deviations(prepared.inner.estimate(data, scale, mask), lambda v: 25.0 * v)


@caught_by("deviations_are_a_norm", "times a quantity is off")
class VarianceForDeviation(Sound):
    def change(self, prepared, data, scale, mask):
        return with_deviations(prepared.inner.estimate(data, scale, mask), lambda v: v**2)


@caught_by("deviations_are_a_norm", "expected finite numbers of 0 or more, one a series")
class NegativeVariance(Sound):
    def change(self, prepared, data, scale, mask):
        return with_deviations(prepared.inner.estimate(data, scale, mask), lambda v: np.where(v > 0, np.nan, v))


@caught_by("deviations_grow_with_noise", "fall by")
class MoreNoiseMoreCertain(Sound):
    def change(self, prepared, data, scale, mask):
        return with_deviations(prepared.inner.estimate(data, scale, mask), lambda v: v / (1.0 + np.max(scale)))


@caught_by("noise_level_enters_once", "in deviation")
class DeviationsIgnoreTheScale(Sound):
    def change(self, prepared, data, scale, mask):
        found = prepared.inner.estimate(data, scale, mask)
        fixed = prepared.inner.estimate(data, 1.0, mask).uncertainty
        return replace(found, uncertainty=fixed)


@caught_by("nothing_given_is_changed", "writes into what it is given|changes the data")
class CentresTheDataInPlace(Sound):
    def change(self, prepared, data, scale, mask):
        data -= 0.0
        return prepared.inner.estimate(data, scale, mask)


@caught_by("nothing_given_is_changed", "changes its settings")
class RemembersInItsSettings(Sound):
    def change(self, prepared, data, scale, mask):
        object.__setattr__(self, "calls", prepared.calls)
        return prepared.inner.estimate(data, scale, mask)


@caught_by("stability_constants", "inf_sup has shape")
class OneConstantForAll(Sound):
    def constants(self, inner):
        return np.array([0.5])


@caught_by("stability_constants", "expected numbers from 0 to 1")
class ConstantsAboveOne(Sound):
    def constants(self, inner):
        return np.full(len(inner.steps), 1.5)


@caught_by("background_spaces", "uses 3 of 2 modes")
class MoreModesThanThereAre(Sound):
    def spaces(self, inner):
        modes = np.zeros((inner.background.dimension, 2))
        return (BackgroundSpace(modes, np.ones(2), np.ones(5), np.ones(4), 3),)


@caught_by("background_spaces", "inf_sup rises with the dimension")
class ConstantsRise(Sound):
    def spaces(self, inner):
        modes = np.zeros((inner.background.dimension, 2))
        return (BackgroundSpace(modes, np.ones(2), np.ones(3), np.array([0.1, 0.2]), 2),)


@caught_by("masks", "")
class IgnoresTheMask(Sound):
    def change(self, prepared, data, scale, mask):
        return prepared.inner.estimate(np.nan_to_num(data) if mask is not None else data, scale)


@caught_by("masks", "differs by .* from one prepared without them")
class MasksByZero(Sound):
    """Functionals left out are taken for measured as expected."""

    def change(self, prepared, data, scale, mask):
        if mask is None or mask.all() or not mask.any():
            return prepared.inner.estimate(data, scale, mask)
        full = np.where(mask[:, None, None], data, prepared.inner.expected[:, :, None])
        return prepared.inner.estimate(full, scale)


class Twisted(Riesz):
    """Lifts to zero and pairs to something."""

    def __init__(self, n):
        self.n = n

    def lift(self, weights):
        return np.zeros((self.n, *weights.shape[1:]))

    def pair(self, functionals):
        return np.ones((functionals.count, 16))


@caught_by("functionals_of_the_state", "functional.. of new functionals is off")
class StateAndFunctionalsDiffer(Sound):
    def change(self, prepared, data, scale, mask):
        found = prepared.inner.estimate(data, scale, mask)
        return replace(found, correction=np.ones(data.shape), riesz=Twisted(found.background.space.n_dofs))


def read(prepared, quantity, scale, mask, **changes):
    ready = prepared.inner.readout(quantity, scale, mask)
    return replace(ready, **{name: change(getattr(ready, name)) for name, change in changes.items()})


@caught_by("readout", "is off by .* from the estimate's quantity")
class ReadsWithoutTheOffset(Sound):
    def readout(self, prepared, quantity, scale, mask):
        return read(prepared, quantity, scale, mask, offset=np.zeros_like)


@caught_by("readout", "with a mask is off")
class ReadsWithoutTheMask(Sound):
    def readout(self, prepared, quantity, scale, mask):
        whole = prepared.inner.readout(quantity, scale)
        return replace(whole, mask=mask)


@caught_by("readout", "claims a deviation that is off")
class ReadsTheVariance(Sound):
    def readout(self, prepared, quantity, scale, mask):
        return read(prepared, quantity, scale, mask, deviation=np.square)


@caught_by("series_do_not_mix", "of series 0 differs by .* when it is alone")
class SubtractsTheMeanOfTheSeries(Sound):
    def change(self, prepared, data, scale, mask):
        found = prepared.inner.estimate(data, scale, mask)
        mean = found.coefficients.mean(axis=2, keepdims=True)
        return replace(found, coefficients=found.coefficients + 1e-3 * mean)


@caught_by("series_do_not_mix", "when the series are in another order")
class EachSeriesStartsFromTheLast(Sound):
    def change(self, prepared, data, scale, mask):
        found = prepared.inner.estimate(data, scale, mask)
        before = np.concatenate([0.0 * found.coefficients[..., :1], found.coefficients[..., :-1]], axis=2)
        return replace(found, coefficients=found.coefficients + 1e-6 * before)


@caught_by("series_do_not_mix", "")
class OneScaleForAll(Sound):
    def change(self, prepared, data, scale, mask):
        return prepared.inner.estimate(data, float(np.mean(scale)), mask)


@caught_by("the_same_again", "is there state, or randomness")
class Draws(Sound):
    def change(self, prepared, data, scale, mask):
        found = prepared.inner.estimate(data, scale, mask)
        return moved(found, 1.0 + 1e-10 * np.random.default_rng().standard_normal())


@caught_by("the_same_again", "when asked again")
class Learns(Sound):
    def change(self, prepared, data, scale, mask):
        return moved(prepared.inner.estimate(data, scale, mask), 1.0 + 1e-12 * prepared.calls)


@caught_by("wrong_data_are_refused", "NaN in the data raises nothing")
class TakesNaN(Sound):
    def change(self, prepared, data, scale, mask):
        clean = np.nan_to_num(data) if np.ndim(data) == 3 else data
        return prepared.inner.estimate(clean, scale, mask)


@caught_by("wrong_data_are_refused", "raises DacoreError")
class AnotherError(Sound):
    def change(self, prepared, data, scale, mask):
        try:
            return prepared.inner.estimate(data, scale, mask)
        except ShapeError as error:
            raise DacoreError(str(error)) from error


@caught_by("some_steps_observed", "")
class IgnoresTheSteps(Sound):
    def prepare(self, background, functionals, noise, steps=None):
        return Prepared(self, MinimumVariance().prepare(background, functionals, noise))

    def change(self, prepared, data, scale, mask):
        full = np.repeat(data[:, :1], 5, axis=1) if data.ndim == 3 and data.shape[1] == 2 else data
        return prepared.inner.estimate(full, scale, mask)


@caught_by("estimates_are_their_own", "share memory")
class OneBuffer(Sound):
    def change(self, prepared, data, scale, mask):
        kept = prepared.__dict__.setdefault("kept", {})
        key = (np.asarray(data).tobytes(), np.asarray(scale).tobytes(), None if mask is None else mask.tobytes())
        if key not in kept:
            kept[key] = prepared.inner.estimate(data, scale, mask)
        return kept[key]


@caught_by("estimates_are_their_own", "when its data are overwritten")
class KeepsTheData(Sound):
    def change(self, prepared, data, scale, mask):
        found = prepared.inner.estimate(data, scale, mask)

        class Late(Riesz):
            def lift(self, weights):
                return np.zeros((found.background.space.n_dofs, *weights.shape[1:])) + weights.sum()

            def pair(self, functionals):
                return np.ones((functionals.count, data.shape[0]))

        return replace(found, correction=data, riesz=Late())


@caught_by("units_do_not_matter", "measured in mm in place of cm")
class NoiseOfOneCentimetre(Sound):
    def prepare(self, background, functionals, noise, steps=None):
        return super().prepare(background, functionals, WhiteNoise(0.3), steps)


@caught_by("noise_level_enters_once", "differ by")
class PreparedNoiseIgnored(NoiseOfOneCentimetre):
    pass


@caught_by("exact_data_help", "is 1 of that of guessing the training mean, expected below 0.8")
class Guesses(Sound):
    def change(self, prepared, data, scale, mask):
        found = prepared.inner.estimate(data, scale, mask)
        mean = np.repeat(prepared.inner.mean[:, :, None], found.n_series, axis=2)
        return replace(found, coefficients=mean)


@caught_by("shapes", "coefficients of shape .* expected")
class SeriesFirst(Sound):
    def change(self, prepared, data, scale, mask):
        check_data(data, *data.shape[:2])
        found = prepared.inner.estimate(data, scale, mask)
        return replace(found, coefficients=found.coefficients.transpose(0, 2, 1))


@caught_by("settings_fit_before_training", "no")
class RefusesBeforehand(Sound):
    def check(self, layout, samples):
        raise ShapeError("no")
