"""What every picture of a run needs: results, the plane it looks at, names, values on the plane."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import block_diag, csr_array, hstack

from dacore.core.arrays import Array, Sparse
from dacore.core.estimator import BackgroundSpace, Estimate
from dacore.core.fields import Field
from dacore.dynamics.harmonic import HarmonicModel
from dacore.dynamics.march import MarchedModel
from dacore.figures.comparison import Compared
from dacore.figures.slices import HEAD, Frame, Slab, View
from dacore.geometry.cut import cut_plane, planar_domain
from dacore.studies.outcomes import Outcome
from dacore.workflow.drawn import unit_text
from dacore.workflow.session import Session
from dacore.workflow.tables import name_of


@dataclass(frozen=True, eq=False)
class Canvas:
    """A finished run, seen on one plane.

    Parameters
    ----------
    session : Session
        With the results of the scene's targets.
    """

    session: Session

    @cached_property
    def caption(self) -> str:
        """Scene, size and scheme in one line."""
        scene, model = self.session.builder.scene, self.session.model
        parts = [scene.title]
        if scene.domain is not None:
            parts.append(f"{len(self.session.mesh.points):,} nodes")
        if isinstance(model, MarchedModel):
            grid = model.grid
            graded = f", graded {grid.graded}" if grid.graded else ""
            parts.append(f"{model.scheme.label}, τ = {grid.step / grid.substeps:g} s{graded}")
        if isinstance(model, HarmonicModel):
            parts.append(f"{model.frequency:g} Hz, phases 0 and a quarter")
        return " · ".join(parts)

    @cached_property
    def frame(self) -> Frame:
        """Names of the axes."""
        return HEAD if self.session.builder.scene.report.anatomical else Frame()

    @cached_property
    def has_slices(self) -> bool:
        """Whether the domain can be cut or shown as a plane."""
        space = self.session.background.space
        return "cells" in space.capabilities and space.cells().points.shape[1] in (2, 3)

    @cached_property
    def planar(self) -> bool:
        """Whether the domain has two dimensions."""
        return bool(self.session.background.space.cells().points.shape[1] == 2)

    @cached_property
    def spaces(self) -> dict[str, tuple[BackgroundSpace, ...]]:
        """Background spaces V_n of the estimators that have some."""
        found = {}
        for name in self.session.builder.scene.estimator:
            spaces = tuple(space for space in self.session.judged(name).spaces if space.n > 0)
            if spaces:
                found[name] = spaces
        return found

    @cached_property
    def hidden(self) -> Field | None:
        """The last field that no functional sees, if there is one."""
        layout = self.session.background.space.layout
        unseen = [f for f in layout.fields if not self.session.functionals.matrix[:, layout.block(f.name)].nnz]
        return unseen[-1] if unseen else None

    def view(self) -> View:
        """The plane the report looks at, with the measured slices marked."""
        views = self.session.builder.scene.report
        cells = self.session.background.space.cells()
        if self.planar:
            return View(planar_domain(cells.points, cells.cells), self.frame)
        axis = "xyz".index(views.plane)
        low, high = cells.points.min(axis=0), cells.points.max(axis=0)
        position = views.position if views.position is not None else float(0.5 * (low + high)[axis])
        return View(cut_plane(cells.points, cells.cells, axis, position), self.frame, self.slabs)

    @cached_property
    def slabs(self) -> tuple[Slab, ...]:
        """The measured layers, where the voxels fill few layers along one axis."""
        found = self.layers
        if found is None:
            return ()
        axis, centres, spacing = found
        return tuple(Slab(axis, c - spacing / 2, c + spacing / 2) for c in centres)

    @cached_property
    def layers(self) -> tuple[int, Array, float] | None:
        """Axis, places and thickness of the measured layers, if the voxels fill few."""
        if not self.session.functionals.spacing or not self.has_slices or self.planar:
            return None
        places = [np.unique(self.session.functionals.centres[:, k].round(6)) for k in range(3)]
        axis = int(np.argmin([len(each) for each in places]))
        if len(places[axis]) > 4:
            return None
        return axis, places[axis], float(self.session.functionals.spacing[axis])

    def step_at(self, moment: float | None) -> int:
        """Recorded step next to a time; the middle of the recorded steps for None."""
        times = self.session.background.times
        return len(times) // 2 if moment is None else int(np.argmin(np.abs(times - moment)))

    def measured_step(self, step: int) -> int:
        """Measured step next to a recorded one."""
        measured = self.session.builder.observed(len(self.session.background.times))
        return step if measured is None else int(measured[np.argmin(np.abs(measured - step))])

    def shown_step(self, estimates: Sequence[Estimate]) -> int:
        """Recorded step next to the scene's time of the worst case, among those that all estimates are of."""
        step = self.step_at(self.session.builder.scene.report.worst_time)
        shared = set(range(len(self.session.background.times)))
        for estimate in estimates:
            shared &= set(estimate.steps.tolist())
        return min(shared, key=lambda each: (abs(each - step), each)) if shared else step

    def quantity_unit(self, name: str) -> str:
        """Unit of a quantity."""
        return unit_text(self.session.builder.quantities[name].functionals(self.session.background.space).unit)

    def outcomes(self, level: float) -> list[Outcome]:
        """Outcomes of the estimators at one noise level, in the order of the scene."""
        return [self.session.validation.outcome(name, level) for name in self.session.builder.scene.estimator]

    def points(self, view: View, field: str) -> Sparse:
        """Values of a field at the points of a cut, as functionals (c · q, n_dofs), component by component."""
        space = self.session.background.space
        layout, cells = space.layout, space.cells()
        matrix = view.cut.interpolation(cells.nodes[field], cells.orders[field], layout.nodes[field])
        block = layout.block(field)
        inside = block_diag([matrix] * layout.field(field).components, format="csr")
        before, after = (csr_array((inside.shape[0], n)) for n in (block.start, space.n_dofs - block.stop))
        return csr_array(hstack([before, inside, after], format="csr"))

    def values(self, view: View, states: Array, field: str) -> Array:
        """Values of a field of states (n_dofs, n) on a cut: (n, c, q)."""
        states = states.reshape(states.shape[0], -1)
        parts = self.session.background.space.layout.field(field).components
        found = np.asarray(self.points(view, field) @ states)
        return found.reshape(parts, -1, states.shape[1]).transpose(2, 0, 1)

    def compared(
        self, view: View, field: str, truth: Array, estimate: Array, outcome: Outcome, deviation: Array | None = None
    ) -> Compared:
        """Truth and estimate of a field on a cut: the length of a vector, a scalar less its contrast's constant.

        Parameters
        ----------
        view : View
        field : str
        truth, estimate : (n_dofs,) arrays
        outcome : Outcome
        deviation : (c, q) array, optional
            Standard deviation of each component at the points of the cut; of a vector, the root of the sum of
            their squares is shown.
        """
        one = self.values(view, truth, field)[0]
        other = self.values(view, estimate, field)[0]
        unit = unit_text(self.session.background.space.layout.field(field).unit)
        label = name_of(self.session.builder, outcome.estimator)
        spread = inside = None
        if deviation is not None and np.isfinite(deviation).all():
            spread = np.linalg.norm(deviation, axis=0)
            inside = float((np.abs(other - one) <= 2.0 * deviation).mean())
        if len(one) > 1:
            size = np.linalg.norm(one, axis=0)
            return Compared(
                f"|{field}|", unit, size, np.linalg.norm(other, axis=0), spread, np.linalg.norm(other - one, axis=0),
                inside, label, signed=False,
            )  # fmt: skip
        name, constant = field, 0.0
        for contrast in self.session.builder.scene.validation.contrasts:
            if contrast.field == field:
                name = f"{field} − {contrast.minus}"
                constant = self.session.background.parameters[contrast.minus].low
                break
        return Compared(name, unit, one[0] - constant, other[0] - constant, spread, inside=inside, label=label)

    def deviation(self, view: View, estimate: Estimate, case: int, step: int, field: str) -> Array | None:
        """Standard deviations (c, q) that an estimate claims of a field on a cut; None where it claims none."""
        if estimate.uncertainty is None:
            return None
        parts = self.session.background.space.layout.field(field).components
        return estimate.deviation(self.points(view, field), _row(estimate, step), case).reshape(parts, -1)

    def state(self, estimate: Estimate, case: int, step: int) -> Array:
        """The state (n_dofs,) of a case at a recorded step, one that the estimate is of."""
        return estimate.state(series=case, step=_row(estimate, step))


def _row(estimate: Estimate, step: int) -> int:
    return int(np.flatnonzero(estimate.steps == step)[0])
