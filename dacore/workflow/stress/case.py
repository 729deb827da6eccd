"""A case of the catalogue, what it finds, and how that is judged."""

import re
import time
import traceback
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from dacore.errors import DacoreError, MissingDependencyError

if TYPE_CHECKING:
    from dacore.workflow.stress.context import Context

Verdict = Literal["stable", "degraded", "refused", "wrong", "crashed", "not applicable"]
Theme = Literal["physics", "discretisation", "solvers", "observations", "data", "spaces", "noise", "training"]

FAILURES: tuple[Verdict, ...] = ("wrong", "crashed")

# Whatever the conditioning, an answer that is further off than this is not called stable.
CEILING = 1e-4

# How an error of dacore says what to do: what was expected, or an advice after a semicolon.
_ADVICE = re.compile(r"\bexpected\b|; \w+")


@dataclass(frozen=True)
class Outcome:
    """What a case found when dacore answered.

    Parameters
    ----------
    error : float
        Difference from the reference, relative to it or to a scale that the case states.
    bound : float
        Up to where the error is what conditioning, or the nominal case, explains.
    told : str
        How the user learns of more: an uncertainty that covers it, a small β. What dacore logs and
        warns is heard besides.
    note : str
        A number or two that explain.
    """

    error: float
    bound: float
    told: str = ""
    note: str = ""


@dataclass(frozen=True)
class Case:
    """One hard case.

    Parameters
    ----------
    name : str
    theme : str
    stressed : str
        What is asked for.
    hard : str
        Why it is hard.
    run : callable
        Takes the context, asks dacore through `Context.ask`, and compares with a reference.
    """

    name: str
    theme: Theme
    stressed: str
    hard: str
    run: "Callable[[Context], Outcome]"


@dataclass(frozen=True)
class Judged:
    """A case with its verdict.

    Parameters
    ----------
    case : Case
    verdict : str
    error, bound : float
        NaN where dacore gave no answer.
    said : str
        The message of a refusal, how the user is told of an error, or what went wrong.
    note : str
    seconds : float
    """

    case: Case
    verdict: Verdict
    error: float
    bound: float
    said: str
    note: str
    seconds: float

    @property
    def failed(self) -> bool:
        """Whether the user would be misled, or left with a traceback."""
        return self.verdict in FAILURES


class Refusal(Exception):  # noqa: N818 (it is an answer, not an error of the catalogue)
    """dacore refused what a case asked."""

    def __init__(self, error: DacoreError) -> None:
        super().__init__(str(error))
        self.error = error


class Inapplicable(Exception):  # noqa: N818
    """The scene has nothing that the case could be tried on."""


def conditioned(condition: float, precision: float, factor: float = 1.0) -> float:
    """Error that a condition number explains, at most `CEILING`."""
    return float(min(factor * condition * precision, CEILING))


def judge(case: Case, context: "Context") -> Judged:
    """Run a case and compute its verdict.

    Stable: the error is within its bound. Degraded: it is not, but finite, and the user was told.
    Refused: dacore raised one of its own errors, in one line that says what to do. Wrong: an error that
    nobody mentions. Crashed: any other exception.
    """
    started = time.perf_counter()
    context.begin()
    verdict: Verdict
    error = bound = float("nan")
    note = ""
    try:
        with warnings.catch_warnings():
            # References divide by zero now and then; what dacore warns of is heard in `Context.ask`.
            warnings.simplefilter("ignore", RuntimeWarning)
            outcome = case.run(context)
    except Refusal as refusal:
        said = str(refusal)
        verdict = "refused" if _advises(said) else "crashed"
        if verdict == "crashed":
            note = "the message is not one line that says what to do"
    except Inapplicable as reason:
        verdict, said = "not applicable", str(reason)
    except MissingDependencyError:
        raise
    except Exception as raised:  # noqa: BLE001 (whatever it is, the user would have got it)
        verdict, said = "crashed", f"{type(raised).__name__}: {raised}"
        note = _where(raised)
    else:
        error, bound, note = outcome.error, outcome.bound, outcome.note
        said = "; ".join(dict.fromkeys([*([outcome.told] if outcome.told else []), *context.heard]))
        if error <= bound:
            verdict = "stable"
        else:
            verdict = "degraded" if said and error < float("inf") else "wrong"
            said = said or "nothing was said"
    return Judged(case, verdict, error, bound, said, note, time.perf_counter() - started)


def _advises(message: str) -> bool:
    return "\n" not in message and len(message) < 500 and _ADVICE.search(message) is not None


def _where(raised: Exception) -> str:
    """File and line that an exception came from."""
    frames = traceback.extract_tb(raised.__traceback__)
    own = [frame for frame in frames if "dacore" in frame.filename] or frames
    return f"{own[-1].filename.rpartition('dacore/')[2]}:{own[-1].lineno}" if own else ""
