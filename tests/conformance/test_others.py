"""The suites of all kinds but backends pass what is sound and find every mutant, and say what is wrong with it."""

import pytest

from dacore.testing import observation_suite, quantity_suite, solver_suite
from dacore.testing.estimators import estimator_suite
from tests.conformance import (
    broken_estimators,
    broken_formats,
    broken_models,
    broken_observations,
    broken_solvers,
    broken_spaces,
)
from tests.conformance.mutants import needed

SOUND = {
    "observation": observation_suite(broken_observations.Sound(), reproduces="linear"),
    "strain": observation_suite(broken_observations.Gauge(), **broken_observations.STRAIN),
    "quantity": quantity_suite(broken_observations.SoundQuantity(), reproduces="linear"),
    "solver": solver_suite(broken_solvers.Sound()),
    "estimator": estimator_suite(broken_estimators.Sound(), deviations=True),
    "space": broken_spaces.suite_of(broken_spaces.Sound),
    "domain": broken_spaces.suite_of(broken_spaces.SoundDomain),
    "format": broken_formats.suite_of(broken_formats.Sound),
    "affine model": broken_models.suite_of(broken_models.Sound),
    "forward model": broken_models.suite_of(broken_models.SoundForward),
}
BROKEN = (broken_observations, broken_solvers, broken_estimators, broken_spaces, broken_models, broken_formats)
MUTANTS = [mutant for module in BROKEN for mutant in module.MUTANTS]
CASES = [pytest.param(case, id=f"{kind}-{case.name}") for kind, suite in SOUND.items() for case in suite]


@pytest.mark.parametrize("case", CASES)
def test_sound(case):
    case()


@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda mutant: mutant.name)
def test_mutant(mutant):
    mutant.prove()


@pytest.mark.parametrize("kind", SOUND)
def test_every_check_finds_something(kind):
    """A check that no mutant needs may be a check that cannot fail."""
    assert {case.check.name for case in SOUND[kind]} - needed(MUTANTS) == set()
