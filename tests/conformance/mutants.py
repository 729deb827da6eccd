"""Mutants: subjects that are wrong in one way each, and the checks that must find them."""

import re
from collections.abc import Callable
from dataclasses import dataclass

from dacore.testing import Suite, run


@dataclass(frozen=True)
class Mutant:
    """A broken subject.

    Parameters
    ----------
    name : str
    suite : callable
        Makes the suite of the subject.
    checks : tuple of str
        Every one of these must find it.
    says : str
        A pattern of what one of them must say.
    """

    name: str
    suite: Callable[[], Suite]
    checks: tuple[str, ...]
    says: str

    def prove(self) -> None:
        """Run the checks that must find it."""
        suite = self.suite()
        unknown = set(self.checks) - {case.check.name for case in suite}
        assert not unknown, f"no check is called {unknown}"
        # One by one: run would tell of an error that several checks meet once.
        found = [failure for case in suite if case.check.name in self.checks for failure in run([case])]
        assert {failure.case.check.name for failure in found} == set(self.checks)
        text = "\n".join(map(str, found))
        assert re.search(self.says, text), text


def needed(mutants: list[Mutant]) -> set[str]:
    """Names of the checks that the mutants prove able to fail."""
    return {check for mutant in mutants for check in mutant.checks}
