"""The suite of a backend passes what is sound and finds every mutant, and says what is wrong with it."""

import pytest

from dacore.testing import backend_suite
from dacore.testing.spaces import ReferenceBackend
from tests.conformance import broken_backends, broken_forms, eager_backend
from tests.conformance.mutants import needed
from tests.conformance.sound_backend import MUTANTS, Sound

DECLARED_IN = (broken_backends, broken_forms, eager_backend)

test_sound = backend_suite(Sound()).as_test()
test_reference = backend_suite(ReferenceBackend()).as_test()


@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda mutant: mutant.name)
def test_mutant(mutant):
    mutant.prove()


def test_every_check_finds_something():
    """A check that no mutant needs may be a check that cannot fail."""
    assert {case.check.name for case in backend_suite(Sound())} - needed(MUTANTS) == set()
