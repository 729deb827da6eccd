"""Trajectories on disk: exact, atomic, and never silently wrong."""

import h5py
import numpy as np
import pytest

from dacore.core.model import Trajectory
from dacore.errors import StoreError
from dacore.io.snapshots import TrajectoryStore

TRAJECTORY = Trajectory(np.arange(12.0).reshape(4, 3) / 7, np.array([0.1, 0.2, 0.3]))


def filled(tmp_path):
    store = TrajectoryStore(tmp_path, "key")
    store.write(2, TRAJECTORY, np.array([1.0, 2.0]), {"u": "cm"})
    return store


def test_round_trip_is_exact(tmp_path):
    store = filled(tmp_path)
    found, parameters = store.read(2)
    assert 2 in store
    assert 1 not in store
    assert np.array_equal(found.states, TRAJECTORY.states)
    assert np.array_equal(found.times, TRAJECTORY.times)
    assert np.array_equal(parameters, [1.0, 2.0])
    assert [path.name for path in tmp_path.iterdir()] == ["trajectory_00002.h5"]


def test_a_changed_byte_is_noticed(tmp_path):
    store = filled(tmp_path)
    path = store.path(2)
    content = bytearray(path.read_bytes())
    at = content.find(TRAJECTORY.states.tobytes())
    assert at > 0
    content[at + 8] ^= 1
    path.write_bytes(bytes(content))
    with pytest.raises(StoreError, match="damaged"):
        store.read(2)


def test_a_truncated_file_is_noticed(tmp_path):
    store = filled(tmp_path)
    content = store.path(2).read_bytes()
    store.path(2).write_bytes(content[: len(content) // 2])
    with pytest.raises(StoreError, match="damaged"):
        store.read(2)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [("magic", "other", "not a dacore"), ("schema", 99, "schema 99"), ("key", "x", "other settings")],
)
def test_foreign_files_are_refused(tmp_path, name, value, message):
    store = filled(tmp_path)
    with h5py.File(store.path(2), "a") as file:
        file.attrs[name] = value
    with pytest.raises(StoreError, match=message):
        store.read(2)


def test_a_folder_that_cannot_be_made(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(StoreError, match="cannot make"):
        TrajectoryStore(tmp_path / "file" / "below", "key")


def test_a_write_that_fails_leaves_nothing(tmp_path, monkeypatch):
    store = TrajectoryStore(tmp_path, "key")

    def full(*_args, **_kwargs):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(h5py.Group, "create_dataset", full)
    with pytest.raises(StoreError, match="cannot be written"):
        store.write(0, TRAJECTORY, np.zeros(1), {})
    assert list(tmp_path.iterdir()) == []
