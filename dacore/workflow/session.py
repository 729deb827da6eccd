"""A scene with its results, each made when it is first asked for."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from dacore.core.arrays import Array, BoolArray
from dacore.core.background import Background
from dacore.core.display import Card, Displayed, Rows, listed
from dacore.core.estimator import Estimate, PreparedEstimator
from dacore.core.mesh import Mesh
from dacore.core.model import ForwardModel, Trajectory
from dacore.core.observation import Functionals
from dacore.core.parameters import ParameterSpace
from dacore.core.quantity import QuantityOfInterest
from dacore.errors import SceneError, ShapeError
from dacore.io.scene import Scene
from dacore.pipeline.runner import Runner
from dacore.reduction.training import Reduced
from dacore.studies.outcomes import Judged, Validation
from dacore.studies.reduction import UnseenErrors
from dacore.studies.refinement import Refinement
from dacore.workflow.build import Builder

if TYPE_CHECKING:
    from dacore.core.data import Data, Frame
    from dacore.workflow.reconstruct.result import Reconstruction


@dataclass(frozen=True, eq=False, repr=False)
class Session(Displayed):
    """A scene and its stages.

    Nothing is computed on making; every property computes, or reads from the cache, what it needs.

    Parameters
    ----------
    builder : Builder
    runner : Runner
    """

    builder: Builder
    runner: Runner

    def _card(self) -> Card:
        states = {stage.name: self.runner.state(stage.name) for stage in self.runner.pipeline.stages}
        stages = self.runner.pipeline.stages
        grouped = {
            word: listed([name for name, state in states.items() if state == word], 16)
            for word in dict.fromkeys(states.values())
        }
        card = self.scene._card()
        return Card(
            f"Session: {self.scene.title}",
            (
                ("scene", self.builder.where),
                *card.facts,
                *((f"stages {word}", names) for word, names in grouped.items()),
            ),
            notebook=(
                Rows(("stage", "state", "what it is"), tuple((s.name, states[s.name], s.purpose) for s in stages)),
            ),
        )

    @property
    def scene(self) -> Scene:
        """The checked scene."""
        return self.builder.scene

    @property
    def mesh(self) -> Mesh:
        """The domain; SceneError for a scene without one."""
        if self.scene.domain is None:
            raise SceneError(f"{self.builder.where}: [domain]: missing; this scene has no mesh")
        made: Mesh = self.runner["domain"]
        return made

    @property
    def model(self) -> ForwardModel:
        """The forward model."""
        made: ForwardModel = self.runner["model"]
        return made

    @property
    def parameters(self) -> ParameterSpace:
        """The model's parameters with the scene's ranges."""
        made: ParameterSpace = self.runner["parameters"]
        return made

    @property
    def background(self) -> Background:
        """The compressed training set."""
        made: Background = self.runner["background"]
        return made

    @property
    def reduced(self) -> Reduced:
        """The reduced model of a scene with ``training.method = "reduced"``, and how it was trained."""
        if self.scene.training.method != "reduced":
            raise SceneError(
                f"{self.builder.where}: training.method: got 'full', expected 'reduced' for a reduced model"
            )
        made: Reduced = self.runner["training"]
        return made

    @property
    def unseen_errors(self) -> UnseenErrors:
        """The reduced model held against the unseen cases."""
        made: UnseenErrors = self.runner["reduction"]
        return made

    @property
    def functionals(self) -> Functionals:
        """What is measured; call it with states (n_dofs, ...) to measure them."""
        made: Functionals = self.runner["functionals"]
        return made

    @property
    def quantities(self) -> Mapping[str, QuantityOfInterest]:
        """Numbers of interest by name."""
        return self.builder.quantities

    @property
    def truth(self) -> Sequence[Trajectory]:
        """Trajectories of the unseen cases."""
        made: Sequence[Trajectory] = self.runner["truth"]
        return made

    @property
    def validation(self) -> Validation:
        """Errors of every estimator on the unseen cases."""
        made: Validation = self.runner["validation"]
        return made

    @property
    def refinement(self) -> Refinement:
        """Discretisation error in time, for a scene with ``validation.refine_time``."""
        made: Refinement = self.runner["refinement"]
        return made

    @property
    def cautions(self) -> tuple[str, ...]:
        """What to beware of in this scene's physics, a line each."""
        made: tuple[str, ...] = self.runner["checks"]
        return made

    def observe(
        self, truth: Trajectory, noise: float = 0.0, rng: np.random.Generator | None = None
    ) -> tuple[Array, float]:
        """Measure a trajectory as the scene says, at the steps it observes, and add noise.

        Parameters
        ----------
        truth : Trajectory
            Of `model`, or one of `truth`.
        noise : float
            Level Ξ: σ = Ξ max|ℓ_i(u(t))| over all recorded steps, as that of the scene's ``[noise]``.
        rng : numpy.random.Generator, optional
            Where the noise comes from; needed where there is some.

        Returns
        -------
        data : (m, t) array
            What `estimate` takes, in the unit of the functionals.
        sigma : float
            Standard deviation σ of the noise, in that unit.

        Raises
        ------
        ShapeError
            If the noise is negative, or there is no `rng` for it.
        """
        if not (np.isfinite(noise) and noise >= 0.0):
            raise ShapeError(f"noise: got {noise}, expected a level of 0 or more, 0.1 for a tenth of the largest value")
        states = truth.states
        if self.scene.observed.less_mean:
            states = np.array(states)
            for name in self.scene.observed.less_mean:
                block = self.model.space.layout.block(name)
                states[block] -= states[block].mean(axis=1, keepdims=True)
        data = self.functionals(states)
        sigma = float(noise * np.abs(data).max())
        steps = self.builder.observed(data.shape[1])
        data = data if steps is None else data[:, steps]
        if sigma > 0.0:
            if rng is None:
                raise ShapeError("rng: got none, but there is noise to draw; give numpy.random.default_rng(seed)")
            data = data + sigma * rng.standard_normal(data.shape)
        return data, sigma

    def estimate(self, estimator: str, data: Array, noise: Array | float, mask: BoolArray | None = None) -> Estimate:
        """Estimate states from data with one of the scene's estimators.

        Parameters
        ----------
        estimator : str
            Its name in the scene.
        data : (m, t) or (m, t, k) array
            Measured values of one series or of k, in the unit of the functionals, at the observed steps.
        noise : float or (k,) array
            Standard deviation of their noise, in that unit; 0 for exact data.
        mask : (m,) bool array, optional
            Which functionals were measured; None for all. What the others hold is not looked at.

        Returns
        -------
        Estimate

        Raises
        ------
        SceneError
            If the scene has no such estimator.
        ShapeError
            If data, noise or mask do not fit.
        """
        return self.prepared(estimator).estimate(np.asarray(data), noise, mask)

    def judged(self, estimator: str) -> Judged:
        """Return what was found of an estimator on the unseen cases, with its stability and its spaces.

        Parameters
        ----------
        estimator : str
            Its name in the scene.

        Returns
        -------
        Judged

        Raises
        ------
        SceneError
            If the scene has no such estimator.
        """
        self._known(estimator)
        made: Judged = self.runner[f"judged.{estimator}"]
        return made

    def prepared(self, estimator: str) -> PreparedEstimator:
        """Return an estimator of the scene, prepared for noise of unit standard deviation.

        Parameters
        ----------
        estimator : str
            Its name in the scene.

        Returns
        -------
        PreparedEstimator

        Raises
        ------
        SceneError
            If the scene has no such estimator.
        """
        self._known(estimator)
        made: PreparedEstimator = self.runner[f"prepared.{estimator}"]
        return made

    def reconstruct(
        self,
        data: "Path | str | Data | Sequence[Path | str | Data]",
        *,
        unit: str | None = None,
        noise: str | float | None = None,
        estimator: str | None = None,
        times: Sequence[float] | None = None,
        frequency: float | None = None,
        field: str | None = None,
        components: Sequence[int] = (),
        frame: "Frame" = "world",
        mask: Path | str | None = None,
        phase: Sequence[Path | str] = (),
        tolerance: float | None = None,
    ) -> "Reconstruction":
        """Reconstruct state and quantities from measured data, as ``dacore reconstruct`` does (docs/data.md).

        Parameters
        ----------
        data : file, files or data
            CSV, NPZ, HDF5 or NIfTI; or `SensorData` or `ImageData` of `dacore.core.data`.
        unit : str, optional
            Of the values, if no file says it.
        noise : str or float, optional
            "5%" of the largest value, "0.2 um", or a number in the data's unit; 0 for exact data.
        estimator : str, optional
            One of the scene's; its last by default.
        times : sequence of float, optional [s]
            Of the volumes.
        frequency : float, optional [Hz]
            Of the drive, for complex data.
        field : str, optional
            Which field was measured.
        components : sequence of int
            Components of the files, in their order.
        frame : {"world", "voxel"}
            Axes of an image's vectors.
        mask : path, optional
            Image, zero where nothing is measured.
        phase : sequence of paths
            Phases [rad] of amplitudes, one a file of data.
        tolerance : float, optional [cm]
            How far sensors may be from where the scene has them.

        Returns
        -------
        Reconstruction

        Raises
        ------
        DacoreError
            If the data cannot be read, do not fit the scene, or contradict what was learned beyond all doubt.
        """
        from dacore.core.data import Asked
        from dacore.workflow.reconstruct.run import reconstruct

        asked = Asked(
            unit, None if times is None else tuple(float(t) for t in times), frequency, field, tuple(components), frame,
            None if mask is None else Path(mask), tuple(Path(each) for each in phase),
        )  # fmt: skip
        return reconstruct(self, data, asked=asked, noise=noise, estimator=estimator, tolerance=tolerance)

    def _known(self, estimator: str) -> None:
        if estimator not in self.scene.estimator:
            raise SceneError(f"estimator {estimator!r}: this scene has {', '.join(self.scene.estimator)}")
