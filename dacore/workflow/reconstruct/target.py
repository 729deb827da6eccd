"""What a scene measures, row by row: what data are fitted to."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from dacore.core.arrays import Array, IntArray
from dacore.core.data import Placed
from dacore.core.observation import Functionals
from dacore.dynamics.harmonic import HarmonicModel
from dacore.errors import ShapeError
from dacore.workflow.session import Session

# Another reading of complex data: written for e^{−iωt}.
CONJUGATE = "its phases of the other sign (complex conjugate)"


@dataclass(frozen=True, eq=False)
class Target:
    """The functionals of a scene, and what each of them is of.

    Parameters
    ----------
    functionals : Functionals
    fields : tuple of str, length m
        Field that each functional sees; "" for one that sees several.
    units : tuple of str, length m
    components : mapping of str to int
        Number of components of each field of the state.
    times : (T,) array [s]
        Recorded times.
    observed : (t,) int array
        Which of them the scene measures.
    frequency : float, optional [Hz]
        Of the motion, for a model of one frequency.
    to_scene : (d + 1, d + 1) array, optional
        From an image's world to the scene [cm]; None if they are the same.
    """

    functionals: Functionals
    fields: tuple[str, ...]
    units: tuple[str, ...]
    components: Mapping[str, int]
    times: Array
    observed: IntArray
    to_scene: Array | None = None
    frequency: float | None = None

    @property
    def count(self) -> int:
        """Number m of functionals."""
        return self.functionals.count

    @property
    def measured(self) -> tuple[str, ...]:
        """Fields that are measured, in the order of the state."""
        return tuple(name for name in self.components if name in self.fields)

    def rows(self, name: str | None, where: str) -> IntArray:
        """Functionals of a field; of the only one that is measured for None.

        Raises
        ------
        ShapeError
            If the scene does not measure it, or nobody says which of several.
        """
        if not name:
            if len(self.measured) > 1:
                raise ShapeError(f"{where}: the scene measures {', '.join(self.measured)}; say which with --field")
            name = self.measured[0] if self.measured else ""
        found = np.flatnonzero(np.array(self.fields) == name)
        if not len(found):
            raise ShapeError(f"{where}: is of the field {name!r}, but the scene measures {', '.join(self.measured)}")
        return found


@dataclass(frozen=True, eq=False)
class Fitted:
    """Data as values of a scene's functionals.

    Parameters
    ----------
    name : str
    values : (m, t) array, real or complex
        In the functionals' units; NaN where there is none.
    times : (t,) array, optional [s]
    sigma : (m, t) array, optional
    frequency : float, optional [Hz]
    given : int
        Number of values that the files hold.
    notes, warnings : lists of str
        What was supposed, and what was left out, a line each.
    others : sequence of (str, callable)
        The same data read in another way, with axes exchanged or turned round for instance: functionals (k,) in,
        their values (k, t) out.
    """

    name: str
    values: Array
    times: Array | None
    sigma: Array | None
    frequency: float | None
    given: int
    notes: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    others: Sequence[tuple[str, Callable[[IntArray], Array]]] = ()


def target_of(session: Session) -> Target:
    """What the scene of a session measures."""
    functionals, layout = session.functionals, session.model.space.layout
    seen = np.zeros((functionals.count, len(layout.fields)), dtype=bool)
    for k, each in enumerate(layout.fields):
        columns = functionals.matrix[:, layout.block(each.name)]
        seen[:, k] = np.asarray(abs(columns).sum(axis=1)).ravel() > 0
    names = [each.name for each in layout.fields]
    fields = tuple(names[int(np.argmax(row))] if row.sum() == 1 else "" for row in seen)
    units = (functionals.unit,) * functionals.count
    operators = session.builder.observations
    if functionals.unit == "mixed":
        parts = [operator.functionals(session.model.space) for operator in operators.values()]
        units = tuple(part.unit for part in parts for _ in range(part.count))
    maps = [operator.to_scene for operator in operators.values() if isinstance(operator, Placed)]
    if any(not np.array_equal(each, maps[0]) for each in maps[1:]):
        raise ShapeError("observations: images of several placements; give data of one of them to a scene of its own")
    times = session.model.times
    observed = session.builder.observed(len(times))
    return Target(
        functionals, fields, units, {each.name: each.components for each in layout.fields}, times,
        np.arange(len(times)) if observed is None else observed, maps[0] if maps else None,
        model.frequency if isinstance(model := session.model, HarmonicModel) else None,
    )  # fmt: skip
