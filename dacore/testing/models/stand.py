"""What a check of a physics stands on: its settings, a mesh, and the model built there."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from dacore.core.discretization import Backend, Discretization
from dacore.core.fields import Field
from dacore.core.mesh import Mesh
from dacore.core.model import AffineModel, ForwardModel, Physics
from dacore.core.timegrid import TimeGrid
from dacore.dynamics.march import MarchedModel
from dacore.testing.spaces import ReferenceBackend
from dacore.testing.suite import fail


@dataclass(eq=False)
class Stand:
    """A physics on a mesh.

    Parameters
    ----------
    physics : Physics
    mesh : callable or None
        Makes the mesh when it is first needed; None for a physics that has none.
    grid : TimeGrid
        For an affine model, which is marched.
    backend : Backend
    affine_in : tuple of str
        Parameters in which the trajectory is claimed to be affine.
    """

    physics: Physics
    mesh: Callable[[], Mesh] | None = field(repr=False)
    grid: TimeGrid
    backend: Backend = field(default_factory=ReferenceBackend)
    affine_in: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """Name of the class, for messages."""
        return type(self.physics).__name__

    @cached_property
    def _mesh(self) -> Mesh | None:
        return None if self.mesh is None else self.mesh()

    def discretize(self, fields: Sequence[Field]) -> Discretization:
        """Put fields on the mesh, as a scene does."""
        if self._mesh is None:
            raise AssertionError(f"{self.name}: asks for a mesh, and the suite was given none")
        return self.backend.discretize(self._mesh, fields)

    def build(self) -> AffineModel | ForwardModel:
        """Build the model anew."""
        return self.physics.build(self.discretize)

    @cached_property
    def built(self) -> AffineModel | ForwardModel:
        """The model as it is built."""
        made: object = self.build()
        if not isinstance(made, AffineModel | ForwardModel):
            fail(f"{self.name}: builds a {type(made).__name__}, expected AffineModel or ForwardModel")
        return made

    @property
    def affine(self) -> AffineModel | None:
        """The affine model, if it is one."""
        return self.built if isinstance(self.built, AffineModel) else None

    @cached_property
    def forward(self) -> ForwardModel:
        """The model that solves: itself, or marched in time."""
        return self.marched(self.built)

    def marched(self, built: AffineModel | ForwardModel) -> ForwardModel:
        """March an affine model; any other is returned as it is."""
        return MarchedModel(built, self.grid) if isinstance(built, AffineModel) else built

    def at(self, share: float | dict[str, float] = 0.5) -> dict[str, float]:
        """Parameters at a share of every range, or at shares by name (the middle for others)."""
        out = {}
        for parameter in self.built.parameters.parameters:
            here = share.get(parameter.name, 0.5) if isinstance(share, dict) else share
            out[parameter.name] = float(parameter.quantile(np.array(here)))
        return out

    def some(self, count: int = 4) -> list[dict[str, float]]:
        """Parameters drawn from the ranges."""
        rng = np.random.default_rng(0)
        names = self.built.parameters.names
        return [self.at(dict(zip(names, rng.random(len(names)), strict=True))) for _ in range(count)]
