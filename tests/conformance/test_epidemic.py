"""The model of examples/epidemic keeps every contract, though it is no finite element model and has no mesh."""

import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from dacore.plugins.files import import_file
from dacore.testing import model_suite, observation_suite, quantity_suite, space_suite

epidemic = import_file(Path(__file__).resolve().parents[2] / "examples/epidemic/epidemic.py")


def space():
    return epidemic.SIR(towns=8, weeks=5).build(None).space


def scaled(share, values, gradient, directions):
    return share * values[:, 0]


test_model = model_suite(epidemic.SIR(towns=8, weeks=5)).as_test()
test_space = space_suite(space).as_test()
test_reports = observation_suite(epidemic.Reports((1, 4, 6)), space, reproduces=partial(scaled, 0.3)).as_test()
test_quantity = quantity_suite(epidemic.InTown(3), space).as_test()


def test_people_are_conserved_and_the_final_size_is_that_of_the_formula():
    """Without commuters all stays in the first town, and log(s∞) = −R0 (1 − s∞) there (Kermack and McKendrick)."""
    model = epidemic.Epidemic(towns=4, weeks=200, seed=1)
    states = model.solve({"R0": 1.8, "d": 5.0, "mixing": 0.0, "immune": 0.0, "first": 1e-3}).states.reshape(3, 4, -1)
    new, infected, recovered = states
    assert np.allclose(np.cumsum(new, axis=1) + 1e-3 * (np.arange(4) == 0)[:, None], infected + recovered, atol=1e-6)
    assert not states[:, 1:].any()
    left = 1 - recovered[0, -1] / 1000
    assert abs(np.log(left) + 1.8 * (1 - left)) < 1e-5


def test_its_module_is_that_of_every_scene_that_names_it():
    assert sys.modules[epidemic.__name__] is epidemic
    with pytest.raises(Exception, match="no such file"):
        import_file(Path(__file__).with_name("epidemic.py"))
