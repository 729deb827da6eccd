"""What a plugin gives is looked at where it is given: a wrong type or shape is one line and no traceback."""

from dataclasses import replace
from functools import partial
from operator import itemgetter
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.sparse import csr_array

from dacore.core.estimate import Estimate
from dacore.core.model import AffineModel, AffineTerm, Load
from dacore.core.observation import Functionals
from dacore.core.parameters import Parameter, ParameterSpace
from dacore.errors import ShapeError
from dacore.studies.validation import Judge
from dacore.testing.spaces import Chain
from dacore.workflow.built import check_built

SPACE = Chain(6)
N = SPACE.n_dofs


def model(coefficient=itemgetter("k"), amplitude=itemgetter("k")):
    none = np.zeros(N)
    return AffineModel(
        SPACE, ParameterSpace((Parameter("k", "1", 1.0, 2.0),)), (),
        (AffineTerm("storage", csr_array(np.eye(N)), coefficient),), (),
        (Load("push", amplitude, np.ones_like, none, none),), none.astype(bool), none.astype(bool),
    )  # fmt: skip


def test_a_sound_model_is_taken():
    check_built(model(), "Mine")


@pytest.mark.parametrize(
    ("built", "message"),
    [
        (lambda: None, r"Mine.build gave a NoneType, expected an AffineModel or a ForwardModel \(dacore.core.model\)"),
        (lambda: (model(),), "Mine.build gave a tuple"),
        (
            lambda: model(coefficient=itemgetter("K")),
            "term storage: its coefficient asks for the parameter 'K'; there is k",
        ),
        (lambda: model(amplitude=itemgetter("p")), "load push: its amplitude asks for the parameter 'p'; there is k"),
    ],
)
def test_what_a_physics_builds(built, message):
    with pytest.raises(ShapeError, match=message):
        check_built(built(), "Mine")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"constrained": np.zeros(3, dtype=bool)}, rf"constrained: got flags of shape \(3,\), expected \({N},\)"),
        ({"antisymmetric": np.zeros(3, dtype=bool)}, "antisymmetric: got flags of shape"),
        (
            {"loads": (Load("push", itemgetter("k"), np.ones_like, np.zeros(3), np.zeros(N)),)},
            rf"load push: got a force of shape \(3,\) and prescribed values of shape \({N},\)",
        ),
    ],
)
def test_arrays_of_a_model(change, message):
    with pytest.raises(ShapeError, match=message):
        replace(model(), **change)


def test_functionals():
    place = np.zeros((2, 1))
    make = partial(Functionals, unit="1", centres=place, directions=place, sites=np.arange(2))
    make(csr_array(np.eye(2)), ("a", "b"))
    with pytest.raises(ShapeError, match="got a matrix of type ndarray, expected a csr_array"):
        make(np.eye(2), ("a", "b"))
    with pytest.raises(ShapeError, match="got 1 labels, 2 centres, 2 directions, 2 sites for a matrix of 2 rows"):
        make(csr_array(np.eye(2)), ("a",))


@pytest.mark.parametrize("shape", [(2, 4, 1), (3, 5, 1), (3, 4), (4, 3, 1)])
def test_coefficients_of_an_estimate(shape):
    background = SimpleNamespace(coefficients=np.zeros((3, 9, 20)))
    Estimate(background, np.arange(4), np.zeros((3, 4, 7)))
    with pytest.raises(ShapeError, match=r"expected \(3 modes, 4 steps, series\)"):
        Estimate(background, np.arange(4), np.zeros(shape))


def test_what_an_estimator_gives():
    judge = object.__new__(Judge)
    prepared = SimpleNamespace(estimate=lambda data, scale, mask: np.zeros(3))
    noisy = SimpleNamespace(data={0.0: None}, given=lambda level: None, sigmas={0.0: 1.0})
    with pytest.raises(ShapeError, match="estimator mine: estimate gave a ndarray, expected an Estimate"):
        judge.judge("mine", prepared, noisy)
