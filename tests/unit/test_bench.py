"""Benchmarks of a scene: frontier, advice, growth, and the errors they are made of."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from dacore.errors import SceneError
from dacore.workflow.bench.frontier import cheapest, frontier, growth
from dacore.workflow.bench.output import publish
from dacore.workflow.bench.run import bench
from dacore.workflow.bench.tables import advice_table, growth_table, point_table
from dacore.workflow.comparison.variants import Axis, axis_of

ROOT = Path(__file__).resolve().parents[2]
TOY = ROOT / "examples/toy/ball.toml"
SMALL = (
    "domain.edge=2.0", "time.steps=4", "training.samples=8", "validation.cases=2", "noise.levels=[0.0]",
    "estimator.pbdw_per_phase.n=3", "observation.slice.coverage=0.98",
)  # fmt: skip


def test_a_point_is_efficient_if_none_beats_it_in_both():
    costs = np.array([1.0, 2.0, 2.0, 3.0, 4.0, np.nan, 0.5])
    errors = np.array([0.5, 0.6, 0.1, 0.1, 0.01, 1e-9, np.nan])
    assert frontier(costs, errors).tolist() == [True, False, True, False, True, False, False]
    rng = np.random.default_rng(0)
    costs, errors = rng.uniform(size=(2, 60))
    beaten = [((costs <= c) & (errors <= e) & ((costs < c) | (errors < e))).any() for c, e in zip(costs, errors)]
    assert frontier(costs, errors).tolist() == [not each for each in beaten]


def test_advice_is_the_cheapest_that_is_accurate_enough():
    costs, errors = np.array([5.0, 1.0, 2.0]), np.array([1e-3, 0.2, 0.05])
    assert [cheapest(costs, errors, wanted) for wanted in (0.3, 0.1, 1e-2, 1e-5)] == [1, 2, 0, None]


def test_growth_is_the_power_of_a_power_law():
    sizes = np.array([1e3, 4e3, 2e4])
    fit = growth(sizes, 3e-7 * sizes**1.4)
    assert fit.exponent == pytest.approx(1.4)
    assert fit.at(1e6) == pytest.approx(3e-7 * 1e6**1.4)
    assert fit.scatter == pytest.approx(1.0)
    assert growth(sizes, [1.0, np.nan, np.nan]) is None
    assert growth([7, 7], [1.0, 2.0]) is None
    assert growth(sizes, [1.0, 9.0, 10.0]).scatter > 1.3


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    only = ("time step", "mesh", "voxels", "dimension", "minimum variance")
    cache = tmp_path_factory.mktemp("cache")
    return bench(TOY, SMALL, axis_of("domain.edge=3.0,2.0"), [], only, cache, workers=1)


def of_sweep(measured, name):
    return {point.label: point for point in measured.points if point.sweep.name == name}


def test_nothing_failed_and_every_point_has_work_memory_and_errors(measured):
    for point in measured.points:
        assert point.error == "", point.name
        assert point.costs["work"] > 0.0
        assert point.costs["memory"] > 50.0
        assert point.errors
        assert all(value >= 0.0 or np.isnan(value) for value in point.errors.values())


def test_shorter_steps_and_finer_meshes_come_closer_to_the_reference(measured):
    steps = of_sweep(measured, "time step")
    assert list(steps) == ["1 substep", "2 substeps", "4 substeps", "8 substeps"]
    assert steps["8 substeps"].errors["u"] < 0.7 * steps["1 substep"].errors["u"]
    mesh = of_sweep(measured, "mesh")
    assert mesh["2.0"].errors["u"] < mesh["3.0"].errors["u"]
    assert mesh["3.0"].facts["nodes"] < mesh["2.0"].facts["nodes"]
    # The scene as it stands is a point of several sweeps: the same error each time.
    assert mesh["2.0"].errors["p"] == pytest.approx(steps["1 substep"].errors["p"], rel=1e-9)
    assert set(measured.doubt) == {"u", "p", "p − p_csf"}
    assert 0.0 < measured.doubt["u"] < steps["1 substep"].errors["u"]


def test_quadratures_approach_the_exact_integrals(measured):
    found = of_sweep(measured, "quadrature of slice")
    assert found["exact"].errors["measured values"] == 0.0
    known = [
        found[k].errors["measured values"] for k in ("2", "4", "8") if np.isfinite(found[k].errors["measured values"])
    ]
    assert len(known) >= 2
    assert known[-1] < known[0]


def test_estimates_are_measured_for_every_dimension_that_the_samples_allow(measured):
    assert list(of_sweep(measured, "dimension n of pbdw_per_phase")) == ["2", "4"]
    assert {point.sweep.name for point in measured.of("estimate")} >= {"minimum variance"}


def test_tables_and_files_hold_every_point(measured, tmp_path):
    files = publish(measured, tmp_path, "dacore bench ball.toml")
    content = json.loads((tmp_path / "bench.json").read_text(encoding="utf-8"))
    assert len(content["points"]) == len(measured.points)
    assert content["reference"]["domain.edge"] == 2.0
    assert set(content["growth"]) == {"assembly", "analysis", "trajectory", "memory"}
    with (tmp_path / "bench.csv").open(encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == len(measured.points)
    assert float(rows[0]["cost: work"]) == measured.points[0].costs["work"]
    assert all(path.stat().st_size > 0 for path in files)
    pictures = {path.name for path in (tmp_path / "figures").iterdir()}
    assert pictures == {f"{kind}_work_precision.png" for kind in ("forward", "voxels", "estimate")} | {"growth.png"}
    table = point_table(measured, "forward")
    assert len(table.rows) == len(measured.of("forward")) + 1, "the reference's own doubt stands below the points"
    assert advice_table(measured, "forward").rows
    assert growth_table(measured).headers[-1] == "10⁶ nodes?"


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: bench(TOY, SMALL, only=("speed",)), "--only: got 'speed', expected forward, voxels, estimate"),
        (lambda: bench(TOY, SMALL, Axis("domain.edgy", (1, 2))), "edgy: unknown key"),
        (lambda: bench(TOY, (*SMALL, "discretization.backend=fenics")), "discretization.backend"),
    ],
)
def test_mistakes_are_one_line_before_anything_runs(make, message):
    with pytest.raises(SceneError, match=message) as caught:
        make()
    assert "\n" not in str(caught.value)


def test_a_point_that_fails_is_said_to_and_the_others_go_on():
    found = bench(TOY, SMALL, extra=[axis_of("solver.tolerance=1e-300,1e-8")], only=("solver.tolerance",))
    failed, fine = found.points
    assert "relative residual" in failed.error
    assert fine.errors["u"] > 0.0
