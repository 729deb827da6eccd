"""Names on their way out: said where they are used, and still working."""

import logging
import warnings
from dataclasses import dataclass
from pathlib import Path

import pytest

from dacore.deprecation import Renamed, deprecated, renamed_keys, warn_deprecated
from dacore.errors import SceneError
from dacore.plugins.settings import build


@deprecated(since="0.2", removed_in="0.4", instead="new_way")
def old_way(value, *, twice=False):
    """Say it."""
    return 2 * value if twice else value


def test_a_function_that_goes_still_works_and_warns_at_its_caller():
    with pytest.warns(
        DeprecationWarning, match=r"old_way is deprecated since 0.2 and will be removed in 0.4; use new"
    ) as told:
        assert old_way(3, twice=True) == 6
    assert told[0].filename == __file__
    assert (old_way.__name__, old_way.__doc__) == ("old_way", "Say it.")


def test_it_is_said_once_for_each_place():
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("default")
        for _ in range(3):
            old_way(1)
        old_way(2)
    assert len({each.lineno for each in told}) == len(told) == 2


def test_a_helper_of_a_helper_points_at_who_called_it():
    def helper():
        warn_deprecated("this", since="0.2", removed_in="0.4", instead="that")

    def between():
        helper()

    with pytest.warns(DeprecationWarning, match="^this is deprecated") as told:
        between()
    assert told[0].filename == __file__
    assert Path(__file__).read_text(encoding="utf-8").splitlines()[told[0].lineno - 1].strip() == "helper()"


@dataclass(frozen=True)
class Settings:
    renamed = {"size": Renamed("edge", "0.2", "0.4")}  # noqa: RUF012

    edge: float = 1.0


def test_an_old_key_of_a_table_is_read_and_told_in_the_log(caplog):
    with caplog.at_level(logging.WARNING, "dacore"):
        assert build(Settings, {"size": 2.0}, "demo.toml: domain") == Settings(2.0)
    assert caplog.messages == ["demo.toml: domain.size: deprecated since 0.2 and refused from 0.4 on; write edge"]
    caplog.clear()
    assert build(Settings, {"edge": 3.0}, "demo.toml: domain") == Settings(3.0)
    assert not caplog.messages
    with pytest.raises(SceneError, match=r"demo\.toml: domain\.size: unknown key"):
        build(Settings, {"size": 2.0, "edge": 3.0}, "demo.toml: domain")


def test_tables_without_old_keys_stay_as_they_are():
    table = {"a": 1, "b": [2]}
    assert renamed_keys(table, {"c": Renamed("a", "0.2", "0.4")}, "here") == table
