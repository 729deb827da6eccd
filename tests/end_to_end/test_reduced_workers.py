"""Reduced training with workers: the same bits for any number of them, started once, and killed at any moment."""

import time
from pathlib import Path

import numpy as np
import pytest

from dacore import open_scene
from dacore.dynamics import training
from dacore.execution import cluster
from tests.end_to_end.test_kill import TOY, content, finish, kill, run_undisturbed, train

SMALL = (
    "domain.edge=2.4", "time.steps=10", "training.samples=40", 'training.method="reduced"', "training.reduction=1e-3",
    "validation.cases=2", "validation.refine_time=0",
)  # fmt: skip


@pytest.fixture(scope="module")
def undisturbed(script, tmp_path_factory):
    files, seconds = run_undisturbed(script, tmp_path_factory.mktemp("undisturbed"), SMALL)
    assert sum(name.startswith("motions") for name in files) == 10
    assert sum(name.startswith("truth") for name in files) == 2
    assert sum(name.startswith("training") for name in files) == 1
    return files, seconds


def count(monkeypatch, owner, name):
    """Note each call of a function from now on."""
    calls, original = [], getattr(owner, name)

    def counted(*arguments, **settings):
        calls.append(arguments)
        return original(*arguments, **settings)

    monkeypatch.setattr(owner, name, counted)
    return calls


def test_workers_start_once_for_all_rounds_and_change_no_bit(undisturbed, tmp_path, monkeypatch):
    starts = count(monkeypatch, cluster, "LocalCluster")
    session = open_scene(TOY, SMALL, tmp_path, workers=2)
    _ = session.background
    assert len(session.reduced.rounds) > 2
    assert len(starts) == 1
    found = content(tmp_path)
    assert found == {name: data for name, data in undisturbed[0].items() if not name.startswith("truth")}
    again = open_scene(TOY, SMALL, tmp_path, workers=2)
    assert np.array_equal(again.background.coefficients, session.background.coefficients)
    for path in tmp_path.glob("training-*"):
        path.unlink()
    repeated = open_scene(TOY, SMALL, tmp_path, workers=2)  # of motions that are all there
    assert np.array_equal(repeated.background.coefficients, session.background.coefficients)
    assert len(starts) == 1


def stamps(cache):
    """Which files hold whole trajectories, and since when."""
    return {path: (path.stat().st_ino, path.stat().st_mtime_ns) for path in cache.rglob("trajectory_*.h5")}


def check_killed(script, cache, undisturbed, kills, seed, monkeypatch):
    """Kill runs of one cache, end the last one here, and see what it solves and what comes out."""
    files, seconds = undisturbed
    rng, kept, killed = np.random.default_rng(seed), {}, 0
    for _ in range(kills):
        workers = int(rng.integers(1, 3))
        running = train(script, cache, workers, SMALL)
        time.sleep(float(rng.uniform(0, seconds if workers == 1 else seconds + 3)) / 2)
        if running.poll() is None:
            kill(running, bool(rng.integers(2)))
            killed += 1
        else:
            finish(running)
        found, now = content(cache), stamps(cache)
        assert kept.items() <= now.items()  # nothing that was there was solved and written again
        for name in found:
            if not Path(name).name.startswith("."):
                assert found[name] == files[name], name
        kept = now
    solved = count(monkeypatch, training, "_solve")
    session = open_scene(TOY, SMALL, cache)
    _ = session.background, session.truth
    found = content(cache)
    assert len(solved) == sum("trajectory_" in name for name in files) - len(kept)
    assert kept.items() <= stamps(cache).items()
    assert found.keys() == files.keys()
    for name, expected in files.items():
        assert found[name] == expected, name
    return killed


@pytest.mark.parametrize("seed", [1, 2])
def test_reduced_training_killed_at_random_moments_goes_on(script, undisturbed, tmp_path, monkeypatch, seed):
    assert check_killed(script, tmp_path, undisturbed, 2, seed, monkeypatch) > 0


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3, 13))
def test_reduced_training_killed_many_times(script, undisturbed, tmp_path, monkeypatch, seed):
    assert check_killed(script, tmp_path, undisturbed, 3, seed, monkeypatch) > 0
