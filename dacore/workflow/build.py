"""From a scene's plugin tables to objects."""

from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse import csr_array, vstack

from dacore import __version__
from dacore.core.discretization import Backend
from dacore.core.domain import Domain
from dacore.core.estimator import Estimator
from dacore.core.mesh import Mesh
from dacore.core.model import AffineModel, ForwardModel, Physics
from dacore.core.observation import Functionals, ObservationOperator
from dacore.core.parameters import ParameterSpace
from dacore.core.quantity import QuantityOfInterest
from dacore.core.space import StateSpace
from dacore.core.timegrid import TimeGrid
from dacore.dynamics.march import MarchedModel
from dacore.dynamics.newmark import Newmark
from dacore.errors import MissingDependencyError, PluginError, SceneError, ShapeError, UnstableError
from dacore.io.scene import PluginTable, Scene, convert
from dacore.plugins.registry import Registry, load
from dacore.plugins.settings import build


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
    """

    scene: Scene
    where: str
    base: Path

    @cached_property
    def registry(self) -> Registry:
        """What is installed."""
        return load()

    def _make(self, kind: str, table: PluginTable, key: str) -> Any:
        return build(self._class(kind, table.kind, key), table.settings, f"{self.where}: {key}", self.base)

    def _class(self, kind: str, name: str, key: str) -> type[Any]:
        try:
            return self.registry.get(kind, name)
        except MissingDependencyError:
            raise
        except PluginError as error:
            raise SceneError(f"{self.where}: {key}: {error}") from error

    @cached_property
    def domain(self) -> Domain:
        """The domain's settings."""
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
        made: Backend = self._class("backend", self.scene.discretization.backend, "discretization.backend")()
        return made

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
    def scheme(self) -> Newmark:
        """The time scheme; SceneError outside its stability region."""
        time = self.scene.time
        try:
            return Newmark(time.beta, time.gamma, time.first_order)
        except UnstableError as error:
            raise SceneError(f"{self.where}: time: {error}") from error

    def check(self) -> None:
        """Make every settings object, so that a mistake anywhere in the scene shows before any work."""
        _ = (self.domain, self.physics, self.backend, self.observations, self.quantities, self.estimators, self.scheme)

    def model(self, mesh: Mesh) -> ForwardModel:
        """Build the forward model on a mesh; an affine model is marched as ``[time]`` says."""
        built = self.physics.build(lambda fields: self.backend.discretize(mesh, fields))
        if isinstance(built, AffineModel):
            return self.march(built, 1)
        if "time" in self.scene.model_fields_set:
            raise SceneError(f"{self.where}: time: {self.scene.physics.kind} steps by itself; remove the [time] table")
        return built

    def march(self, model: AffineModel, refinement: int) -> MarchedModel:
        """March an affine model with each step divided by `refinement`."""
        time = self.scene.time
        grid = TimeGrid(time.step / refinement, time.steps * refinement, time.spin_up * refinement)
        return MarchedModel(model, grid, self.scheme, time.start, time.solver, time.tolerance)

    def parameters(self, model: ForwardModel) -> ParameterSpace:
        """The model's parameters with the scene's ranges."""
        ranges = {}
        for name, value in self.scene.parameters.items():
            where = f"{self.where}: parameters.{name}"
            try:
                ranges[name] = convert(value, model.parameters[name].unit, where)
            except ShapeError as error:
                raise SceneError(f"{self.where}: {error}") from error
        try:
            return model.parameters.restrict(ranges)
        except ShapeError as error:
            raise SceneError(f"{self.where}: {error}") from error

    def functionals(self, space: StateSpace) -> Functionals:
        """Everything that is measured, observation after observation."""
        parts = []
        for operator in self.observations.values():
            operator.check(space)
            parts.append(operator.functionals(space))
        return join(parts)

    def version_of(self, key: str) -> str:
        """Version of the distribution that brings the scene's domain or physics."""
        kind = {"domain": "domain", "physics": "model"}[key]
        name = getattr(self.scene, key).kind
        found = [row.version for row in self.registry.table() if row.kind == kind and row.name == name]
        return found[0] if found else "unknown"

    def versions(self) -> dict[str, str]:
        """Versions of dacore, its numerical libraries and every installed plugin distribution."""
        names = {"dacore", "numpy", "scipy", "h5py"} | {row.distribution for row in self.registry.table()}
        out = {}
        for name in sorted(names):
            try:
                out[name] = version(name)
            except PackageNotFoundError:
                out[name] = __version__ if name == "dacore" else "unknown"
        return out


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
