"""Background spaces at their limits: n against m and against samples, β, ζ, ill-conditioned saddle points."""

from dataclasses import replace
from typing import Any

import numpy as np
from scipy.sparse import csr_array

from dacore.core.arrays import Array
from dacore.core.noise import WhiteNoise
from dacore.core.observation import Functionals
from dacore.estimators.saddle_point import solve_saddle_point
from dacore.workflow.stress.case import Case, Inapplicable, Outcome, conditioned
from dacore.workflow.stress.context import Context
from dacore.workflow.stress.inference import WEIGHT, check_minimum_variance, check_pbdw, pbdw, spread, suited, trained
from dacore.workflow.stress.needs import mpmath
from dacore.workflow.stress.reference import EPS

FEW = 24


def _dimension(excess: int) -> Any:
    """PBDW of dimension m + excess with m = 24."""

    def run(context: Context) -> Outcome:
        functionals = spread(context.functionals, FEW)
        n = functionals.count + excess
        if context.background.dimension < n:
            raise Inapplicable(f"the training set has {context.background.dimension} modes, the case needs {n}")
        return check_pbdw(context, pbdw(n), functionals, functionals(context.truth))

    return run


def _more_than_samples(context: Context) -> Outcome:
    settings = pbdw(context.background.n_samples + 1, spaces="phase", centring="phase")
    return check_pbdw(context, settings, context.functionals, context.data)


def _fewer_functionals(estimator: str) -> Any:
    """Four functionals for a space of ten modes."""

    def run(context: Context) -> Outcome:
        functionals = spread(context.functionals, 4)
        data = functionals(context.truth)
        if estimator == "PBDW":
            return check_pbdw(context, pbdw(10), functionals, data)
        if estimator == "bound":
            return check_pbdw(context, pbdw("bound"), functionals, data)
        return check_minimum_variance(context, functionals, data, 0.05 * float(np.abs(data).max()))

    return run


def _dim(strength: float) -> Any:
    """Functionals that all but one mode show themselves in: the last is seen by `strength`."""

    def run(context: Context) -> Outcome:
        functionals = _blinded(context, 5, strength)
        return check_pbdw(context, pbdw(5), functionals, functionals(context.truth))

    return run


def _blinded(context: Context, n: int, strength: float) -> Functionals:
    """Functionals less what they see of the n-th mode of the published space, but for a fraction `strength`."""
    functionals = spread(context.functionals, 30)
    prepared = suited(context, pbdw(n)).prepare(context.background, functionals, WhiteNoise())
    modes = context.background.lift(prepared.spaces()[0].modes[:, :n])
    block = context.space.layout.block(context.space.fields[0].name)
    product = context.space.field_product(context.space.fields[0].name)
    seen = np.zeros_like(modes)
    seen[block] = modes[block]
    dual = np.zeros_like(modes)
    dual[block] = product @ seen[block]
    # Take out of each functional the direction that sees mode n and no other.
    direction = dual @ np.linalg.solve(dual.T @ seen, np.eye(n)[:, -1])
    values = functionals.matrix @ modes[:, -1]
    rows = functionals.matrix.toarray() - (1.0 - strength) * np.outer(values, direction)
    return replace(functionals, matrix=csr_array(rows))


def _weight(factor: float) -> Any:
    def run(context: Context) -> Outcome:
        functionals = spread(context.functionals, 60)
        return check_pbdw(context, pbdw(8, WEIGHT * factor), functionals, functionals(context.truth))

    return run


def _saddle(context: Context) -> Outcome:
    """The dense saddle point with a condition number of 1e12, against the explicit form in 60 digits."""
    mp = mpmath()
    rng = context.rng(5)
    size, m, n = 40, 8, 5
    w, _ = np.linalg.qr(rng.standard_normal((size, m)))
    inside, outside = w @ np.linalg.qr(rng.standard_normal((m, n)))[0], _outside(rng, w, n)
    angles = np.geomspace(1.0, 1e-6, n)  # β = 1e-6, and the saddle point is as ill-conditioned as 1/β²
    basis = inside * angles + outside * np.sqrt(1 - angles**2)
    data = rng.standard_normal((m, 2))
    product = csr_array(np.eye(size))
    found = context.ask(lambda: solve_saddle_point(basis, product, w, data))
    with mp.workdps(60):
        big_w, big_v, big_l = (mp.matrix(each.tolist()) for each in (w, basis, data))
        # W and Φ are orthonormal to round-off only: the exact problem is that of the given numbers.
        top = mp.eye(size) - big_v * big_v.T
        system = mp.zeros(size + m)
        system[:size, :size], system[:size, size:], system[size:, :size] = top, -big_w, big_w.T
        right = mp.zeros(size + m, 2)
        right[size:, :] = big_l
        exact = np.array([mp.lu_solve(system, right[:, k])[:size] for k in range(2)], dtype=object).T.astype(np.float64)
    condition = float(np.linalg.cond(np.array(system.tolist(), dtype=np.float64)))
    error = float(np.linalg.norm(found - exact) / np.linalg.norm(exact))
    told = ""
    return Outcome(error, conditioned(condition, EPS, 10.0), told, f"condition {condition:.0e}")


def _outside(rng: np.random.Generator, w: Array, n: int) -> Array:
    """Orthonormal columns (size, n) perpendicular to those of `w`."""
    free = rng.standard_normal((len(w), n))
    for _ in range(2):
        free = np.linalg.qr(free - w @ (w.T @ free))[0]
    return np.asarray(free)


def _one_sample(settings: Any) -> Any:
    def run(context: Context) -> Outcome:
        background = trained(context.background, 1)
        functionals = spread(context.functionals, 30)
        return check_pbdw(context, settings, functionals, functionals(context.truth), background)

    return run


CASES = (
    Case("n = m - 4", "spaces", "20 modes, 24 functionals", "β falls as n nears m", _dimension(-4)),
    Case("n = m", "spaces", "24 modes, 24 functionals", "a square system, interpolation", _dimension(0)),
    Case("n = m + 1", "spaces", "25 modes, 24 functionals", "β = 0", _dimension(1)),
    Case("n > samples", "spaces", "more modes a phase than samples", "the space has no such mode", _more_than_samples),
    Case("mask leaves m < n, PBDW", "spaces", "10 modes, 4 functionals", "β = 0", _fewer_functionals("PBDW")),
    Case(
        "mask leaves m < n, bound",
        "spaces",
        "n from the bound, 4 functionals",
        "β = 0 for n > 4",
        _fewer_functionals("bound"),
    ),
    Case(
        "mask leaves m < K, minimum variance",
        "spaces",
        "12 samples, 4 functionals",
        "more unknowns than data",
        _fewer_functionals("minimum variance"),
    ),
    Case("mode seen to 1e-6", "spaces", "β of some 1e-8", "errors are magnified by 1/β", _dim(1e-6)),
    Case("mode seen to 1e-8", "spaces", "β of some 1e-10", "errors are magnified by 1/β", _dim(1e-8)),
    Case("mode seen to 1e-11", "spaces", "β of some 1e-13", "beyond any use", _dim(1e-11)),
    Case("zeta x 1e12", "spaces", "ζ a trillion times that of the toy", "modes are pressures alone", _weight(1e12)),
    Case(
        "zeta x 1e-12",
        "spaces",
        "ζ a trillionth of that of the toy",
        "the pressure's weight nears round-off",
        _weight(1e-12),
    ),
    Case(
        "saddle point, condition 1e12", "spaces", "the dense saddle point", "errors of 1e-4 may be lost in it", _saddle
    ),
    Case(
        "one snapshot, uncentred", "spaces", "one trajectory, n = 1", "a space of one direction", _one_sample(pbdw(1))
    ),
    Case(
        "one snapshot, centred",
        "spaces",
        "one trajectory less its mean",
        "nothing is left",
        _one_sample(pbdw(1, spaces="phase", centring="phase")),
    ),
)
