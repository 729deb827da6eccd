"""What an estimator refuses, what it leaves as it is, and what its deviations mean."""

import pickle
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np

from dacore.core.noise import WhiteNoise
from dacore.errors import DacoreError, ShapeError
from dacore.testing.backgrounds import Weighted
from dacore.testing.estimators.stand import Bench, gap
from dacore.testing.suite import fail, require


def nothing_given_is_changed(bench: Bench) -> None:
    """Data, masks, steps, the training set and the functionals stay as they are, and read-only arrays are enough."""
    data, mask, steps = bench.data.copy(), np.arange(bench.m) % 3 != 0, np.arange(bench.steps)
    scale = np.full(data.shape[2], 0.5)
    given: dict[str, Any] = {"data": data, "mask": mask, "steps": steps, "noise scale": scale}
    given |= {"coefficients of the training set": bench.background.coefficients}
    given |= {f"modes of {name}": base.basis for name, base in bench.background.bases.items()}
    given |= {"functionals": bench.functionals.matrix.data}
    before = {name: array.copy() for name, array in given.items()}
    settings = pickle.dumps(bench.estimator)
    flags = {name: array.flags.writeable for name, array in given.items()}
    for array in given.values():
        array.flags.writeable = False
    try:
        prepared = bench.prepare(bench.background, bench.functionals, bench.noise(), steps)
        estimate = prepared.estimate(data, scale, mask)
        estimate.state()
        prepared.estimate(data, scale).functional(bench.functionals)
    except ValueError as error:
        if "read-only" in str(error):
            fail(f"{bench.name}: writes into what it is given: {error}")
        raise
    finally:
        for name, array in given.items():
            array.flags.writeable = flags[name]
    for name, array in given.items():
        require(np.array_equal(array, before[name]), f"{bench.name}: changes the {name}")
    require(pickle.dumps(bench.estimator) == settings, f"{bench.name}: changes its settings when it is used")


def estimates_are_their_own(bench: Bench) -> None:
    """Overwriting an estimate's arrays, or the data after it, changes no other estimate."""
    data = bench.data.copy()
    first = bench.prepared.estimate(data)
    want = first.state()
    data[:] = 0.0
    off = gap(first.state(), want)
    require(off == 0.0, f"{bench.name}: an estimate changes by {off:.1e} when its data are overwritten")
    spoiled = bench.prepared.estimate(bench.data)
    for array in (spoiled.coefficients, spoiled.correction):
        if array is not None and array.flags.writeable:
            array[:] = np.nan
    off = gap(bench.prepared.estimate(bench.data).state(), want)
    require(off == 0.0, f"{bench.name}: estimates share memory with what is prepared")


def wrong_data_are_refused(bench: Bench) -> None:
    """Data of a wrong shape or with NaN, a wrong noise scale, mask or steps raise ShapeError."""
    prepare, estimate, data = bench.estimator.prepare, bench.prepared.estimate, bench.data
    spoiled = data.copy()
    spoiled[1, 2, 0] = np.nan
    given = (bench.background, bench.functionals, bench.noise())
    asked: dict[str, Callable[[], object]] = {
        "one functional too few": lambda: estimate(data[1:]),
        "one step too few": lambda: estimate(data[:, 1:]),
        "data without axes of steps and series": lambda: estimate(data[:, 0, 0]),
        "NaN in the data": lambda: estimate(spoiled),
        "a negative noise scale": lambda: estimate(data, -1.0),
        "a noise scale of NaN": lambda: estimate(data, np.nan),
        "noise scales for other series": lambda: estimate(data, np.ones(data.shape[2] + 1)),
        "a mask of another length": lambda: estimate(data, 1.0, np.arange(bench.m - 1) > 0),
        "a mask that keeps nothing": lambda: estimate(data, 1.0, np.zeros(bench.m, dtype=bool)),
        "steps that are not there": lambda: prepare(*given, np.array([0, bench.steps])),
        "a step twice": lambda: prepare(*given, np.array([1, 1])),
        "no steps": lambda: prepare(*given, np.array([], dtype=np.int64)),
    }
    for what, ask in asked.items():
        try:
            ask()
        except ShapeError:
            continue
        except DacoreError as error:
            fail(f"{bench.name}: {what} raises {type(error).__name__}: {error}; expected ShapeError")
        except Exception as error:  # noqa: BLE001  anything else is the finding
            fail(f"{bench.name}: {what} raises {type(error).__name__}: {error}; expected ShapeError")
        else:
            fail(f"{bench.name}: {what} raises nothing, expected ShapeError")


def settings_fit_before_training(bench: Bench) -> None:
    """`check` accepts the layout and number of samples that `prepare` accepts."""
    bench.estimator.check(bench.space.layout, bench.background.n_samples)


def deviations_are_a_norm(bench: Bench) -> None:
    """Deviations, where there are any, scale with the quantity and satisfy the law of a quadratic form."""
    rng = np.random.default_rng(12)
    estimate = bench.prepared.estimate(bench.data)
    if estimate.uncertainty is None:
        return
    one, other = rng.standard_normal((2, 1, bench.space.n_dofs))
    first = estimate.standard_deviation(Weighted(one))
    good = first.shape == (1, bench.data.shape[2]) and bool((np.isfinite(first) & (first >= 0)).all())
    require(good, f"{bench.name}: deviations are {first.tolist()}, expected finite numbers of 0 or more, one a series")
    for factor in (-2.0, 1e3):
        off = gap(estimate.standard_deviation(Weighted(factor * one)), abs(factor) * first)
        require(off < 1e-6, f"{bench.name}: the deviation of {factor:g} times a quantity is off by {off:.1e}")
    plus, minus, second = (
        estimate.standard_deviation(Weighted(rows)) ** 2 for rows in (one + other, one - other, other)
    )
    off = gap(plus + minus, 2 * (first**2 + second))
    require(off < 1e-6, f"{bench.name}: variances are no quadratic form of the weights (off by {off:.1e})")
    stacked = estimate.standard_deviation(Weighted(np.concatenate([one, other])))
    off = gap(stacked, np.concatenate([first, np.sqrt(second)]))
    require(off < 1e-6, f"{bench.name}: deviations of two quantities differ by {off:.1e} from those of each alone")


def deviations_grow_with_noise(bench: Bench) -> None:
    """More noise does not make an estimate claim to be more exact by a tenth."""
    rows = np.random.default_rng(13).standard_normal((3, bench.space.n_dofs))
    found = []
    for scale in (0.0, 0.3, 1.0, 3.0):
        estimate = bench.prepared.estimate(bench.data, scale)
        if estimate.uncertainty is None:
            return
        found.append(estimate.standard_deviation(Weighted(rows)))
    falls = np.array([float(((before - after) / before).max()) for before, after in pairwise(found)])
    require(bool((falls < 0.1).all()), f"{bench.name}: deviations fall by {falls.max():.0%} when the noise grows")


def deviations_hold(bench: Bench) -> None:
    """Where it is claimed: errors on unseen cases, over their deviations, have a mean square near one."""
    if not bench.deviations:
        return
    rng = np.random.default_rng(14)
    rows = np.zeros((4, bench.space.n_dofs))
    for k, field in enumerate(("u", "u", "p", "p")):
        block = bench.space.layout.block(field)
        rows[k, block] = rng.standard_normal(block.stop - block.start)
    cases = 150
    truth = bench.population.draw(rng, cases)
    for kind, scale in (("white", 0.3), ("white", 3.0), ("sensors", 1.0), ("correlated", 1.0)):
        noise = bench.noise(kind)
        prepared = bench.prepare(bench.background, bench.functionals, noise)
        data = bench.functionals(truth) + scale * noise.sample(rng, (bench.m, bench.steps, cases))
        estimate = prepared.estimate(data, scale)
        require(estimate.uncertainty is not None, f"{bench.name}: claims deviations and gives no uncertainty")
        quantity = Weighted(rows, "mean")
        error = estimate.quantity(quantity) - np.tensordot(rows, truth, axes=1).mean(axis=1)
        ratio = np.sqrt(((error / estimate.standard_deviation(quantity)) ** 2).mean(axis=1))
        good = bool(((ratio > 0.5) & (ratio < 2.0)).all())
        cause = "; is a variance taken for a deviation, or the noise scale left out?" if not good else ""
        require(
            good,
            f"{bench.name}: with {kind} noise at scale {scale:g}, errors of four quantities are "
            f"{ratio.round(2).tolist()} of the deviations claimed, expected 0.5 to 2{cause}",
        )


def noise_level_enters_once(bench: Bench) -> None:
    """Noise prepared twice as large and half the scale are the same noise."""
    rows = np.random.default_rng(15).standard_normal((2, bench.space.n_dofs))
    ours = bench.prepared.estimate(bench.data, 1.0)
    other = bench.prepare(bench.background, bench.functionals, WhiteNoise(0.6)).estimate(bench.data, 0.5)
    off = gap(other.state(), ours.state())
    require(
        off < 1e-6, f"{bench.name}: noise of 0.6 at scale 0.5 and of 0.3 at scale 1 differ by {off:.1e} in the state"
    )
    if ours.uncertainty is not None:
        off = gap(other.standard_deviation(Weighted(rows)), ours.standard_deviation(Weighted(rows)))
        require(off < 1e-6, f"{bench.name}: noise of 0.6 at scale 0.5 and of 0.3 at 1 differ by {off:.1e} in deviation")


CHECKS = (
    nothing_given_is_changed, estimates_are_their_own, wrong_data_are_refused, settings_fit_before_training,
    deviations_are_a_norm, deviations_grow_with_noise, deviations_hold, noise_level_enters_once,
)  # fmt: skip
