"""From a scene's plugin tables to objects."""

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, fields, is_dataclass
from functools import cached_property
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.sparse import csr_array, vstack

from dacore import __version__
from dacore.core.arrays import IntArray
from dacore.core.discretization import Backend, Discretization
from dacore.core.domain import Domain
from dacore.core.estimator import Estimator
from dacore.core.fields import Field
from dacore.core.mesh import Mesh
from dacore.core.model import AffineModel, ForwardModel, Physics
from dacore.core.observation import Functionals, ObservationOperator
from dacore.core.parameters import ParameterSpace
from dacore.core.quantity import QuantityOfInterest
from dacore.core.solver import SolverMethod
from dacore.core.space import StateSpace
from dacore.core.timegrid import TimeGrid
from dacore.dynamics.generalized_alpha import GeneralizedAlpha
from dacore.dynamics.march import MarchedModel
from dacore.dynamics.newmark import Newmark
from dacore.dynamics.scheme import Scheme
from dacore.errors import DacoreError, MissingDependencyError, PluginError, SceneError, ShapeError
from dacore.io.scene import PluginTable, Scene, convert
from dacore.plugins.files import check_files, located, with_files
from dacore.plugins.registry import Registry, load
from dacore.plugins.settings import build
from dacore.plugins.versions import source_hash
from dacore.studies.errors import Contrast
from dacore.workflow.built import check_built

if TYPE_CHECKING:
    from dacore.workflow.studies.study import Study


@dataclass(frozen=True, eq=False)
class Builder:
    """Makes a scene's objects through the plugin door.

    Parameters
    ----------
    scene : Scene
    where : str
        What to call the scene in messages.
    base : Path
        Folder that relative paths in the scene start from.
    installed : Registry, optional
        What is installed; read by default, and shared by the variants of a scene.
    """

    scene: Scene
    where: str
    base: Path
    installed: Registry = field(default_factory=lambda: load())

    @cached_property
    def registry(self) -> Registry:
        """What is installed, and what the plugin files of the scene declare; SceneError if one of them is faulty."""
        if not self.scene.plugins:
            return self.installed
        found = with_files(self.installed, located(self.scene.plugins, self.base))
        try:
            check_files(found)
        except PluginError as error:
            raise SceneError(f"{self.where}: plugins: {error}") from error
        return found

    def _make(self, kind: str, table: PluginTable, key: str) -> Any:
        cls = self._class(kind, table.kind, key)
        taken = (
            [each.name for each in fields(cls) if each.name in type(table).model_fields] if is_dataclass(cls) else []
        )
        if taken:
            raise SceneError(
                f"{self.where}: {key}: {kind} {table.kind!r} has a setting {taken[0]!r}, a key of the scene itself; "
                "its author must rename it"
            )
        return build(cls, table.settings, f"{self.where}: {key}", self.base)

    def _class(self, kind: str, name: str, key: str) -> type[Any]:
        try:
            return self.registry.get(kind, name)
        except MissingDependencyError as error:
            raise MissingDependencyError(f"{self.where}: {key}: {error}") from error
        except PluginError as error:
            raise SceneError(f"{self.where}: {key}: {error}") from error

    @cached_property
    def domain(self) -> Domain | None:
        """The domain's settings; None for a scene without one."""
        if self.scene.domain is None:
            return None
        made: Domain = self._make("domain", self.scene.domain, "domain")
        return made

    @cached_property
    def physics(self) -> Physics:
        """The model's settings."""
        made: Physics = self._make("model", self.scene.physics, "physics")
        return made

    @cached_property
    def backend(self) -> Backend:
        """The finite element library."""
        name, key = self.scene.discretization.backend, "discretization.backend"
        cls = self._class("backend", name, key)
        with self.blame(key):
            made: Backend = cls()
            if made.name != name:
                raise PluginError(f"backend {name!r} calls itself {made.name!r}; its author must use one name")
        return made

    @property
    def backend_version(self) -> str:
        """Version of the finite element library; SceneError if the plugin cannot tell."""
        with self.blame("discretization.backend"):
            return self.backend.version()

    @cached_property
    def observations(self) -> dict[str, ObservationOperator]:
        """What is measured, by name."""
        tables = self.scene.observation
        return {name: self._make("observation", table, f"observation.{name}") for name, table in tables.items()}

    @cached_property
    def quantities(self) -> dict[str, QuantityOfInterest]:
        """What is asked, by name."""
        tables = self.scene.quantity
        return {name: self._make("quantity", table, f"quantity.{name}") for name, table in tables.items()}

    @cached_property
    def estimators(self) -> dict[str, Estimator]:
        """How it is estimated, by name."""
        tables = self.scene.estimator
        return {name: self._make("estimator", table, f"estimator.{name}") for name, table in tables.items()}

    @cached_property
    def studies(self) -> "dict[str, Study]":
        """What is studied, by name."""
        tables = self.scene.study
        return {name: self._make("study", table, f"study.{name}") for name, table in tables.items()}

    @cached_property
    def solver(self) -> SolverMethod:
        """What solves the time steps."""
        made: SolverMethod = self._make("solver", self.scene.solver, "solver")
        return made

    @cached_property
    def scheme(self) -> Scheme:
        """The time scheme; SceneError outside its stability region."""
        time = self.scene.time
        with self.blame("time"):
            if time.scheme == "generalized_alpha":
                return GeneralizedAlpha(time.rho_inf)
            return Newmark(time.beta, time.gamma, time.first_order)

    def check(self) -> None:
        """Make every settings object, so that a mistake anywhere in the scene shows before any work."""
        _ = (
            self.registry,
            self.domain,
            self.physics,
            self.backend if self.domain else None,
            self.observations,
            self.quantities,
            self.estimators,
            self.scheme,
            self.solver,
            self.studies,
        )
        for name, estimator in self.estimators.items():
            if estimator.needs_forward and self.scene.training.method != "reduced":
                raise SceneError(
                    f"{self.where}: estimator.{name}: {self.scene.estimator[name].kind} needs the map from parameters "
                    "to trajectories that reduced training leaves; set training.method = 'reduced'"
                )

    def model(self, mesh: Mesh | None) -> ForwardModel:
        """Build the forward model on a mesh, or without one; an affine model is marched as ``[time]`` says."""
        return self.complete(self.assemble(mesh))

    def assemble(self, mesh: Mesh | None) -> AffineModel | ForwardModel:
        """Build what the physics makes: matrices and loads of an affine model, or a model of its own kind."""

        def discretize(fields: Sequence[Field]) -> Discretization:
            if mesh is None:
                raise SceneError(f"{self.where}: [domain]: missing; {self.scene.physics.kind} needs one")
            made.append(self.backend.discretize(mesh, fields))
            return made[-1]

        made: list[Discretization] = []
        with self.blame("physics"):
            built = self.physics.build(discretize)
            check_built(built, type(self.physics).__name__)
        # The model has its matrices; its space asks for masses and evaluations later, and not always.
        for discretization in made:
            discretization.release()
        return built

    def complete(self, built: AffineModel | ForwardModel) -> ForwardModel:
        """Return a model that solves; SceneError if the scene says how to step a model that steps by itself."""
        if isinstance(built, AffineModel):
            return self.march(built, 1)
        for table in ("time", "solver"):
            if table in self.scene.model_fields_set:
                raise SceneError(
                    f"{self.where}: {table}: {self.scene.physics.kind} steps by itself; remove the [{table}] table"
                )
        return built

    def march(self, model: AffineModel, refinement: int) -> MarchedModel:
        """March an affine model with each step divided by `refinement`, recording the same times."""
        time = self.scene.time
        grid = TimeGrid(time.step, time.steps, time.spin_up, time.substeps * refinement, time.graded)
        return MarchedModel(model, grid, self.scheme, time.start, self.solver, self.scene.solver.tolerance)

    def parameters(self, model: ForwardModel) -> ParameterSpace:
        """The model's parameters with the scene's ranges."""
        ranges = {}
        for name, value in self.scene.parameters.items():
            with self.blame("parameters"):
                unit = model.parameters[name].unit
            ranges[name] = convert(value, unit, f"{self.where}: parameters.{name}")
        with self.blame("parameters"):
            return model.parameters.restrict(ranges)

    def observed(self, steps: int) -> IntArray | None:
        """Which of the recorded steps are measured, None for all; SceneError if there are none such."""
        table = self.scene.observed
        if table.phases is not None:
            if table.phases > steps:
                raise SceneError(
                    f"{self.where}: observed.phases: got {table.phases}, but {steps} steps are recorded; lower it"
                )
            # The last of each of equal parts of the cycle.
            return np.round((np.arange(table.phases) + 1) * steps / table.phases).astype(np.int64) - 1
        if table.steps is None:
            return None
        chosen = np.unique(table.steps)
        if chosen[-1] > steps or len(chosen) < len(table.steps):
            raise SceneError(
                f"{self.where}: observed.steps: got {table.steps}, expected different numbers from 1 to {steps}"
            )
        return chosen - 1

    def functionals(self, space: StateSpace) -> Functionals:
        """Everything that is measured, observation after observation."""
        parts = []
        for name, operator in self.observations.items():
            with self.blame(f"observation.{name}"):
                operator.check(space)
                parts.append(fitting(operator.functionals(space), space))
        joined = join(parts)
        if joined.unit == "mixed" and any(level > 0 for level in self.scene.noise.levels):
            units = ", ".join(sorted({part.unit for part in parts}))
            raise SceneError(
                f"{self.where}: noise.levels: observations in {units} share one noise level Ξ · max|ℓ|, which would "
                "drown the smaller ones; observe one unit, or set noise.levels = [0.0]"
            )
        return joined

    def check_before_training(self, space: StateSpace, parameters: ParameterSpace) -> None:
        """Find what is wrong in the scene before anything expensive is done."""
        for name, quantity in self.quantities.items():
            with self.blame(f"quantity.{name}"):
                fitting(quantity.functionals(space), space)
        for name, estimator in self.estimators.items():
            with self.blame(f"estimator.{name}"):
                estimator.check(space.layout, self.scene.training.samples)
        with self.blame("observed.less_mean"):
            for field in self.scene.observed.less_mean:
                space.layout.field(field)
        for name, study in self.studies.items():
            with self.blame(f"study.{name}"):
                study.check(parameters)
        self.contrasts(space, parameters)

    def contrasts(self, space: StateSpace, parameters: ParameterSpace) -> list[Contrast]:
        """The contrasts of the scene, with the values of their constants."""
        out = []
        for table in self.scene.validation.contrasts:
            with self.blame("validation.contrasts"):
                space.layout.field(table.field)
                if not parameters[table.minus].fixed:
                    raise ShapeError(f"{table.minus} varies, expected a fixed parameter")
            out.append(Contrast(f"{table.field} − {table.minus}", table.field, parameters[table.minus].low))
        return out

    @contextmanager
    def blame(self, key: str) -> Iterator[None]:
        """Turn whatever goes wrong into an error of the scene that names `key`."""
        try:
            yield
        except (SceneError, MissingDependencyError):
            raise
        except DacoreError as error:
            raise SceneError(f"{self.where}: {key}: {error}") from error
        except MemoryError:
            raise
        except Exception as error:
            # No error that dacore foresees: a fault of a plugin's code, which its author sees with --debug.
            reason = " ".join(f"{type(error).__name__}: {error}".split())
            raise SceneError(
                f"{self.where}: {key}: its plugin failed ({reason}); dacore --debug shows where"
            ) from error

    def version_of(self, kind: str, name: str) -> str:
        """Version of the plugin that a result depends on, with a hash of its source and of the plugins it builds on.

        The hash makes a change of an installed-in-place plugin's code show, and costs a millisecond.
        """
        cls = self.registry.get(kind, name)
        packages = {each.__module__.partition(".")[0] for each in cls.__mro__}
        own = sorted(packages - {"dacore"} - sys.stdlib_module_names) or ["dacore"]
        return f"{self.registry.version(kind, name)}+{'+'.join(map(source_hash, own))}"

    @property
    def same_truth(self) -> str:
        """What the truth of unseen cases has in common with what the estimators learn from, in words."""
        how = "by the same model" if self.scene.domain is None else "on the same mesh with the same time scheme"
        return f"truth computed {how}"

    def versions(self) -> dict[str, str]:
        """Versions of dacore, its numerical libraries and every installed plugin distribution."""
        names = {"dacore", "numpy", "scipy", "h5py", "meshio", "matplotlib"}
        names |= {row.distribution for row in self.installed.table()}
        files = [each.source for each in self.registry.declarations if each.source.file]
        out = {each.distribution: f"source {each.digest}" for each in files}
        for name in sorted(names):
            try:
                out[name] = version(name)
            except PackageNotFoundError:
                out[name] = __version__ if name == "dacore" else "not installed"
        if self.scene.domain is not None:
            out[f"backend {self.scene.discretization.backend}"] = self.backend_version
        return out


def fitting(found: object, space: StateSpace) -> Functionals:
    """Return what an observation or a quantity gave; PluginError if it is no functionals of this space."""
    if not isinstance(found, Functionals):
        raise PluginError(f"functionals gave a {type(found).__name__}, expected Functionals (dacore.core.observation)")
    columns = found.matrix.shape[1]
    if columns != space.n_dofs:
        raise PluginError(
            f"functionals have {columns} columns, expected {space.n_dofs}, one for each degree of freedom of the state"
        )
    return found


def join(parts: list[Functionals]) -> Functionals:
    """Put the functionals of several observations one after the other."""
    if len(parts) == 1:
        return parts[0]
    starts = np.cumsum([0, *(int(part.sites.max()) + 1 for part in parts[:-1])])
    units = {part.unit for part in parts}
    spacings = {part.spacing for part in parts}
    return Functionals(
        csr_array(vstack([part.matrix for part in parts], format="csr")),
        tuple(label for part in parts for label in part.labels),
        units.pop() if len(units) == 1 else "mixed",
        np.concatenate([part.centres for part in parts]),
        np.concatenate([part.directions for part in parts]),
        np.concatenate([part.sites + start for part, start in zip(parts, starts, strict=True)]),
        spacings.pop() if len(spacings) == 1 else (),
        sum(part.dropped for part in parts),
    )
