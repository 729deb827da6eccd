"""Every figure of a run, from its results; each is drawn by a function of `dacore.figures`."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from matplotlib.figure import Figure

from dacore.core.arrays import Array
from dacore.core.background import Background
from dacore.core.mesh import Mesh
from dacore.core.observation import Functionals
from dacore.estimators.pbdw import PreparedPBDW
from dacore.figures.bound import BoundCurve, bound
from dacore.figures.comparison import Compared, comparison
from dacore.figures.cycle import ErrorHistory, cycle_errors
from dacore.figures.hero import Hidden, Measured, hero
from dacore.figures.inf_sup import InfSupCurve, inf_sup
from dacore.figures.modes import ModeField, modes
from dacore.figures.quantity import QuantityPanel, quantity
from dacore.figures.slices import HEAD, Frame, Slab, View
from dacore.figures.spectrum import Spectrum, spectrum
from dacore.figures.summary import summary
from dacore.figures.voxels import measured_slice
from dacore.geometry.cut import cut_plane, planar_domain
from dacore.pipeline.runner import Runner
from dacore.studies.validation import PRIOR, Outcome, Validation
from dacore.workflow.build import Builder
from dacore.workflow.tables import name_of, noise_name, percent, quantity_title

SHOWN_MODES = 4


@dataclass(frozen=True, eq=False)
class Drawn:
    """A figure with what a report says of it."""

    name: str
    figure: Figure
    caption: str
    alt: str


@dataclass(frozen=True, eq=False)
class Pictures:
    """Draws the figures of a finished run.

    Parameters
    ----------
    builder : Builder
    runner : Runner
        With the results of the scene's targets.
    """

    builder: Builder
    runner: Runner

    @cached_property
    def background(self) -> Background:
        """The compressed training set."""
        made: Background = self.runner["background"]
        return made

    @cached_property
    def validation(self) -> Validation:
        """Errors on unseen cases."""
        made: Validation = self.runner["validation"]
        return made

    @cached_property
    def functionals(self) -> Functionals:
        """What is measured."""
        made: Functionals = self.runner["functionals"]
        return made

    @cached_property
    def caption(self) -> str:
        """Scene, mesh and scheme in one line."""
        mesh: Mesh = self.runner["domain"]
        time = self.builder.scene.time
        return (
            f"{self.builder.scene.title} · {len(mesh.points):,} nodes · β = {time.beta:g}, γ = {time.gamma:g}, "
            f"{time.first_order.replace('_', ' ')}, τ = {time.step:g} s"
        )

    @cached_property
    def frame(self) -> Frame:
        """Names of the axes."""
        return HEAD if self.builder.scene.report.anatomical else Frame()

    @cached_property
    def planar(self) -> bool:
        """Whether the domain has two dimensions."""
        return bool(self.background.space.cells().points.shape[1] == 2)

    @cached_property
    def spectral(self) -> dict[str, PreparedPBDW]:
        """The estimators that have background spaces V_n."""
        prepared = {name: self.runner[f"prepared.{name}"] for name in self.builder.scene.estimator}
        return {name: each for name, each in prepared.items() if isinstance(each, PreparedPBDW)}

    def everything(self) -> list[Drawn]:
        """Draw all figures of the scene."""
        out = [*self.spaces(), self.modes(), *self.measured(), *self.histories(), self.summary()]
        for level in self.builder.scene.noise.levels:
            out += self.worst(level)
        return [*out, *self.quantities(), *self.hero()]

    def view(self) -> View:
        """The plane the report looks at, with the measured slices marked."""
        views = self.builder.scene.report
        cells = self.background.space.cells()
        if self.planar:
            return View(planar_domain(cells.points, cells.cells), self.frame)
        axis = "xyz".index(views.plane)
        low, high = cells.points.min(axis=0), cells.points.max(axis=0)
        position = views.position if views.position is not None else float(0.5 * (low + high)[axis])
        return View(cut_plane(cells.points, cells.cells, axis, position), self.frame, self.slabs)

    @cached_property
    def slabs(self) -> tuple[Slab, ...]:
        """The measured layers, where the voxels fill few layers along one axis."""
        found = self._layers
        if found is None:
            return ()
        axis, centres, spacing = found
        return tuple(Slab(axis, c - spacing / 2, c + spacing / 2) for c in centres)

    @cached_property
    def _layers(self) -> tuple[int, Array, float] | None:
        if not self.functionals.spacing or self.planar:
            return None
        places = [np.unique(self.functionals.centres[:, k].round(6)) for k in range(3)]
        axis = int(np.argmin([len(each) for each in places]))
        if len(places[axis]) > 4:
            return None
        return axis, places[axis], float(self.functionals.spacing[axis])

    def spaces(self) -> list[Drawn]:
        """Singular values, β_n and the bound of every background space."""
        if not self.spectral:
            return []
        spectra, constants, bounds = [], [], []
        for name, prepared in self.spectral.items():
            label = name_of(self.builder, name)
            n = min(len(beta) for beta in prepared.constants)
            values = np.stack([frame.singular_values for frame in prepared.frames])
            beta = np.stack([each[:n] for each in prepared.constants])
            tails = np.stack([frame.tails[1 : n + 1] for frame in prepared.frames])
            dimensions = np.arange(1, n + 1)
            one = len(values) == 1
            spectra.append(Spectrum(label, values[0] if one else values))
            constants.append(InfSupCurve(label, dimensions, beta[0] if one else beta))
            middle = len(beta) // 2
            where = "" if one else f", step {middle + 1}"
            bounds.append(
                BoundCurve(label + where, dimensions, tails[middle], beta[middle], int(prepared.dimensions[middle]))
            )
        return [
            Drawn(
                "singular_values", spectrum(spectra, self.caption, largest=200),
                "Singular values of the training set in each background space, and the tails ε̂_n they leave. "
                "A family (one space a phase) is drawn as its median within its range.",
                "decaying curves of singular values and relative tails against their number",
            ),
            Drawn(
                "inf_sup", inf_sup(constants, self.caption),
                "Stability constants β_n = σ_min of the cross-Gramian between the background space and the "
                "measurements. They never rise with n.",
                "stability constants falling with the dimension of the background space",
            ),
            Drawn(
                "bound", bound(bounds, self.caption),
                "The a-priori bound ε̂_n/β_n and the dimension in use. ε̂_n is a mean-square tail, not a worst case.",
                "bound, tails and stability constants against the dimension, with the dimension in use marked",
            ),
        ]  # fmt: skip

    def modes(self) -> Drawn:
        """The first modes of the first background space, or of the training set."""
        view = self.view()
        if self.spectral:
            name, prepared = next(iter(self.spectral.items()))
            vectors = self.background.lift(prepared.frames[0].modes[:, :SHOWN_MODES])
            whose = name_of(self.builder, name)
        else:
            centred = self.background.coefficients - self.background.mean()[:, :, None]
            left = np.linalg.svd(centred.reshape(self.background.dimension, -1), full_matrices=False)[0]
            vectors, whose = self.background.lift(left[:, :SHOWN_MODES]), "training set"
        fields = [
            ModeField(field.name, self._values(view, vectors, field.name)) for field in self.background.space.fields
        ]
        return Drawn(
            "modes", modes(view, fields, self.caption),
            f"First modes of the space of “{whose}”, each scaled to at most 1. Displacement and pressure of one "
            "column belong together: that is how an unmeasured pressure is recovered.",
            "grid of brain slices with the first modes of each field",
        )  # fmt: skip

    def measured(self) -> list[Drawn]:
        """The measured layer at the scene's time, exact and noisy."""
        found = self._layers
        if found is None:
            return []
        axis, places, _ = found
        cells = self.background.space.cells()
        view = View(cut_plane(cells.points, cells.cells, axis, float(places[len(places) // 2])), self.frame)
        step = self.step_at(self.builder.scene.report.measured_time)
        values = {"exact": self.validation.clean[:, step, 0]}
        for level, data in self.validation.data.items():
            if level > 0:
                values[noise_name(level)] = data[:, step, 0]
        when = f"t = {1e3 * self.background.times[step]:.3g} ms, case 1"
        f = self.functionals
        return [
            Drawn(
                "measured_slice",
                measured_slice(
                    view, f.centres, f.directions, f.spacing, values, f.unit, caption=f"{self.caption} · {when}"
                ),
                f"What is measured: {f.count} averages over {f.n_sites} voxels of "
                f"{' × '.join(f'{s:g}' for s in f.spacing)} cm at {when}. Nothing else of the state is known.",
                "pixel images of the measured displacement components over the outline of the slice",
            )
        ]  # fmt: skip

    def histories(self) -> list[Drawn]:
        """Errors over the cycle for every case, a figure a noise level."""
        prior = self.validation.outcome(PRIOR, 0.0)
        out = []
        for level in self.builder.scene.noise.levels:
            histories = [
                ErrorHistory(name_of(self.builder, o.estimator), {_e(k): v for k, v in o.per_step.items()})
                for o in self._outcomes(level)
            ]
            guess = {_e(label): values for label, values in prior.per_step.items()}
            figure = cycle_errors(self.background.times, histories, guess, f"{self.caption} · {noise_name(level)}")
            out.append(
                Drawn(
                    f"errors_{_tag(level)}", figure,
                    f"Relative errors at each step, {noise_name(level)}: a thin line for each unseen case, the mean in "
                    "bold, and the error of guessing the training mean dashed.",
                    "grids of error curves over the cycle, one column an estimator",
                )
            )  # fmt: skip
        return out

    def summary(self) -> Drawn:
        """Space–time errors of every estimator at every noise level beside the guess."""
        levels = self.builder.scene.noise.levels
        names = list(self.builder.scene.estimator)
        prior = self.validation.outcome(PRIOR, 0.0)
        errors, guess, units = {}, {}, {}
        for label in self.validation.errors:
            table = [
                [self.validation.outcome(name, level).space_time[label].mean() for level in levels] for name in names
            ]
            errors[_e(label)] = np.array(table)
            guess[_e(label)] = float(prior.space_time[label].mean())
        for title in self.builder.scene.quantity:
            name = quantity_title(self.builder, title)
            errors[f"{name} (rms)"] = np.array(
                [[self.validation.outcome(n, level).quantities[title].rms for level in levels] for n in names]
            )
            guess[f"{name} (rms)"] = prior.quantities[title].rms
            units[f"{name} (rms)"] = self.quantity_unit(title)
        figure = summary(
            [name_of(self.builder, name) for name in names], [noise_name(level) for level in levels], errors, guess,
            self.caption, units,
        )  # fmt: skip
        return Drawn(
            "summary", figure,
            "Mean space–time errors over the unseen cases. Right of the dashed line, guessing is better.",
            "points of the error of each estimator at each noise level beside the training mean",
        )  # fmt: skip

    def worst(self, level: float) -> list[Drawn]:
        """Truth, reconstruction and difference of each field in the worst case, every estimator a row."""
        view = self.view()
        step = self.step_at(self.builder.scene.report.worst_time)
        outcomes = self._outcomes(level)
        label = self.validation.errors[len(self.background.space.fields) - 1]
        best = min(outcomes, key=lambda o: float(o.space_time[label].mean()))
        case = best.worst_case(label)
        truth = self.runner["truth"][case].states[:, step]
        estimates = [o.estimate.state(series=case, step=step) for o in outcomes if o.estimate is not None]
        when = f"t = {1e3 * self.background.times[step]:.3g} ms, case {case + 1}, {noise_name(level)}"
        out = []
        for field in self.background.space.fields:
            rows = [
                self._compared(view, field.name, truth, estimate, outcome)
                for outcome, estimate in zip(outcomes, estimates, strict=True)
            ]
            out.append(
                Drawn(
                    f"worst_{field.name}_{_tag(level)}", comparison(view, rows, f"{self.caption} · {when}"),
                    f"{rows[0].name} at {when}: the case that “{name_of(self.builder, best.estimator)}” reconstructs "
                    "worst. Dashed: the measured slice.",
                    f"brain slices of true and reconstructed {field.name} and their difference",
                )
            )  # fmt: skip
        return out

    def quantities(self) -> list[Drawn]:
        """Estimated against true quantities, a panel an estimator and noise level."""
        prior = self.validation.outcome(PRIOR, 0.0)
        out = []
        for title in self.builder.scene.quantity:
            panels = []
            for level in self.builder.scene.noise.levels:
                for outcome in self._outcomes(level):
                    q = outcome.quantities[title]
                    deviation = q.deviation if np.isfinite(q.deviation).all() else None
                    panels.append(
                        QuantityPanel(
                            name_of(self.builder, outcome.estimator), noise_name(level), q.truth, q.estimate, deviation
                        )
                    )
            guess = prior.quantities[title]
            name, unit = quantity_title(self.builder, title), self.quantity_unit(title)
            figure = quantity(panels, name, unit, (float(guess.estimate[0]), guess.rms), self.caption)
            out.append(
                Drawn(
                    f"quantity_{title}", figure,
                    f"{name}: estimate against truth for every unseen case, with the 90% interval each estimator "
                    "claims; the band is the training mean and its error.",
                    f"scatter plots of estimated against true {name}",
                )
            )  # fmt: skip
        return out

    def hero(self) -> list[Drawn]:
        """From the measured voxels to the hidden field, in one strip: the picture of the README."""
        found = self._layers
        if found is None or len(self.background.space.fields) < 2:
            return []
        level = self.builder.scene.noise.levels[-1]
        hidden = self.background.space.fields[-1]
        label = self.validation.errors[len(self.background.space.fields)] if self.validation.errors else hidden.name
        best = min(self._outcomes(level), key=lambda o: float(o.space_time[label].mean()))
        if best.estimate is None:
            return []
        axis, places, _ = found
        cells = self.background.space.cells()
        step = self.step_at(self.builder.scene.report.worst_time)
        case = int(np.argsort(best.space_time[label])[len(best.space_time[label]) // 2])
        f = self.functionals
        spread = [np.abs(f.directions[:, k]).sum() for k in range(f.directions.shape[1])]
        chosen = f.directions[:, int(np.argmax(spread)) if min(spread) == 0 else min(1, len(spread) - 1)] == 1
        flat = View(cut_plane(cells.points, cells.cells, axis, float(places[len(places) // 2])), self.frame)
        view = self.view()
        truth = self.runner["truth"][case].states[:, step]
        compared = self._compared(view, hidden.name, truth, best.estimate.state(series=case, step=step), best)
        f_values = self.validation.data[level][chosen, step, case]
        field = self.background.space.fields[0]
        figure = hero(
            Measured(
                flat, f.centres[chosen], f.spacing, f_values, f"measured {field.name}", f.unit,
                f"{f.n_sites} voxels, {noise_name(level)}",
            ),
            Hidden(
                view, compared.truth, compared.estimate, compared.name, compared.unit,
                f"error {percent(float(best.space_time[label][case]))} over the cycle (training mean: "
                f"{percent(float(self.validation.outcome(PRIOR, level).space_time[label][case]))})",
            ),
        )  # fmt: skip
        return [
            Drawn(
                "hero", figure,
                f"From one measured slice of displacement ({noise_name(level)}) to the unmeasured {compared.name} by "
                f"“{name_of(self.builder, best.estimator)}”: the median case.",
                "measured voxels, reconstructed and true pressure",
            )
        ]  # fmt: skip

    def step_at(self, moment: float | None) -> int:
        """Recorded step next to a time; the middle of the recorded steps for None."""
        times = self.background.times
        return len(times) // 2 if moment is None else int(np.argmin(np.abs(times - moment)))

    def quantity_unit(self, name: str) -> str:
        """Unit of a quantity."""
        return self.builder.quantities[name].functionals(self.background.space).unit

    def _outcomes(self, level: float) -> list[Outcome]:
        return [self.validation.outcome(name, level) for name in self.builder.scene.estimator]

    def _values(self, view: View, states: Array, field: str) -> Array:
        """Values of a field of states (n_dofs, n) on a cut: (n, c, q)."""
        space = self.background.space
        layout, cells = space.layout, space.cells()
        matrix = view.cut.interpolation(cells.nodes[field], cells.orders[field], layout.nodes[field])
        values = states.reshape(states.shape[0], -1)[layout.block(field)]
        parts = values.reshape(layout.field(field).components, layout.nodes[field], -1)
        return np.stack([np.asarray(matrix @ part).T for part in parts], axis=1)

    def _compared(self, view: View, field: str, truth: Array, estimate: Array, outcome: Outcome) -> Compared:
        one = self._values(view, truth, field)[0]
        other = self._values(view, estimate, field)[0]
        unit = self.background.space.layout.field(field).unit
        label = f"{name_of(self.builder, outcome.estimator)}"
        if len(one) > 1:
            size = np.linalg.norm(one, axis=0)
            return Compared(
                f"|{field}|", unit, size, np.linalg.norm(other, axis=0), None, np.linalg.norm(other - one, axis=0),
                label, signed=False,
            )  # fmt: skip
        for contrast in self.builder.scene.validation.contrasts:
            if contrast.field == field:
                constant = self.background.parameters[contrast.minus].low
                return Compared(
                    f"{field} − {contrast.minus}", unit, one[0] - constant, other[0] - constant, label=label
                )
        return Compared(field, unit, one[0], other[0], label=label)


def _e(label: str) -> str:
    """What a figure calls the error of a field or contrast."""
    return f"e_{label}" if label.isidentifier() else f"e of {label}"


def _tag(level: float) -> str:
    return "no_noise" if level == 0 else f"noise_{100 * level:g}".replace(".", "p")
