"""Suites: named checks bound to a subject, run by pytest or by themselves."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any, NoReturn

from dacore.algebra.threads import one_blas_thread
from dacore.errors import MissingDependencyError, PluginError

# What dacore says to somebody who does not run these checks at the moment.
_ADVICE = "; run dacore.testing's checks on the backend"


class ContractError(AssertionError):
    """A promise that is not kept; the message says which, how far off, and the likely cause if it can be told."""


@dataclass(frozen=True, eq=False)
class Check:
    """A contract and what proves it.

    Parameters
    ----------
    function : callable
        Takes a subject; raises `ContractError`, or whatever the subject raises. Its docstring states the contract.
    """

    function: Callable[[Any], None]

    @property
    def name(self) -> str:
        """Name of the function."""
        return self.function.__name__

    @property
    def contract(self) -> str:
        """First line of the docstring."""
        return (self.function.__doc__ or "").strip().splitlines()[0]


@dataclass(frozen=True, eq=False)
class Case:
    """One check bound to one subject. Calling it runs it.

    Parameters
    ----------
    check : Check
    subject : object
    label : str
        What distinguishes the subject from others of the suite; empty if it is the only one.
    """

    check: Check
    subject: Any
    label: str = ""

    @property
    def name(self) -> str:
        """Name of the check and of the subject, unique in a suite."""
        return f"{self.check.name}-{self.label}" if self.label else self.check.name

    def __call__(self) -> None:
        """Run the check; raises if the contract is broken."""
        # The matrices are tiny: threads of BLAS only wait for each other on a busy machine.
        with one_blas_thread():
            try:
                self.check.function(self.subject)
            except PluginError as error:
                if not str(error).endswith(_ADVICE):
                    raise
                raise ContractError(str(error).removesuffix(_ADVICE)) from error


@dataclass(frozen=True, eq=False)
class Failure:
    """A case that failed.

    Parameters
    ----------
    case : Case
    error : Exception
        A `ContractError`, or what the subject raised.
    stopped : tuple of str
        Names of cases that were stopped by the same error, raised at the same place: they are not failures of their
        own.
    """

    case: Case
    error: Exception
    stopped: tuple[str, ...] = ()

    def __str__(self) -> str:
        more = f"; not run, since the same error stops them: {', '.join(self.stopped)}" if self.stopped else ""
        return f"{self.case.name}: {type(self.error).__name__}: {self.error}{more}"


@dataclass(frozen=True, eq=False)
class Suite:
    """Checks bound to what they check. Making one runs nothing and needs no library of the plugin.

    Parameters
    ----------
    cases : tuple of Case
    """

    cases: tuple[Case, ...]

    def __iter__(self) -> Iterator[Case]:
        return iter(self.cases)

    def __len__(self) -> int:
        return len(self.cases)

    def __contains__(self, case: object) -> bool:
        return case in self.cases

    def __add__(self, other: "Suite") -> "Suite":
        """Both suites in one; names must still be different."""
        return Suite((*self.cases, *other.cases))

    def as_test(self) -> Callable[..., None]:
        """One parametrised test function for pytest: ``test_backend = backend_suite(MyBackend()).as_test()``.

        Raises
        ------
        MissingDependencyError
            If pytest is not installed.

        Notes
        -----
        A case that is stopped by an error that another case has failed with before is skipped, and says so: one
        mistake is one failure.
        """
        try:
            import pytest
        except ImportError as error:
            raise MissingDependencyError(
                "pytest is not installed; install it with: pip install 'dacore[testing]', "
                "or run the suite with dacore.testing.run"
            ) from error

        failed: dict[tuple[object, ...], str] = {}

        @pytest.mark.parametrize("case", [pytest.param(case, id=case.name) for case in self.cases])
        def test(case: Case) -> None:
            __tracebackhide__ = True
            try:
                case()
            except Exception as error:
                first = failed.setdefault(_origin(error), case.name)
                if first != case.name:
                    pytest.skip(f"not run: {first} failed with the same error, {type(error).__name__}: {error}")
                raise

        return test


def run(suite: Iterable[Case]) -> list[Failure]:
    """Run every case without pytest.

    Parameters
    ----------
    suite : Suite or iterable of Case

    Returns
    -------
    list of Failure
        Empty if every contract is kept. Cases that the same error stops are one failure.
    """
    failures: dict[tuple[object, ...], Failure] = {}
    for case in suite:
        try:
            case()
        except Exception as error:  # noqa: BLE001  a plugin may raise anything; all of it is a failure
            first = failures.setdefault(key := _origin(error), Failure(case, error))
            if first.case is not case:
                failures[key] = replace(first, stopped=(*first.stopped, case.name))
    return list(failures.values())


def _origin(error: BaseException) -> tuple[object, ...]:
    """Kind, message and place of what was raised first: equal for one mistake that several checks run into."""
    while error.__cause__ is not None:
        error = error.__cause__
    place = error.__traceback__
    while place is not None and place.tb_next is not None:
        place = place.tb_next
    where = () if place is None else (place.tb_frame.f_code.co_filename, place.tb_lineno)
    return (type(error), str(error), *where)


def fail(message: str) -> NoReturn:
    """Raise a `ContractError`."""
    __tracebackhide__ = True
    raise ContractError(message)


def require(kept: bool, message: str) -> None:
    """Raise a `ContractError` with this message unless the promise is kept."""
    __tracebackhide__ = True
    if not kept:
        raise ContractError(message)


def bind(functions: Iterable[Callable[[Any], None]], subject: Any, label: str = "") -> tuple[Case, ...]:
    """Bind check functions to one subject."""
    return tuple(Case(Check(function), subject, label) for function in functions)


def expect_kind(suite: str, given: object, kind: type[Any]) -> None:
    """Refuse what a suite is not for, when it is made.

    Raises
    ------
    PluginError
        If `given` is not an instance of `kind`.
    """
    if isinstance(given, kind):
        return
    if isinstance(given, type):
        what, then = f"the class {given.__name__}", f"make it first: {suite}({given.__name__}(...))"
    else:
        what, then = f"a {type(given).__name__}", f"derive its class from {kind.__module__}.{kind.__name__}"
    raise PluginError(f"{suite}: got {what}, expected an instance of a {kind.__name__}; {then}")


def expect_maker(suite: str, name: str, given: object) -> None:
    """Refuse a space or a mesh in place of a function that makes it, when the suite is made.

    Raises
    ------
    PluginError
        If `given` cannot be called.
    """
    if not callable(given):
        raise PluginError(
            f"{suite}: {name} is a {type(given).__name__}, expected a function without arguments that makes it; "
            f"write lambda: ..., so that nothing is made before the first test"
        )
