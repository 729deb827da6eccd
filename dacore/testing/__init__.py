"""Suites of checks for authors of plugins: every promise of the interfaces in `dacore.core`, proved.

A suite is a list of named checks bound to what they check. ``suite.as_test()`` makes one parametrised
pytest test of it; `run` runs it without pytest.
"""

from dacore.testing.backends import backend_suite
from dacore.testing.suite import Case, Check, ContractError, Failure, Suite, run

__all__ = ["Case", "Check", "ContractError", "Failure", "Suite", "backend_suite", "run"]
