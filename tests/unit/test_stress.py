"""The catalogue of hard cases: how it judges, that its references are right, what it says of the toy, and its page."""

import json
import logging
import re
import warnings
from pathlib import Path

import numpy as np
import pytest
from scipy.sparse import csr_array

from dacore.algebra.solvers import Direct
from dacore.core.timegrid import TimeGrid
from dacore.dynamics.march import MarchedModel
from dacore.errors import ConvergenceError, MissingDependencyError, SceneError, ShapeError, StoreError
from dacore.workflow.stress import needs
from dacore.workflow.stress.case import Case, Inapplicable, Outcome, judge
from dacore.workflow.stress.catalogue import CATALOGUE, chosen, themes
from dacore.workflow.stress.context import open_context
from dacore.workflow.stress.marching import Steps, march
from dacore.workflow.stress.output import BEGIN, END, publish, tables, update
from dacore.workflow.stress.reference import Extended, dense_solve, least_squares
from dacore.workflow.stress.run import stress

mpmath = pytest.importorskip("mpmath")

ROOT = Path(__file__).resolve().parents[2]
TOY = ROOT / "examples/toy/ball.toml"
SMALL = ("domain.edge=2.5",)

# Verdicts on the toy ball; whatever is not named here is stable.
EXPECTED = {
    "refused": (
        "nu = 0.5", "nu = 1/2 - 1e-12, tolerance 1e-13",
        "no storage, no permeability", "E = NaN", "steady start, free pressure", "steady start, free body",
        "steady start, undetermined pressure",
        "Newmark beta = 1/4, gamma = 1", "Newmark beta = 1/2 - 1e-9, gamma = 1", "direct, tolerance 1e-18",
        "krylov, tolerance 1e-18", "krylov, nu = 0.499999", "direct, singular matrix", "krylov, singular matrix",
        "duplicated voxels, PBDW", "contradictory voxels, PBDW", "nearly parallel, 1e-9", "functional of zeros",
        "functional with NaN", "slice outside", "sensor outside", "mask of integers", "NaN in the data",
        "infinite data",
        "all data masked, PBDW", "all data masked, minimum variance", "complex data", "transposed data", "n = m + 1",
        "n > samples", "mask leaves m < n, PBDW", "mode seen to 1e-11", "one snapshot, centred", "noise scale NaN",
        "noise scale negative", "noise of 1e-200", "noise of 1e200", "identical snapshots, PBDW",
        "identical snapshots, minimum variance", "snapshots of rank 3, n = 4",
        "snapshots of size 1e-160", "snapshots of size 1e160", "snapshot with NaN",
    ),
    "degraded": (
        "locking, nu = 0.4999", "unit too small, PBDW", "unit too small, minimum variance",
        "unit too large, PBDW", "unit too large, minimum variance", "wrong sign, minimum variance",
        "deviation, 10% noise", "deviation, PBDW, 10% noise", "deviation, zeta x 1e12", "unseen field, model",
        "constant 1e3 times what varies", "constant 1e6 times what varies",
    ),
}  # fmt: skip
# On the border between two verdicts on so coarse a mesh.
EITHER = {
    "compression to 1e-17": {"stable", "refused"},
    "krylov, tolerance 1e-3": {"stable", "degraded"},
    "deviation, no noise": {"stable", "degraded"},
    "locking, nu = 0.49": {"stable", "degraded"},
    "little seepage, none": {"stable", "degraded"},
}


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    return tmp_path_factory.mktemp("stress")


@pytest.fixture(scope="module")
def context(cache):
    return open_context(TOY, SMALL, cache)


@pytest.fixture(scope="module")
def stressed(cache):
    return stress(TOY, CATALOGUE, SMALL, cache)


def case(run, name="a case"):
    return Case(name, "data", "something", "for some reason", run)


def verdict(run, context):
    return judge(case(run), context).verdict


def test_verdicts_follow_from_error_bound_and_what_is_said(context):
    assert verdict(lambda _: Outcome(1e-9, 1e-8), context) == "stable"
    assert verdict(lambda _: Outcome(1e-7, 1e-8), context) == "wrong"
    assert verdict(lambda _: Outcome(1e-7, 1e-8, "β = 1e-9"), context) == "degraded"
    assert verdict(lambda _: Outcome(np.nan, 1e-8), context) == "wrong"
    assert verdict(lambda _: Outcome(np.nan, 1e-8, "it said so"), context) == "wrong"
    assert verdict(lambda _: Outcome(np.inf, 1e-8, "it said so"), context) == "wrong"


def raises(error):
    def run():
        raise error

    return run


def test_a_refusal_counts_only_where_dacore_was_asked_and_only_with_advice(context):
    advised = ShapeError("n: got 3, expected 2")
    assert verdict(lambda c: c.ask(raises(advised)), context) == "refused"
    assert verdict(raises_in_case(advised), context) == "crashed", "an error in the case's own work is no answer"
    assert verdict(lambda c: c.ask(raises(ShapeError("no"))), context) == "crashed"
    assert verdict(lambda c: c.ask(raises(ShapeError("n: got 3,\nexpected 2"))), context) == "crashed"
    assert verdict(lambda c: c.ask(raises(ValueError("n: got 3, expected 2"))), context) == "crashed"
    assert verdict(raises_in_case(Inapplicable("no such parameter")), context) == "not applicable"


def raises_in_case(error):
    return lambda _: raises(error)()


def test_what_dacore_logs_or_warns_of_counts_as_told_and_what_numpy_does_does_not(context):
    def logged(c):
        c.ask(lambda: logging.getLogger("dacore.somewhere").warning("beware of %d", 3))
        return Outcome(1.0, 0.0)

    def from_elsewhere(c):
        c.ask(lambda: logging.getLogger("matplotlib").warning("beware"))
        return Outcome(1.0, 0.0)

    def by_numpy(c):
        c.ask(lambda: np.log(np.zeros(1)))
        return Outcome(1.0, 0.0)

    def warned(c):
        c.ask(lambda: warnings.warn("beware", UserWarning, stacklevel=1))
        return Outcome(1.0, 0.0)

    assert judge(case(logged), context).said == "beware of 3"
    assert [verdict(run, context) for run in (logged, warned, from_elsewhere, by_numpy)] == [
        "degraded", "degraded", "wrong", "wrong",
    ]  # fmt: skip
    assert judge(case(lambda _: Outcome(0.0, 0.0)), context).said == "", "what one case heard is forgotten in the next"


def test_the_references_solve_what_double_precision_does_not():
    n = 12
    hilbert = np.array([[1.0 / (i + j + 1) for j in range(n)] for i in range(n)])  # condition 1.7e16
    exact = np.linspace(-1, 1, n)
    with mpmath.workdps(60):
        product = mpmath.matrix(hilbert.tolist()) * mpmath.matrix(exact.tolist())
        right = np.array([np.longdouble(mpmath.nstr(value, 25)) for value in product])
    assert np.abs(np.linalg.solve(hilbert, right.astype(float)) - exact).max() > 1e-3
    assert np.abs(dense_solve(hilbert, right[:, None])[:, 0] - exact).max() < 1e-2
    tall = np.vstack([hilbert[:, :8], 1e-3 * np.eye(8)])
    weights = exact[:8]
    found = least_squares(tall, (np.asarray(tall, np.longdouble) @ weights)[:, None])[:, 0]
    assert np.abs(found - weights).max() < 1e-15


def test_refinement_in_extended_precision_and_its_condition_number():
    rng = np.random.default_rng(0)
    q, _ = np.linalg.qr(rng.standard_normal((40, 40)))
    r, _ = np.linalg.qr(rng.standard_normal((40, 40)))
    scale = 10.0 ** rng.integers(-30, 30, 40)
    matrix = (q * np.geomspace(1, 1e-9, 40)) @ r * scale
    solver = Extended(csr_array(matrix))
    exact = np.asarray(rng.standard_normal(40), np.longdouble) / scale
    found = solver.solve(np.asarray(matrix, np.longdouble) @ exact)
    assert np.abs((found - exact) * scale).max() < 1e-9
    assert 1e8 < solver.condition < 1e12
    with pytest.raises(ConvergenceError, match="singular"):
        Extended(csr_array(np.outer(np.ones(4), np.arange(1.0, 5.0)))).solve(np.arange(4.0))


@pytest.mark.parametrize("changes", [(), ("time.scheme=generalized_alpha", "time.rho_inf=0.2")])
@pytest.mark.parametrize("gap", [1e-5, 1e-6, 1e-8, 1e-10, 1e-12])
def test_near_incompressibility_a_residual_is_met_or_refused_and_refused_at_the_floor_of_rounding_only(
    cache, gap, changes
):
    """Backward error for ν within 1e-5 of 1/2: what is answered solves its equations, to the last digits if asked."""
    context = open_context(TOY, (*SMALL, *changes), cache)
    values = context.parameters(nu=0.5 - gap)
    system = Steps(context.model, values, context.scheme, context.step, 3)
    answered = {}
    for tolerance in 10.0 ** np.arange(-9.0, -17.0, -1.0):
        own = MarchedModel(context.model, TimeGrid(context.step, 3), context.scheme, "zero", Direct(), tolerance)
        try:
            found = own.solve(values).states
        except ConvergenceError:
            break
        answered[tolerance] = system.residuals(found)
        # The right side of a scheme that solves for a moment within the step is another one there.
        assert answered[tolerance].relative <= 3.0 * (tolerance + answered[tolerance].floor)
    last = answered[min(answered)]
    # One decade further is refused: below what rounding the answer leaves, times a few.
    assert last.relative < 3.0 * last.floor
    assert 0.1 * min(answered) < 10.0 * last.floor


@pytest.mark.parametrize(
    "changes",
    [
        ("time.scheme=generalized_alpha",),
        ("time.scheme=generalized_alpha", "time.rho_inf=0.0", "physics.ramp=0.005"),
        ("time.scheme=generalized_alpha", "time.rho_inf=1.0", "time.step=2e-4"),
        ("time.beta=0.3025", "time.gamma=0.6", "time.first_order=newmark"),
        (),
    ],
)
def test_the_plain_march_is_that_of_the_scenes_own_scheme(cache, changes):
    """Two codes of each scheme, after a jump and from a smooth start, agree far below what a step is worth."""
    context = open_context(TOY, (*SMALL, *changes), cache)
    values = context.parameters()
    own = MarchedModel(context.model, TimeGrid(context.step, 6), context.scheme, "zero", Direct(), 1e-12)
    expected = march(context.model, values, context.scheme, context.step, 6)
    assert context.difference(own.solve(values).states, expected.states.astype(np.float64)) < 1e-9
    halved = march(context.model, values, context.scheme, context.step / 2, 12)
    assert context.difference(halved.states[:, 1::2].astype(np.float64), expected.states.astype(np.float64)) > 1e-3


def test_bounds_of_marches_are_near_what_is_measured(context):
    """A bound that is far above every error would excuse anything."""
    found = {each.name: judge(each, context) for each in CATALOGUE if each.theme in ("physics", "solvers")}
    marched = [each for each in found.values() if each.verdict == "stable" and "condition of a step" in each.note]
    assert len(marched) >= 15
    ratios = [each.bound / each.error for each in marched]
    assert all(1.0 <= ratio < 40.0 for ratio in ratios), {each.case.name: each.bound / each.error for each in marched}
    assert np.median(ratios) < 15.0


def test_a_small_silent_error_of_dacore_is_found(context, monkeypatch):
    """The catalogue can fail: trajectories off by a thousandth are wrong in every case of the march."""
    right = MarchedModel.solve

    def off(self, parameters):
        trajectory = right(self, parameters)
        return type(trajectory)(1.001 * trajectory.states, trajectory.times)

    monkeypatch.setattr(MarchedModel, "solve", off)
    for name in ("nu = 0.49", "SI units", "krylov, tolerance 1e-13"):
        (one,) = [each for each in CATALOGUE if each.name == name]
        assert judge(one, context).verdict == "wrong"


def test_the_verdicts_on_the_toy(stressed):
    found = {each.case.name: each for each in stressed.judged}
    wanted = {name: word for word, names in EXPECTED.items() for name in names}
    assert not set(wanted) - set(found)
    for name, each in found.items():
        allowed = EITHER.get(name, {wanted.get(name, "stable")})
        assert each.verdict in allowed, f"{name}: {each.verdict} ({each.said}), error {each.error}, bound {each.bound}"
    assert not stressed.failed


def test_names_are_unique_and_themes_are_many():
    assert len({each.name for each in CATALOGUE}) == len(CATALOGUE) >= 40
    assert len(themes()) == 8
    assert all(each.stressed and each.hard for each in CATALOGUE)


def test_cases_are_chosen_by_theme_and_by_part_of_a_name():
    assert {each.theme for each in chosen(["noise", "data"])} == {"noise", "data"}
    assert [each.name for each in chosen([], "n = m + 1")] == ["n = m + 1"]
    with pytest.raises(SceneError, match=r"'moods'.*physics"):
        chosen(["moods"])
    with pytest.raises(SceneError, match="no name contains"):
        chosen([], "no such case")


def test_everything_is_written_down(stressed, tmp_path):
    publish(stressed, tmp_path, "dacore stress …")
    content = json.loads((tmp_path / "stress.json").read_text())
    assert [each["name"] for each in content["cases"]] == [each.name for each in CATALOGUE]
    assert sum(content["verdicts"].values()) == len(CATALOGUE)
    assert content["sizes"]["trajectories"] == 12
    page = (tmp_path / "report.html").read_text()
    assert "nearly parallel, 1e-9" in page
    assert len(tables(stressed)) == len(themes()) + 1


def test_a_page_is_updated_between_its_markers_only(stressed, tmp_path):
    page = tmp_path / "page.md"
    page.write_text(f"before\n{BEGIN}\nstale\n{END}\nafter\n")
    update(stressed, page)
    once = page.read_text()
    assert once.startswith("before\n")
    assert once.endswith("\nafter\n")
    assert "stale" not in once
    assert "| n = m + 1 |" in once
    update(stressed, page)
    assert page.read_text() == once
    page.write_text("no markers")
    with pytest.raises(StoreError, match="expected lines"):
        update(stressed, page)
    with pytest.raises(StoreError, match="cannot be read"):
        update(stressed, tmp_path / "none.md")


def test_the_page_of_the_docs_names_every_case():
    text = (ROOT / "docs/stress.md").read_text(encoding="utf-8")
    part = text[text.index(BEGIN) : text.index(END)]
    rows = [line.strip("|").split(" | ") for line in part.splitlines() if line.startswith("| ")]
    documented = [row[0].strip().replace("&lt;", "<") for row in rows if row[0].strip() != "case"]
    assert documented == [each.name for each in CATALOGUE], (
        "run: dacore stress examples/toy/ball.toml --page docs/stress.md"
    )
    assert not re.search(r"\b20\d\d-\d\d-\d\d\b", part), "a date would change with every run"
    failed = [row[0].strip() for row in rows if "**wrong**" in row[3] or "**crashed**" in row[3]]
    assert not failed


def test_without_mpmath_one_line_says_how_to_get_it(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "mpmath", None)
    with pytest.raises(MissingDependencyError, match=r"dacore\[stress\]"):
        needs.mpmath()
