"""The command line as a user meets it."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
TOY = ROOT / "examples" / "toy" / "ball.toml"


def dacore(*arguments, cwd=ROOT):
    """Run the command in a process of its own."""
    environment = {**os.environ, "COLUMNS": "160", "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, "-c", "from dacore.cli.main import main; main()", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, cwd=cwd, env=environment, check=False)


def test_help_and_version_import_no_numerical_library():
    code = (
        "import sys\nfrom dacore.cli.main import main\n"
        "try:\n    main(['--help'])\nexcept SystemExit as stop:\n    assert stop.code == 0\n"
        "heavy = {'numpy', 'scipy', 'skfem', 'matplotlib', 'h5py', 'pydantic', 'meshio'} & set(sys.modules)\n"
        "assert not heavy, heavy"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "reconstruct" in done.stdout.lower() or "measurements" in done.stdout
    assert dacore("--version").stdout.startswith("dacore ")


def test_plugins_lists_our_own():
    done = dacore("plugins")
    assert done.returncode == 0
    for name in ("skfem", "brain", "biot", "voxels", "pbdw", "minimum_variance"):
        assert name in done.stdout


def test_plan_starts_nothing_and_says_what_it_would_take(tmp_path):
    done = dacore("plan", TOY, "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    assert "training" in done.stdout
    assert re.search(r"in all +\d+ (s|min) +\d+ MiB", done.stdout)
    assert "this cache has not measured anything yet" in done.stdout
    assert not (tmp_path / "out").exists()
    done = dacore("plan", TOY, "--out", tmp_path / "out", "--fresh", "moods")
    assert done.returncode == 2
    assert done.stderr.startswith("error: --fresh: got 'moods', expected all, or any of domain, model")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (["training.sampels=3"], ["training.sampels", "did you mean 'samples'"]),
        (["domain.kind=bal"], ["domain", "'bal'", "ball"]),
        (["domain.radius=-1.0"], ["domain", "radius", "-1"]),
        (["domain.radios=3.0"], ["domain", "radios", "radius"]),
        (["time.beta=0.25"], ["time", "2 beta >= gamma"]),
        (["observation.slice.size='big'"], ["observation.slice", "size", "big"]),
        (["estimator.minimum_variance.window='day'"], ["estimator.minimum_variance", "window", "day"]),
        (["discretization.backend='fenics'"], ["backend", "'fenics'", "skfem"]),
        (["physics.ranges={E=[1.0, 2.0, 3.0]}"], ["physics", "ranges"]),
    ],
)
def test_a_mistake_in_the_scene_gives_one_line_before_any_work(tmp_path, changes, words):
    settings = [part for change in changes for part in ("--set", change)]
    done = dacore("run", TOY, "--out", tmp_path / "out", *settings)
    assert done.returncode == 2
    assert done.stderr.startswith("error: ")
    assert len(done.stderr.strip().splitlines()) == 1
    for word in words:
        assert word in done.stderr
    assert not (tmp_path / "out" / "results.json").exists()


def test_a_missing_scene_is_a_scene_error(tmp_path):
    done = dacore("run", tmp_path / "none.toml")
    assert done.returncode == 2
    assert done.stderr == f"error: {tmp_path / 'none.toml'}: no such file; expected a scene in TOML, see examples/\n"


def test_an_output_folder_that_cannot_be_made(tmp_path):
    (tmp_path / "file").write_text("")
    done = dacore("run", TOY, "--out", tmp_path / "file", "--workers", "1")
    assert done.returncode == 1
    assert len(done.stderr.strip().splitlines()) == 1
    assert "cannot" in done.stderr


def test_run_from_a_terminal_and_again_from_the_cache(tmp_path):
    out = tmp_path / "out"
    small = ["--set", "training.samples=6", "--set", "time.steps=6", "--set", "validation.cases=2"]
    small += ["--set", "estimator.pbdw_per_phase.n=3", "--set", "validation.refine_time=0"]
    first = dacore("run", TOY, "--out", out, "--workers", "2", *small)
    assert first.returncode == 0, first.stderr
    assert "guessing the training mean" in first.stdout
    results = json.loads((out / "results.json").read_text())
    again = dacore("run", TOY, "--out", out, "--workers", "1", *small, "--set", "noise.levels=[0.05]")
    assert again.returncode == 0, again.stderr
    assert "kept  background" in again.stdout
    assert "training" not in json.loads((out / "results.json").read_text())["timings"]
    assert "training" in results["timings"]


def test_ctrl_c_says_that_nothing_is_lost_and_leaves_no_worker(tmp_path):
    command = [sys.executable, "-c", "from dacore.cli.main import main; main()", "run", str(TOY)]
    command += ["--out", str(tmp_path), "--workers", "2", "--set", "training.samples=2000"]
    running = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT, start_new_session=True
    )
    deadline = time.monotonic() + 120
    while not list(tmp_path.glob("cache/training*/*.h5")):
        assert running.poll() is None, running.communicate()
        assert time.monotonic() < deadline
        time.sleep(0.1)
    os.killpg(running.pid, signal.SIGINT)
    _, stderr = running.communicate(timeout=60)
    assert running.returncode == 130
    assert "what was finished is kept" in stderr
    assert "Traceback" not in stderr
    assert "training" in dacore("plan", TOY, "--out", tmp_path, "--set", "training.samples=2000").stdout


def test_bench_says_what_failed_and_still_writes_everything(tmp_path):
    out = tmp_path / "out"
    small = ["--set", "domain.edge=3.0", "--set", "time.steps=2"]
    done = dacore(
        "bench",
        TOY,
        "--out",
        out,
        *small,
        "--only",
        "growth",
        "--growth",
        "solver.tolerance=1e-300,1e-8",
        "--workers",
        1,
    )
    assert done.returncode == 1
    assert done.stderr.startswith("error: growth: 1e-300: ")
    assert "relative residual" in done.stderr
    points = json.loads((out / "bench.json").read_text())["points"]
    assert [point["error"] is None for point in points] == [False, True]
    assert points[1]["costs"]["step"] > 0.0
    assert "what failed" in done.stdout
    assert (out / "report.html").exists()
    bad = dacore("bench", TOY, "--only", "speed")
    assert bad.returncode == 2
    assert bad.stderr.startswith("error: --only: got 'speed', expected forward, voxels, estimate, costs")


def test_stress_judges_cases_and_writes_a_report(tmp_path):
    out = tmp_path / "out"
    page = tmp_path / "page.md"
    page.write_text("<!-- begin: dacore stress -->\n<!-- end: dacore stress -->\n")
    small = ["--set", "domain.edge=2.5", "--set", "training.samples=4", "--themes", "data", "--case", "NaN in the data"]
    done = dacore("stress", TOY, "--out", out, "--page", page, *small)
    assert done.returncode == 0, done.stderr
    assert "refused" in done.stdout
    (case,) = json.loads((out / "stress.json").read_text())["cases"]
    assert case["verdict"] == "refused"
    assert "leave them out with a mask" in case["said"]
    assert "| NaN in the data |" in page.read_text()
    assert (out / "report.html").exists()
    bad = dacore("stress", TOY, "--out", out, "--themes", "moods")
    assert bad.returncode == 2
    assert bad.stderr.startswith("error: --themes: got 'moods', expected any of physics")


def living(group):
    """Processes of a group that still run; one that ended may wait to be reaped by a parent that never does."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, _, its_group = stat.read_text().rpartition(")")[2].split()[:3]
        except (FileNotFoundError, ProcessLookupError):
            continue
        if int(its_group) == group and state != "Z":
            found.append(stat.parent.name)
    return found


def test_workers_of_a_killed_run_leave(tmp_path):
    command = [sys.executable, "-c", "from dacore.cli.main import main; main()", "run", str(TOY)]
    command += ["--out", str(tmp_path), "--workers", "2", "--set", "training.samples=2000"]
    running = subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, cwd=ROOT, start_new_session=True
    )
    deadline = time.monotonic() + 120
    while not list(tmp_path.glob("cache/training*/*.h5")):
        assert running.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.1)
    running.kill()
    running.wait()
    while living(running.pid):
        assert time.monotonic() < deadline, living(running.pid)
        time.sleep(0.2)
    assert not list(tmp_path.rglob("*.part"))
