"""Every figure: right axes, labels with units, no warning when drawn, its data left alone."""

import numpy as np
import pytest

pytest.importorskip("matplotlib")

import matplotlib as mpl
from matplotlib.figure import Figure

from dacore.errors import ShapeError
from dacore.figures.bound import BoundCurve, bound
from dacore.figures.comparison import Compared, comparison
from dacore.figures.cycle import ErrorHistory, cycle_errors
from dacore.figures.hero import Hidden, Measured, hero
from dacore.figures.inf_sup import InfSupCurve, inf_sup
from dacore.figures.modes import ModeField, modes, thin
from dacore.figures.parameters import ParameterPanel, parameters
from dacore.figures.quantity import QuantityPanel, quantity
from dacore.figures.slices import HEAD, Frame, Slab, View, scale
from dacore.figures.spectrum import Spectrum, spectrum
from dacore.figures.stability import RadiusCurve, RadiusMap, stability
from dacore.figures.style import look, percent_text, plain_text, png, pretty, share_text, svg
from dacore.figures.summary import summary
from dacore.figures.voxels import component_name, measured_slice, on_slice
from dacore.geometry.cut import cut_plane, planar_domain


@pytest.fixture(scope="module")
def view():
    grid = np.linspace(0.0, 4.0, 5)
    points = np.stack(np.meshgrid(grid, grid, grid, indexing="ij"), axis=-1).reshape(-1, 3)
    from scipy.spatial import Delaunay

    points = points + 0.05 * np.random.default_rng(0).standard_normal(points.shape)
    cells = Delaunay(points).simplices
    return View(cut_plane(points, cells, 0, 2.1), HEAD, (Slab(2, 1.0, 2.0),))


@pytest.fixture
def rng():
    return np.random.default_rng(1)


def drawn(figure):
    """Draw it (a warning fails the test), and return the axes that are not colour bars."""
    assert isinstance(figure, Figure)
    assert png(figure, dpi=40).startswith(b"\x89PNG")
    return [axes for axes in figure.axes if axes.get_label() != "<colorbar>" and axes.get_visible()]


def bars(figure):
    return [axes for axes in figure.axes if axes.get_label() == "<colorbar>"]


def bar_labels(figure):
    return [axes.get_ylabel() or axes.get_xlabel() for axes in bars(figure)]


def legend(figure):
    return [text.get_text() for text in figure.legends[0].get_texts()]


def test_spectrum_scales_values_and_draws_a_family_as_band_and_median():
    one, family = np.array([4.0, 2.0, 1.0]), np.array([[2.0, 1.0], [4.0, 1.0], [8.0, 1.0]])
    figure = spectrum([Spectrum("cycle", one), Spectrum("per phase", family)], caption="box")
    left, right = drawn(figure)
    assert left.get_yscale() == right.get_yscale() == "log"
    assert "[–]" in left.get_ylabel()
    np.testing.assert_allclose(left.lines[0].get_ydata(), [1.0, 0.5, 0.25])
    np.testing.assert_allclose(left.lines[1].get_ydata(), [1.0, 0.25])
    np.testing.assert_allclose(right.lines[0].get_ydata(), np.sqrt([1.0, 5 / 21, 1 / 21]))
    assert len(left.collections) == 1
    assert legend(figure) == ["cycle", "per phase"]
    np.testing.assert_array_equal(one, [4.0, 2.0, 1.0])


def test_spectrum_leaves_out_round_off_and_what_is_not_asked_for():
    figure = spectrum([Spectrum("s", np.array([1.0, 1e-3, 1e-20]))], largest=2)
    left, right = drawn(figure)
    assert len(left.lines[0].get_ydata()) == 2
    assert len(right.lines[0].get_ydata()) == 2
    with pytest.raises(ShapeError, match=r"expected \(r,\) or \(k, r\)"):
        Spectrum("s", np.zeros((2, 2, 2)))


def test_inf_sup_leaves_out_zeros():
    figure = inf_sup([InfSupCurve("one slice", np.arange(1, 4), np.array([0.9, 0.5, 0.0]))])
    (axes,) = drawn(figure)
    np.testing.assert_allclose(axes.lines[0].get_ydata(), [0.9, 0.5])
    assert "beta" in axes.get_ylabel()
    with pytest.raises(ShapeError, match="for 2 dimensions"):
        InfSupCurve("x", np.arange(2), np.ones(3))


def test_bound_marks_the_chosen_dimension_on_the_curve():
    n = np.arange(1, 6)
    curve = BoundCurve(
        "cycle", n, 1.0 / n, np.array([1.0, 1.0, 0.9, 0.1, 0.0]), 3, {"e_u": 0.1 / n, "e of p − p_csf": 1.0 / n}
    )
    figure = bound([curve, curve], caption="scene")
    panels = drawn(figure)
    assert len(panels) == 2
    star = next(line for line in panels[0].lines if line.get_marker() == "*")
    assert star.get_xydata()[0] == pytest.approx([3, 1 / 2.7])
    assert np.isinf(curve.bound[-1])
    assert any("$n$ = 3" in text.get_text() for text in panels[0].texts)
    assert len(legend(figure)) == 4
    with pytest.raises(ShapeError, match="not among the dimensions"):
        BoundCurve("x", n, 1.0 / n, np.ones(5), 9)
    with pytest.raises(ShapeError, match=r"β of 'x': got shape \(4,\)"):
        BoundCurve("x", n, 1.0 / n, np.ones(4))


def test_four_bounds_take_two_rows():
    n = np.arange(1, 4)
    assert len(drawn(bound([BoundCurve(str(i), n, 1.0 / n, np.ones(3)) for i in range(4)]))) == 4


def test_cycle_draws_cases_their_mean_and_the_prior(rng):
    times = 5e-4 * np.arange(1, 9)
    errors = {"e_u": rng.uniform(0.01, 0.1, (8, 5)), "e_p": rng.uniform(0.001, 0.1, (8, 5))}
    kept = errors["e_u"].copy()
    histories = [ErrorHistory("PBDW", errors), ErrorHistory("space–time", errors)]
    figure = cycle_errors(times, histories, {"e_u": np.full(8, 0.2)}, caption="10 % noise")
    panels = drawn(figure)
    assert len(panels) == 4
    lines = [line for line in panels[0].lines if len(line.get_xdata())]
    assert len(lines) == 5 + 1 + 1
    np.testing.assert_allclose(lines[5].get_ydata(), 100 * kept.mean(axis=1))
    np.testing.assert_allclose(lines[6].get_ydata(), 20.0)
    np.testing.assert_allclose(lines[0].get_xdata(), 1e3 * times)
    assert panels[-1].get_xlabel() == "time [ms]"
    assert panels[0].get_ylabel().endswith("[%]")
    assert "guessing the training mean" in legend(figure)
    np.testing.assert_array_equal(errors["e_u"], kept)
    with pytest.raises(ShapeError, match="expected \\(8, k\\)"):
        cycle_errors(times, [ErrorHistory("x", {"e_u": np.ones((7, 2))})], {})
    with pytest.raises(ShapeError, match=r"expected \['e_u', 'e_p'\]"):
        cycle_errors(times, [histories[0], ErrorHistory("x", {"e_u": np.ones((8, 2))})], {})


def test_cycle_takes_exact_estimates():
    figure = cycle_errors(np.arange(1, 4) * 1e-3, [ErrorHistory("exact", {"e_u": np.full((3, 2), 1e-17)})], {})
    assert len(drawn(figure)) == 1


def test_modes_are_scaled_and_arrows_drawn_for_vectors(view, rng):
    q = len(view.cut.points)
    u, p = rng.standard_normal((3, 3, q)), rng.standard_normal((3, 1, q))
    figure = modes(view, [ModeField("u", u), ModeField("p", p)])
    panels = drawn(figure)
    assert len(panels) == 6
    assert [axes.get_title() for axes in panels[:3]] == ["mode 1", "mode 2", "mode 3"]
    assert len(bars(figure)) == 2
    assert bar_labels(figure) == ["|u|, scaled  [–]", "p, scaled  [–]"]
    quivers = [any(type(c).__name__ == "Quiver" for c in axes.collections) for axes in panels]
    assert quivers == [True] * 3 + [False] * 3
    with pytest.raises(ShapeError, match=r"expected \(n, c, q\)"):
        ModeField("u", u[0])
    with pytest.raises(ShapeError, match="modes of 'p'"):
        modes(view, [ModeField("u", u), ModeField("p", p[:2])])


def test_thin_spreads_points(rng):
    points = rng.uniform(0, 1, (4000, 2))
    chosen = points[thin(points, 10)]
    assert 80 <= len(chosen) <= 110
    gaps = np.linalg.norm(chosen[:, None] - chosen[None], axis=2) + np.eye(len(chosen))
    assert gaps.min() > 0.03


def voxels():
    centres = np.stack(np.meshgrid([1.5, 2.5], [0.5, 1.5, 2.5, 3.5], [0.5, 1.5], indexing="ij"), -1).reshape(-1, 3)
    return np.tile(centres, (3, 1)), np.repeat(np.eye(3), len(centres), axis=0)


def test_measured_slice_has_a_column_a_component_and_a_row_a_data_set(view, rng):
    centres, directions = voxels()
    exact = 1e-3 * rng.uniform(1.0, 9.0, len(centres)) * rng.choice([-1.0, 1.0], len(centres))
    noisy = exact + 1e-4
    noisy[0] = np.nan
    near = on_slice(view, centres, (1.0, 1.0, 1.0))
    noisy[np.flatnonzero(near)[0]] = np.nan
    kept = noisy.copy()
    figure = measured_slice(view, centres, directions, (1, 1, 1), {"exact": exact, "10 % noise": noisy}, "cm")
    panels = drawn(figure)
    assert len(panels) == 6
    assert [axes.get_title() for axes in panels[:3]] == [pretty(f"u_{name}") for name in "xyz"]
    assert bar_labels(figure) == [pretty(f"u_{name}") + "  [10⁻³ cm]" for name in "xyz"]
    assert panels[3].get_ylabel().startswith("10 % noise\n")
    pixels = [c for c in panels[0].collections if c.get_array() is not None]
    assert near.sum() / 3 == 8
    assert pixels[0].get_array().size == 8
    np.testing.assert_allclose(pixels[0].get_array(), 1e3 * exact[near][:8])
    assert panels[0].get_xlim()[1] > 4.0
    assert [t.get_text() for t in figure.legends[0].get_texts()] == ["missing"]
    np.testing.assert_array_equal(noisy, kept)


def test_measured_scalar_has_one_column_and_errors_speak(view):
    centres, _ = voxels()
    ones = np.ones(len(centres))
    figure = measured_slice(view, centres, np.zeros_like(centres), (1, 1, 1), {"data": ones}, "dyn/cm²", name="p")
    assert [axes.get_title() for axes in drawn(figure)] == ["p"]
    assert bar_labels(figure) == ["p  [dyn/cm²]"]
    with pytest.raises(ShapeError, match="no voxel meets this slice; their centres run from 101"):
        measured_slice(view, centres + 100, np.zeros_like(centres), (1, 1, 1), {"data": ones}, "1")
    with pytest.raises(ShapeError, match="values of 'data'"):
        measured_slice(view, centres, np.zeros_like(centres), (1, 1, 1), {"data": ones[1:]}, "1")


def test_component_names():
    assert component_name("u", np.array([0.0, 1.0, 0.0]), "xyz") == "u_y"
    assert component_name("u", np.array([0.6, 0.8, 0.0]), "xyz") == "u·(0.6, 0.8, 0)"
    assert component_name("u", np.array([0.0, -1.0, 0.0]), "xyz") == "u·(0, -1, 0)"
    assert component_name("p", np.zeros(3), "xyz") == "p"


def test_comparison_shares_the_truths_scale_and_gives_each_difference_its_own(view):
    truth = view.cut.points[:, 0] * 1e-3
    rows = [
        Compared("|u|", "cm", truth, 3.0 * truth, label="PBDW"),
        Compared("|u|", "cm", truth, 1.01 * truth, label="space–time"),
        Compared("p − p_csf", "dyn/cm²", view.cut.points[:, 1] - 2.0, view.cut.points[:, 1] - 2.1),
    ]
    figure = comparison(view, rows, caption="t = 10 ms")
    panels = drawn(figure)
    assert len(panels) == 9
    assert [axes.get_title() for axes in panels[:3]] == ["truth", "reconstruction", "difference"]
    fills = [axes.collections[0] for axes in panels]
    assert fills[0].norm.vmax == fills[1].norm.vmax == fills[3].norm.vmax == fills[4].norm.vmax
    assert fills[2].norm.vmin == -fills[2].norm.vmax
    assert fills[2].norm.vmax != fills[5].norm.vmax
    assert fills[6].norm.vmin == -fills[6].norm.vmax
    labels = bar_labels(figure)
    assert labels[:2] == ["|u|  [10⁻³ cm]", "Δ|u|  [10⁻³ cm]"]
    assert labels[4] == pretty("p − p_csf") + "  [dyn/cm²]"
    assert figure.get_suptitle() == "t = 10 ms"
    assert panels[6].get_xlabel() == "y [cm] → front"
    assert panels[0].get_ylabel() == "z [cm] → top"


def test_comparison_with_deviation_and_given_difference(view):
    ones = np.ones(len(view.cut.points))
    rows = [
        Compared("|u|", "cm", ones, ones, deviation=0.1 * ones, difference=0.2 * ones),
        Compared("p", "1", ones, ones),
    ]
    figure = comparison(view, rows)
    panels = drawn(figure)
    assert len(panels) == 7
    assert [axes.get_title() for axes in panels[:4]][3] == "standard deviation"
    assert bar_labels(figure)[1:3] == ["|Δu|  [cm]", "std  [cm]"]
    assert figure.get_suptitle() == "sagittal plane x = 2.1 cm"
    fills = [axes.collections[0] for axes in panels[:4]]
    assert fills[3].norm.vmin == 0.0
    assert fills[3].norm.vmax == fills[2].norm.vmax
    with pytest.raises(ShapeError, match="one value a point of the cut"):
        comparison(view, [Compared("p", "1", ones, ones[1:])])


@pytest.mark.parametrize(("claimed", "shown"), [(0.5, 1.0), (2.0, 2.0), (50.0, 3.0)])
def test_claims_and_errors_share_a_scale_that_tells_errors_apart(view, claimed, shown):
    error = np.linspace(-1.0, 1.0, len(view.cut.points))
    row = Compared("p", "1", 0 * error, error, deviation=np.full_like(error, claimed), inside=0.625)
    figure = comparison(view, [row])
    panels = drawn(figure)
    difference, deviation = (axes.collections[0].norm for axes in panels[2:])
    assert (difference.vmin, difference.vmax) == (-shown, shown)
    assert (deviation.vmin, deviation.vmax) == (0.0, shown)
    assert [text.get_text() for text in panels[3].texts] == ["62% of errors within 2 std"]


def test_parameters_have_a_panel_each_in_their_range_and_are_grey_if_not_seen(rng):
    truth = np.array([2e-9, 5e-9, 8e-9])
    values = {"no noise": (truth, 1e-10 + 0 * truth), "10% noise": (5e-9 + 0 * truth, 2e-9 + 0 * truth)}
    seen = ParameterPanel("kappa", "cm²", 1e-9, 1e-8, truth, values, {"no noise": 0.9998, "10% noise": 0.02})
    unseen = ParameterPanel("E", "dyn/cm²", 1e3, 1e5, 1e13 * truth, {}, {"no noise": 0.03}, logarithmic=True)
    panels = drawn(parameters([seen, unseen], "case"))
    assert [axes.get_title() for axes in panels] == ["kappa  [10⁻⁹ cm²]", "E  [dyn/cm²]"]
    assert [text.get_text() for text in panels[0].texts] == ["learned 99.98% / 2%"]
    assert panels[0].get_facecolor() != panels[1].get_facecolor()
    assert panels[0].get_xlim() == panels[0].get_ylim()
    assert panels[0].get_xlim()[0] < 1.0 < 10.0 < panels[0].get_xlim()[1]
    assert panels[1].get_xscale() == "log"
    dots = next(line for line in panels[0].lines if line.get_label() == "no noise")
    np.testing.assert_allclose(dots.get_xydata(), 1e9 * np.stack([truth, truth], axis=1))
    with pytest.raises(ShapeError, match="kappa, x: got shapes"):
        ParameterPanel("kappa", "cm²", 0.0, 1.0, truth, {"x": (truth[1:], truth)}, {})
    with pytest.raises(ShapeError, match="no panel"):
        parameters([])


def test_shares_near_all_keep_their_digits():
    assert [share_text(each) for each in (-0.2, 0.004, 0.634, 0.9, 0.9997, 1.0)] == [
        "0%", "0%", "63%", "90%", "99.97%", "100%",
    ]  # fmt: skip


def test_a_legend_is_no_wider_than_its_figure():
    long = [Spectrum(f"an estimator with quite a long title, number {k}", np.ones(3)) for k in range(5)]
    figure = spectrum(long)
    drawn(figure)
    figure.canvas.draw()
    box = figure.legends[0].get_window_extent()
    assert box.width <= figure.get_figwidth() * figure.dpi
    assert plain_text(pretty("p − p_csf")) == "p − pcsf"


def test_the_measured_slab_is_drawn_only_across_the_view(view):
    ones = view.cut.points[:, 0]
    across = comparison(view, [Compared("p", "1", ones, ones)])
    along = comparison(View(view.cut, HEAD, (Slab(0, 1.0, 2.0),)), [Compared("p", "1", ones, ones)])
    assert len(drawn(across)[0].lines) == 4
    assert len(drawn(along)[0].lines) == 0
    assert legend(across) == ["measured slice"]
    assert along.legends == []


def test_a_planar_domain_needs_no_cut():
    points = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 1.0]])
    flat = View(planar_domain(points, np.array([[0, 1, 2], [0, 2, 3]])), Frame())
    panels = drawn(comparison(flat, [Compared("T", "K", points[:, 0], points[:, 1])], caption="plate"))
    assert panels[0].get_xlabel() == "x [cm]"


def test_quantity_panels_share_axes_and_count_what_is_outside(rng):
    truth = rng.uniform(1e4, 1.1e4, 12)
    wild = truth.copy()
    wild[:2] = [5e4, -5e4]
    panels = [
        QuantityPanel("PBDW", "10 % noise", truth, wild),
        QuantityPanel("space–time", "10 % noise", truth, truth + 50.0, np.full(12, 60.0)),
        QuantityPanel("space–time", "no noise", truth, truth),
    ]
    figure = quantity(panels, "p_v", "dyn/cm²", (10500.0, 289.0), caption="box")
    axes = drawn(figure)
    assert len(axes) == 3
    assert "2 of 12 outside" in axes[0].texts[0].get_text()
    assert axes[1].texts[0].get_text() == "rms error 50"
    assert axes[0].get_xlim() == axes[0].get_ylim() == axes[1].get_ylim()
    assert axes[0].get_ylim()[1] < 1.3e4
    assert axes[-1].get_xlabel() == "true " + pretty("p_v") + "  [dyn/cm²]"
    assert legend(figure) == ["training mean ± std", "estimate = truth", "90 % interval"]
    with pytest.raises(ShapeError, match="deviation of 'x'"):
        QuantityPanel("x", "", truth, truth, np.ones(3))


def test_summary_puts_each_error_at_its_place():
    errors = {"e_u": np.array([[0.01, 0.2], [0.001, np.nan]]), "p_v": np.array([[100.0, 200.0], [1.0, 90.0]])}
    figure = summary(["a", "b"], ["no noise", "10 %"], errors, {"e_u": 0.2, "p_v": 278.0}, units={"p_v": "dyn/cm²"})
    left, right = drawn(figure)
    points = [line for line in left.lines if line.get_marker() == "o"]
    np.testing.assert_allclose(points[0].get_xdata(), [1.0, 0.1])
    assert [left.get_xlabel(), right.get_xlabel()] == ["error  [%]", "error  [dyn/cm²]"]
    assert left.get_xscale() == "log"
    assert [label.get_text() for label in left.get_yticklabels()] == ["a", "b"]
    assert legend(figure) == ["no noise", "10 %", "guessing the training mean"]
    with pytest.raises(ShapeError, match=r"expected \(2, 2\)"):
        summary(["a", "b"], ["x", "y"], {"e_u": np.ones((2, 3))}, {})


def test_hero_has_measured_recovered_and_truth_on_one_scale(view, rng):
    centres, _ = voxels()
    centres = centres[:16]
    truth = np.exp(-((view.cut.points - 2.0) ** 2).sum(axis=1))
    measured = Measured(view, centres, (1, 1, 1), rng.standard_normal(16), "u_y", "cm", "10 % noise")
    figure = hero(measured, Hidden(view, truth, 1.1 * truth, "p − p_csf", "dyn/cm²", "error 12 %"))
    titles = [axes.get_title() for axes in drawn(figure)]
    assert titles == ["measured", "", "recovered", "truth"]
    right, true = drawn(figure)[2:]
    assert right.collections[0].norm.vmax == true.collections[0].norm.vmax
    assert sorted(bar_labels(figure)) == sorted([pretty("u_y") + "  [cm]", pretty("p − p_csf") + "  [dyn/cm²]"])


@pytest.mark.parametrize(
    ("values", "low", "high", "power"),
    [
        ([0.0, 5.0], 0.0, 5.0, 0),
        ([-1e-4, 5e-4], -5e-4, 5e-4, -6),
        ([1e4, 1.1e4], 1e4, 1.1e4, 0),
        ([3.0, 3.0], 1.5, 4.5, 0),
        ([0.0, 0.0], -0.5, 0.5, 0),
        ([np.nan, 2e6], 1e6, 3e6, 6),
    ],
)
def test_scales(values, low, high, power):
    made = scale(np.array(values))
    assert (made.low, made.high, made.power) == (pytest.approx(low), pytest.approx(high), power)
    assert made.colours == ("RdBu_r" if values[0] < 0 else "viridis")


def test_scale_labels():
    assert scale(np.array([0.0, 5e-4])).label("|u|", "cm") == "|u|  [10⁻⁶ cm]"
    assert scale(np.array([0.0, 5e-4])).label("s", "1") == "s  [10⁻⁶]"
    assert scale(np.array([0.0, 5.0])).label("s", "1") == "s  [–]"
    assert scale(np.array([0.0, 5.0])).label("s", "1/s") == "s  [1/s]"
    assert scale(np.zeros(0)).norm.vmin < scale(np.zeros(0)).norm.vmax


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("e_u", r"e$_{\mathrm{u}}$"),
        ("p − p_csf, β_n.", r"p − p$_{\mathrm{csf}}$, β$_{\mathrm{n}}$."),
        ("brain_zero.toml and a_b.py", "brain_zero.toml and a_b.py"),
        ("costs $5 or $6", r"costs \$5 or \$6"),
    ],
)
def test_pretty(text, expected):
    assert pretty(text) == expected


def test_percent_text():
    assert [percent_text(v) for v in (0.01, 2.13, 39.2, 140.4, 10.0, 0.0, 1e-5, 2e6)] == [
        "0.01 %", "2.1 %", "39 %", "140 %", "10 %", "0 %", "1e-5 %", "2e6 %",
    ]  # fmt: skip


def test_text_of_a_user_is_never_parsed_as_mathematics():
    odd = r"$\frac{ \x _ ^ & % # {"
    drawn(inf_sup([InfSupCurve(odd, np.arange(1, 3), np.array([0.9, 0.5]))], caption=odd))


def test_drawing_leaves_matplotlib_alone_and_is_reproducible():
    before = dict(mpl.rcParams)
    curve = [InfSupCurve("x", np.arange(1, 3), np.array([0.9, 0.5]))]
    first, second = inf_sup(curve), inf_sup(curve)
    assert svg(first) == svg(second)
    assert png(first) == png(second)
    assert dict(mpl.rcParams) == before


def test_no_figure_imports_pyplot():
    import subprocess
    import sys

    code = (
        "import sys, pkgutil, importlib, dacore.figures as f\n"
        "[importlib.import_module('dacore.figures.' + m.name) for m in pkgutil.iter_modules(f.__path__)]\n"
        "sys.exit('matplotlib.pyplot' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_stability_shows_a_map_for_each_rule_and_the_line_of_the_theory():
    betas, gammas = np.linspace(0.1, 0.7, 5), np.linspace(0.3, 1.3, 7)
    radii = 1 + np.maximum(0.0, gammas - 2 * betas[:, None])
    frequencies = np.logspace(-1, 3, 9)
    maps = [RadiusMap("backward Euler", betas, gammas, radii), RadiusMap("newmark", betas, gammas, radii)]
    figure = stability(maps, [RadiusCurve("damped", frequencies, 1 / (1 + frequencies))], "seen")
    first, second, curves = drawn(figure)
    assert [axes.get_title() for axes in (first, second)] == ["backward Euler", "newmark"]
    assert (first.get_xlabel(), first.get_ylabel(), curves.get_xlabel()) == ("β", "γ", "ωτ")
    np.testing.assert_allclose(first.lines[0].get_xydata(), [[0.25, 0.5], [0.65, 1.3]])
    assert legend(figure) == ["damped"]
    assert bar_labels(figure) == ["largest growth per step"] * 2
    with pytest.raises(ShapeError, match="map 'turned': got shape"):
        stability([RadiusMap("turned", gammas, betas, radii)], [])


def test_the_look_puts_back_what_it_changed_and_nothing_else():
    before = dict(mpl.rcParams)
    with look():
        assert dict(mpl.rcParams) != before
        mpl.rcParams["interactive"] = not before["interactive"]  # as a notebook's backend does when it is first loaded
    changed = {key for key, value in mpl.rcParams.items() if value != before[key]}
    mpl.rcParams["interactive"] = before["interactive"]
    assert changed == {"interactive"}
