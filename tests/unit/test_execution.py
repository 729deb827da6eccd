"""The same work in this process, in processes beside it, and on a cluster: same results, one clear error."""

import os
import re
import signal
import subprocess
import sys
from contextlib import closing
from itertools import islice
from pathlib import Path

import pytest

from dacore.errors import WorkerError
from dacore.execution import cluster as execution_cluster
from dacore.execution import stream
from dacore.execution.cluster import address_of
from dacore.execution.foreach import crew as crew_of
from dacore.execution.foreach import for_each
from tests import workers as work
from tests.workers import ROOT, Shared, cluster, wait_for


@pytest.fixture(scope="module")
def crew(tmp_path_factory):
    """Two workers of a scheduler that somebody else started."""
    with cluster(tmp_path_factory.mktemp("cluster"), 2) as made:
        yield made


def everything(function, shared, items, **where):
    with closing(for_each(function, shared, items, **where)) as results:
        return dict(results)


def count_starts(monkeypatch):
    """Note each start of workers beside this process from now on."""
    started, original = [], execution_cluster.LocalCluster

    def counted(*arguments, **settings):
        started.append(settings["n_workers"])
        return original(*arguments, **settings)

    monkeypatch.setattr(execution_cluster, "LocalCluster", counted)
    return started


def living(pids):
    return [pid for pid in pids if Path(f"/proc/{pid}").exists()]


@pytest.mark.parametrize("count", [1, 2, 3])
def test_any_number_of_workers_gives_the_same(tmp_path, count):
    before = dict(os.environ)
    found = everything(work.add, Shared(tmp_path), range(7), workers=count)
    assert {item: value for item, (_, value) in found.items()} == {item: 499500.0 + item for item in range(7)}
    pids = {pid for pid, _ in found.values()}
    assert (pids == {os.getpid()}) == (count == 1)
    assert len(pids) <= count
    assert dict(os.environ) == before
    assert not living(pids - {os.getpid()})


def test_one_worker_goes_in_order_and_begins_nothing_early(tmp_path):
    begun = []
    items = (begun.append(item) or item for item in range(4))
    results = for_each(work.add, Shared(tmp_path), items)
    assert begun == []
    for expected in range(4):
        assert next(results)[0] == expected
        assert begun == list(range(expected + 1))


def test_one_worker_imports_no_dask():
    code = (
        "import sys\nfrom dacore.execution.foreach import for_each\nimport dacore.dynamics.training\n"
        "assert dict(for_each(pow, 2, range(3))) == {0: 1, 1: 2, 2: 4}\n"
        "assert not {'distributed', 'dask', 'tornado'} & set(sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, cwd=ROOT)
    assert done.returncode == 0, done.stderr


def test_what_is_shared_travels_once_to_each_worker(tmp_path, crew):
    shared = Shared(tmp_path, 2_000_000)
    found = everything(work.add, shared, range(20), scheduler=str(crew.file))
    assert len(found) == 20
    notes = {int(path.suffix[1:]): path.read_text() for path in tmp_path.glob("unpickled.*")}
    assert set(notes) == {process.pid for process in crew.processes[1:]}
    assert set(notes.values()) == {"x"}


def test_a_crew_keeps_workers_and_what_they_share_over_several_lists(tmp_path, monkeypatch):
    started = count_starts(monkeypatch)
    before, environment, pids = os.getpid(), dict(os.environ), set()
    with crew_of(work.add, Shared(tmp_path), workers=2) as run:
        assert not started
        for items in (range(4), [], range(2), [7, 7, 7]):
            found = list(run(items))
            assert sorted(item for item, _ in found) == sorted(items)
            assert all(value == 499500.0 + item for item, (_, value) in found)
            pids |= {pid for _, (pid, _) in found}
            assert dict(os.environ) == environment
        assert len(started) == 1
        assert set(living(pids)) == pids
    assert before not in pids
    assert {path.read_text() for path in tmp_path.glob("unpickled.*")} == {"x"}
    assert not living(pids)


def test_a_crew_of_a_cluster_leaves_its_workers_alone(tmp_path, crew):
    with crew_of(work.add, Shared(tmp_path), scheduler=str(crew.file)) as run:
        assert [dict(run(range(3))).keys() for _ in range(3)] == [{0, 1, 2}] * 3
    notes = {int(path.suffix[1:]): path.read_text() for path in tmp_path.glob("unpickled.*")}
    assert notes == {process.pid: "x" for process in crew.processes[1:]}
    assert len(living(notes)) == 2


@pytest.mark.parametrize("workers", [1, 2])
def test_nothing_asked_starts_nothing(tmp_path, monkeypatch, workers):
    started = count_starts(monkeypatch)
    with crew_of(work.add, Shared(tmp_path), workers=workers):
        pass
    with crew_of(work.add, Shared(tmp_path), workers=1) as run:
        assert len(list(run(range(3)))) == 3
    assert not started


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_a_crew_ends_with_its_block_however_that_ends(tmp_path, error):
    pids = set()

    def begin_and_fail():
        with crew_of(work.add, Shared(tmp_path), workers=2) as run:
            pids.update(pid for _, (pid, _) in run(range(4)))
            assert set(living(pids)) == pids
            raise error

    with pytest.raises(error):
        begin_and_fail()
    assert pids
    assert not living(pids)


def test_a_list_left_early_does_not_disturb_the_next(tmp_path):
    with crew_of(work.slow, Shared(tmp_path), workers=2) as run:
        with closing(run(range(20))) as results:
            next(results)
        assert {item for item, _ in run([30, 31])} == {30, 31}
    assert len(list(tmp_path.glob("done.*"))) < 10


def test_items_are_taken_as_workers_come_free(tmp_path, crew):
    """At most two a worker are under way, however slowly results are taken."""
    begun, taken = [], 0
    items = (begun.append(item) or item for item in range(15))
    with closing(for_each(work.add, Shared(tmp_path), items, scheduler=str(crew.file))) as results:
        for _ in results:
            taken += 1
            assert len(begun) - taken < 4
    assert taken == 15


def test_each_worker_uses_one_blas_thread(tmp_path, crew):
    shared = Shared(tmp_path)
    assert set(everything(work.blas_threads, shared, range(4), scheduler=str(crew.file)).values()) == {1}
    assert set(everything(work.blas_threads, shared, range(4), workers=2).values()) == {1}


def test_a_dead_worker_beside_is_replaced_and_its_work_done_again(tmp_path):
    assert set(everything(work.die_once, Shared(tmp_path), range(8), workers=2).values()) == set(range(8))
    assert (tmp_path / "died").exists()


def test_an_item_that_always_kills_ends_in_one_error(tmp_path):
    with pytest.raises(WorkerError, match=r"\d: 4 workers died with this item on their hands \(out of memory\?\)"):
        everything(work.die_always, Shared(tmp_path), [3, 3, 3], workers=2)
    assert 1 < len((tmp_path / "deaths").read_text()) <= 12


def test_a_worker_of_a_cluster_dies_and_the_others_do_its_work(tmp_path):
    with cluster(tmp_path, 2) as made:
        victim, items = made.processes[1], range(12)
        with closing(for_each(work.slow, Shared(tmp_path), items, scheduler=str(made.file))) as results:
            # Three, not files of three: a list goes on only while it is read, and one worker may be late.
            found = dict(islice(results, 3))
            os.kill(victim.pid, signal.SIGKILL)
            found.update(results)
        assert set(found) == set(items)
        assert living([made.processes[2].pid])


def test_a_worker_may_join_late(tmp_path):
    with cluster(tmp_path, 0) as made:
        items = iter([made.worker] * 1 + list(range(3)))
        next(items)()
        assert len(everything(work.add, Shared(tmp_path), items, scheduler=str(made.file))) == 3


def test_a_failure_is_raised_as_it_was_and_the_rest_is_not_begun(tmp_path, crew):
    for where in ({"workers": 1}, {"scheduler": str(crew.file)}):
        found = []
        with (
            pytest.raises(ValueError, match="two is too many"),
            closing(for_each(work.fail, Shared(tmp_path), range(100), **where)) as results,
        ):
            found.extend(item for item, _ in results)
        assert {0, 1} <= set(found) <= set(range(10))


def test_an_error_that_cannot_travel_comes_as_text(tmp_path, crew):
    with pytest.raises(WorkerError, match=r"StrangeError: strange 0"):
        everything(work.fail_strangely, Shared(tmp_path), [0], scheduler=str(crew.file))


def test_runs_leave_nothing_on_a_cluster(tmp_path, crew):
    from distributed import Client

    everything(work.add, Shared(tmp_path), range(3), scheduler=str(crew.file))
    with Client(scheduler_file=str(crew.file), set_as_default=False) as client:
        wait_for(lambda: not any(client.has_what().values()))
        held = client.run(lambda: len(sys.modules["dacore.execution.worker"]._held))
        assert set(held.values()) == {0}
        assert not any(
            client.run(lambda dask_worker: [name for name in dask_worker.plugins if name.startswith("dacore")]).values()
        )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("nonsense", "neither an address nor a file"),
        ("tcp://", "neither an address nor a file"),
        ("none.json", r"neither an address nor a file \(No such file or directory\); expected tcp://host:port"),
    ],
)
def test_a_scheduler_that_is_none(text, message):
    with pytest.raises(WorkerError, match=message):
        address_of(text)


@pytest.mark.parametrize("content", ["", "{}", "[1]", '{"address": 3}', '{"address": "here"}'])
def test_a_file_that_is_no_scheduler_file(tmp_path, content):
    file = tmp_path / "scheduler.json"
    file.write_text(content)
    with pytest.raises(WorkerError, match=r"not a scheduler file|its address is"):
        address_of(str(file))


def test_nobody_at_the_address(tmp_path):
    with pytest.raises(WorkerError, match=r"--scheduler tcp://127.0.0.1:9: nobody answers at tcp://127.0.0.1:9"):
        everything(work.add, Shared(tmp_path), [1], scheduler="tcp://127.0.0.1:9")


def test_a_scheduler_without_workers_is_not_waited_for_for_ever(tmp_path, monkeypatch):
    monkeypatch.setattr(stream, "PATIENCE", 1.5)
    with cluster(tmp_path) as made, pytest.raises(WorkerError, match=r"no worker at tcp://\S+ for 2 s"):
        everything(work.add, Shared(tmp_path), [1], scheduler=str(made.file))


def test_the_last_worker_leaves(tmp_path, monkeypatch):
    monkeypatch.setattr(stream, "PATIENCE", 1.5)
    with cluster(tmp_path, 1) as made:
        results = for_each(work.slow, Shared(tmp_path), range(50), scheduler=str(made.file))
        next(results)
        os.kill(made.processes[1].pid, signal.SIGKILL)
        with pytest.raises(WorkerError, match="no worker at"):
            list(results)


def test_the_scheduler_dies(tmp_path):
    with cluster(tmp_path, 1) as made:
        results = for_each(work.slow, Shared(tmp_path), range(50), scheduler=str(made.file))
        next(results)
        os.kill(made.processes[0].pid, signal.SIGKILL)
        with pytest.raises(WorkerError, match=r"gone|still running"):
            list(results)


def test_a_worker_with_several_threads_is_refused(tmp_path):
    with cluster(tmp_path) as made:
        made.worker("--nthreads", 2)
        with pytest.raises(WorkerError, match=r"worker tcp://\S+: it has 2 threads, expected 1"):
            everything(work.add, Shared(tmp_path), [1], scheduler=str(made.file))


def test_a_worker_with_another_dacore_is_refused(tmp_path):
    """A copy of dacore with one more line in it, as an older or newer clone would have."""
    other = tmp_path / "other"
    other.mkdir()
    subprocess.run(["cp", "-r", ROOT / "dacore", other], check=True)
    with (other / "dacore" / "errors.py").open("a") as stream_:
        stream_.write("\n# changed\n")
    with cluster(tmp_path) as made:
        made.worker(path=other)
        with pytest.raises(WorkerError) as caught:
            everything(work.add, Shared(tmp_path), [1], scheduler=str(made.file))
    wanted = r"worker tcp://\S+: it has dacore \S+\+\w{12}, this run has \S+\+\w{12}; install the same version there"
    assert re.fullmatch(wanted, str(caught.value))


BLOCKER = """
import sys
class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] == {name!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)
sys.meta_path.insert(0, Missing())
"""


@pytest.mark.parametrize(
    ("name", "message"),
    [("dacore_biot", "it lacks 'dacore_biot', which this run needs"), ("dacore", "could not take the run's work")],
)
def test_a_worker_without_a_package_is_refused(tmp_path, name, message):
    from dacore_biot.model import Biot

    (tmp_path / "sitecustomize.py").write_text(BLOCKER.format(name=name))
    with cluster(tmp_path) as made:
        made.worker(path=tmp_path)
        with pytest.raises(WorkerError, match=message) as caught:
            everything(work.add, Biot(), [1], scheduler=str(made.file))
    assert "\n" not in str(caught.value)
    assert name in str(caught.value)


def test_a_script_without_its_guard_is_told_so(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(
        "from dacore.execution.foreach import for_each\nprint(dict(for_each(pow, 2, range(3), workers=2)))\n"
    )
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, check=False, cwd=ROOT)
    assert done.returncode != 0
    assert "put if __name__ ==" in done.stderr
