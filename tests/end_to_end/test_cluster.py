"""A scene solved by the workers of a cluster that somebody else started."""

import subprocess
import sys

import pytest

from tests.environment.processes import TOY, dacore
from tests.workers import ROOT, cluster, wait_for

SMALL = (
    "domain.edge=2.5", "time.steps=6", "training.samples=5", "validation.cases=2", "validation.refine_time=0",
    "estimator.pbdw_per_phase.n=3",
)  # fmt: skip

TRAIN = """
import sys
from dacore import open_scene

session = open_scene(sys.argv[1], sys.argv[4:], cache=sys.argv[2], scheduler=sys.argv[3] or None)
session.background, session.truth
print(*sorted({name.partition(".")[0] for name in sys.modules}))
"""


def content(cache):
    return {path.relative_to(cache).as_posix(): path.read_bytes() for path in cache.rglob("*.h5")}


def train(cache, scheduler):
    command = [sys.executable, "-c", TRAIN, TOY, cache, scheduler, *SMALL]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    return set(done.stdout.split())


def test_a_cluster_gives_the_same_bits_as_one_process(tmp_path):
    with cluster(tmp_path, 2) as made:
        assert "distributed" in train(tmp_path / "cluster", made.file)
        for worker in made.processes[1:]:
            assert worker.poll() is None
    assert not {"distributed", "dask"} & train(tmp_path / "alone", "")
    found = content(tmp_path / "cluster")
    assert sum("trajectory_" in name for name in found) == 7
    assert found == content(tmp_path / "alone")


@pytest.mark.slow
def test_the_command_line_runs_on_a_cluster_given_by_address_or_file(tmp_path):
    settings = [part for change in SMALL for part in ("--set", change)]
    with cluster(tmp_path, 1) as made:
        wait_for(made.file.exists, made)
        done = dacore("run", TOY, "--out", tmp_path / "out", "--scheduler", made.file, *settings)
        assert done.returncode == 0, done.stderr
        assert (tmp_path / "out" / "results.json").exists()


@pytest.mark.parametrize(
    ("scheduler", "said"),
    [
        ("tcp://127.0.0.1:9", "nobody answers at tcp://127.0.0.1:9"),
        ("nowhere.json", "neither an address nor a file (No such file or directory)"),
    ],
)
def test_a_scheduler_that_is_not_there_is_one_line_before_any_work(tmp_path, scheduler, said):
    done = dacore("run", TOY, "--out", tmp_path / "out", "--scheduler", scheduler)
    assert done.returncode == 1
    (line,) = done.stderr.strip().splitlines()
    assert line.startswith(f"error: --scheduler {scheduler}: ")
    assert said in line
    assert not (tmp_path / "out").exists()


def test_a_plan_imports_no_dask(tmp_path):
    done = dacore("plan", TOY, "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    assert not {"distributed", "dask", "tornado"} & set(done.stdout.splitlines()[-1].split())
