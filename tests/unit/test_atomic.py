"""Files appear whole or not at all."""

import pytest

from dacore.errors import StoreError
from dacore.io.atomic import atomic_path, atomic_write


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
