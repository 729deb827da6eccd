"""docs/conformance.md lists every check of every suite with the contract it proves."""

import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from dacore.algebra.solvers import Direct
from dacore.domains.box import Box
from dacore.estimators.pbdw import PBDW
from dacore.testing import (
    backend_suite,
    domain_suite,
    estimator_suite,
    model_suite,
    observation_suite,
    quantity_suite,
    run,
    settings,
    solver_suite,
    space_suite,
)
from dacore.testing.spaces import Chain, ReferenceBackend
from tests.conformance import broken_formats, broken_forms, broken_spaces, sound_backend
from tests.graph_plugin import Ring, Tank, Thermometers

PAGE = (Path(__file__).resolve().parents[2] / "docs/conformance.md").read_text(encoding="utf-8")
SUITES = {
    "Backends": backend_suite(ReferenceBackend()),
    "State spaces": space_suite(lambda: Chain(3)),
    "Observations": observation_suite(Thermometers()),
    "Quantities": quantity_suite(Tank()),
    "Estimators": estimator_suite(PBDW()),
    "Models": model_suite(Ring()),
    "Solvers": solver_suite(Direct()),
    "Domains": domain_suite(Box()),
    "Formats": broken_formats.suite_of(broken_formats.Sound),
}
DECLARED_IN = broken_forms
COMMON = {check.__name__ for check in settings.CHECKS}


def contracts(suite, without=()):
    """Names of the checks of a suite, and what they prove."""
    return {case.check.name: case.check.contract for case in suite if case.check.name not in without}


EXPECTED = {title: contracts(suite, COMMON) for title, suite in SUITES.items()}
EXPECTED["Settings of every plugin but a backend"] = {
    name: text for name, text in contracts(SUITES["Domains"]).items() if name in COMMON
}
# A quantity keeps the contracts of an observation and one more.
EXPECTED["Quantities"] = contracts(SUITES["Quantities"], COMMON | set(EXPECTED["Observations"]))


def table(rows):
    return "| check | contract |\n|---|---|\n" + "".join(f"| `{name}` | {text} |\n" for name, text in rows.items())


@pytest.mark.parametrize("title", EXPECTED)
def test_every_check_is_listed(title):
    section = re.search(rf"^### {title}\n(.*?)(?=^##|\Z)", PAGE, re.MULTILINE | re.DOTALL)
    assert section, f"docs/conformance.md has no section '### {title}'"
    assert table(EXPECTED[title]) in section[1]


def test_nothing_else_is_listed():
    listed = re.findall(r"^\| `(\w+)` \|", PAGE, re.MULTILINE)
    assert len(listed) == sum(map(len, EXPECTED.values()))


@pytest.mark.parametrize("title", SUITES)
def test_names_are_different_and_contracts_are_sentences(title):
    names = [case.name for case in SUITES[title]]
    assert len(set(names)) == len(names)
    for text in contracts(SUITES[title]).values():
        assert text.endswith(".")


def test_running_needs_no_pytest():
    code = (
        "import sys; sys.modules['pytest'] = None\n"
        "from dacore.algebra.solvers import Direct\n"
        "from dacore.testing import run, solver_suite\n"
        "assert not run(solver_suite(Direct()))\n"
        "from dacore.errors import MissingDependencyError\n"
        "try:\n    solver_suite(Direct()).as_test()\n"
        "except MissingDependencyError as error:\n    print(error)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "dacore[testing]" in done.stdout


def test_a_failure_names_the_case_and_the_error():
    (case,) = (case for case in domain_suite(broken_spaces.SoundDomain()) if case.check.name == "makes_a_mesh")
    (failure,) = run([replace(case, subject=None)])
    assert str(failure) == "makes_a_mesh: AttributeError: 'NoneType' object has no attribute 'mesh'"


def test_the_message_that_is_shown_is_one_that_is_given():
    (mutant,) = (mutant for mutant in sound_backend.MUTANTS if mutant.name == "InwardNormal")
    (failure,) = run(case for case in mutant.suite() if case.name == "boundary_coupling-bumpy2d")
    shown = re.search(r"^(?:> .*\n)+", PAGE, re.MULTILINE)[0]
    assert " ".join(shown.replace("> ", "").split()) == str(failure)
