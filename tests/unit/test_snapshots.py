"""Trajectories on disk: exact, atomic, and never silently wrong."""

import os
import resource
import signal
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

from dacore.core.model import Trajectory
from dacore.errors import StoreError
from dacore.io.sealed import BLOCK, write_sealed
from dacore.io.snapshots import KIND, SCHEMA, TrajectoryStore

TRAJECTORY = Trajectory(np.arange(12.0).reshape(4, 3) / 7, np.array([0.1, 0.2, 0.3]))
ROOT = Path(__file__).resolve().parents[2]


def put(store, index=2, trajectory=TRAJECTORY):
    store.write(index, trajectory, np.array([1.0, 2.0]), ("E", "nu"), {"u": "cm"})


def filled(tmp_path):
    store = TrajectoryStore(tmp_path, "key")
    put(store)
    return store


def same(found, other=TRAJECTORY):
    return np.array_equal(found.states, other.states) and np.array_equal(found.times, other.times)


def test_round_trip_is_exact(tmp_path):
    store = filled(tmp_path)
    found, parameters = store.read(2)
    assert 2 in store
    assert 1 not in store
    assert store.intact(2)
    assert not store.intact(1)
    assert same(found)
    assert np.array_equal(parameters, [1.0, 2.0])
    assert [path.name for path in tmp_path.iterdir()] == ["trajectory_00002.h5"]


def test_a_file_says_where_it_comes_from(tmp_path):
    found = filled(tmp_path).provenance(2)
    assert found.key == "key"
    assert found.parameters == {"E": 1.0, "nu": 2.0}
    assert found.units == {"u": "cm"}
    assert {"dacore", "dacore-biot"} <= set(found.versions)


def test_other_programs_can_open_it(tmp_path):
    with h5py.File(filled(tmp_path).path(2)) as file:
        assert np.array_equal(file["states"][:], TRAJECTORY.states)


def test_the_same_content_gives_the_same_bytes(tmp_path):
    one, two = filled(tmp_path / "one"), filled(tmp_path / "two")
    assert one.path(2).read_bytes() == two.path(2).read_bytes()


def test_any_changed_byte_is_noticed(tmp_path):
    """One bit anywhere in the file, in the seal, in HDF5's own tables or in the states: refused and set aside."""
    store = filled(tmp_path)
    path, content = store.path(2), store.path(2).read_bytes()
    rng = np.random.default_rng(0)
    places = {
        0,
        BLOCK - 1,
        BLOCK,
        len(content) - 1,
        *rng.integers(BLOCK, size=100),
        *rng.integers(len(content), size=300),
    }
    for at in places:
        damaged = bytearray(content)
        damaged[at] ^= 1 << int(rng.integers(8))
        path.write_bytes(damaged)
        with pytest.raises(StoreError, match=r"damaged|other settings|schema|expected a"):
            store.read(2)
        assert 2 not in store
    assert path.with_suffix(".damaged").exists()


@pytest.mark.parametrize("keep", [0, 1, BLOCK - 1, BLOCK, BLOCK + 1, -1])
def test_a_truncated_file_is_noticed_without_reading_it(tmp_path, keep, caplog):
    store = filled(tmp_path)
    content = store.path(2).read_bytes()
    store.path(2).write_bytes(content[:keep])
    with pytest.raises(StoreError, match="damaged"):
        store.read(2)
    store.path(2).write_bytes(content[:keep])
    assert not store.intact(2)
    assert 2 not in store
    assert "trajectory_00002.damaged" in caplog.text


def test_an_enlarged_file_is_noticed(tmp_path):
    store = filled(tmp_path)
    with store.path(2).open("ab") as stream:
        stream.write(b"\0")
    assert not store.intact(2)


@pytest.mark.parametrize(
    ("kind", "schema", "key", "message"),
    [
        ("dacore background", SCHEMA, "key", "a dacore background, expected a dacore trajectory"),
        (KIND, 99, "key", f"schema 99, this version reads {SCHEMA}"),
        (KIND, SCHEMA, "x", "other settings"),
    ],
)
def test_foreign_files_are_refused(tmp_path, kind, schema, key, message):
    store = TrajectoryStore(tmp_path, "key")
    write_sealed(store.path(2), kind, schema, key, lambda file: file.create_dataset("states", data=TRAJECTORY.states))
    with pytest.raises(StoreError, match=message):
        store.provenance(2)
    assert not store.intact(2)


def test_files_of_an_older_dacore_and_of_others_are_refused(tmp_path):
    store = TrajectoryStore(tmp_path, "key")
    with h5py.File(store.path(0), "w") as file:
        file.attrs["magic"] = "dacore trajectory"
        file["states"] = TRAJECTORY.states
    store.path(1).write_text("a letter to my aunt\n" * 100)
    with pytest.raises(StoreError, match=r"not a dacore trajectory of this version \(no seal\)"):
        store.provenance(0)
    assert not store.intact(0)
    assert not store.intact(1)


def test_a_good_seal_on_other_content_is_refused(tmp_path):
    store = TrajectoryStore(tmp_path, "key")
    write_sealed(store.path(0), KIND, SCHEMA, "key", lambda file: file.create_dataset("other", data=1.0))
    with pytest.raises(StoreError, match="not what its seal says"):
        store.read(0)


def test_a_folder_that_cannot_be_made(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(StoreError, match="cannot make"):
        TrajectoryStore(tmp_path / "file" / "below", "key")


LIMITED = """
import resource, sys
import numpy as np
from pathlib import Path
from dacore.core.model import Trajectory
from dacore.errors import StoreError
from dacore.io.snapshots import TrajectoryStore

store = TrajectoryStore(Path(sys.argv[1]), "key")
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[2]), resource.RLIM_INFINITY))
try:
    store.write(0, Trajectory(np.ones((1000, 30)), np.arange(30.0)), np.ones(2), ("a", "b"), {"u": "cm"})
except StoreError as error:
    print(error)
"""


@pytest.mark.parametrize("room", [0, 100, 512, 8192, 200_000])
def test_a_file_that_may_not_grow_leaves_the_store_as_it_was(tmp_path, room):
    """What a full disk or a quota does, at several places of the file, in a process that really may not write on."""
    store = filled(tmp_path)
    done = subprocess.run(
        [sys.executable, "-c", LIMITED, tmp_path, str(room)], capture_output=True, text=True, check=False, cwd=ROOT
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    assert "cannot be written (File too large); is the disk full" in done.stdout
    assert [path.name for path in tmp_path.iterdir()] == ["trajectory_00002.h5"]
    assert same(store.read(2)[0])


def test_a_full_disk_leaves_the_store_as_it_was(tmp_path):
    """A file system of one megabyte, really full, then read-only."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", disk], capture_output=True, check=False
    ).returncode  # fmt: skip
    if mounted != 0:
        pytest.skip("file systems can be mounted by root only; the test above covers the same lines of code")
    try:
        store = filled(disk)
        with pytest.raises(StoreError, match=r"cannot be written \(No space left on device\); is the disk full"):
            put(store, 0, Trajectory(np.ones((100_000, 2)), np.arange(2.0)))
        assert [path.name for path in disk.iterdir()] == ["trajectory_00002.h5"]
        assert same(store.read(2)[0])
        put(store, 3)
        subprocess.run(["mount", "-o", "remount,ro", disk], check=True)
        with pytest.raises(StoreError, match="cannot write into this folder"):
            put(store, 4)
        with pytest.raises(StoreError, match="cannot write into this folder"):
            TrajectoryStore(disk, "key")
        assert same(store.read(3)[0])
    finally:
        subprocess.run(["umount", disk], check=True)


def test_a_failing_disk_at_every_system_call(tmp_path, monkeypatch):
    """Write, synchronise, move: whichever fails, the file that was there is still whole."""
    store = filled(tmp_path)
    other = Trajectory(TRAJECTORY.states + 1, TRAJECTORY.times)

    def fail(*_args, **_kwargs):
        raise OSError(5, "Input/output error")

    for owner, name in ((os, "fsync"), (Path, "replace")):
        with monkeypatch.context() as patch:
            patch.setattr(owner, name, fail)
            with pytest.raises(StoreError, match=r"cannot be written \(Input/output error\)"):
                put(store, 2, other)
        assert [path.name for path in tmp_path.iterdir()] == ["trajectory_00002.h5"]
        assert same(store.read(2)[0])
    put(store, 2, other)
    assert same(store.read(2)[0], other)


def test_two_writers_and_a_reader_never_see_half_a_file(tmp_path):
    """Processes that overwrite one trajectory as fast as they can, while another reads it."""
    code = """
import sys, numpy as np
from pathlib import Path
from dacore.core.model import Trajectory
from dacore.io.snapshots import TrajectoryStore
store = TrajectoryStore(Path(sys.argv[1]), "key")
value = float(sys.argv[2])
for _ in range(60):
    store.write(0, Trajectory(np.full((2000, 30), value), np.arange(30.0)), np.ones(1), ("a",), {})
"""
    writers = [subprocess.Popen([sys.executable, "-c", code, tmp_path, str(k)], cwd=ROOT) for k in (1, 2)]
    store, seen = TrajectoryStore(tmp_path, "key"), set()
    try:
        while any(writer.poll() is None for writer in writers):
            if 0 in store:
                states = store.read(0)[0].states
                assert (states == states[0, 0]).all()
                seen.add(states[0, 0])
    finally:
        for writer in writers:
            writer.wait()
    assert [writer.returncode for writer in writers] == [0, 0]
    assert seen <= {1.0, 2.0}
    assert [path.name for path in tmp_path.iterdir()] == ["trajectory_00000.h5"]


def test_this_process_may_write_large_files():
    """The limits above were another process's."""
    assert resource.getrlimit(resource.RLIMIT_FSIZE)[0] == resource.RLIM_INFINITY
    assert signal.getsignal(signal.SIGXFSZ) == signal.SIG_IGN
