"""Suites: named checks bound to a subject, run by pytest or by themselves."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any, NoReturn

from dacore.algebra.threads import one_blas_thread
from dacore.errors import MissingDependencyError


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
            self.check.function(self.subject)


@dataclass(frozen=True, eq=False)
class Failure:
    """A case that failed.

    Parameters
    ----------
    case : Case
    error : Exception
        A `ContractError`, or what the subject raised.
    """

    case: Case
    error: Exception

    def __str__(self) -> str:
        return f"{self.case.name}: {type(self.error).__name__}: {self.error}"


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
        """
        try:
            import pytest
        except ImportError as error:
            raise MissingDependencyError(
                "pytest is not installed; install it with: pip install 'dacore[testing]', "
                "or run the suite with dacore.testing.run"
            ) from error

        @pytest.mark.parametrize("case", [pytest.param(case, id=case.name) for case in self.cases])
        def test(case: Case) -> None:
            __tracebackhide__ = True
            case()

        return test


def run(suite: Iterable[Case]) -> list[Failure]:
    """Run every case without pytest.

    Parameters
    ----------
    suite : Suite or iterable of Case

    Returns
    -------
    list of Failure
        Empty if every contract is kept.
    """
    failures = []
    for case in suite:
        try:
            case()
        except Exception as error:  # noqa: BLE001  a plugin may raise anything; all of it is a failure
            failures.append(Failure(case, error))
    return failures


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
