"""Runs killed at any moment: what was finished stays, the next run goes on, and the result has the same bits."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
TOY = ROOT / "examples" / "toy" / "ball.toml"
SMALL = ("domain.edge=2.5", "time.steps=40", "training.samples=14", "validation.cases=3", "validation.refine_time=0")

TRAIN = """
import sys
from dacore import open_scene

if __name__ == "__main__":
    session = open_scene(sys.argv[1], sys.argv[4:], cache=sys.argv[2], workers=int(sys.argv[3]))
    session.model
    print("go", flush=True)
    session.background, session.truth
    print("end", flush=True)
"""


def train(script, cache, workers, settings=SMALL):
    """Begin a training run; returns once its model is made."""
    command = [sys.executable, script, TOY, cache, str(workers), *settings]
    begun = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=ROOT, start_new_session=True)
    line = begun.stdout.readline()
    assert line == b"go\n", begun.communicate()
    return begun


def finish(running):
    out, err = running.communicate(timeout=300)
    assert running.returncode == 0, err.decode()
    assert out == b"end\n"
    return err.decode()


def kill(running, whole_group):
    """Kill a run, with or without its workers, and wait until all of it is gone."""
    os.kill(running.pid, signal.SIGKILL)
    if whole_group:
        os.killpg(running.pid, signal.SIGKILL)
    running.communicate()


def content(cache):
    """What was computed: meshes, trajectories, background. Notes of what it cost differ from run to run."""
    kept = (path for path in cache.rglob("*") if path.is_file() and path.suffix in (".h5", ".npz", ".damaged"))
    return {path.relative_to(cache).as_posix(): path.read_bytes() for path in kept}


def run_undisturbed(script, cache, settings=SMALL):
    """Everything that one process leaves in its cache, and the seconds it took after its model was made."""
    running = train(script, cache, 1, settings)
    began = time.monotonic()
    finish(running)
    return content(cache), time.monotonic() - began


@pytest.fixture(scope="module")
def undisturbed(script, tmp_path_factory):
    files, seconds = run_undisturbed(script, tmp_path_factory.mktemp("undisturbed"))
    assert sum("trajectory_" in name for name in files) == 17
    assert sum(map(len, files.values())) > 1e6
    return files, seconds


def check_killed(script, cache, undisturbed, kills, seed):
    """Kill runs of one cache until it is complete or `kills` are used up, and let the last one end."""
    files, seconds = undisturbed
    rng, kept, done = np.random.default_rng(seed), set(), 0
    for _ in range(kills):
        workers = int(rng.integers(1, 3))
        running = train(script, cache, workers)
        time.sleep(float(rng.uniform(0, seconds if workers == 1 else seconds + 3)) / 2)
        if running.poll() is None:
            kill(running, bool(rng.integers(2)))
            done += 1
        else:
            finish(running)
        found = content(cache)
        whole = {name for name in found if not Path(name).name.startswith(".")}
        assert kept <= whole
        for name in whole:
            assert found[name] == files[name], name
        kept = whole
    finish(train(script, cache, 1))
    found = content(cache)
    assert found.keys() == files.keys()
    for name, expected in files.items():
        assert found[name] == expected, name
    return done


@pytest.mark.parametrize("seed", [1, 2])
def test_training_killed_at_random_moments_ends_with_the_same_bits(script, undisturbed, tmp_path, seed):
    assert check_killed(script, tmp_path, undisturbed, 4, seed) > 0


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3, 13))
def test_training_killed_many_times(script, undisturbed, tmp_path, seed):
    assert check_killed(script, tmp_path, undisturbed, 5, seed) > 0


def test_leftovers_of_a_kill_in_mid_write_are_removed_and_those_of_the_living_stay(script, undisturbed, tmp_path):
    """A process stopped in the middle of a write is killed; another one, stopped there, still lives."""
    hang = """
import os, sys, time
from pathlib import Path
from dacore.io.atomic import atomic_path
with atomic_path(Path(sys.argv[1]) / "trajectory_00000.h5") as temporary:
    temporary.write_bytes(b"half")
    print("go", flush=True)
    time.sleep(600)
"""
    cache = tmp_path / "cache"
    running = train(script, cache, 1)
    finish(running)
    (folder,) = cache.glob("training-*/")
    expected = (folder / "trajectory_00000.h5").read_bytes()
    (folder / "trajectory_00000.h5").unlink()
    for path in (cache / f"{folder.name}.json", *cache.glob("background*")):
        path.unlink(missing_ok=True)
    writers = [
        subprocess.Popen([sys.executable, "-c", hang, folder], stdout=subprocess.PIPE, cwd=ROOT) for _ in range(2)
    ]
    for writer in writers:
        assert writer.stdout.readline() == b"go\n"
    dead, living = writers
    try:
        dead.kill()
        dead.communicate()
        assert len(list(folder.glob(".trajectory_*"))) == 2
        finish(train(script, cache, 1))
        assert [path.name for path in folder.glob(".trajectory_*")] == [
            path.name for path in folder.glob(f".trajectory_00000.dacore-*-{living.pid}-*")
        ]
        assert len(list(folder.glob(".trajectory_*"))) == 1
        assert (folder / "trajectory_00000.h5").read_bytes() == expected
    finally:
        living.kill()
        living.communicate()


def test_two_runs_of_one_scene_at_once(script, undisturbed, tmp_path):
    """Both end well with the right results; together they solve little more than one alone."""
    files, _ = undisturbed
    both = [train(script, tmp_path, workers) for workers in (1, 2)]
    for each in both:
        assert "damaged" not in finish(each)
    found = content(tmp_path)
    assert found.keys() == files.keys()
    for name, expected in files.items():
        assert found[name] == expected, name


@pytest.mark.parametrize("workers", [2, 3])
def test_any_number_of_workers_gives_the_same_bits(script, undisturbed, tmp_path, workers):
    finish(train(script, tmp_path, workers))
    assert content(tmp_path) == undisturbed[0]


@pytest.mark.parametrize("damage", ["flipped", "cut", "empty", "foreign"])
def test_a_damaged_trajectory_is_solved_again(script, undisturbed, tmp_path, damage):
    finish(train(script, tmp_path, 1))
    (folder,) = tmp_path.glob("training-*/")
    path = folder / "trajectory_00003.h5"
    good = path.read_bytes()
    middle = len(good) // 2
    path.write_bytes(
        {
            "flipped": good[:middle] + bytes([good[middle] ^ 1]) + good[middle + 1 :], "cut": good[:middle],
            "empty": b"", "foreign": b"something else",
        }[damage]
    )  # fmt: skip
    for kept in tmp_path.glob("background*"):
        kept.unlink()
    said = finish(train(script, tmp_path, 1))
    assert "trajectory_00003.h5" in said
    assert "trajectory_00003.damaged" in said
    found = content(tmp_path)
    assert found.pop(f"{folder.name}/trajectory_00003.damaged") != good
    assert found == undisturbed[0]


RUN = ("training.samples=6", "time.steps=6", "validation.cases=2", "validation.refine_time=0", "domain.edge=2.5")


@pytest.mark.slow
def test_the_command_killed_at_random_moments_ends_with_the_same_numbers(tmp_path):
    def run(out):
        settings = [part for change in (*RUN, "estimator.pbdw_per_phase.n=3") for part in ("--set", change)]
        command = [sys.executable, "-c", "from dacore.cli.main import main; main()", "run", str(TOY), *settings]
        return subprocess.Popen(
            [*command, "--out", out, "--workers", "2"], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, cwd=ROOT,
            start_new_session=True,
        )  # fmt: skip

    def numbers(out):
        found = json.loads((out / "results.json").read_text())
        for row in found["validation"]:
            row.pop("seconds_for_all_cases", None)  # on the clock
        return {key: found[key] for key in ("validation", "background", "estimators", "parameters", "joint_weights")}

    began = time.monotonic()
    first = run(tmp_path / "one")
    said = first.communicate()
    assert first.returncode == 0, said
    seconds, rng = time.monotonic() - began, np.random.default_rng(5)
    for _ in range(8):
        running = run(tmp_path / "two")
        time.sleep(float(rng.uniform(0.1, 1)) * seconds)
        if running.poll() is None:
            kill(running, bool(rng.integers(2)))
        else:
            running.communicate()
    last = run(tmp_path / "two")
    said = last.communicate()
    assert last.returncode == 0, said
    assert numbers(tmp_path / "one") == numbers(tmp_path / "two")
    assert not list((tmp_path / "two").rglob(".*dacore-*"))
