"""A scene with its results, each made when it is first asked for."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from dacore.core.background import Background
from dacore.core.estimator import PreparedEstimator
from dacore.core.mesh import Mesh
from dacore.core.model import ForwardModel, Trajectory
from dacore.core.observation import Functionals
from dacore.core.parameters import ParameterSpace
from dacore.core.quantity import QuantityOfInterest
from dacore.errors import SceneError
from dacore.io.scene import Scene
from dacore.pipeline.runner import Runner
from dacore.reduction.training import Reduced
from dacore.studies.outcomes import Judged, Validation
from dacore.studies.reduction import UnseenErrors
from dacore.studies.refinement import Refinement
from dacore.workflow.build import Builder


@dataclass(frozen=True, eq=False)
class Session:
    """A scene and its stages.

    Nothing is computed on making; every property computes, or reads from the cache, what it needs.

    Parameters
    ----------
    builder : Builder
    runner : Runner
    """

    builder: Builder
    runner: Runner

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

    def judged(self, estimator: str) -> Judged:
        """Return what was found of an estimator on the unseen cases, with its stability and its spaces."""
        self._known(estimator)
        made: Judged = self.runner[f"judged.{estimator}"]
        return made

    def prepared(self, estimator: str) -> PreparedEstimator:
        """Return an estimator of the scene, prepared for noise of unit standard deviation."""
        self._known(estimator)
        made: PreparedEstimator = self.runner[f"prepared.{estimator}"]
        return made

    def _known(self, estimator: str) -> None:
        if estimator not in self.scene.estimator:
            raise SceneError(f"estimator {estimator!r}: this scene has {', '.join(self.scene.estimator)}")
