"""What a case can work with: the scene's space, functionals, model and a small training set, each made once."""

import logging
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from dacore.core.arrays import Array
from dacore.core.background import Background
from dacore.core.model import AffineModel
from dacore.core.observation import Functionals
from dacore.core.space import StateSpace
from dacore.dynamics.generalized_alpha import GeneralizedAlpha
from dacore.dynamics.newmark import Newmark
from dacore.errors import DacoreError, PluginError
from dacore.workflow.board import ProgressBoard
from dacore.workflow.build import Builder
from dacore.workflow.open import open_scene
from dacore.workflow.session import Session
from dacore.workflow.stress.case import Inapplicable, Refusal
from dacore.workflow.stress.stepping import Plain

T = TypeVar("T")

SAMPLES, STEPS, CASES = 12, 6, 3


@dataclass(eq=False)
class Context:
    """A scene under stress.

    Parameters
    ----------
    session : Session
        Of the scene with a small training set.
    heard : list of str
        What dacore logged or warned of while it was asked in the case that runs.
    """

    session: Session
    heard: list[str] = field(default_factory=list)

    def begin(self) -> None:
        """Forget what was heard: a new case begins."""
        self.heard.clear()

    def ask(self, call: Callable[[], T]) -> T:
        """Call what is under stress; an error of dacore becomes a refusal, warnings are kept.

        Errors of dacore outside of this are faults of the case, not answers.
        """
        root = logging.getLogger()
        before, root.handlers = root.handlers, [_Listener(self.heard)]  # heard, not printed
        try:
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always")
                try:
                    return call()
                except DacoreError as error:
                    raise Refusal(error) from error
                finally:
                    # Those of numpy are no message to a user.
                    self.heard += [str(w.message) for w in caught if issubclass(w.category, UserWarning)]
        finally:
            root.handlers = before

    @property
    def builder(self) -> Builder:
        """What makes the scene's objects."""
        return self.session.builder

    @cached_property
    def model(self) -> AffineModel:
        """The scene's affine model."""
        return self.affine(self.builder.physics)

    def affine(self, physics: Any, mesh: Any = None) -> AffineModel:
        """Assemble a physics on the scene's mesh or another."""
        own = mesh if mesh is not None else self.mesh
        built = physics.build(lambda asked: self.builder.backend.discretize(own, asked))
        if not isinstance(built, AffineModel):
            raise Inapplicable("the scene's model is not affine: it solves by itself")
        return built

    @property
    def mesh(self) -> Any:
        """The scene's mesh."""
        if self.session.scene.domain is None:
            raise Inapplicable("the scene has no mesh")
        return self.session.mesh

    def physics(self, **settings: Any) -> Any:
        """Return the scene's physics with other settings; Inapplicable if it has no such setting."""
        own = self.builder.physics
        known = {each.name for each in fields(own)}  # type: ignore[arg-type]
        if missing := [name for name in settings if name not in known]:
            raise Inapplicable(f"the physics has no setting {', '.join(missing)}")
        return replace(own, **settings)  # type: ignore[type-var]

    @cached_property
    def space(self) -> StateSpace:
        """The scene's state space."""
        return self.session.model.space

    @cached_property
    def scheme(self) -> Plain:
        """The scene's time scheme; Inapplicable if there is no reference for it."""
        scheme = self.builder.scheme
        if not isinstance(scheme, Newmark | GeneralizedAlpha):
            raise Inapplicable(f"there is no reference for {scheme.label}")
        return scheme

    @property
    def step(self) -> float:
        """The scene's time step [s]."""
        return self.session.scene.time.step

    def parameters(self, **changes: float) -> dict[str, float]:
        """Every parameter in the middle of the scene's range, some changed; Inapplicable without them."""
        space = self.session.parameters
        if missing := [name for name in changes if name not in space.names]:
            raise Inapplicable(f"the model has no parameter {', '.join(missing)}")
        middle = space.middle
        return middle | changes

    @cached_property
    def background(self) -> Background:
        """Training set of a few trajectories."""
        return self.session.background

    @cached_property
    def functionals(self) -> Functionals:
        """What the scene measures."""
        return self.session.functionals

    @cached_property
    def truth(self) -> Array:
        """States (n_dofs, t, cases) that the training has not seen."""
        return np.stack([each.states for each in self.session.truth], axis=2)

    @cached_property
    def data(self) -> Array:
        """Exact data (m, t, cases) of `truth`."""
        return self.functionals(self.truth)

    def plugin(self, kind: str, name: str) -> Any:
        """Class of a plugin; Inapplicable if it is not installed."""
        try:
            return self.builder.registry.get(kind, name)
        except PluginError as error:
            raise Inapplicable(f"the {kind} {name!r} is not installed") from error

    def rng(self, seed: int = 0) -> np.random.Generator:
        """Random numbers, the same in every run."""
        return np.random.default_rng(seed)

    def norms(self, states: Array) -> Mapping[str, float]:
        """Root of the summed squared norms of states (n_dofs, ...), for each field."""
        out = {}
        for each in self.space.fields:
            block = states[self.space.layout.block(each.name)].reshape(-1, states[0].size).astype(np.float64)
            size = float(np.abs(block).max(initial=0.0)) or 1.0
            product = self.space.field_product(each.name)
            out[each.name] = size * float(np.sqrt(np.einsum("ij,ij->", block / size, product @ (block / size))))
        return out

    def difference(self, found: Array, reference: Any) -> float:
        """Largest relative difference of a field, over all columns together; infinite for NaN."""
        if not np.isfinite(found).all():
            return float("inf")
        gaps, sizes = self.norms(np.asarray(found - reference)), self.norms(np.asarray(reference))
        return max(gap / sizes[name] if sizes[name] else (np.inf if gap else 0.0) for name, gap in gaps.items())


class _Listener(logging.Handler):
    """Keeps what dacore logs as a warning or worse."""

    def __init__(self, heard: list[str]) -> None:
        super().__init__(logging.WARNING)
        self.heard = heard

    def emit(self, record: logging.LogRecord) -> None:
        if record.name.startswith("dacore"):
            self.heard.append(record.getMessage())


def open_context(
    path: Path,
    changes: tuple[str, ...] = (),
    cache: Path | None = None,
    workers: int = 1,
    board: ProgressBoard | None = None,
) -> Context:
    """Open a scene with a training set of at most 12 samples, 6 steps and 3 unseen cases."""
    scene = open_scene(path, changes, cache, 1).scene
    small = [
        f"training.samples={min(scene.training.samples, SAMPLES)}",
        f"validation.cases={min(scene.validation.cases, CASES)}",
    ]
    if scene.domain is not None or "time" in scene.model_fields_set:  # or it may step by itself
        small.append(f"time.steps={min(scene.time.steps, STEPS)}")
    return Context(open_scene(path, (*changes, *small), cache, workers, board))
