"""Keys of content: equal content, equal keys, whatever object holds it."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from dacore.workflow.content import content_key


@dataclass(frozen=True)
class Shown:
    values: Any
    label: str = "u"


def test_equal_content_has_equal_keys():
    one = Shown({"a": np.arange(3.0), "b": [1, "x", None, True]})
    other = Shown({"a": np.arange(6.0)[:3].copy(), "b": [1, "".join(["x"]), None, True]}, "".join("u"))
    assert content_key(one, content_key) == content_key(other, content_key)
    # A view that is not contiguous shows the same numbers.
    assert content_key(np.arange(6.0).reshape(3, 2)[:, 0]) == content_key(np.array([0.0, 2.0, 4.0]))


@pytest.mark.parametrize(
    "other",
    [
        Shown(np.arange(3.0), "v"), Shown(np.arange(3)), Shown(np.arange(3.0)[:, None]), Shown([0.0, 1.0, 2.0]),
        Shown(np.array([0.0, 1.0, np.nextafter(2.0, 3.0)])), Shown({"values": np.arange(3.0)}), np.arange(3.0),
    ],
)  # fmt: skip
def test_other_content_has_other_keys(other):
    assert content_key(other) != content_key(Shown(np.arange(3.0)))


def test_pieces_do_not_run_into_each_other():
    assert content_key("ab", "c") != content_key("a", "bc")
    assert content_key(["a"], ["b"]) != content_key(["a", "b"], [])


@pytest.mark.parametrize("value", [object(), lambda: 0, np.array([object()]), Shown(object())])
def test_what_has_no_content_to_go_by_has_no_key(value):
    assert content_key(value) is None
