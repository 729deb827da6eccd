"""Comparisons of variants of a scene: which variants, how far they agree, what a failing one does."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.sparse import csr_array

from dacore.errors import MissingDependencyError, SceneError
from dacore.io.scene import read_table
from dacore.workflow.comparison.agreement import agreement, group_of, relative_difference
from dacore.workflow.comparison.measure import MARK, Job, main, read_arrays, write_job
from dacore.workflow.comparison.run import compare
from dacore.workflow.comparison.tables import agreement_table, cost_table, error_tables, item_table
from dacore.workflow.comparison.variants import Axis, axis_of, names, variants

ROOT = Path(__file__).resolve().parents[2]
TOY = ROOT / "examples/toy/ball.toml"
SMALL = ("domain.edge=2.5", "time.steps=4", "training.samples=6", "validation.cases=2", "estimator.pbdw_per_phase.n=3")


def test_every_combination_becomes_a_variant_named_by_what_differs():
    table = read_table(TOY)
    made = variants(
        table, [Axis("backends", ("skfem",)), Axis("solvers", ("direct", "krylov")), axis_of("time.steps=4,8")]
    )
    assert [variant.label for variant in made] == ["direct · 4", "direct · 8", "krylov · 4", "krylov · 8"]
    assert made[3].table["solver"] == {"kind": "krylov"}
    assert made[3].table["time"] == {**table["time"], "steps": 8}
    assert made[0].table["discretization"]["backend"] == "skfem"
    assert "solver" not in table, "the scene itself was changed"


def test_observations_and_estimators_are_picked_by_name_and_joined_by_a_plus():
    table = read_table(TOY)
    table["observation"]["top"] = {"kind": "points"}
    picked = variants(table, [Axis("observations", names("slice, slice+top"))])
    assert [set(variant.table["observation"]) for variant in picked] == [{"slice"}, {"slice", "top"}]
    assert picked[1].label == "slice + top"
    with pytest.raises(SceneError, match="--estimators: got 'kalman', expected names of the scene: pbdw_one_space"):
        variants(table, [Axis("estimators", ("pbdw_per_phase", "kalman"))])


def test_another_solver_keeps_the_tolerance_and_no_foreign_keys():
    table = {**read_table(TOY), "solver": {"kind": "petsc", "fill": 2, "tolerance": 1e-8}}
    same, other = variants(table, [Axis("solvers", ("petsc", "direct"))])
    assert same.table["solver"] == {"kind": "petsc", "fill": 2, "tolerance": 1e-8}
    assert other.table["solver"] == {"kind": "direct", "tolerance": 1e-8}


def test_values_of_a_key_are_toml_or_words():
    assert axis_of("training.samples=16, 32").values == (16, 32)
    assert axis_of("domain.nodes=5k,33k").values == ("5k", "33k")
    assert axis_of("slices=[1, 2],[3]").values == ([1, 2], [3])


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: variants(read_table(TOY), [Axis("backends", ("skfem",))]), "got one variant"),
        (lambda: variants(read_table(TOY), []), "got one variant"),
        (lambda: Axis("backends", ("skfem", "skfem")), "skfem is named twice"),
        (lambda: Axis("backends", ()), "got nothing"),
        (lambda: axis_of("samples"), "expected key=value,value"),
        (lambda: variants(read_table(TOY), [axis_of("title.x=1,2")]), "title is not a table"),
        (lambda: compare(TOY, [axis_of("time.steps=4,8")], depth="all"), "--until: got 'all'"),
        (lambda: compare(TOY, [axis_of("time.steps=4,8")], rounds=0), "--rounds: got 0"),
        (lambda: compare(TOY, [axis_of("time.stepz=4,8")]), r"ball.toml \(4\): time.stepz: unknown key"),
        (lambda: compare(TOY, [Axis("solvers", ("direct", "drect"))]), "did you mean 'direct'"),
    ],
)  # fmt: skip
def test_mistakes_are_one_line_before_anything_runs(make, message):
    with pytest.raises(SceneError, match=message) as caught:
        make()
    assert "\n" not in str(caught.value)


def test_differences_are_relative_to_the_largest_entry_of_the_reference():
    a, b = np.array([1.0, 2.0, -4.0]), np.array([1.0, 2.0, -4.4])
    assert relative_difference(a, b) == pytest.approx(0.4 / 4.4)
    assert relative_difference(a, a) == 0.0
    assert relative_difference(np.zeros(2), np.zeros(2)) == 0.0
    assert relative_difference(np.ones(2), np.zeros(2)) == np.inf
    assert relative_difference(np.array([np.nan]), np.ones(1)) == np.inf
    # Stored zeros and other patterns of the same matrix do not count.
    thick = csr_array((np.array([1.0, 0.0, 3.0]), np.array([0, 1, 1]), np.array([0, 2, 3])), shape=(2, 2))
    thin = csr_array(np.diag([1.0, 3.0]))
    assert relative_difference(thick, thin) == 0.0
    assert relative_difference(csr_array((2, 2)), thin) == 1.0


def test_what_has_another_size_is_named_and_not_compared():
    mine = {"matrix a": np.ones(2), "functionals": np.ones(3), "p (x)": np.ones(1)}
    theirs = {"matrix a": np.ones(2) * 1.1, "functionals": np.ones(4), "load b": np.ones(1)}
    found = agreement(mine, theirs)
    assert found.groups() == {"matrices": pytest.approx(0.1 / 1.1)}
    assert set(found.apart) == {"functionals", "load b", "p (x)"}
    assert [group_of(name) for name in ("load b", "trajectory u", "p (x)")] == ["loads", "trajectory", "estimates"]


@pytest.fixture(scope="module")
def solvers(tmp_path_factory):
    return compare(
        TOY, [Axis("solvers", ("direct", "krylov"))], SMALL, tmp_path_factory.mktemp("cache"), rounds=2, workers=1
    )


def test_two_solvers_agree_and_every_cost_is_measured(solvers):
    direct, krylov = solvers.variants
    assert (direct.error, krylov.error) == ("", "")
    assert direct.agreement is None
    groups = krylov.agreement.groups()
    assert groups["matrices"] == groups["loads"] == groups["functionals"] == 0.0
    # Different methods reach the tolerance of 1e-10 by different roads; the pressure magnifies it.
    assert 0.0 < groups["trajectory"] < 1e-6
    assert 0.0 < groups["estimates"] < 1e-3
    assert krylov.agreement.apart == ()
    for variant in solvers.variants:
        assert len(variant.rounds) == 2
        assert "training" in variant.rounds[0]
        assert "training" not in variant.rounds[1], "training is measured once"
        for name in ("first assembly", "assembly", "functionals", "trajectory", "training", "preparing", "estimating"):
            assert variant.cost(name) > 0.0, name
        assert 30.0 < variant.rounds[0]["memory before"] <= variant.cost("memory assembling") < 3000.0
        assert variant.facts["trajectories"] == {"solved": 8, "of": 8}
    assert np.isnan(direct.cost("nothing of the kind"))


def test_tables_say_it_all(solvers):
    table = cost_table(solvers)
    assert table.headers == ["cost", "", "direct", "krylov"]
    assert [row[0] for row in table.rows][:3] == ["library version", "first assembly", "assembly"]
    assert agreement_table(solvers).rows[0][0] == "krylov"
    assert len(item_table(solvers).rows) == len(solvers.variants[1].agreement.differences)
    exact, noisy = error_tables(solvers)
    assert exact.caption.startswith("no noise")
    assert noisy.caption.startswith("10% noise")
    assert [str(getattr(row[0], "text", row[0])) for row in exact.rows] == [
        "guessing the training mean", "pbdw one space, direct", "pbdw one space, krylov", "pbdw per phase, direct",
        "pbdw per phase, krylov", "minimum variance, direct", "minimum variance, krylov",
    ]  # fmt: skip


def test_results_can_be_published_and_read(solvers, tmp_path):
    from dacore.workflow.comparison.output import publish

    report, summary = publish(solvers, tmp_path, "dacore compare ball.toml --solvers direct,krylov")
    content = json.loads(summary.read_text(encoding="utf-8"))
    assert content["varied"] == {"solvers": ["direct", "krylov"]}
    assert content["reference"] == "direct"
    assert content["variants"][1]["differences"]["matrix inertia"] == 0.0
    assert len(content["variants"][0]["rounds"]) == 2
    assert "How far they agree" in report.read_text(encoding="utf-8")
    assert {path.name for path in (tmp_path / "figures").iterdir()} == {"costs.png", "agreement.png"}


def test_stages_that_are_the_same_are_shared(tmp_path):
    found = compare(
        TOY, [Axis("estimators", ("pbdw_per_phase", "minimum_variance"))], SMALL, tmp_path, rounds=1, workers=1
    )
    assert [variant.facts["trajectories"]["solved"] for variant in found.variants] == [8, 0]
    assert [row[0] for row in error_tables(found)[0].rows[1:]] == ["pbdw per phase", "minimum variance"]


def test_a_variant_that_fails_is_said_to_and_the_others_go_on():
    axis = axis_of("solver.tolerance=1e-300,1e-10")
    found = compare(TOY, [axis], SMALL, depth="trajectory", rounds=1)
    failed, finished = found.variants
    assert "relative residual" in failed.error
    assert "\n" not in failed.error
    assert finished.cost("trajectory") > 0.0
    assert found.reference == "1e-10"
    assert cost_table(found).headers == ["cost", "", "1e-10"]


def test_a_process_that_dies_is_an_error_of_its_variant(monkeypatch):
    import dacore.workflow.comparison.run as run_module

    monkeypatch.setattr(run_module, "write_job", lambda job: "/no/such/job.json")
    found = compare(TOY, [axis_of("time.steps=4,5")], SMALL[:1], depth="matrices", rounds=1)
    assert all("its process ended with code 1" in variant.error for variant in found.variants)
    assert all("job.json" in variant.error for variant in found.variants)
    assert found.reference == "–"


def test_progress_comes_as_marked_lines_and_arrays_survive_the_way(tmp_path, capsys):
    table = read_table(TOY, SMALL)
    job = Job(table, "ball", str(TOY.parent), str(tmp_path / "cache"), str(tmp_path), "matrices", 1, True)
    assert main(str(write_job(job))) == 0
    lines = capsys.readouterr().out.rstrip("\n").split("\n")  # the mark is a line end to splitlines
    assert lines
    assert all(json.loads(line.removeprefix(MARK)) for line in lines)
    result = json.loads((tmp_path / "measured.json").read_text(encoding="utf-8"))
    arrays = read_arrays(tmp_path / "arrays.npz")
    assert arrays["functionals"].shape == (result["facts"]["functionals"], result["facts"]["n_dofs"])
    assert abs(arrays["matrix inertia"] - arrays["matrix inertia"].T).max() < 1e-12


def test_a_missing_library_is_said_before_anything_runs(monkeypatch):
    import dacore.plugins.registry as registry

    original = registry.available
    monkeypatch.setattr(registry, "available", lambda module: module != "skfem" and original(module))
    with pytest.raises(MissingDependencyError, match="pip install scikit-fem"):
        compare(TOY, [axis_of("time.steps=4,5")])
