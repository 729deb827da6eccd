"""Figures of convergence and of curves known by formula."""

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from dacore.errors import ShapeError
from dacore.figures.convergence import Convergence, ErrorCurve, convergence
from dacore.figures.formula import FormulaPanel, Known, against_formula
from dacore.figures.style import svg

SIZES = np.array([0.1, 0.05, 0.025])


def shown(figure):
    svg(figure)
    return [axes for axes in figure.axes if axes.get_visible()]


def test_convergence_has_a_panel_a_problem_and_a_line_an_order():
    curves = [ErrorCurve(q, v, SIZES, SIZES**k) for q, k in (("u", 2), ("∇u", 1)) for v in ("P1", "P2")]
    figure = convergence([Convergence("first", curves), Convergence("second", curves[:1])], (1, 2), "seen")
    first, second = shown(figure)
    assert [axes.get_title() for axes in (first, second)] == ["first", "second"]
    assert (first.get_xscale(), first.get_yscale()) == ("log", "log")
    assert (first.get_xlabel(), first.get_ylabel()) == ("size of the cells", "relative error")
    assert [len(axes.lines) for axes in (first, second)] == [6, 3]
    drawn, guides = first.lines[:4], first.lines[4:]
    np.testing.assert_array_equal(drawn[0].get_ydata(), SIZES**2)
    assert drawn[0].get_color() == drawn[1].get_color() != drawn[2].get_color()
    assert drawn[0].get_linestyle() == drawn[2].get_linestyle() != drawn[1].get_linestyle()
    for order, line in zip((1, 2), guides, strict=True):
        x, y = line.get_data()
        assert np.diff(np.log(y))[0] / np.diff(np.log(x))[0] == pytest.approx(order)
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["u, P1", "u, P2", "∇u, P1", "∇u, P2"]


def test_formulas_are_lines_and_computed_values_marks():
    x = np.linspace(0, 1, 50)
    curve = Known("t = 1", x, np.sin(x), x[::10], np.sin(x[::10]) + 0.1)
    panel = FormulaPanel("waves", "x [cm]", "u [cm]", [curve])
    log = FormulaPanel("decay", "t [s]", "p", [Known("p", x[1:], x[1:], x[1:5], x[1:5])], log_x=True)
    first, second = shown(against_formula([panel, log]))
    line, marks = first.lines
    assert line.get_marker() == "None"
    assert marks.get_linestyle() == "None"
    assert line.get_color() == marks.get_color()
    np.testing.assert_array_equal(marks.get_ydata(), curve.computed)
    assert (first.get_xlabel(), first.get_ylabel(), first.get_xscale()) == ("x [cm]", "u [cm]", "linear")
    assert second.get_xscale() == "log"


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ErrorCurve("u", "P1", SIZES, SIZES[:2]), "errors of 'u': got shape"),
        (lambda: ErrorCurve("u", "P1", SIZES, 0 * SIZES), "positive"),
        (lambda: convergence([]), "no panel"),
        (lambda: convergence([Convergence("empty", ())]), "without curves"),
        (lambda: Known("u", SIZES, SIZES, SIZES, SIZES[:1]), "points of 'u'"),
        (lambda: against_formula([]), "no panel"),
    ],
)
def test_what_cannot_be_drawn_is_refused(make, message):
    with pytest.raises(ShapeError, match=message):
        make()
