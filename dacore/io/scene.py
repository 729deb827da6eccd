"""Scene files: TOML in, validated values out. Numbers, names and tables only; nothing is evaluated.

The tables with a ``kind`` (domain, physics, solver, observation, quantity, estimator) belong to plugins:
here they are read as they stand, and the plugin's own settings class checks them when it is used.
"""

import difflib
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from dacore.core.display import Card, Displayed
from dacore.errors import SceneError
from dacore.io.scene_card import scene_card
from dacore.io.units import factor

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]*$")]


class Table(BaseModel):
    """A table with fixed keys."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class PluginTable(BaseModel):
    """A table whose keys a plugin knows; ``kind`` names the plugin."""

    model_config = ConfigDict(extra="allow", frozen=True, strict=True)

    kind: str
    title: str = ""

    @property
    def settings(self) -> dict[str, Any]:
        """The plugin's own keys."""
        return dict(self.model_extra or {})


class SolverTable(PluginTable):
    """``[solver]``: what solves the time steps; other keys belong to the solver."""

    kind: str = "auto"
    tolerance: Annotated[float, Field(gt=0, lt=1e-2)] = 1e-10


class Discretization(Table):
    """``[discretization]``: which finite element library."""

    backend: str = "skfem"


class Time(Table):
    """``[time]``: the recorded steps [s], how they are marched, the scheme and the start."""

    step: Positive = 5e-4
    steps: Annotated[int, Field(ge=1)] = 40
    spin_up: Annotated[int, Field(ge=0)] = 0
    substeps: Annotated[int, Field(ge=1, le=10_000)] = 1
    graded: Annotated[int, Field(ge=0, le=30)] = 0
    start: Literal["zero", "steady"] = "zero"
    scheme: Literal["newmark", "generalized_alpha"] = "newmark"
    beta: float = 0.5
    gamma: float = 1.0
    first_order: Literal["backward_euler", "newmark"] = "backward_euler"
    rho_inf: float = 0.5

    @model_validator(mode="after")
    def _fitting(self) -> "Time":
        """Refuse numbers of a scheme that is not the one chosen."""
        for scheme, keys in _SCHEME_KEYS.items():
            strange = [key for key in keys if key in self.model_fields_set]
            if strange and scheme != self.scheme:
                raise ValueError(
                    f"{', '.join(strange)}: of scheme = {scheme!r}, but the scheme is {self.scheme!r}; "
                    "remove this or change the scheme"
                )
        return self


_SCHEME_KEYS = {"newmark": ("beta", "gamma", "first_order"), "generalized_alpha": ("rho_inf",)}


class Range(Table):
    """A parameter's range, a fixed value, or both in a unit of one's own."""

    low: float
    high: float
    unit: str | None = None


class Training(Table):
    """``[training]``: how many trajectories, drawn how, compressed how far."""

    samples: Annotated[int, Field(ge=2)] = 64
    sampling: Literal["uniform", "latin_hypercube", "sobol"] = "uniform"
    seed: Annotated[int, Field(ge=0)] = 1
    tolerance: Annotated[float, Field(gt=0, lt=1)] = 1e-6
    product: Literal["l2", "h1"] = "l2"
    memory: Positive | None = None
    method: Literal["full", "reduced"] = "full"
    reduction: Annotated[float, Field(gt=0, lt=1)] = 1e-4
    most: Annotated[int, Field(ge=8)] = 64

    @model_validator(mode="after")
    def _fitting(self) -> "Training":
        """Refuse settings of reduced training where every sample is solved in full."""
        strange = [key for key in ("reduction", "most") if key in self.model_fields_set]
        if strange and self.method == "full":
            raise ValueError(f"{', '.join(strange)}: of method = 'reduced', but the method is 'full'")
        return self


class Noise(Table):
    """``[noise]``: levels Ξ; σ = Ξ · max |ℓ_i(u(t))| of each test case (docs/method.md: Noise)."""

    levels: Annotated[list[Annotated[float, Field(ge=0, lt=10)]], Field(min_length=1)] = [0.0]
    seed: Annotated[int, Field(ge=0)] = 3

    @field_validator("levels")
    @classmethod
    def _distinct(cls, levels: list[float]) -> list[float]:
        if len(set(levels)) != len(levels):
            raise ValueError("expected each level once")
        return levels


class Observed(Table):
    """``[observed]``: what is seen of a cycle.

    Which recorded steps are measured: so many phases, or steps counted from 1; all without. Fields in `less_mean`
    are states less their mean over the recorded steps, which is what harmonic imaging sees of them.
    """

    phases: Annotated[int, Field(ge=1)] | None = None
    less_mean: list[str] = []
    steps: Annotated[list[Annotated[int, Field(ge=1)]], Field(min_length=1)] | None = None

    @model_validator(mode="after")
    def _one(self) -> "Observed":
        if self.phases is not None and self.steps is not None:
            raise ValueError("got both phases and steps, expected one of them")
        return self


class Contrast(Table):
    """An error of a field less a constant that would flatter it: {field = "p", minus = "p_csf"}."""

    field: str
    minus: str


class Validation(Table):
    """``[validation]``: unseen cases and what is measured on them."""

    cases: Annotated[int, Field(ge=1)] = 18
    seed: Annotated[int, Field(ge=0)] = 2
    contrasts: list[Contrast] = []
    refine_time: Annotated[int, Field(ge=0, le=64)] = 0


class Published(Table):
    """A figure somebody published, to stand beside the same figure of every estimator: an error or a quantity's rms."""

    what: str
    value: str
    error: str | None = None
    quantity: str | None = None
    noise: float = 0.0
    statistic: Literal["mean", "worst"] = "mean"

    @model_validator(mode="after")
    def _one(self) -> "Published":
        if (self.error is None) == (self.quantity is None):
            raise ValueError("expected either error or quantity, the one that the figure is of")
        return self


class Views(Table):
    """``[report]``: whether states are shown, where they are cut [cm] and when [s], whose axes, what was published."""

    states: bool = True
    anatomical: bool = False
    plane: Literal["x", "y", "z"] = "x"
    position: float | None = None
    measured_time: Positive | None = None
    worst_time: Positive | None = None
    published: list[Published] = []


class Scene(Displayed, Table):
    """A whole scene.

    Attributes
    ----------
    title : str
    plugins : list of str
        Python files with hooks, for this scene alone; paths start from the scene's folder.
    domain, physics : PluginTable
    discretization, time, training, observed, noise, validation, report : Table
    solver : SolverTable
    parameters : mapping of str to Range
        Ranges that replace the model's own.
    observation, quantity, estimator, study : mapping of str to PluginTable
        By a name of your choice.
    """

    title: str
    plugins: list[str] = []
    domain: PluginTable | None = None
    physics: PluginTable
    discretization: Discretization = Discretization()
    parameters: Mapping[str, Range] = {}
    time: Time = Time()
    solver: SolverTable = SolverTable()
    training: Training = Training()
    observation: Annotated[Mapping[Name, PluginTable], Field(min_length=1)]
    quantity: Mapping[Name, PluginTable] = {}
    observed: Observed = Observed()
    noise: Noise = Noise()
    estimator: Annotated[Mapping[Name, PluginTable], Field(min_length=1)]
    validation: Validation = Validation()
    study: Mapping[Name, PluginTable] = {}
    report: Views = Views()

    def _card(self) -> Card:
        return scene_card(self)

    __str__ = Displayed.__repr__

    @model_validator(mode="after")
    def _asked(self) -> "Scene":
        """Refuse a scene that asks for nothing."""
        for figure in self.report.published:
            if figure.quantity is not None and figure.quantity not in self.quantity:
                raise ValueError(f"report.published: {figure.quantity!r} is no [quantity.NAME] of the scene")
            if figure.noise not in self.noise.levels:
                raise ValueError(f"report.published: got noise {figure.noise}, expected one of {self.noise.levels}")
        if not self.report.states and not self.quantity:
            raise ValueError(
                "report.states: got false in a scene without a quantity, so that nothing is asked for; add a "
                "[quantity.NAME] or leave report.states out"
            )
        return self

    @field_validator("parameters", mode="before")
    @classmethod
    def _ranges(cls, table: Any) -> Any:
        """Accept ``E = 5e5`` and ``E = [1e5, 1e6]`` besides ``E = {low, high, unit}``."""
        if not isinstance(table, Mapping):
            return table
        out: dict[str, Any] = {}
        for name, value in table.items():
            if isinstance(value, bool):
                raise ValueError(f"{name}: got {value}, expected a number, [low, high] or {{low, high, unit}}")
            if isinstance(value, int | float):
                out[name] = {"low": value, "high": value}
            elif isinstance(value, Sequence) and not isinstance(value, str):
                if len(value) != 2:
                    raise ValueError(f"{name}: got {len(value)} values, expected [low, high]")
                out[name] = {"low": value[0], "high": value[1]}
            else:
                out[name] = value
        return out


def read_scene(path: Path, changes: Sequence[str] = ()) -> Scene:
    """Read and check a scene.

    Parameters
    ----------
    path : Path
    changes : sequence of str
        ``"training.samples=16"``: keys set to TOML values before checking.

    Raises
    ------
    SceneError
        Names the file, the key, what was given and what is allowed.
    """
    return validate(read_table(path, changes), str(path))


def read_table(path: Path, changes: Sequence[str] = ()) -> dict[str, Any]:
    """Read a scene's TOML with changes applied, unchecked."""
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError as error:
        raise SceneError(f"{path}: no such file; expected a scene in TOML, see examples/") from error
    except (OSError, UnicodeDecodeError) as error:
        raise SceneError(f"{path}: cannot be read ({error}); expected a scene in TOML") from error
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise SceneError(f"{path}: not valid TOML: {error}") from error
    for change in changes:
        _apply_change(table, change)
    return table


def plugin_files(path: Path) -> list[str]:
    """Read which plugin files a scene names, whatever else is in it; SceneError if they are no list of names."""
    found = read_table(path).get("plugins", [])
    if not isinstance(found, list) or not all(isinstance(each, str) for each in found):
        raise SceneError(f"{path}: plugins: expected a list of file names in quotes")
    return found


def validate(table: Mapping[str, Any], where: str = "scene") -> Scene:
    """Check a table and return the scene."""
    try:
        return Scene.model_validate(table)
    except ValidationError as error:
        raise SceneError(f"{where}: " + "; ".join(_explain(item) for item in error.errors()[:4])) from error


def _apply_change(table: dict[str, Any], change: str) -> None:
    key, equals, text = change.partition("=")
    if not equals or not key.strip():
        raise SceneError(f"--set {change}: expected key=value, for example training.samples=16")
    try:
        value = tomllib.loads(f"value = {text.strip()}")["value"]
    except tomllib.TOMLDecodeError:
        value = text.strip()
    apply(table, key.strip(), value)


def apply(table: dict[str, Any], key: str, value: Any) -> None:
    """Set one dotted key of an unchecked scene; SceneError if there is no such table."""
    at: Any = table
    *path, last = key.split(".")
    for part in path:
        at = at.setdefault(part, {})
        if not isinstance(at, dict):
            raise SceneError(f"{key}: {part} is not a table")
    at[last] = value


def _explain(item: Any) -> str:
    location = [str(part) for part in item["loc"]]
    key = ".".join(location)
    given = item.get("input")
    if item["type"] == "extra_forbidden":
        known = _known_keys(location[:-1])
        close = difflib.get_close_matches(location[-1], known, n=1)
        hint = f"did you mean {close[0]!r}?" if close else f"allowed are {', '.join(known)}"
        return f"{key}: unknown key; {hint}"
    if item["type"] == "missing":
        return f"{key}: missing; expected a value" if "." in key else f"[{key}]: missing; every scene needs it"
    message = item["msg"].removeprefix("Value error, ").replace("Input should be", "expected")
    shown = "" if isinstance(given, Mapping | list) else f"got {given!r}, "
    return f"{key}: {shown}{message}"


def _known_keys(path: Sequence[str]) -> list[str]:
    model: Any = Scene
    for part in path:
        field = model.model_fields.get(part) if isinstance(model, type) and issubclass(model, BaseModel) else None
        model = field.annotation if field is not None else None
    if isinstance(model, type) and issubclass(model, BaseModel):
        return list(model.model_fields)
    return list(Contrast.model_fields) if path and path[-1].isdigit() else list(Range.model_fields)


def convert(value: Range, unit: str, where: str) -> tuple[float, float]:
    """Express a range in the model's unit.

    Raises
    ------
    SceneError
        If the unit is unknown or measures something else.
    """
    if value.unit is None or value.unit == unit:
        return value.low, value.high
    scale = factor(value.unit, unit, where)
    return value.low * scale, value.high * scale
