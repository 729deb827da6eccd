"""Suites refuse what they are not for, and tell of one mistake once."""

import os
import re
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from dacore.algebra.linear_solver import CorrectingSolver
from dacore.algebra.solvers import Direct
from dacore.core.solver import SolverMethod
from dacore.domains.box import Box
from dacore.errors import PluginError
from dacore.estimators.pbdw import PBDW
from dacore.testing import (
    backend_suite,
    domain_suite,
    estimator_suite,
    model_suite,
    observation_suite,
    quantity_suite,
    run,
    solver_suite,
    space_suite,
)
from dacore.testing.meshes import shuffled_box
from dacore.testing.spaces import Chain, ReferenceBackend
from tests.conformance.broken_estimators import Sound as SoundEstimator
from tests.conformance.broken_observations import Gauge, Sound, SoundQuantity
from tests.conformance.sound_backend import Delegate
from tests.graph_plugin import Ring


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: backend_suite(ReferenceBackend), r"the class ReferenceBackend, .* backend_suite\(ReferenceBackend\("),
        (lambda: observation_suite(Gauge), "got the class Gauge, expected an instance of a ObservationOperator"),
        (lambda: observation_suite(SoundQuantity()), "got a SoundQuantity, expected an instance of a ObservationOp"),
        (lambda: quantity_suite(Sound()), "got a Sound, expected an instance of a QuantityOfInterest"),
        (lambda: estimator_suite(Direct()), "got a Direct, .* dacore.core.estimator.Estimator"),
        (lambda: model_suite(Box()), "got a Box, expected an instance of a Physics"),
        (lambda: solver_suite(PBDW), "got the class PBDW"),
        (lambda: domain_suite(shuffled_box(2)), "got a Mesh, expected an instance of a Domain"),
        (lambda: space_suite(Chain(3)), "space is a Chain, expected a function without arguments"),
        (lambda: observation_suite(Gauge(), Chain(3)), "space is a Chain, expected a function without arguments"),
        (lambda: model_suite(Ring(), shuffled_box(2)), "mesh is a Mesh, expected a function"),
        (lambda: observation_suite(Gauge(), reproduces="affine"), "reproduces is 'affine', expected 'nothing', 'cons"),
        (lambda: quantity_suite(SoundQuantity(), reproduces="exact"), "reproduces is 'exact', expected"),
        (lambda: observation_suite(Gauge(), reproduces=np.add, derivative=0), "derivative is 0, .* is given the grad"),
        (lambda: observation_suite(Sound(), derivative="x"), "derivative is 'x', expected the number of an axis"),
    ],
)
def test_what_a_suite_is_not_for_is_refused_when_it_is_made(make, says):
    with pytest.raises(PluginError, match=says):
        make()


@dataclass(frozen=True)
class Raises(Sound):
    def functionals(self, space):
        raise RuntimeError("no licence")


@dataclass(frozen=True)
class ReturnsNothing(Sound):
    def functionals(self, space):
        return None


class Prepares(SoundEstimator):
    def prepare(self, background, functionals, noise, steps=None):
        return None


class NoStrain(Delegate):
    def strain(self, order):
        raise RuntimeError("no licence")


class Strainless(ReferenceBackend):
    name = "strainless"

    def assembler(self, mesh):
        return NoStrain(mesh)


@pytest.mark.parametrize(
    ("suite", "says"),
    [
        (lambda: observation_suite(Raises()), r"functionals_of_the_space: RuntimeError: no licence; not run, since "),
        (lambda: observation_suite(ReturnsNothing()), "functionals_of_the_space: ContractError: .* returns a NoneType"),
        (lambda: estimator_suite(Prepares()), "shapes: ContractError: .* returns a NoneType, expected a PreparedEst"),
        (lambda: [c for c in backend_suite(Strainless()) if c.name.endswith("small2d")], "strainless .* no licence"),
    ],
)
def test_one_mistake_is_one_failure(suite, says):
    failures = run(suite())
    first = [failure for failure in failures if len(failure.stopped) >= 4]
    assert len(first) == 1
    assert re.search(says, str(first[0])), str(first[0])
    assert not [failure for failure in failures if isinstance(failure.error, AttributeError)]


def test_what_differs_stays_a_failure_of_its_own():
    @dataclass(frozen=True)
    class Twice(Sound):
        def broken(self, space, found):
            return {"labels": ("same",) * 9, "centres": found["centres"] + 0.1}

    failures = run(observation_suite(Twice(), reproduces="linear"))
    assert {"labels_and_places", "linear_fields_are_reproduced"} <= {failure.case.name for failure in failures}


def test_pytest_skips_what_the_same_error_stops(pytester_run):
    text = pytester_run("observation_suite(Raises())", "from tests.conformance.test_suite import Raises")
    assert "not run: functionals_of_the_space failed with the same error, RuntimeError: no licence" in text
    assert "1 failed" in text


@pytest.fixture
def pytester_run(tmp_path):
    def work(suite, imports):
        path = tmp_path / "test_it.py"
        path.write_text(f"from dacore.testing import observation_suite\n{imports}\ntest_it = {suite}.as_test()\n")
        root = str(Path(__file__).resolve().parents[2])
        command = [sys.executable, "-m", "pytest", "-q", "-rs", "-p", "no:cacheprovider", "-p", "no:xdist", str(path)]
        done = subprocess.run(
            command, capture_output=True, text=True, cwd=tmp_path, env={**os.environ, "PYTHONPATH": root}
        )
        return done.stdout

    return work


class Flat(CorrectingSolver):
    name = "flat"

    def correct(self, residual, goal):
        return residual[:, 0]


@dataclass(frozen=True)
class FlatMethod(SolverMethod):
    def prepare(self, matrix, definite, tolerance, analysis=None):
        return Flat(matrix, definite, tolerance)


def test_a_correction_of_a_wrong_shape_is_said_with_the_system():
    failures = [failure for case in solver_suite(FlatMethod()) for failure in run([case])]
    text = str(next(failure for failure in failures if failure.case.name == "reaches_the_tolerance"))
    assert "on a poroelastic step with the tolerance 1e-04 raises PluginError: flat: correct gave shape (208,)" in text
