"""What a study is: settings, the results it asks for, what it finds, and how that is shown."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar

from dacore.core.arrays import Array
from dacore.core.display import Displayed
from dacore.core.parameters import ParameterSpace
from dacore.io.scene import Scene
from dacore.workflow.report_parts import Table
from dacore.workflow.studies.bench import Bench

if TYPE_CHECKING:  # drawing needs matplotlib; stages do not
    from dacore.workflow.canvas import Canvas
    from dacore.workflow.drawn import Drawn

# What a run of a scene asks for in any case.
VALIDATED = ("validation",)


@dataclass(frozen=True)
class Variant:
    """The scene with some keys changed, for a study that needs another model, other data or other settings.

    Parameters
    ----------
    changes : mapping of str to object
        Dotted keys of the scene and their values: ``{"physics.skempton": 0.9}``.
    needs : tuple of str
        Stages of it that the study asks for.
    """

    changes: Mapping[str, Any]
    needs: tuple[str, ...] = VALIDATED


@dataclass(frozen=True, eq=False, repr=False)
class Findings(Displayed):
    """What a study found, in a form that is kept on disk.

    Parameters
    ----------
    arrays : mapping of str to array
    facts : mapping of str to JSON values
    """

    arrays: Mapping[str, Array]
    facts: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Score:
    """One number for the table of all studies: how an estimator did in a setting.

    Parameters
    ----------
    setting : str
        "three slices, 10% noise".
    estimator : str
        Name in the scene, or "prior".
    label : str
        Name of an error or a quantity.
    value : float
        Mean relative error, or root mean square error of a quantity.
    """

    setting: str
    estimator: str
    label: str
    value: float


@dataclass(frozen=True)
class Exhibit:
    """How findings are shown: a section of the report.

    Parameters
    ----------
    text : str
        Paragraphs parted by blank lines.
    parts : sequence of Table or Drawn
    scores : sequence of Score
    """

    text: str
    parts: "Sequence[Table | Drawn]"
    scores: Sequence[Score] = ()


class Study(ABC):
    """Frozen settings of a study; a plugin class of the hook ``dacore_studies``.

    Attributes
    ----------
    heading : str
        Title in the report where the scene gives none.
    """

    heading: ClassVar[str]

    def needs(self, scene: Scene) -> tuple[str, ...]:
        """Stages of the scene itself whose results `run` asks for."""
        return VALIDATED

    def variants(self, scene: Scene) -> Mapping[str, Variant]:
        """Variants of the scene, by a short name; what they have in common with it is computed once."""
        return {}

    def check(self, parameters: ParameterSpace) -> None:  # noqa: B027 (most studies take any)
        """Raise ShapeError for settings that cannot work with a scene's parameters, before anything is trained."""

    @abstractmethod
    def run(self, bench: Bench) -> Findings:
        """Find out. Everything random comes from seeds in the settings, and no state is changed."""

    @abstractmethod
    def show(self, found: Findings, canvas: "Canvas") -> Exhibit:
        """Show what was found."""
