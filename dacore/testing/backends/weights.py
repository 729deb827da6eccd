"""Forms with a number on each cell that multiplies the integrand."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from dacore.core.arrays import Array
from dacore.core.discretization import Discretization
from dacore.testing.backends.stand import ORDERS, PAIRS, Stand
from dacore.testing.compare import Form, Side, agree
from dacore.testing.reference import Expected, Reference
from dacore.testing.suite import require

_Form = tuple[str, str, tuple[int, ...], Side, Side]


def weighted_forms(stand: Stand) -> None:
    """Forms over cells take a weight that multiplies the integrand on each cell, entry by entry, zeros among them."""
    weight = _weight(stand, seed=6)
    weight[:: max(len(weight) // 5, 2)] = 0.0
    reference = Reference(stand.mesh, weight)
    disc = stand.discretization
    for name, orders, arguments, rows, columns in _forms(stand):
        expected: Expected = getattr(reference, name)(*arguments)
        # Where the weight is zero, rounding may still be of the size it has without.
        whole: Expected = getattr(stand.reference, name)(*arguments)
        mistakes = {"the weight is left out": partial(_matrix, whole)}
        form = Form(stand.where(f"{name} with a weight", orders), rows, columns, mistakes)
        raw = partial(getattr(stand.assembler(), name), *arguments, weight)
        agree(partial(_ask(disc, name, arguments), weight), raw, Expected(expected.matrix, whole.scale), form)


def weights_of_one(stand: Stand) -> None:
    """A weight of one on every cell gives the form without a weight, up to rounding."""
    disc, ones = stand.discretization, np.ones(len(stand.mesh.cells))
    for name, orders, arguments, _, _ in _forms(stand):
        ask = _ask(disc, name, arguments)
        gap = _gap(ask(ones), ask())
        require(
            gap < 1e-13,
            f"{stand.where(f'{name} with a weight of one', orders)}: differs by {gap:.1e} of the largest entry from "
            "the form without a weight",
        )


def weights_add_up(stand: Stand) -> None:
    """Forms of the parts of a mesh, whatever was asked for before, add up to the form without a weight."""
    disc = stand.fresh()
    part = np.random.default_rng(7).integers(3, size=len(stand.mesh.cells))
    for name, orders, arguments, _, _ in _forms(stand):
        ask = _ask(disc, name, arguments)
        gap = _gap(sum(ask((part == k).astype(np.float64)) for k in range(3)), ask())
        require(
            gap < 1e-13,
            f"{stand.where(f'{name} with a weight', orders)}: forms of three parts of the mesh add up to the whole but "
            f"for {gap:.1e} of the largest entry; is something kept that belongs to another weight?",
        )


CHECKS = (weighted_forms, weights_of_one, weights_add_up)


def _forms(stand: Stand) -> list[_Form]:
    """Method of the assembler, words for its orders, arguments, rows and columns of every form over cells."""
    out: list[_Form] = []
    for k in ORDERS:
        one, many = stand.side(k), stand.side(k, vector=True)
        out += [(name, f"P{k}", (k,), one, one) for name in ("mass", "stiffness")]
        out += [(name, f"P{k}", (k,), many, many) for name in ("strain", "divergence")]
    for v, s in PAIRS:
        orders, tall, thin = f"vector P{v}, scalar P{s}", stand.side(v, vector=True), stand.side(s)
        out.append(("gradient_coupling", orders, (s, v), tall, thin))
        out.append(("divergence_coupling", orders, (v, s), thin, tall))
    return out


def _ask(disc: Discretization, name: str, arguments: tuple[int, ...]) -> Callable[..., Any]:
    """Return a function of the weight, or of nothing, that asks the discretisation for a form."""
    if name == "gradient_coupling":
        return partial(disc.gradient_coupling, f"p{arguments[0]}", f"u{arguments[1]}")
    if name == "divergence_coupling":
        return partial(disc.divergence_coupling, f"u{arguments[0]}", f"p{arguments[1]}")
    scalar = {"mass": disc.scalar_mass, "stiffness": disc.scalar_stiffness}
    if name in scalar:
        return partial(scalar[name], f"p{arguments[0]}")
    return partial(getattr(disc, name), f"u{arguments[0]}")


def _weight(stand: Stand, seed: int) -> Array:
    return np.random.default_rng(seed).uniform(0.2, 3.0, size=len(stand.mesh.cells))


def _matrix(expected: Expected) -> Array:
    return expected.matrix


def _gap(given: Any, want: Any) -> float:
    """Largest difference as a part of the largest entry; infinite for NaN."""
    gap = abs(given - want).max() / max(abs(want).max(), 1e-300)
    return float(gap) if np.isfinite(gap) else float("inf")
