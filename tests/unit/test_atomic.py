"""Files appear whole or not at all."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from dacore.errors import StoreError
from dacore.io.atomic import atomic_path, atomic_write, make_folder
from dacore.io.leftovers import AGE_ELSEWHERE, mark, present, sweep

ROOT = Path(__file__).resolve().parents[2]


def test_writes_text_and_bytes_and_makes_the_folder(tmp_path):
    target = tmp_path / "a" / "b.txt"
    with atomic_write(target) as stream:
        stream.write("β = 1\n")
        assert stream.write(b"end") == 3
    assert target.read_bytes() == "β = 1\n".encode() + b"end"
    assert list(target.parent.iterdir()) == [target]


def fail_half_way(target):
    with atomic_write(target) as stream:
        stream.write("half")
        assert target.read_text() == "old"
        raise RuntimeError


def test_a_failure_leaves_the_old_file_and_nothing_else(tmp_path):
    target = tmp_path / "b.txt"
    target.write_text("old")
    with pytest.raises(RuntimeError):
        fail_half_way(target)
    assert target.read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]


def test_path_keeps_the_suffix_and_must_be_written(tmp_path):
    with atomic_path(tmp_path / "c.vtu") as path:
        assert path.suffix == ".vtu"
        assert path.parent == tmp_path
        path.write_text("data")
    assert (tmp_path / "c.vtu").read_text() == "data"
    with pytest.raises(StoreError, match="nothing was written"), atomic_path(tmp_path / "d.vtu"):
        pass
    assert not (tmp_path / "d.vtu").exists()


def test_errors_name_the_path(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(StoreError, match="cannot make this folder"), atomic_write(tmp_path / "file" / "x") as stream:
        stream.write("")
    with pytest.raises(StoreError, match="is a folder"), atomic_write(tmp_path) as stream:
        stream.write("")


def test_a_foreign_os_error_passes_through(tmp_path):
    with pytest.raises(FileNotFoundError), atomic_write(tmp_path / "x") as stream:
        stream.write((tmp_path / "missing").read_bytes())
    assert list(tmp_path.iterdir()) == []


def dead_mark():
    """The mark of a process that has ended."""
    code = "from dacore.io.leftovers import mark; print(mark())"
    return subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT
    ).stdout.strip()  # fmt: skip


def test_what_a_dead_process_left_is_removed_and_nothing_else(tmp_path):
    dead, (_, place, process, began) = dead_mark(), mark().split("-")
    assert dead.split("-")[1] == place
    leave = [
        f".trajectory_00001.{dead}-00c0ffee.h5", f".results.{dead}-00c0ffee.json", f".plain.{dead}-00c0ffee",
        f".used.dacore-{place}-{process}-{int(began) + 1}-00c0ffee.h5",
    ]  # fmt: skip
    stay = [
        f".trajectory_00001.{mark()}-00c0ffee.h5", f"trajectory_00001.{dead}-00c0ffee.h5", "trajectory_00002.h5",
        ".bashrc", ".mine.00c0ffee.h5",
        f".elsewhere.dacore-00000000-{process}-{began}-00c0ffee.h5",
    ]  # fmt: skip
    for name in (*leave, *stay):
        (tmp_path / name).write_text("half")
    make_folder(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(stay)


def test_what_another_machine_left_is_removed_after_a_day(tmp_path):
    file = tmp_path / ".trajectory_00001.dacore-00000000-17-99-00c0ffee.h5"
    file.write_text("half")
    now = file.stat().st_mtime
    os.utime(file, (now, now - AGE_ELSEWHERE + 60))
    sweep(tmp_path)
    assert file.exists()
    os.utime(file, (now, now - AGE_ELSEWHERE - 60))
    sweep(tmp_path)
    assert not file.exists()


def test_a_sweep_of_nothing_is_nothing(tmp_path):
    sweep(tmp_path / "none")
    assert list(tmp_path.iterdir()) == []


def test_processes_in_one_folder_know_of_each_other(tmp_path):
    (tmp_path / f".present.{dead_mark()}-00c0ffee").touch()
    with present(tmp_path) as first, present(tmp_path) as second, present(tmp_path) as third:
        assert (first, second, third) == (0, 1, 2)
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(StoreError, match="cannot write"), present(tmp_path / "none"):
        pass
