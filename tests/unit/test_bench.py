"""Benchmarks of a scene: frontier, advice, growth, and the errors they are made of."""

import csv
import json
import os
import sys
from pathlib import Path

import numpy as np
import pytest

from dacore.errors import SceneError
from dacore.figures.style import log_axis, sheet
from dacore.figures.ticks import number_label
from dacore.io.scene import read_table
from dacore.workflow.bench import run
from dacore.workflow.bench.frontier import cheapest, frontier, growth
from dacore.workflow.bench.output import publish
from dacore.workflow.bench.point import Point, against_exact
from dacore.workflow.bench.reference import references
from dacore.workflow.bench.run import bench
from dacore.workflow.bench.sweeps import Sweep, axes_of, default_sweeps
from dacore.workflow.bench.tables import advice_table, failed_table, growth_table, growths, point_table
from dacore.workflow.comparison.run import checked
from dacore.workflow.comparison.variants import Axis, Variant, axis_of

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
    # Errors that differ in the third digit are one error: the cheapest point that has it will do.
    costs, errors = np.array([1.0, 2.0, 3.0, 4.0]), np.array([0.2, 0.1999, 0.18, 0.1795])
    assert frontier(costs, errors).all()
    assert frontier(costs, errors, 0.05).tolist() == [True, False, True, False]
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
    assert set(content["growth"]) == {"assembly", "ordering", "set-up", "a step", "trajectory", "memory"}
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
    found = bench(TOY, SMALL, extra=[axes_of("solver.tolerance=1e-300,1e-8")], only=("solver.tolerance",))
    failed, fine = found.points
    assert "relative residual" in failed.error
    assert fine.errors["u"] > 0.0
    assert found.failures == {failed.name: failed.error}
    assert failed_table(found).rows == [[failed.name, failed.error]]


def test_without_a_reference_there_are_costs_and_its_fault_and_the_estimates_go_on(tmp_path):
    only = ("mesh", "minimum variance")
    found = bench(
        TOY, SMALL, axis_of("domain.edge=3.0,2.5"), only=only, workers=1, reference=[axis_of("solver.tolerance=1e-300")]
    )
    assert list(found.failures) == ["the reference"]
    assert "relative residual" in found.failures["the reference"]
    coarse = found.of("forward")[0]
    assert not coarse.errors
    assert 0.0 < coarse.costs["step"] < coarse.costs["trajectory"]
    assert coarse.facts["solver"] == "direct solver"
    assert found.of("estimate")[0].errors
    assert len(point_table(found, "forward").rows) == 2
    assert growth_table(found) is not None
    assert advice_table(found, "forward") is None
    publish(found, tmp_path, "dacore bench ball.toml")
    content = json.loads((tmp_path / "bench.json").read_text(encoding="utf-8"))
    assert list(content["failures"]) == ["the reference"]
    assert {path.name for path in (tmp_path / "figures").iterdir()} == {"estimate_work_precision.png", "growth.png"}


def test_a_process_that_is_killed_is_a_failed_point(monkeypatch, tmp_path):
    """What a machine short of memory does to a point; the others go on."""
    right = run.run_job
    killed = tmp_path / "killed"
    killed.write_text("#!/bin/sh\nkill -9 $$\n")
    killed.chmod(0o755)

    def killing(job, label, number, board):
        with monkeypatch.context() as inside:
            if job.table["time"].get("substeps") == 2:
                inside.setattr(sys, "executable", str(killed))
            return right(job, label, number, board)

    monkeypatch.setattr(run, "run_job", killing)
    changes = [axis_of("time.substeps=4"), axis_of("time.graded=0")]
    found = bench(TOY, SMALL, extra=[axes_of("time.substeps=1,2")], only=("time.substeps",), reference=changes)
    fine, failed = found.points
    assert failed.error == "its process was stopped by signal 9"
    assert "the reference with half its steps" in found.failures
    assert not found.doubt
    assert fine.errors["u"] > 0.0


def test_results_that_cannot_be_read_are_a_failed_point(monkeypatch):
    def cut(path):
        raise OSError(f"{path.name} is cut short")

    monkeypatch.setattr(run, "kept_arrays", cut)
    found = bench(TOY, SMALL, only=("minimum variance",), workers=1)
    assert "arrays.npz is cut short" in found.points[0].error


def measured_point(label, values, error=""):
    sweep = Sweep("quadrature of slice", "voxels", (Axis("observation.slice.quadrature", (1, 2, "exact")),))
    facts = {} if error else {"measured": np.array(values)}
    return Point(sweep, label, {"work": 1.0, "memory": 1.0}, {}, facts, error)


def test_only_the_exact_quadrature_counts_as_exact():
    points = [measured_point("1", [2.0, 0.0]), measured_point("2", [1.1, 0.0]), measured_point("exact", [1.0, 0.0])]
    assert [point.errors["measured values"] for point in against_exact(points)] == pytest.approx([1.0, 0.1, 0.0])
    # Where it failed, the last one that ran is no truth.
    points[2] = measured_point("exact", [], "Qhull failed")
    found = against_exact(points)
    assert np.isnan([point.errors["measured values"] for point in found[:2]]).all()
    assert found[2].error == "Qhull failed"
    # Other functionals, as a threshold near the border makes them, are not compared.
    points = [measured_point("2", [1.1]), measured_point("exact", [1.0, 0.0])]
    assert np.isnan(against_exact(points)[0].errors["measured values"])


RING = """
title = "Ring of tanks"

[physics]
kind = "ring"

[observation.thermometers]
kind = "thermometers"

[quantity.tank]
kind = "tank"

[training]
samples = 12
seed = 1

[estimator.pbdw]
kind = "pbdw"
n = 2
centring = "none"
spaces = "cycle"

[estimator.mean]
kind = "minimum_variance"
window = "cycle"

[validation]
cases = 3
"""


@pytest.fixture
def ring(tmp_path, monkeypatch):
    """A scene without a mesh, its plugin installed for this process and those it starts."""
    info = tmp_path / "site/tanks-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: tanks\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[dacore]\ntanks = tests.graph_plugin\n")
    monkeypatch.syspath_prepend(str(tmp_path / "site"))
    before = os.environ.get("PYTHONPATH", "")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, [str(tmp_path / "site"), str(ROOT), before])))
    path = tmp_path / "ring.toml"
    path.write_text(RING)
    return path


def test_a_scene_without_a_mesh_is_measured_by_its_estimates(ring, tmp_path):
    found = bench(ring, extra=[axes_of("training.samples=6,12")], workers=1)
    # More modes than three thermometers see, or than twelve tanks have, are said to; nothing else fails.
    assert list(found.failures) == ["dimension n of pbdw: 4", "dimension n of pbdw: 8"]
    assert "the background has only 6 modes" in found.failures["dimension n of pbdw: 8"]
    assert {point.sweep.kind for point in found.points} == {"estimate"}
    assert not found.reference
    assert {point.sweep.name for point in found.points} == {"dimension n of pbdw", "mean", "training.samples"}
    assert all(point.errors["T, noise 0"] >= 0.0 for point in found.of("estimate"))
    assert publish(found, tmp_path / "out", "dacore bench ring.toml")


@pytest.mark.parametrize(
    "asked",
    [
        {"extra": [axes_of("physics.count=6,12")]},
        {"sizes": axis_of("physics.count=6,12")},
        {"larger": axis_of("physics.count=6,12")},
    ],
)
def test_trajectories_without_a_mesh_are_refused_in_one_line(ring, asked):
    with pytest.raises(
        SceneError, match=r"physics.count: trajectories are compared .* has no \[domain\]; vary"
    ) as caught:
        bench(ring, **asked)
    assert "\n" not in str(caught.value)


def test_keys_are_combined_and_costs_are_measured_without_errors():
    first, second = axes_of("domain.edge=3.0,2.5; time.substeps=1,2")
    assert (first.key, second.values) == ("domain.edge", (1, 2))
    extra = [(first, second)]
    found = bench(TOY, SMALL, extra=extra, only=("costs",), larger=axis_of("domain.edge=3.0,2.5,2.0"))
    assert [point.label for point in found.points] == ["3.0", "2.5", "2.0"]
    assert not found.reference, "nothing is compared"
    table = growth_table(found)
    assert [row[0] for row in table.rows] == [
        "assembly [CPU s]", "ordering [CPU s]", "set-up [CPU s]", "a step [CPU s]", "trajectory [CPU s]",
        "memory [MiB]", "solver",
    ]  # fmt: skip
    _, fits = growths(found)
    nodes = [point.facts["nodes"] for point in found.points]
    assert nodes == sorted(nodes)
    assert 0.2 < fits["trajectory"].exponent < 3.0


def test_the_reference_is_finer_in_time_and_space_and_takes_changes():
    table = read_table(TOY, SMALL)
    finest, coarser, differs = references(table, axis_of("domain.edge=3.0,2.5"))
    assert finest.table["domain"]["edge"] == differs["domain.edge"] == 2.5
    assert (finest.table["time"]["substeps"], coarser.table["time"]["substeps"]) == (32, 16)
    changes = [axis_of("domain.edge=1.0"), axis_of("time.substeps=1")]
    finest, coarser, differs = references(table, axis_of("domain.edge=3.0,2.5"), changes)
    assert finest.table["domain"]["edge"] == differs["domain.edge"] == 1.0
    assert differs["time.substeps"] == 1
    assert coarser is None, "a step cannot be halved the other way"
    with pytest.raises(SceneError, match=r"--reference domain\.edge: got 2 values, expected one"):
        references(table, None, [axis_of("domain.edge=1.0,2.0")])


def test_every_scheme_but_the_scenes_own_is_a_sweep_of_its_own():
    def names(*changes):
        scene = "examples/toy/ball.toml"
        builder = checked(Variant("", read_table(ROOT / scene, changes)), ROOT / scene)
        return [sweep.name for sweep in default_sweeps(builder, None) if sweep.name.startswith("time step")]

    graded, damped = "time step, generalised α, graded start", "time step, generalised α, ρ∞ = 0.5"
    published = "time step, Newmark as published"
    assert names() == ["time step", graded, damped]
    assert names("time.scheme=generalized_alpha") == ["time step", graded, published]
    assert names("time.beta=0.3025", "time.gamma=0.6") == ["time step", graded, damped, published]


@pytest.mark.parametrize("plain", [False, True])
@pytest.mark.parametrize("decades", [0.002, 0.01, 0.05, 0.2, 0.5, 0.9, 1.4, 1.9, 2.5, 6.0, 11.0])
def test_a_logarithmic_axis_always_has_two_labels_inside(decades, plain):
    for start in (-7.0, -4.3, -1.37, 0.0, 0.61, 1.93, 4.7):
        _, ((axes,),) = sheet(1, 1, 2.0)
        log_axis(axes, "x", plain=plain, ticks=6)
        low, high = 10.0**start, 10.0 ** (start + decades)
        axes.set_xlim(low, high)
        labels = [*axes.get_xticklabels(), *axes.get_xticklabels(minor=True)]
        read = [each.get_text() for each in labels if low <= each.get_position()[0] <= high and each.get_text()]
        assert len(read) >= 2, f"{low:g} to {high:g}"
        assert len(set(read)) == len(read), read


def test_numbers_on_axes_are_short():
    assert [number_label(value) for value in (0.02, 500.0, 1e-3, 0.1 + 0.2)] == ["0.02", "500", "0.001", "0.3"]
    assert number_label(3e-6) == r"$3\cdot10^{-6}$"
    assert number_label(1e-5) == r"$10^{-5}$"
