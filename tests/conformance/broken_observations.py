"""Observations and quantities that are wrong in one way each."""

from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, ClassVar

import numpy as np
from scipy.sparse import csr_array

from dacore.core.observation import Functionals, ObservationOperator
from dacore.core.quantity import Over, QuantityOfInterest
from dacore.errors import CapabilityError
from dacore.testing import observation_suite, quantity_suite
from tests.conformance.mutants import Mutant

POSITIONS = ((1.1, 1.7, 0.8), (0.4, 2.2, 1.3), (2.9, 0.1, 2.95))
MUTANTS = []


def caught_by(check, says="", also=(), keywords=None):
    def declare(cls):
        make = quantity_suite if issubclass(cls, QuantityOfInterest) else observation_suite
        suite = partial(lambda: make(cls(), **({"reproduces": "linear"} | (keywords or {}))))
        MUTANTS.append(Mutant(cls.__name__, suite, (check, *also), says))
        return cls

    return declare


def sensors(space, positions, name="u", unit=None):
    """Values of a field at points, and what is known of them."""
    points = np.array(positions)
    components = space.layout.field(name).components
    directions = np.eye(3) if components == 3 else np.zeros((components, 3))
    return {
        "matrix": csr_array(space.evaluation(points, name)),
        "labels": tuple(f"{name}_{c} @ {point}" for c in range(components) for point in positions),
        "unit": space.layout.field(name).unit if unit is None else unit,
        "centres": np.tile(points, (components, 1)),
        "directions": np.repeat(directions, len(points), axis=0),
        "sites": np.tile(np.arange(len(points)), components),
    }


@dataclass(frozen=True)
class Sound(ObservationOperator):
    """Values of u at points."""

    needs: ClassVar[frozenset[str]] = frozenset({"points"})

    positions: tuple[tuple[float, ...], ...] = POSITIONS

    def functionals(self, space):
        self.check(space)
        return Functionals(**(found := sensors(space, self.positions)) | self.broken(space, found))

    def broken(self, space, found):
        return {}


@dataclass(frozen=True)
class SoundQuantity(QuantityOfInterest):
    """Pressure at a point."""

    over_time: Over = "mean"

    def functionals(self, space):
        return Functionals(**sensors(space, POSITIONS[:1], "p"))


@caught_by("constants_are_reproduced", "all values are 0.9 times", also=("linear_fields_are_reproduced",))
@dataclass(frozen=True)
class WeightsDoNotSumToOne(Sound):
    def broken(self, space, found):
        return {"matrix": 0.9 * found["matrix"]}


def stretch(values, gradient, directions):
    """Strain of a linear displacement along directions."""
    return np.einsum("mi,ij,mj->m", directions, gradient, directions)


@dataclass(frozen=True)
class Gauge(ObservationOperator):
    """Mean strain of u between two points."""

    needs: ClassVar[frozenset[str]] = frozenset({"points"})

    start: tuple[float, ...] = POSITIONS[0]
    end: tuple[float, ...] = POSITIONS[1]
    unit: str = "1"

    def functionals(self, space):
        self.check(space)
        ends = np.array([self.start, self.end])
        along = ends[1] - ends[0]
        direction = along / np.linalg.norm(along)
        values = space.evaluation(ends, "u").toarray().reshape(3, 2, -1)
        row = direction @ (values[:, 1] - values[:, 0]) / self.over(np.linalg.norm(along))
        return Functionals(
            csr_array(row[None]), ("strain",), self.unit, ends.mean(axis=0)[None], direction[None], np.array([0])
        )

    def over(self, length):
        return length


STRAIN = {"reproduces": stretch, "unit": "1"}


@caught_by("linear_fields_are_reproduced", "all values are 0.994987 times", keywords=STRAIN)
@dataclass(frozen=True)
class ForgetsTheLength(Gauge):
    def over(self, length):
        return 1.0


@caught_by("constants_are_reproduced", "expected 'cm'; for another quantity than the field itself")
@dataclass(frozen=True)
class IsNoValue(Gauge):
    pass


@caught_by("constants_are_reproduced", "measures u in 'cm', expected '1'", keywords=STRAIN)
@dataclass(frozen=True)
class StrainInCentimetres(Gauge):
    unit: str = "cm"


@caught_by("constants_are_reproduced", "u is 1 everywhere, expected 0", keywords=STRAIN)
@dataclass(frozen=True)
class TakesOneEnd(Gauge):
    def functionals(self, space):
        found = super().functionals(space)
        return replace(found, matrix=csr_array(np.maximum(found.matrix.toarray(), 0.0)))


@caught_by(
    "linear_fields_are_reproduced",
    r"the function for reproduces returns \(1, 3\) values, expected \(1,\)",
    keywords={"reproduces": lambda values, gradient, directions: values, "unit": "1"},
)
@dataclass(frozen=True)
class LawOfAnotherShape(Gauge):
    pass


@caught_by("directions_fit_the_field", "its direction names")
@dataclass(frozen=True)
class WrongComponent(Sound):
    def broken(self, space, found):
        return {"directions": np.roll(found["directions"], 3, axis=0)}


@caught_by("directions_fit_the_field", "sees the fields u, p, expected one")
@dataclass(frozen=True)
class TwoFields(Sound):
    def broken(self, space, found):
        pressure = csr_array(space.evaluation(np.array(POSITIONS), "p"))
        zero = csr_array((6, space.n_dofs))
        from scipy.sparse import vstack

        return {"matrix": csr_array(found["matrix"] + 1e-9 * vstack([pressure, zero]))}


@caught_by("linear_fields_are_reproduced", "where u is linear, expected")
@dataclass(frozen=True)
class WrongPlace(Sound):
    def broken(self, space, found):
        return {"centres": found["centres"] + 0.1}


@caught_by("linear_fields_are_reproduced", "where u is linear, expected")
@dataclass(frozen=True)
class SwappedAxes(Sound):
    def broken(self, space, found):
        return {"centres": found["centres"][:, [1, 0, 2]]}


@caught_by("constants_are_reproduced", "measures u in 'mm', expected 'cm'")
@dataclass(frozen=True)
class IgnoresTheUnit(Sound):
    def broken(self, space, found):
        return {"unit": "mm"}


@caught_by("linear_in_the_state", "functionals must be linear")
@dataclass(frozen=True)
class SecretlyNonlinear(Sound):
    class Clipped(csr_array):
        def __matmul__(self, other):
            return np.clip(csr_array(self) @ other, -1.0, 1.0)

    def broken(self, space, found):
        return {"matrix": self.Clipped(found["matrix"])}


class Absolute(Functionals):
    def __call__(self, states):
        return np.abs(super().__call__(states))


@caught_by("functionals_of_the_space", "returns a Absolute", also=("linear_in_the_state",))
@dataclass(frozen=True)
class ReturnsSomethingElse(Sound):
    def functionals(self, space):
        return Absolute(**sensors(space, self.positions))


@caught_by("functionals_of_the_space", "columns")
@dataclass(frozen=True)
class OneFieldOnly(Sound):
    def broken(self, space, found):
        return {"matrix": csr_array(found["matrix"][:, space.layout.block("u")])}


@caught_by("functionals_of_the_space", "NaN")
@dataclass(frozen=True)
class NotANumber(Sound):
    def broken(self, space, found):
        return {"matrix": found["matrix"] * np.nan}


@caught_by("labels_and_places", "labels occur twice")
@dataclass(frozen=True)
class LabelsTwice(Sound):
    def broken(self, space, found):
        return {"labels": tuple(label[:3] for label in found["labels"])}


@caught_by("labels_and_places", "of site")
@dataclass(frozen=True)
class SitesMixed(Sound):
    def broken(self, space, found):
        return {"sites": np.sort(found["sites"])}


@caught_by("labels_and_places", "a direction has length 2")
@dataclass(frozen=True)
class LongDirections(Sound):
    def broken(self, space, found):
        return {"directions": 2.0 * found["directions"]}


@caught_by("the_same_again", "other functionals when asked again")
@dataclass(frozen=True)
class Noisy(Sound):
    def broken(self, space, found):
        return {"matrix": found["matrix"] * (1.0 + 1e-12 * np.random.default_rng().standard_normal())}


@caught_by("nothing_given_is_changed", "changes its settings")
@dataclass(frozen=True)
class CountsItsUses(Sound):
    def broken(self, space, found):
        object.__setattr__(self, "uses", getattr(self, "uses", 0) + 1)
        return {}


@caught_by("nothing_given_is_changed", "changes the points of the space")
@dataclass(frozen=True)
class MovesThePoints(Sound):
    def broken(self, space, found):
        points = space.cells().points
        points.flags.writeable = True
        points += 1e-9
        points.flags.writeable = False
        return {}


@caught_by("numbering_does_not_matter", "renumbered")
@dataclass(frozen=True)
class TakesTheFirstNode(Sound):
    def broken(self, space, found):
        matrix = found["matrix"].toarray()
        matrix[0] = 0.0
        matrix[0, 0] = 1.0
        return {"matrix": csr_array(matrix)}


@caught_by("what_a_space_lacks_is_refused", "needs is")
@dataclass(frozen=True)
class NeedsUnknown(Sound):
    needs: ClassVar[frozenset[str]] = frozenset({"pixels"})

    def check(self, space):
        pass


@caught_by("what_a_space_lacks_is_refused", "needs cells, but does not refuse")
@dataclass(frozen=True)
class NeedsTooMuch(Sound):
    needs: ClassVar[frozenset[str]] = frozenset({"points", "cells"})

    def check(self, space):
        pass


@caught_by("what_a_space_lacks_is_refused", "measures something else on a space without boundary, in silence")
@dataclass(frozen=True)
class FallsBack(Sound):
    def broken(self, space, found):
        try:
            return {"matrix": found["matrix"] * (1.0 + 0.0 * space.boundary_mean("left", "p").sum())}
        except CapabilityError:
            return {"matrix": 0.5 * found["matrix"]}


@caught_by("settings_cannot_change", "holds a list, which can be changed")
@dataclass(frozen=True)
class MutableSettings(Sound):
    positions: Any = field(default_factory=lambda: [list(each) for each in POSITIONS])


@caught_by("settings_are_frozen", "can be set after making")
@dataclass
class NotFrozen(ObservationOperator):
    width: float = 1.0

    def functionals(self, space):
        return Functionals(**sensors(space, POSITIONS))


@caught_by("settings_are_equal_to_their_copy", "made again from its own fields")
@dataclass(frozen=True)
class ConvertsAgainAndAgain(Sound):
    width: float = 1.0

    def __post_init__(self):
        object.__setattr__(self, "width", 10.0 * self.width)


@caught_by("settings_are_equal_to_their_copy", "cannot be pickled")
@dataclass(frozen=True)
class Unpicklable(Sound):
    def __reduce__(self):
        raise TypeError("no")


@caught_by("settings_come_from_a_scene", "no value of a scene can fill|missing|got")
@dataclass(frozen=True)
class NoScene(Sound):
    width: complex = 1.0 + 0.0j


@caught_by("weights_over_time", "over 4 steps its weights are")
@dataclass(frozen=True)
class SumInPlaceOfMean(SoundQuantity):
    def time_weights(self, n_steps):
        return np.ones((1, n_steps))
