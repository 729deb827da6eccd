"""Figures of studies: what is drawn is what was given, labelled with units, and wrong shapes are refused."""

import itertools

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from dacore.errors import ShapeError
from dacore.figures.calibration import CalibrationCurve, calibration
from dacore.figures.classify import ClassPanel, OperatingLine, classification
from dacore.figures.data_amount import data_amount
from dacore.figures.dimension import DimensionPanel, dimension
from dacore.figures.learned import learned
from dacore.figures.mismatch import MismatchCurve, mismatch
from dacore.figures.placement import PlacementPanel, placement
from dacore.figures.style import COLOURS, png
from dacore.figures.weights import WeightStudy, weights

RATES = np.array([0.0, 0.0, 0.5, 1.0]), np.array([0.0, 0.5, 1.0, 1.0])


def drawn(figure):
    """Draw it (a warning fails the test), and return the axes."""
    assert png(figure, dpi=40).startswith(b"\x89PNG")
    return [axes for axes in figure.axes if axes.get_visible()]


def legend(figure):
    return [text.get_text() for text in figure.legends[0].get_texts()]


def texts(axes):
    return [text.get_text() for text in axes.texts]


def class_panel(k=16, wrong=1, **options):
    truth = np.concatenate([np.linspace(1e4, 1.02e4, k // 2), np.linspace(1.08e4, 1.1e4, k // 2)])
    raised = np.arange(k) >= k // 2
    estimate = truth.copy()
    estimate[:wrong] += 800
    return ClassPanel("minimum variance", truth, estimate, raised, 1.05e4, **options)


def test_classification_counts_who_is_told_right_and_rings_the_others():
    panel = class_panel()
    with_ends = class_panel(wrong=0, low=panel.truth - 50, high=panel.truth + 90)
    line = OperatingLine("minimum variance", *RATES, 0.875, (0.6, 0.97))
    figure = classification([panel, with_ends], [line], "ventricular pressure", "dyn/cm²")
    first, second, roc = drawn(figure)
    assert texts(first) == ["15 of 16 told right"]
    assert texts(second) == ["16 of 16 told right"]
    (ringed,) = [each for each in first.lines if each.get_label() == "told wrong"]
    np.testing.assert_array_equal(ringed.get_xdata(), panel.truth[:1])
    assert "told wrong" not in [each.get_label() for each in second.lines]
    assert first.get_xlabel() == "true ventricular pressure  [dyn/cm²]"
    assert first.get_ylabel() == "estimated ventricular pressure  [dyn/cm²]"
    entries = ["threshold", "estimate = truth", "normal", "raised", "told wrong", "90 % interval"]
    assert legend(figure) == [*entries, "minimum variance\nAUC 0.875 [0.600, 0.970]"]
    np.testing.assert_array_equal(roc.lines[1].get_ydata(), RATES[1])
    # Segments of the intervals go from the low to the high ends.
    ends = np.concatenate([each.get_segments() for each in second.collections if hasattr(each, "get_segments")])
    np.testing.assert_allclose(np.ptp(ends[:, :, 1], axis=1), 140.0)


def test_estimates_far_away_are_on_the_edge_and_counted():
    panel = class_panel(wrong=0)
    panel.estimate[-1] = 5e6
    (axes,) = drawn(classification([panel], [], "p_v", "dyn/cm²"))
    assert texts(axes) == ["16 of 16 told right · 1 outside, on the edge"]
    assert axes.get_ylim()[1] < 1.3e4


def test_intervals_of_many_patients_are_left_out():
    panel = class_panel(200, low=np.zeros(200), high=np.full(200, 2e4))
    (axes,) = drawn(classification([panel], [], "p_v", "dyn/cm²"))
    assert not [each for each in axes.collections if hasattr(each, "get_segments") and len(each.get_segments()) > 1]


def test_calibration_draws_shares_in_percent_and_histograms_of_density():
    levels = np.array([0.5, 0.9])
    uniform = (np.arange(400) + 0.5) / 400
    curves = [
        CalibrationCurve("right", levels, levels, uniform, "rms 1.0"),
        CalibrationCurve("narrow", levels, levels - 0.2, np.round(uniform)),
    ]
    figure = calibration(curves, caption="400 patients")
    shares, right, _ = drawn(figure)
    np.testing.assert_allclose(shares.lines[2].get_ydata(), [30.0, 70.0])
    assert shares.get_ylim()[0] < 30.0
    np.testing.assert_allclose([bar.get_height() for bar in right.patches if bar.get_width() < 0.5], 1.0)
    assert [each.get_xlabel()[-3:] for each in (shares, right)] == ["[%]", "[–]"]
    assert texts(right) == ["rms 1.0", "400 patients"]
    assert legend(figure) == ["95 % of right claims", "right", "narrow"]


def dimension_panel(label="exact", **options):
    n = np.arange(1, 11)
    return DimensionPanel(label, n, {"e_u": 1.0 / n, "e_p": 0.1 * (n - 4.0) ** 2 + 0.5}, 1.0 / n**2, 1.0 / n, **options)


def test_dimension_marks_the_least_error_of_the_last_and_each_rules_choice():
    figure = dimension([dimension_panel(chosen={"bound": 7, "held out": 4}), dimension_panel("10 % noise")])
    above, _, below, _ = drawn(figure)
    lines = {each.get_label(): each for each in above.lines}
    assert lines["least e$_{\\mathrm{p}}$"].get_xydata().tolist() == [[4.0, 50.0]]
    np.testing.assert_allclose(lines["bound"].get_xydata(), [[7.0, 140.0]])
    np.testing.assert_allclose(lines["held out"].get_xydata(), [[4.0, 50.0]])
    bound = next(each for each in below.lines if each.get_label() == "bound")
    np.testing.assert_allclose(bound.get_ydata(), 1.0 / np.arange(1, 11))
    assert above.get_ylabel() == "relative error  [%]"
    assert above.get_yscale() == below.get_yscale() == "log"
    few = DimensionPanel("x", np.arange(1, 4), {"u": ONES}, ONES, ONES)
    figure = dimension([few])
    figure.canvas.draw()
    for axes in drawn(figure):
        assert (axes.get_xticks() % 1 == 0).all()


def test_a_bound_is_left_out_where_the_space_is_not_seen():
    n = np.arange(1, 4)
    panel = DimensionPanel("x", n, {"u": n / 3}, 1.0 / n, np.array([1.0, 0.5, 0.0]))
    np.testing.assert_array_equal(panel.curve, [1.0, 1.0, np.nan])
    given = DimensionPanel("x", n, {"u": n / 3}, 1.0 / n, 1.0 / n, bound=np.array([1.0, np.inf, 2.0]))
    np.testing.assert_array_equal(given.curve, [1.0, np.nan, 2.0])
    drawn(dimension([panel]))


def test_weights_share_a_logarithmic_axis_over_all_decades():
    zeta = 10.0 ** np.arange(-20, -7)
    study = WeightStudy(zeta, {"u": zeta**0.01, "p": zeta**-0.01}, np.full(13, 0.1), np.arange(20, 33), "1",
                        {"published": 1e-18}, {"u": 0.2})  # fmt: skip
    figure = weights(study, "brain")
    top, middle, bottom = drawn(figure)
    np.testing.assert_allclose(top.lines[0].get_ydata(), 100 * zeta**0.01)
    assert texts(top) == ["published"]
    assert [axes.get_xscale() for axes in (top, middle, bottom)] == ["log"] * 3
    assert bottom.get_xlabel().endswith("[–]")
    assert bottom.get_xlim()[1] / bottom.get_xlim()[0] > 1e12
    assert legend(figure) == ["u", "p", "guessing the training mean"]


def test_data_amount_draws_medians_and_the_guess():
    cases = np.array([[0.1, 0.05], [0.2, 0.1], [0.6, 0.3]])
    errors = {"u": {"mv": cases}, "p_v": {"mv": np.array([90.0, 60.0]), "pbdw": np.array([300.0, 280.0])}}
    figure = data_amount(["one slice", "all"], [462, 4197], errors, {"u": 0.3}, {"p_v": "dyn/cm²"})
    first, second = drawn(figure)
    np.testing.assert_allclose(first.lines[0].get_ydata(), [20.0, 10.0])
    np.testing.assert_allclose(second.lines[0].get_ydata(), [90.0, 60.0])
    assert [axes.get_ylabel() for axes in (first, second)] == ["error  [%]", "error  [dyn/cm²]"]
    assert [label.get_text() for label in first.get_xticklabels()] == ["one slice\n$m$ = 462", "all\n$m$ = 4,197"]
    assert legend(figure) == ["mv", "guessing the training mean", "pbdw"]


def test_mismatch_draws_errors_and_alarms_against_its_size():
    sizes = np.array([1e-3, 1e-2, 1e-1])
    curves = [MismatchCurve("mv", {"u": sizes, "p_v": 100 * sizes}, {"u": 1e-3}, np.array([0.0, 0.5, 1.0])),
              MismatchCurve("pbdw", {"u": sizes, "p_v": 200 * sizes})]  # fmt: skip
    figure = mismatch(sizes, curves, noise={"10 % noise": 0.1}, guess={"p_v": 300.0}, units={"p_v": "dyn/cm²"})
    errors, pressure, alarm = drawn(figure)
    np.testing.assert_allclose(errors.lines[0].get_ydata(), 100 * sizes)
    np.testing.assert_allclose(pressure.lines[1].get_ydata(), 200 * sizes)
    np.testing.assert_allclose(alarm.lines[0].get_ydata(), [0.0, 50.0, 100.0])
    assert alarm.get_ylabel() == "cases with an alarm  [%]"
    assert texts(errors) == texts(alarm) == ["10 % noise"]
    assert legend(figure) == ["mv", "pbdw", "nothing wrong", "guessing the training mean"]
    assert len(drawn(mismatch(sizes, curves[1:]))) == 2


def test_placement_draws_greedy_random_and_best():
    values = np.array([0.0, 0.2, 0.4])
    random = np.array([[0.0, 0.1, 0.3], [0.0, 0.15, 0.4]])
    panel = PlacementPanel("stability", "β_n  [–]", values, random, np.array([0.0, 0.2, np.nan]), ["8.5", "6.5"])
    bare = PlacementPanel("deviation", "left  [–]", 1 - values, np.zeros((0, 3)), log=False)
    figure = placement([panel, bare], "slices")
    first, second = drawn(figure)
    greedy = next(each for each in first.lines if each.get_label() == "greedy")
    np.testing.assert_array_equal(greedy.get_ydata(), [np.nan, 0.2, 0.4])
    median = next(each for each in first.lines if each.get_label() == "their median")
    np.testing.assert_allclose(median.get_ydata(), [0.125, 0.35])
    assert [label.get_text() for label in first.get_xticklabels()] == ["0", "1\n8.5", "2\n6.5"]
    assert second.get_yscale() == "linear"
    assert legend(figure) == ["2 random orders", "their median", "greedy", "best of all choices"]


def test_learned_marks_what_is_not_seen():
    shares = {"exact": np.array([0.9999, 0.5]), "noise": np.array([[0.5, 0.7], [0.01, 0.03], ])}  # fmt: skip
    figure = learned(["E", "κ"], shares)
    (axes,) = drawn(figure)
    np.testing.assert_allclose([bar.get_width() for bar in axes.patches], [99.99, 50.0, 60.0, 2.0])
    assert [bool(bar.get_hatch()) for bar in axes.patches] == [False, False, False, True]
    assert texts(axes) == ["99.99%", "50%", "60%", "2%, not seen"]
    assert axes.get_xlabel().endswith("[%]")
    assert legend(figure) == ["exact", "noise", "not seen (below 10%)"]


ONES = np.ones(3)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ClassPanel("x", ONES, ONES[:2], ONES > 0, 1.0), "estimate of 'x'"),
        (lambda: ClassPanel("x", ONES, ONES, ONES > 0, 1.0, low=ONES), "one end only"),
        (lambda: OperatingLine("x", ONES, ONES[:2], 1.0, (0.0, 1.0)), "rates of 'x'"),
        (lambda: classification([], [], "p", "1"), "no panel"),
        (lambda: CalibrationCurve("x", ONES, ONES[:2], ONES), "coverage of 'x'"),
        (lambda: CalibrationCurve("x", ONES, ONES, ONES[:0]), "transform of 'x'"),
        (lambda: calibration([]), "no curve"),
        (lambda: DimensionPanel("x", np.arange(3), {"u": ONES[:2]}, ONES, ONES), "u of 'x'"),
        (lambda: DimensionPanel("x", np.arange(3), {}, ONES, ONES), "got none"),
        (lambda: DimensionPanel("x", np.arange(3), {"u": ONES}, ONES, ONES, {"bound": 9}), "chose 9"),
        (lambda: dimension([]), "no panel"),
        (lambda: WeightStudy(ONES, {"u": ONES[:2]}, ONES, ONES, "1"), "u: got shape"),
        (lambda: WeightStudy(0 * ONES, {"u": ONES}, ONES, ONES, "1"), "all positive"),
        (lambda: data_amount(["a"], [1, 2], {"u": {"mv": ONES[:1]}}, {}), "1 amounts with 2 counts"),
        (lambda: data_amount(["a"], [1], {"u": {"mv": ONES}}, {}), "u of 'mv'"),
        (lambda: mismatch(ONES, []), "at least one curve"),
        (lambda: mismatch(ONES, [MismatchCurve("x", {"u": ONES[:2]})]), "u of 'x'"),
        (lambda: mismatch(ONES, [MismatchCurve("x", {"u": ONES}), MismatchCurve("y", {"p": ONES})]), "errors of 'y'"),
        (lambda: PlacementPanel("x", "a", ONES, np.ones((2, 2))), "random orders of 'x'"),
        (lambda: PlacementPanel("x", "a", ONES, np.ones((2, 3)), ONES[:2]), "best of 'x'"),
        (lambda: PlacementPanel("x", "a", ONES, np.ones((2, 3)), names=["a"]), "names of 'x'"),
        (lambda: placement([]), "no panel"),
        (lambda: learned([], {}), "no name"),
        (lambda: learned(["a"], {"x": ONES}), "shares of 'x'"),
    ],
)
def test_what_cannot_be_drawn_is_refused(make, message):
    with pytest.raises(ShapeError, match=message):
        make()


def test_four_measures_take_two_columns_and_labels_of_many_amounts_are_broken():
    amounts = ["one slice", "three slices in the middle", "voxels of 2 cm", "five phases"]
    errors = {name: {"mv": np.full(4, 0.1)} for name in ("u", "p", "p − p_csf", "p_v")}
    figure = data_amount(amounts, [1, 2, 3, 4], errors, {})
    panels = drawn(figure)
    assert len({round(axes.get_position().x0, 2) for axes in panels}) == 2
    assert len({round(axes.get_position().y0, 2) for axes in panels}) == 2
    figure.canvas.draw()
    for axes in panels:
        boxes = [label.get_window_extent() for label in axes.get_xticklabels()]
        assert all(left.x1 <= right.x0 for left, right in itertools.pairwise(boxes))
        assert "three" in axes.get_xticklabels()[1].get_text()


def test_the_legend_of_curves_stands_beside_them_where_there_is_room():
    panels = [class_panel() for _ in range(3)]
    lines = [OperatingLine(f"estimator {k}", *RATES, 0.875, (0.6, 0.97)) for k in range(5)]
    beside = classification([*panels, *panels], lines, "p_v", "dyn/cm²")
    roc = drawn(beside)[-1]
    beside.canvas.draw()
    assert roc.get_legend().get_window_extent().x0 >= roc.get_window_extent().x1
    below = classification(panels[:2], lines, "p_v", "dyn/cm²")
    roc = drawn(below)[-1]
    below.canvas.draw()
    assert roc.get_legend() is None
    assert below.legends[0].get_window_extent().y1 <= roc.get_window_extent().y0
    assert len(legend(below)) == len(legend(beside)) + 5


def test_an_estimator_has_one_colour_in_its_panel_and_its_curve():
    panels = [class_panel(series=2), class_panel(series=0)]
    lines = [OperatingLine(f"estimator {k}", *RATES, 0.875, (0.6, 0.97), series=k) for k in (2, 0)]
    *scatters, roc = drawn(classification(panels, lines, "p_v", "dyn/cm²"))
    for axes, curve, k in zip(scatters, roc.lines[1:], (2, 0), strict=True):
        points = [each for each in axes.lines if len(each.get_xdata()) == 8]
        assert {each.get_color() for each in (curve, *points)} == {COLOURS[k]}
        fills = [each.get_markerfacecolor() for each in points]
        assert fills == ["white", COLOURS[k]]


def test_titles_of_neighbouring_panels_do_not_meet():
    panel = PlacementPanel("deviation left, covariance of the training set", "left", ONES, np.zeros((0, 3)))
    figure = placement([panel, panel, panel])
    figure.canvas.draw()
    boxes = [axes.title.get_window_extent() for axes in drawn(figure)]
    assert all(left.x1 < right.x0 for left, right in itertools.pairwise(boxes))
