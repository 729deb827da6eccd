"""A weight of a form over cells is checked before any library sees it, and a form with one is not kept."""

import numpy as np
import pytest

from dacore.core.fields import Field
from dacore.errors import ShapeError
from dacore.testing.meshes import shuffled_box
from dacore.testing.spaces import ReferenceBackend

MESH = shuffled_box(2, 2, 1)
CELLS = len(MESH.cells)


@pytest.fixture
def disc():
    return ReferenceBackend().discretize(MESH, [Field("u", 2), Field("p", 1)])


def forms(disc):
    return {
        "mass": lambda *w: disc.scalar_mass("p", *w),
        "stiffness": lambda *w: disc.scalar_stiffness("u", *w),
        "strain": lambda *w: disc.strain("u", *w),
        "divergence": lambda *w: disc.divergence("u", *w),
        "gradient coupling": lambda *w: disc.gradient_coupling("p", "u", *w),
        "divergence coupling": lambda *w: disc.divergence_coupling("u", "p", *w),
    }


@pytest.mark.parametrize(
    ("weight", "message"),
    [
        (np.ones(CELLS + 1), rf"got shape \({CELLS + 1},\), expected \({CELLS}\)"),
        (np.ones((CELLS, 1)), rf"got shape \({CELLS}, 1\), expected \({CELLS}\)"),
        (2.0, rf"got shape \(\), expected \({CELLS}\)"),
        (np.full(CELLS, np.nan), f"{CELLS} of {CELLS} values are NaN or infinite"),
        (np.append(np.ones(CELLS - 1), np.inf), f"1 of {CELLS} values are NaN or infinite"),
        (
            np.append(np.ones(CELLS - 1), -0.5),
            rf"1 of {CELLS} are negative \(first: -0.5 on cell {CELLS - 1}\), expected none below 0",
        ),
    ],
)
@pytest.mark.parametrize("name", forms(None))
def test_what_is_no_weight_is_refused_in_one_line(disc, name, weight, message):
    with pytest.raises(ShapeError, match=f"weight of {name}: {message}") as error:
        forms(disc)[name](weight)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("name", forms(None))
def test_a_form_with_a_weight_is_not_kept_and_does_not_change_what_is(disc, name):
    ask, weight = forms(disc)[name], np.linspace(0.5, 2.0, CELLS)
    plain = ask()
    one = ask(weight)
    assert ask() is plain
    assert ask(weight) is not one
    assert abs(ask(weight.tolist()) - one).max() == 0.0
    assert abs(ask(2 * weight) - 2 * one).max() < 1e-15 * abs(one).max()
    assert abs(one - plain).max() > 0.1 * abs(plain).max()
