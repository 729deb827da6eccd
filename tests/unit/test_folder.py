"""Folders that appear whole or not at all."""

import re

import pytest

from dacore.errors import StoreError
from dacore.io.folder import atomic_folder, check_folder
from dacore.io.leftovers import mark

SIGN = "sign.json"


def fill(folder, text="new"):
    with atomic_folder(folder, SIGN) as temporary:
        (temporary / "deep").mkdir()
        (temporary / "deep" / "part").write_text(text)
        earlier = folder / "deep" / "part"
        assert not earlier.exists() or earlier.read_text() != text
        (temporary / SIGN).write_text(text)


def fail(folder, error):
    with atomic_folder(folder, SIGN) as temporary:
        (temporary / "half").write_text("half")
        raise error


def meanwhile(folder):
    with atomic_folder(folder, SIGN) as temporary:
        (temporary / SIGN).write_text("newest")
        for name in ("late", "later"):
            (folder / name).write_text("put there while the work went on")


def test_a_folder_appears_whole_and_replaces_its_own_kind(tmp_path):
    target = tmp_path / "a" / "b"
    fill(target)
    fill(target, "newer")
    assert (target / "deep" / "part").read_text() == "newer"
    assert [each.name for each in target.parent.iterdir()] == ["b"]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit])
def test_what_was_there_stays_when_the_work_fails(tmp_path, error):
    target = tmp_path / "b"
    for before in (False, True):
        with pytest.raises(error):
            fail(target, error)
        assert target.exists() == before
        assert len(list(tmp_path.iterdir())) == int(before)
        fill(target, f"old{before}")
    assert (target / SIGN).read_text() == "oldTrue"


def test_a_block_that_forgets_the_sign_leaves_nothing(tmp_path):
    with pytest.raises(StoreError, match=r"sign\.json was not written"), atomic_folder(tmp_path / "b", SIGN):
        pass
    assert not list(tmp_path.iterdir())


def test_other_peoples_folders_and_files_are_left_alone(tmp_path):
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis" / "chapter").write_text("years")
    (tmp_path / "file").write_text("years")
    for name in ("thesis", "file"):
        with pytest.raises(StoreError, match="holds something else"):
            fill(tmp_path / name)
    assert (tmp_path / "thesis" / "chapter").read_text() == (tmp_path / "file").read_text() == "years"
    (tmp_path / "empty").mkdir()
    check_folder(tmp_path / "empty", SIGN)
    fill(tmp_path / "empty")


def test_what_somebody_put_into_an_earlier_folder_is_not_deleted(tmp_path):
    target = tmp_path / "b"
    fill(target)
    for path in (target / "notes.txt", target / "deep" / "view.pvsm"):
        path.write_text("years")
        with pytest.raises(StoreError, match=rf"holds {path.relative_to(target)}, which an earlier run did not write"):
            fill(target, "newer")
        assert path.read_text() == "years"
        assert (target / SIGN).read_text() == "new"
        path.unlink()
    (target / "deep" / "part").unlink()  # what is gone is nobody's loss
    fill(target, "newer")
    with pytest.raises(StoreError, match="holds late and 1 more"):
        meanwhile(target)
    assert (target / SIGN).read_text() == "newer"
    assert [each.name for each in tmp_path.iterdir()] == ["b"]


def test_what_a_killed_process_left_is_removed_and_what_a_living_one_makes_is_not(tmp_path):
    dead = re.sub(r"-\d+-\d+$", "-4194303-1", mark())
    for who in (dead, mark()):
        (tmp_path / f".b.{who}-0123abcd").mkdir()
        (tmp_path / f".b.{who}-0123abcd" / "half").write_text("half")
    fill(tmp_path / "b")
    assert sorted(each.name for each in tmp_path.iterdir()) == [f".b.{mark()}-0123abcd", "b"]
