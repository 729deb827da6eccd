"""Nothing is done twice, or at all, that a scene does not ask for. Calls and bytes are counted, not seconds."""

import json
import os
import shutil
import subprocess
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

import dacore_imaging.layers
import dacore_imaging.voxels
from dacore import open_scene
from dacore.algebra.gram import RieszMap
from dacore.core.background import Background
from dacore.core.reduced import ReducedSpace
from dacore.dynamics.march import MarchedModel
from dacore.errors import SceneError
from dacore.io.snapshots import TrajectoryStore
from dacore.workflow import output
from dacore.workflow.canvas import Canvas
from dacore.workflow.pictures import draw_all
from dacore.workflow.run import plan_scene, run_scene

ROOT = Path(__file__).resolve().parents[2]
BALL = ROOT / "examples" / "toy" / "ball.toml"
SMALL = [
    "domain.edge=2.5", "training.samples=6", "time.steps=5", "validation.cases=3", "estimator.pbdw_per_phase.n=3",
    "validation.refine_time=0",
]  # fmt: skip
NUMBERS = [*SMALL, "report.states=false"]


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    """A cache with everything that the small scene needs."""
    cache = tmp_path_factory.mktemp("kept")
    for changes in (SMALL, NUMBERS):
        session = open_scene(BALL, changes, cache)
        _ = session.validation
    return cache


@pytest.fixture
def cache(kept, tmp_path):
    """A copy of that cache, to change."""
    return shutil.copytree(kept, tmp_path / "cache")


class Counts(Counter):
    """Calls of methods, and what they were about."""

    def __init__(self, monkeypatch):
        super().__init__()
        self.shapes, self.read = [], []
        lift, read = Background.lift, TrajectoryStore.read
        for owner, name in (
            (RieszMap, "lift"), (RieszMap, "pair"), (RieszMap, "_solve"), (RieszMap, "__init__"),
            (MarchedModel, "solve"), (dacore_imaging.voxels.Voxels, "functionals"), (ReducedSpace, "lift"),
        ):  # fmt: skip
            self._count(monkeypatch, owner, name)

        def lifted(background, coefficients, *rest):
            self["Background.lift"] += 1
            self.shapes.append(coefficients.shape)
            return lift(background, coefficients, *rest)

        def opened(store, index):
            self.read.append((store.folder.name.partition("-")[0], index, store.path(index).stat().st_size))
            return read(store, index)

        monkeypatch.setattr(Background, "lift", lifted)
        monkeypatch.setattr(TrajectoryStore, "read", opened)

    def _count(self, monkeypatch, owner, name):
        inner = getattr(owner, name)

        def counted(*args, **kwargs):
            self[f"{owner.__name__}.{name}"] += 1
            return inner(*args, **kwargs)

        monkeypatch.setattr(owner, name, counted)


@pytest.fixture
def counts(monkeypatch):
    return Counts(monkeypatch)


def test_another_noise_level_solves_integrates_reads_and_lifts_nothing(cache, counts):
    session = open_scene(BALL, [*SMALL, "noise.levels=[0.0, 0.05]"], cache)
    assert np.isfinite(session.validation.outcome("minimum_variance", 0.05).space_time["u"]).all()
    for name in ("MarchedModel.solve", "Voxels.functionals", "Background.lift", "ReducedSpace.lift", "RieszMap.lift"):
        assert counts[name] == 0, name
    assert counts.read == []


def test_an_estimator_that_did_not_change_is_not_prepared_again(cache, counts):
    session = open_scene(BALL, [*SMALL, "estimator.minimum_variance.floor=1e-3"], cache)
    _ = session.validation
    assert counts["RieszMap.__init__"] == 0
    assert "prepared.minimum_variance" in session.runner.timings
    assert "prepared.pbdw_per_phase" not in session.runner.timings


def test_the_same_again_estimates_nothing_until_a_state_is_asked_for(cache, counts):
    session = open_scene(BALL, SMALL, cache)
    outcome = session.validation.outcome("pbdw_per_phase", 0.1)
    assert not [name for name in session.runner.timings if name.startswith("prepared")]
    state = outcome.estimate.state(series=1, step=2)
    assert counts.shapes == [(session.background.dimension,)]
    fresh = open_scene(BALL, SMALL, cache).runner
    again = fresh["prepared.pbdw_per_phase"].estimate(session.validation.data[0.1], session.validation.sigmas[0.1])
    assert np.allclose(state, again.state(series=1, step=2), rtol=1e-12, atol=1e-12 * np.abs(state).max())


def test_numbers_alone_lift_no_state_and_read_each_case_once(tmp_path, counts):
    out = tmp_path / "out"
    run_scene(BALL, NUMBERS, out, workers=1)
    for name in ("Background.lift", "RieszMap.lift"):
        assert counts[name] == 0, name
    assert sorted(index for stage, index, _ in counts.read if stage == "truth") == [0, 1, 2]
    results = json.loads((out / "results.json").read_text())
    assert all(each["errors"] == {} for each in results["validation"])
    assert results["validation"][-1]["quantities"]["cavity_pressure"]["rms_error"] > 0
    assert "reference" not in results["timings"]
    drawn = {path.stem for path in (out / "figures").iterdir()}
    assert "summary" in drawn
    assert "quantity_cavity_pressure" in drawn
    assert not [name for name in drawn if name.startswith(("worst", "hero", "modes", "errors"))]
    assert not (out / "fields").exists()
    assert "error of cavity pressure, rms" in (out / "report.html").read_text()


def test_numbers_alone_are_those_of_the_whole_run(cache, counts):
    whole, alone = (open_scene(BALL, changes, cache).validation for changes in (SMALL, NUMBERS))
    assert alone.errors == ()
    for name in ("pbdw_per_phase", "minimum_variance"):
        one, other = (each.outcome(name, 0.1).quantities["cavity_pressure"] for each in (whole, alone))
        assert np.allclose(one.estimate, other.estimate, rtol=1e-12)
        assert np.array_equal(one.truth, other.truth)
    assert counts.read == []


def test_asking_for_nothing_is_refused(tmp_path):
    scene = tmp_path / "scene.toml"
    text = BALL.read_text()
    start, end = text.index("[quantity."), text.index("[noise]")
    scene.write_text(text[:start] + text[end:])
    with pytest.raises(SceneError, match=r"report.states: got false in a scene without a quantity"):
        open_scene(scene, ["report.states=false"])


def only(tmp_path, estimator):
    """The ball with one estimator."""
    text = BALL.read_text()
    start, end = text.index("[estimator."), text.index("[validation]")
    scene = tmp_path / "one.toml"
    scene.write_text(f"{text[:start]}[estimator.one]\n{estimator}\n\n{text[end:]}")
    return scene, [each for each in NUMBERS if "estimator." not in each]


def test_without_a_correction_there_is_no_representer(cache, tmp_path, counts):
    scene, changes = only(tmp_path, 'kind = "minimum_variance"')
    _ = open_scene(scene, changes, cache).validation
    assert counts["RieszMap.__init__"] == counts["RieszMap._solve"] == 0
    scene, changes = only(tmp_path, 'kind = "pbdw"\nn = 3\nweights = { p = 1e-18 }\ncorrection = false')
    _ = open_scene(scene, changes, cache).validation
    # The fit is in the norm of the Gram matrix: one solve for the functionals that all components share.
    assert counts["RieszMap._solve"] == 1
    assert counts["RieszMap.lift"] == counts["RieszMap.pair"] == 0


def test_a_slice_integrates_no_other_voxel(tmp_path, monkeypatch):
    boxes = []
    inner = dacore_imaging.layers.box_integrals

    def counted(points, cells, nodes, order, lower, upper):
        boxes.append(upper - lower)
        return inner(points, cells, nodes, order, lower, upper)

    monkeypatch.setattr(dacore_imaging.layers, "box_integrals", counted)
    functionals = open_scene(BALL, SMALL, tmp_path).functionals
    ((x, y, z),) = boxes
    assert z == 1
    assert x * y >= functionals.n_sites > 20


def test_pictures_lift_the_step_they_show_and_read_the_cases_they_show(cache, counts, monkeypatch):
    session = open_scene(BALL, SMALL, cache)
    validation = session.validation
    for drawn in draw_all(Canvas(session)):
        assert drawn.figure.key() is not None
    r = session.background.dimension
    steps = [shape for shape in counts.shapes if shape == (r,)]
    modes = [shape for shape in counts.shapes if len(shape) == 2]
    # One estimate in the strip, each of three estimators at two noise levels, and four modes.
    assert len(steps) == 1 + 3 * 2
    assert modes == [(r, 3)] or modes == [(r, 4)]
    assert len(counts.shapes) == len(steps) + len(modes)
    best = [validation.best(list(session.scene.estimator), level) for level in (0.0, 0.1)]
    shown = {each.worst_case(validation.headline) for each in best}
    assert len(counts.read) == 1 + 2
    assert shown <= {index for _, index, _ in counts.read}
    size = 8 * session.model.space.n_dofs * 5
    assert sum(count for *_, count in counts.read) < 3 * (size + 20_000)


def test_fields_are_those_of_the_worst_cases_alone(cache, counts, tmp_path):
    session = open_scene(BALL, SMALL, cache)
    output.write_fields(session, tmp_path / "fields")
    r = session.background.dimension
    assert [shape for shape in counts.shapes if shape == (r, 5)] == [(r, 5)] * 2
    assert len(counts.read) == 2


@pytest.mark.parametrize("name", ["functionals", "measured", "reference", "judged.minimum_variance"])
def test_a_damaged_result_is_made_again_and_said(cache, name, caplog):
    whole = open_scene(BALL, SMALL, cache)
    expected = whole.validation.outcome("minimum_variance", 0.1)
    path = whole.runner.path(whole.runner.pipeline[name])
    content = bytearray(path.read_bytes())
    content[len(content) // 2 : len(content) // 2 + 64] = bytes(64)
    path.write_bytes(content[: len(content) * 3 // 4])
    session = open_scene(BALL, SMALL, cache)
    found = session.validation.outcome("minimum_variance", 0.1)
    if name == "functionals":
        _ = session.functionals
    assert "damaged" in caplog.text
    assert session.runner.states[name] == "run"
    assert np.allclose(found.space_time["p − p_csf"], expected.space_time["p − p_csf"], rtol=1e-10)


def test_a_damaged_trajectory_is_solved_again_when_it_is_read(cache, counts, caplog):
    session = open_scene(BALL, SMALL, cache)
    states = session.truth[1].states
    path = session.truth.store.path(1)
    path.write_bytes(path.read_bytes()[:-1000])
    again = open_scene(BALL, SMALL, cache).truth
    assert counts["MarchedModel.solve"] == 0
    assert np.allclose(again[1].states, states, rtol=1e-8, atol=1e-8 * np.abs(states).max())
    assert counts["MarchedModel.solve"] == 1
    path.unlink()
    assert len(open_scene(BALL, SMALL, cache).truth) == 3
    assert "are gone" in caplog.text
    assert counts["MarchedModel.solve"] == 2


def test_two_processes_may_use_one_cache_at_once(tmp_path):
    code = (
        "import sys, json\nfrom dacore import open_scene\n"
        "v = open_scene(sys.argv[1], sys.argv[3:], sys.argv[2]).validation\n"
        "print(json.dumps([[o.estimator, o.noise, {k: list(e) for k, e in o.space_time.items()}] for o in v.outcomes]))"
    )
    command = [sys.executable, "-c", code, str(BALL), str(tmp_path / "cache"), *SMALL]
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    running = [
        subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT, env=environment)
        for _ in range(2)
    ]
    found = []
    for each in running:
        stdout, stderr = each.communicate(timeout=300)
        assert each.returncode == 0, stderr
        assert "damaged" not in stderr
        found.append(json.loads(stdout))
    for one, other in zip(*found, strict=True):
        assert one[:2] == other[:2]
        for label, values in one[2].items():
            assert np.allclose(values, other[2][label], rtol=1e-6)
    assert not list((tmp_path / "cache").rglob(".*.h5"))
    kept = open_scene(BALL, SMALL, tmp_path / "cache")
    _ = kept.validation
    assert {kept.runner.states[f"judged.{name}"] for name in kept.scene.estimator} == {"cached"}


def test_a_scene_of_one_library_imports_no_other(kept):
    code = (
        "import sys\nfrom dacore import open_scene\n"
        "session = open_scene(sys.argv[1], sys.argv[3:], sys.argv[2])\n"
        "session.validation, session.prepared('pbdw_per_phase'), session.mesh, session.background\n"
        "others = {'dolfinx', 'ufl', 'basix', 'petsc4py', 'mpi4py', 'mfem', 'matplotlib', "
        "'meshio', 'dask', 'distributed'}\n"
        "assert 'skfem' in sys.modules\nassert not others & set(sys.modules), others & set(sys.modules)"
    )
    command = [sys.executable, "-c", code, str(BALL), str(kept), *SMALL]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=False)
    assert done.returncode == 0, done.stderr


def test_plan_tells_what_is_kept_and_what_it_takes(kept, tmp_path):
    rows = {row.name: row for row in plan_scene(BALL, SMALL, tmp_path / "out", kept)}
    assert {
        rows[name].status for name in ("domain", "functionals", "background", "measured", "reference", "truth")
    } == {"cached"}
    assert rows["training"].status == "skipped"
    assert rows["training"].cost is None
    assert rows["prepared.pbdw_per_phase"].why == "asked for"
    assert rows["prepared.pbdw_per_phase"].measured
    assert 0 < rows["report"].cost.seconds < 100
    changed = {row.name: row for row in plan_scene(BALL, [*SMALL, "training.seed=5"], tmp_path / "out", kept)}
    assert changed["training"].status == "run"
    assert changed["training"].measured
    assert changed["truth"].status == "cached"
    alone = {row.name: row for row in plan_scene(BALL, NUMBERS, tmp_path / "out", kept)}
    assert alone["prepared.pbdw_per_phase"].status == "skipped"
    assert not (tmp_path / "out").exists()


def test_fresh_solves_again_what_it_names(cache, counts):
    _ = open_scene(BALL, SMALL, cache, fresh=["truth"]).truth
    assert counts["MarchedModel.solve"] == 3
    with pytest.raises(SceneError, match="--fresh: got 'truths', expected all, or any of domain, model"):
        open_scene(BALL, SMALL, cache, fresh=["truths"])


def test_a_figure_that_shows_the_same_is_not_drawn_again(cache, tmp_path, monkeypatch):
    drawn = []
    inner = output.png
    monkeypatch.setattr(output, "png", lambda figure: drawn.append(figure) or inner(figure))
    first, again, other = (tmp_path / name for name in ("first", "again", "other"))
    run_scene(BALL, NUMBERS, first, cache, workers=1)
    count = len(drawn)
    assert count == len(list((first / "figures").iterdir())) >= 5
    run_scene(BALL, NUMBERS, again, cache, workers=1)
    assert len(drawn) == count
    damaged = next((cache / "figures").glob("summary-*.png"))
    damaged.write_bytes(damaged.read_bytes()[:-100])
    run_scene(BALL, [*NUMBERS, "noise.levels=[0.0, 0.05]"], other, cache, workers=1)
    # The spaces do not know the noise; the summary, the data and the numbers do.
    assert len(drawn) == count + 3
    for path in (first / "figures").iterdir():
        assert path.read_bytes() == (again / "figures" / path.name).read_bytes()
        assert (path.read_bytes() == (other / "figures" / path.name).read_bytes()) is (
            path.stem in ("singular_values", "inf_sup", "bound")
        )
    run_scene(BALL, NUMBERS, again, cache, workers=1)
    assert len(drawn) == count + 4
