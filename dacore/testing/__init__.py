"""Suites of checks for authors of plugins: every promise of the interfaces in `dacore.core`, proved.

A suite is a list of named checks bound to what they check. ``suite.as_test()`` makes one parametrised
pytest test of it; `run` runs it without pytest. See docs/conformance.md.
"""

from dacore.testing.backends import backend_suite
from dacore.testing.domains import domain_suite
from dacore.testing.estimators import estimator_suite
from dacore.testing.formats import format_suite
from dacore.testing.models import model_suite
from dacore.testing.observations import observation_suite, quantity_suite
from dacore.testing.solvers import solver_suite
from dacore.testing.state_spaces import space_suite
from dacore.testing.suite import Case, Check, ContractError, Failure, Suite, run

__all__ = [
    "Case",
    "Check",
    "ContractError",
    "Failure",
    "Suite",
    "backend_suite",
    "domain_suite",
    "estimator_suite",
    "format_suite",
    "model_suite",
    "observation_suite",
    "quantity_suite",
    "run",
    "solver_suite",
    "space_suite",
]
