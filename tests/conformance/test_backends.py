"""The suite of a backend passes what is sound and finds every mutant, and says what is wrong with it."""

import re

import pytest

from dacore.testing import backend_suite, run
from tests.conformance import broken_backends
from tests.conformance.broken_backends import MUTANTS, Sound
from tests.conformance.eager_backend import LoadsAtOnce

test_sound = backend_suite(Sound()).as_test()


def backend_of(name):
    cls = getattr(broken_backends, name)
    return cls.__new__(cls)


@pytest.mark.parametrize("name", MUTANTS)
def test_mutant(name):
    checks, says = MUTANTS[name]
    found = run(case for case in backend_suite(backend_of(name)) if case.check.name in checks)
    assert {failure.case.check.name for failure in found} == set(checks)
    assert re.search(says, "\n".join(map(str, found))), str(found[0])


def test_a_library_that_is_loaded_at_once_is_named():
    found = run(case for case in backend_suite(LoadsAtOnce()) if case.check.name == "the_library_is_loaded_late")
    assert "loads skfem" in str(found[0]), found


def test_every_check_finds_something():
    """A check that no mutant needs may be a check that cannot fail."""
    needed = {check for checks, _ in MUTANTS.values() for check in checks} | {"the_library_is_loaded_late"}
    assert {case.check.name for case in backend_suite(Sound())} - needed == set()
