"""What comes out of an estimator: shapes, agreement of its views, and independence of what must not matter."""

from dataclasses import replace

import numpy as np

from dacore.core.estimator import Estimate
from dacore.core.noise import WhiteNoise
from dacore.core.observation import Functionals
from dacore.errors import CapabilityError
from dacore.testing.backgrounds import Weighted, functionals_of
from dacore.testing.estimators.stand import Bench, gap, parts
from dacore.testing.suite import require

_ROUNDING = 1e-9
# Error with exact data over that of a guess: what a poor estimator reaches, and one that ignores the data does not.
_HELP = 0.8


def shapes(bench: Bench) -> None:
    """An estimate has coefficients (r, t, k), the steps observed, perhaps a correction (m, t, k) with its Riesz map."""
    estimate = bench.prepared.estimate(bench.data)
    require(isinstance(estimate, Estimate), f"{bench.name}: estimate returns a {type(estimate).__name__}")
    r, (m, t, k) = bench.background.dimension, bench.data.shape
    require(estimate.background is bench.background, f"{bench.name}: the estimate has another background")
    require(np.array_equal(estimate.steps, np.arange(t)), f"{bench.name}: steps are {estimate.steps}")
    given = estimate.coefficients.shape
    require(given == (r, t, k), f"{bench.name}: coefficients have shape {given}, expected {(r, t, k)}")
    if estimate.correction is not None:
        given = estimate.correction.shape
        require(given == (m, t, k), f"{bench.name}: correction has shape {given}, expected {(m, t, k)}")
        require(estimate.riesz is not None, f"{bench.name}: has a correction and no Riesz map to lift it")
    state = estimate.state()
    require(state.shape == (bench.space.n_dofs, t, k), f"{bench.name}: states have shape {state.shape}")
    require(bool(np.isfinite(state).all()), f"{bench.name}: states hold NaN or infinite values")


def stability_constants(bench: Bench) -> None:
    """`inf_sup` has one number for each observed step, between 0 and 1, or NaN."""
    for steps in (None, np.array([1, 3])):
        prepared = bench.prepare(bench.background, bench.functionals, bench.noise(), steps)
        constants, count = np.asarray(prepared.inf_sup), bench.steps if steps is None else len(steps)
        good = constants.shape == (count,)
        require(good, f"{bench.name}: inf_sup has shape {constants.shape} for {count} observed steps")
        good = bool((np.isnan(constants) | ((constants >= 0) & (constants <= 1 + 1e-9))).all())
        require(good, f"{bench.name}: inf_sup is {constants.round(4).tolist()}, expected numbers from 0 to 1, or NaN")


def background_spaces(bench: Bench) -> None:
    """`spaces` has none, one, or one space a step, whose arrays fit each other."""
    spaces = bench.prepared.spaces()
    require(len(spaces) in (0, 1, bench.steps), f"{bench.name}: has {len(spaces)} spaces for {bench.steps} steps")
    for space in spaces:
        count = space.modes.shape[1]
        require(len(space.modes) == bench.background.dimension, f"{bench.name}: modes have {len(space.modes)} rows")
        good = 0 <= space.n <= count and len(space.tails) > space.n and len(space.inf_sup) >= space.n
        require(good, f"{bench.name}: uses {space.n} of {count} modes with {len(space.tails)} tails")
        good = bool((np.diff(space.inf_sup) <= 1e-9).all())
        require(good, f"{bench.name}: inf_sup rises with the dimension: {space.inf_sup.round(4).tolist()}")


def functionals_of_the_state(bench: Bench) -> None:
    """Values of functionals and quantities, taken without lifting, are those of the lifted state."""
    rng = np.random.default_rng(11)
    estimate = bench.prepared.estimate(bench.data)
    state = estimate.state()
    rows = rng.standard_normal((3, bench.space.n_dofs))
    rows[1, bench.space.layout.block("u")] = 0.0
    for what, functionals in (("new functionals", functionals_of(rows)), ("the data's own", bench.functionals)):
        off = gap(estimate.functional(functionals), functionals(state))
        require(off < _ROUNDING, f"{bench.name}: functional() of {what} is off by {off:.1e} from the state's values")
    for over in ("mean", "each"):
        quantity = Weighted(rows, over)
        values = np.tensordot(rows, state, axes=1)
        want = np.einsum("ot,stk->sok", quantity.time_weights(bench.steps), values).reshape(-1, state.shape[2])
        off = gap(estimate.quantity(quantity), want)
        require(off < _ROUNDING, f"{bench.name}: quantity() over time {over!r} is off by {off:.1e} from the state's")
    for step, series in ((2, 1), (slice(1, 4), 0), (slice(None), slice(0, 2))):
        off = gap(estimate.state(series, step), state[:, step, series])
        require(off < _ROUNDING, f"{bench.name}: state(series={series}, step={step}) is off by {off:.1e}")


def the_same_again(bench: Bench) -> None:
    """The same data give the same estimate to the last bit, whatever was estimated in between or prepared anew."""
    first = parts(bench.prepared.estimate(bench.data))
    bench.prepared.estimate(-3.0 * bench.data[:, :, ::-1], 2.0)
    bench.prepared.estimate(bench.data, 0.0, np.arange(bench.m) % 4 != 0)
    anew = bench.prepare(bench.background, bench.functionals, bench.noise())
    for how, prepared in (("asked again", bench.prepared), ("prepared anew", anew)):
        for name, array in parts(prepared.estimate(bench.data)).items():
            off = gap(array, first[name])
            require(off == 0.0, f"{bench.name}: {name} differs by {off:.1e} when {how}; is there state, or randomness?")


def series_do_not_mix(bench: Bench) -> None:
    """A series is estimated alike alone, in another order and among others, with its own noise scale."""
    scales = np.array([0.5, 1.0, 2.0, 0.0])
    whole = parts(bench.prepared.estimate(bench.data, scales))
    turn = np.array([2, 0, 3, 1])
    turned = parts(bench.prepared.estimate(bench.data[:, :, turn], scales[turn]))
    for name, array in whole.items():
        if not array.size:
            continue
        off = gap(turned[name], array[..., turn])
        require(off < _ROUNDING, f"{bench.name}: {name} differs by {off:.1e} when the series are in another order")
        for k in range(len(scales)):
            alone = parts(bench.prepared.estimate(bench.data[:, :, [k]], float(scales[k])))[name]
            off = gap(alone[..., 0], array[..., k])
            require(off < _ROUNDING, f"{bench.name}: {name} of series {k} differs by {off:.1e} when it is alone")


def affine_in_the_data(bench: Bench) -> None:
    """Where it is claimed: the estimate of a mixture of data is the mixture of the estimates."""
    if not bench.affine:
        return
    for scale in (0.0, 1.0):
        one, other = bench.data[:, :, :2], 3.0 * bench.data[:, :, 2:]
        for share in (0.3, -1.5):
            ours = bench.prepared.estimate(share * one + (1 - share) * other, scale)
            first, second = (bench.prepared.estimate(data, scale).state() for data in (one, other))
            off = gap(ours.state(), share * first + (1 - share) * second)
            require(
                off < 1e-8,
                f"{bench.name}: the state of {share:g} a + {1 - share:g} b at noise scale {scale:g} is off by "
                f"{off:.1e} from the same mixture of the estimates; is it affine in the data?",
            )


def masks(bench: Bench) -> None:
    """Masked functionals are not looked at: the estimate is that of an estimator prepared without them."""
    mask = np.arange(bench.m) % 4 != 0
    spoiled = bench.data.copy()
    spoiled[~mask] = np.nan
    for kind in ("white", "sensors", "correlated"):
        noise = bench.noise(kind)
        prepared = bench.prepare(bench.background, bench.functionals, noise)
        want = prepared.estimate(np.where(mask[:, None, None], bench.data, 0.0), 1.0, mask).state()
        other = prepared.estimate(np.where(mask[:, None, None], bench.data, 1e6), 1.0, mask).state()
        off = gap(other, want)
        require(off < _ROUNDING, f"{bench.name}: the state depends on masked data (by {off:.1e}) with {kind} noise")
        off = gap(prepared.estimate(spoiled, 1.0, mask).state(), want)
        require(off < _ROUNDING, f"{bench.name}: masked NaN reach the state")
        fewer = bench.prepare(bench.background, bench.fewer(mask), noise.marginal(mask))
        off = gap(fewer.estimate(bench.data[mask]).state(), want)
        require(off < 1e-6, f"{bench.name}: a masked estimate differs by {off:.1e} from one prepared without them")
        off = gap(
            prepared.estimate(bench.data, 1.0, np.ones(bench.m, dtype=bool)).state(),
            prepared.estimate(bench.data).state(),
        )
        require(off < _ROUNDING, f"{bench.name}: a mask that keeps everything changes the state by {off:.1e}")


def units_do_not_matter(bench: Bench) -> None:
    """Data in another unit, with functionals and noise in that unit, give the same estimate."""
    factor = 10.0
    matrix = factor * bench.functionals.matrix.toarray()
    functionals = replace(functionals_of(matrix), unit="mm")
    prepared = bench.prepare(bench.background, functionals, WhiteNoise(0.3 * factor))
    off = gap(prepared.estimate(factor * bench.data).state(), bench.prepared.estimate(bench.data).state())
    require(off < 1e-6, f"{bench.name}: measured in mm in place of cm the state differs by {off:.1e}")


def some_steps_observed(bench: Bench) -> None:
    """With some of the steps observed, data have these steps, and the estimate has them or all of the background's.

    With exact data the measured field is nearer at the observed steps than the training mean is.
    """
    steps = np.array([0, 3])
    prepared = bench.prepare(bench.background, bench.functionals, bench.noise(), steps)
    estimate = prepared.estimate(bench.data[:, steps])
    good = any(np.array_equal(estimate.steps, want) for want in (steps, np.arange(bench.steps)))
    require(good, f"{bench.name}: observes {steps}, and its steps are {estimate.steps}")
    shape, count = estimate.state().shape, len(estimate.steps)
    require(shape[1] == count, f"{bench.name}: {count} steps are estimated, and states have shape {shape}")
    functionals: Functionals = bench.functionals
    exact = prepared.estimate(functionals(bench.truth)[:, steps], 0.0)
    found = exact.state()[:, np.searchsorted(exact.steps, steps)]
    guess = bench.background.lift(bench.background.mean())[:, steps, None]
    block, truth = bench.space.layout.block("u"), bench.truth[:, steps]
    ours, mean = (float(np.linalg.norm((x - truth)[block])) for x in (found, guess))
    require(
        ours < mean,
        f"{bench.name}: with exact data of the steps {steps} the measured field is off there by {ours / mean:.2g} "
        "of what guessing the training mean is, expected below 1; are they taken for these steps?",
    )


def exact_data_help(bench: Bench) -> None:
    """With exact data of unseen cases, the measured field's error is below 0.8 of that of the training mean."""
    functionals: Functionals = bench.functionals
    estimate = bench.prepared.estimate(functionals(bench.truth), 0.0).state()
    guess = bench.background.lift(bench.background.mean())[:, :, None]
    block = bench.space.layout.block("u")
    ours, mean = (float(np.linalg.norm((x - bench.truth)[block])) for x in (estimate, guess))
    few = "" if bench.forward else ", and does it need trajectories of few parameters (forward=True)"
    require(
        ours < _HELP * mean,
        f"{bench.name}: with exact data of unseen cases the error of the measured field is {ours / mean:.2g} of that "
        f"of guessing the training mean, expected below {_HELP}; are the data used{few}?",
    )


def readout(bench: Bench) -> None:
    """A readout, where the estimator has one, gives the quantities and deviations of `estimate`, with masks too."""
    rng = np.random.default_rng(13)
    rows = rng.standard_normal((2, bench.space.n_dofs))
    mask = np.arange(bench.m) % 4 != 1
    for over in ("mean", "each"):
        for flags in (None, mask):
            quantity = Weighted(rows, over)
            try:
                ready = bench.prepared.readout(quantity, 0.5, flags)
            except CapabilityError:
                return
            data = bench.data if flags is None else np.where(flags[:, None, None], bench.data, np.nan)
            estimate = bench.prepared.estimate(data, 0.5, flags)
            what = f"{bench.name}: a readout over time {over!r}{'' if flags is None else ' with a mask'}"
            off = gap(ready(data), estimate.quantity(quantity))
            require(off < _ROUNDING, f"{what} is off by {off:.1e} from the estimate's quantity")
            if estimate.uncertainty is not None:
                off = gap(ready.deviation, estimate.standard_deviation(quantity)[:, 0])
                require(off < _ROUNDING, f"{what} claims a deviation that is off by {off:.1e}")


CHECKS = (
    shapes, stability_constants, background_spaces, functionals_of_the_state, readout, the_same_again,
    series_do_not_mix, affine_in_the_data, masks, units_do_not_matter, some_steps_observed, exact_data_help,
)  # fmt: skip
