"""Contracts of observations and quantities: linear functionals that measure what and where they say."""

import pickle
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, Literal

import numpy as np
from scipy.sparse import csr_array

from dacore.core.arrays import Array
from dacore.core.observation import Functionals, ObservationOperator
from dacore.core.quantity import QuantityOfInterest
from dacore.core.space import StateSpace
from dacore.errors import CapabilityError, PluginError
from dacore.testing import settings
from dacore.testing.spaces import box_space, interpolate, renumbered, without
from dacore.testing.suite import Suite, bind, expect_kind, expect_maker, fail, require

# Of a field that is linear: values (m, c) at the centres, gradient (c, d), directions (m, d) -> what is measured (m,).
Law = Callable[[Array, Array, Array], Array]
Reproduces = Literal["nothing", "constants", "linear"] | Law
WORDS = ("nothing", "constants", "linear")
_CAPABILITIES = frozenset({"points", "cells", "boundary"})


@dataclass(eq=False)
class Measurement:
    """An observation or a quantity on a state space.

    Parameters
    ----------
    operator : ObservationOperator or QuantityOfInterest
    make : callable
        Makes the space when it is first needed.
    reproduces : {"nothing", "constants", "linear"} or callable
    derivative : int or None
    unit : str or None
        Of what is measured; None: that of the field, over cm for a derivative.
    """

    operator: ObservationOperator | QuantityOfInterest
    make: Callable[[], StateSpace] = field(repr=False)
    reproduces: Reproduces = "constants"
    derivative: int | None = None
    unit: str | None = None

    @property
    def name(self) -> str:
        """Name of the class, for messages."""
        return type(self.operator).__name__

    @cached_property
    def space(self) -> StateSpace:
        """The space."""
        return self.make()

    @cached_property
    def found(self) -> Functionals:
        """The functionals on the space, once they are known to be functionals of it: all checks stand on them."""
        found: object = self.operator.functionals(self.space)
        if not isinstance(found, Functionals):
            fail(f"{self.name}: returns a {type(found).__name__}, expected Functionals")
        matrix, n = found.matrix, self.space.n_dofs
        require(isinstance(matrix, csr_array), f"{self.name}: matrix is a {type(matrix).__name__}, expected csr_array")
        require(matrix.shape[1] == n, f"{self.name}: matrix has {matrix.shape[1]} columns, the space has {n} dofs")
        return found

    def seen(self, row: int) -> list[str]:
        """Names of the fields that a functional sees."""
        columns = self.found.matrix[[row]].indices
        blocks = {each.name: self.space.layout.block(each.name) for each in self.space.fields}
        return [name for name, part in blocks.items() if ((columns >= part.start) & (columns < part.stop)).any()]

    def directions(self, name: str) -> Array | None:
        """Directions (m, components) of all functionals if `name` is a vector of space, ones if it is a scalar."""
        components = self.space.layout.field(name).components
        if components == 1:
            return np.ones((self.found.count, 1))
        return self.found.directions if self.is_vector(name) else None

    def is_vector(self, name: str) -> bool:
        """Whether a field is a vector of space."""
        components = self.space.layout.field(name).components
        return components > 1 and components == self.found.directions.shape[1]


def functionals_of_the_space(case: Measurement) -> None:
    """`functionals` returns `Functionals` whose matrix is a finite float64 csr_array with a column for each dof."""
    found = case.found
    require(type(found) is Functionals, f"{case.name}: returns a {type(found).__name__}, expected Functionals")
    matrix = found.matrix
    require(matrix.dtype == np.float64, f"{case.name}: matrix has type {matrix.dtype}, expected float64")
    require(bool(np.isfinite(matrix.data).all()), f"{case.name}: matrix holds NaN or infinite values")


def labels_and_places(case: Measurement) -> None:
    """Labels are different texts; centres, directions, sites and spacing have the types, shapes and sizes stated."""
    found, m = case.found, case.found.count
    good = isinstance(found.labels, tuple) and all(isinstance(label, str) and label for label in found.labels)
    require(good, f"{case.name}: labels are {found.labels!r}, expected a tuple of texts")
    require(len(set(found.labels)) == m, f"{case.name}: {m - len(set(found.labels))} labels occur twice")
    require(isinstance(found.unit, str) and bool(found.unit), f"{case.name}: unit is {found.unit!r}, expected a text")
    centres, directions = np.asarray(found.centres), np.asarray(found.directions)
    for name, array in (("centres", centres), ("directions", directions)):
        good = array.ndim == 2 and array.shape[0] == m and array.dtype == np.float64
        require(good, f"{case.name}: {name} have shape {array.shape} and type {array.dtype}, expected ({m}, d) floats")
    good = centres.shape == directions.shape
    require(good, f"{case.name}: centres {centres.shape} and directions {directions.shape} differ in dimension")
    sizes = np.linalg.norm(directions, axis=1)
    good = bool((np.isclose(sizes, 1.0, atol=1e-9) | (sizes == 0.0)).all())
    require(good, f"{case.name}: a direction has length {sizes[~np.isclose(sizes, 1.0)].max(initial=0):g}, not 1 or 0")
    sites = np.asarray(found.sites)
    good = sites.shape == (m,) and np.issubdtype(sites.dtype, np.integer)
    require(good, f"{case.name}: sites have shape {sites.shape} and type {sites.dtype}, expected ({m},) integers")
    for site in np.unique(sites):
        spread = float(np.ptp(centres[sites == site], axis=0).max())
        require(not spread > 1e-9, f"{case.name}: functionals of site {site} have centres {spread:.2g} cm apart")
    good = isinstance(found.spacing, tuple) and all(size > 0 for size in found.spacing)
    require(good, f"{case.name}: spacing is {found.spacing!r}, expected a tuple of lengths")
    good = isinstance(found.dropped, int) and found.dropped >= 0
    require(good, f"{case.name}: dropped is {found.dropped!r}, expected a number of places")


def directions_fit_the_field(case: Measurement) -> None:
    """Directions are given for vectors of space and only for them; a functional sees one field."""
    for row in range(case.found.count):
        names = case.seen(row)
        label = case.found.labels[row]
        require(len(names) == 1, f"{case.name}: {label} sees the fields {', '.join(names)}, expected one")
        components = case.space.layout.field(names[0]).components
        vector = case.is_vector(names[0])
        has = bool(case.found.directions[row].any())
        require(has == vector, f"{case.name}: {label} has the direction {case.found.directions[row].tolist()}")
        if vector:
            # Components that the direction leaves out must not be seen, the others must.
            parts = case.found.matrix[[row]].toarray()[0, case.space.layout.block(names[0])].reshape(components, -1)
            seen, named = np.abs(parts).max(axis=1) > 0, np.abs(case.found.directions[row]) > 1e-12
            require(
                bool((seen == named).all()),
                f"{case.name}: {label} sees the components {np.flatnonzero(seen).tolist()}, its direction names "
                f"{np.flatnonzero(named).tolist()}",
            )


def constants_are_reproduced(case: Measurement) -> None:
    """A field that is one everywhere is measured as one (or its derivative as zero), in the field's own unit."""
    if case.reproduces == "nothing":
        return
    for name in {each for row in range(case.found.count) for each in case.seen(row)}:
        which = [row for row in range(case.found.count) if case.seen(row) == [name]]
        directions, unit = case.directions(name), case.space.layout.field(name).unit
        wanted_unit = case.unit or (unit if case.derivative is None else f"{unit}/cm")
        require(
            case.found.unit == wanted_unit,
            f"{case.name}: measures {name} in {case.found.unit!r}, expected {wanted_unit!r}; for another quantity than "
            "the field itself give the suite its unit, and as reproduces what it measures of a linear field",
        )
        components = case.space.layout.field(name).components
        for c in range(components):
            state = np.zeros(case.space.n_dofs)
            state[case.space.layout.component(name, c)] = 1.0
            values = case.found(state)[which]
            want = np.zeros(len(which))
            if callable(case.reproduces):
                want = _by_law(case, which, np.eye(components)[c], np.zeros((components, case.found.centres.shape[1])))
            elif case.derivative is None:
                # The weights of a field that is no vector of space are not stated: any of its components, or none.
                want = np.round(values) if directions is None else directions[which, c]
            _close(case, values, want, which, f"component {c} of {name} is 1 everywhere")


def linear_fields_are_reproduced(case: Measurement) -> None:
    """A linear field is measured as its value at the centre (or its slope), in the direction stated, or by its law."""
    if case.reproduces in ("nothing", "constants"):
        return
    if callable(case.reproduces) and "cells" not in case.space.capabilities:
        return  # No field is linear where there are no places: the law was held to constants.
    rng = np.random.default_rng(0)
    for name in {each for row in range(case.found.count) for each in case.seen(row)}:
        which = [row for row in range(case.found.count) if case.seen(row) == [name]]
        directions, components = case.directions(name), case.space.layout.field(name).components
        slopes, level = rng.standard_normal((components, case.found.centres.shape[1])), rng.standard_normal(components)
        state = interpolate(case.space, name, partial(_linear, slopes, level))
        if callable(case.reproduces):
            want = _by_law(case, which, level, slopes)
            _close(case, case.found(state)[which], want, which, f"{name} is linear")
            continue
        if directions is None:
            continue
        if case.derivative is None:
            at_centres = case.found.centres[which] @ slopes.T + level
        else:
            at_centres = np.tile(slopes[:, case.derivative], (len(which), 1))
        want = np.einsum("mc,mc->m", directions[which], at_centres)
        _close(case, case.found(state)[which], want, which, f"{name} is linear")


def linear_in_the_state(case: Measurement) -> None:
    """Values are the matrix times the state, for one state, for many and over time."""
    rng = np.random.default_rng(1)
    states = rng.standard_normal((case.space.n_dofs, 3, 2))
    kept = states.copy()
    values = case.found(states)
    require(np.array_equal(states, kept), f"{case.name}: changes the states it is applied to")
    require(values.shape == (case.found.count, 3, 2), f"{case.name}: values have shape {values.shape}")
    want = np.tensordot(case.found.matrix.toarray(), states, axes=1)
    gap = float(np.abs(values - want).max() / np.abs(want).max())
    require(gap < 1e-12, f"{case.name}: values differ by {gap:.1e} from matrix times state; functionals must be linear")
    gap = float(np.abs(case.found(states[:, 0, 0]) - values[:, 0, 0]).max())
    require(gap < 1e-12 * np.abs(values).max(), f"{case.name}: a state alone is measured differently by {gap:.1e}")


def the_same_again(case: Measurement) -> None:
    """Asked again, and asked of equal or pickled settings, the functionals are the same."""
    first = case.found
    copies = {"asked again": case.operator, "pickled": pickle.loads(pickle.dumps(case.operator))}
    copies["made again"] = replace(case.operator)  # type: ignore[type-var]
    for how, operator in copies.items():
        again = operator.functionals(case.space)
        same = np.array_equal(again.matrix.toarray(), first.matrix.toarray()) and again.labels == first.labels
        require(same, f"{case.name}: gives other functionals when {how}")


def nothing_given_is_changed(case: Measurement) -> None:
    """Neither the settings nor the space are changed, and the functionals share no memory with the space."""
    own, before = case.found, pickle.dumps(case.operator)
    arrays: dict[str, Any] = {}
    if "cells" in case.space.capabilities:
        geometry = case.space.cells()
        arrays = {"points": geometry.points, "cells": geometry.cells}
        arrays |= {f"nodes of {name}": nodes for name, nodes in geometry.nodes.items()}
    kept = {name: np.array(value) for name, value in arrays.items()}
    found = case.operator.functionals(case.space)
    require(pickle.dumps(case.operator) == before, f"{case.name}: changes its settings when it is used")
    for name, value in arrays.items():
        require(np.array_equal(value, kept[name]), f"{case.name}: changes the {name} of the space")
        for mine in (own.matrix.data, found.matrix.data, found.matrix.indices, np.asarray(found.sites)):
            require(not np.shares_memory(mine, value), f"{case.name}: its functionals share memory with the {name}")


def numbering_does_not_matter(case: Measurement) -> None:
    """On the same space with its nodes in another order, the same places measure the same."""
    if not case.space.capabilities:
        return  # nodes without places have nothing but their numbers
    first, (other, dofs) = case.found, renumbered(case.space)
    found = case.operator.functionals(other)
    require(found.labels == first.labels, f"{case.name}: other labels when the nodes of the space are renumbered")
    want = case.found.matrix.toarray()
    moved = found.matrix.toarray()[:, dofs]
    gap = float(np.abs(moved - want).max() / np.abs(want).max())
    require(gap < 1e-9, f"{case.name}: functionals differ by {gap:.1e} when the nodes of the space are renumbered")


def what_a_space_lacks_is_refused(case: Measurement) -> None:
    """On a space without a capability that it `needs`, or uses, CapabilityError is raised; otherwise it works."""
    whole, needs = case.found.matrix.toarray(), type(case.operator).needs
    good = isinstance(needs, frozenset) and needs <= _CAPABILITIES
    require(good, f"{case.name}: needs is {needs!r}, expected a frozenset of {', '.join(sorted(_CAPABILITIES))}")
    for capability in sorted(case.space.capabilities):
        bare = without(case.space, capability)
        try:
            if isinstance(case.operator, ObservationOperator):
                case.operator.check(bare)
            found = case.operator.functionals(bare)
        except CapabilityError:
            continue
        except Exception as error:  # noqa: BLE001  anything else is the finding
            fail(
                f"{case.name}: on a space without {capability} raises {type(error).__name__}, expected CapabilityError"
            )
        require(capability not in needs, f"{case.name}: needs {capability}, but does not refuse a space without")
        same = np.allclose(found.matrix.toarray(), whole, atol=1e-12)
        require(same, f"{case.name}: measures something else on a space without {capability}, in silence")


def weights_over_time(case: Measurement) -> None:
    """`over_time` is "mean" (one row of 1/t) or "each" (the identity), and `time_weights` says so for any t."""
    quantity: Any = case.operator
    require(quantity.over_time in ("mean", "each"), f"{case.name}: over_time is {quantity.over_time!r}")
    for t in (1, 4):
        want = np.full((1, t), 1.0 / t) if quantity.over_time == "mean" else np.eye(t)
        given = np.asarray(quantity.time_weights(t))
        same = given.shape == want.shape and np.allclose(given, want, atol=1e-15)
        require(same, f"{case.name}: over {t} steps its weights are {given.tolist()}, expected {want.tolist()}")


OBSERVATION_CHECKS = (
    functionals_of_the_space, labels_and_places, directions_fit_the_field, constants_are_reproduced,
    linear_fields_are_reproduced, linear_in_the_state, the_same_again, nothing_given_is_changed,
    numbering_does_not_matter, what_a_space_lacks_is_refused,
)  # fmt: skip
QUANTITY_CHECKS = (*OBSERVATION_CHECKS, weights_over_time)


def observation_suite(
    operator: ObservationOperator,
    space: Callable[[], StateSpace] = box_space,
    reproduces: Reproduces = "constants",
    derivative: int | None = None,
    unit: str | None = None,
) -> Suite:
    """Make every check of a kind of measurement, with one choice of its settings.

    Parameters
    ----------
    operator : ObservationOperator
    space : callable
        Makes a state space; by default a cube of 3 cm with fields u (vector), p and c.
    reproduces : {"nothing", "constants", "linear"} or callable
        What is measured as it is: nothing, a constant field, or also the value of a linear field at the centre. Where
        something else is measured of a field, the law of it: a function of the values (m, c) of a linear field at the
        centres, its gradient (c, d), ∂_j u_i in row i, and the directions (m, d), that returns what must be
        measured (m,).
    derivative : int, optional
        Axis, if it is a derivative that is measured.
    unit : str, optional
        Of what is measured; by default the field's own, over cm for a derivative.

    Returns
    -------
    Suite

    Raises
    ------
    PluginError
        If it is no observation, or another argument is not as stated.
    """
    expect_kind("observation_suite", operator, ObservationOperator)
    case = _measurement("observation_suite", operator, space, reproduces, derivative, unit)
    return Suite((*bind(settings.CHECKS, operator), *bind(OBSERVATION_CHECKS, case)))


def quantity_suite(
    quantity: QuantityOfInterest,
    space: Callable[[], StateSpace] = box_space,
    reproduces: Reproduces = "constants",
    derivative: int | None = None,
    unit: str | None = None,
) -> Suite:
    """Make every check of a number of interest; parameters as for `observation_suite`."""
    expect_kind("quantity_suite", quantity, QuantityOfInterest)
    case = _measurement("quantity_suite", quantity, space, reproduces, derivative, unit)
    return Suite((*bind(settings.CHECKS, quantity), *bind(QUANTITY_CHECKS, case)))


def _measurement(
    suite: str,
    operator: ObservationOperator | QuantityOfInterest,
    space: Callable[[], StateSpace],
    reproduces: Reproduces,
    derivative: int | None,
    unit: str | None,
) -> Measurement:
    """Check what does not depend on the space."""
    expect_maker(suite, "space", space)
    if not callable(reproduces) and reproduces not in WORDS:
        raise PluginError(
            f"{suite}: reproduces is {reproduces!r}, expected {', '.join(map(repr, WORDS))} or a function of values, "
            "gradient and directions"
        )
    if derivative is not None and (callable(reproduces) or not isinstance(derivative, int) or derivative < 0):
        raise PluginError(
            f"{suite}: derivative is {derivative!r}, expected the number of an axis, and none beside a function for "
            "reproduces, which is given the gradient"
        )
    return Measurement(operator, space, reproduces, derivative, unit)


def _by_law(case: Measurement, which: list[int], level: Array, slopes: Array) -> Array:
    """What must be measured of the field level + slopes · x, by the law that the suite was given."""
    __tracebackhide__ = True
    law: Any = case.reproduces
    values = case.found.centres[which] @ slopes.T + level
    given = np.asarray(law(values, slopes, case.found.directions[which]), dtype=np.float64)
    good = given.shape == (len(which),)
    require(good, f"{case.name}: the function for reproduces returns {given.shape} values, expected ({len(which)},)")
    return given


def _linear(slopes: Array, level: Array, x: Array) -> Array:
    return np.asarray(x @ slopes.T + level)


def _close(case: Measurement, values: Array, want: Array, which: list[int], when: str) -> None:
    __tracebackhide__ = True
    gap = np.abs(values - want)
    worst = int(gap.argmax())
    if gap[worst] <= 1e-9 * max(1.0, float(np.abs(want).max())):
        return
    cause = ""
    ratio = float(np.vdot(want, values) / np.vdot(want, want)) if want.any() else 0.0
    if np.abs(values - ratio * want).max() < 1e-9 and ratio:
        cause = f"; likely cause: all values are {ratio:.6g} times what they should be"
    fail(
        f"{case.name}: {case.found.labels[which[worst]]} is {values[worst]:.8g} where {when}, expected "
        f"{want[worst]:.8g}{cause}"
    )
