"""Everything the installed distributions declare is there and keeps its kind's contract."""

from dataclasses import fields, is_dataclass

import pytest

from dacore.plugins.registry import KINDS, load

REGISTRY = load()
DECLARED = [(kind, spec.name) for kind in KINDS for spec in REGISTRY.specs(kind)]


def test_nothing_failed_to_load():
    assert [str(each) for each in REGISTRY.failures] == []


@pytest.mark.parametrize(("kind", "name"), DECLARED)
def test_every_declared_class_can_be_had(kind, name):
    row = next(row for row in REGISTRY.table() if (row.kind, row.name) == (kind, name))
    if row.status.startswith("missing"):
        pytest.skip(row.status)
    cls = REGISTRY.get(kind, name)
    assert row.status == "ready"
    assert row.summary
    if kind == "backend":
        assert cls().version() != "unknown"
    else:
        assert is_dataclass(cls)
        assert cls.__dataclass_params__.frozen, "settings never change"


@pytest.mark.parametrize(("kind", "name"), [each for each in DECLARED if each[0] != "backend"])
def test_every_setting_can_be_written_in_a_scene(kind, name):
    from dacore.errors import SceneError
    from dacore.plugins.settings import build

    row = next(row for row in REGISTRY.table() if (row.kind, row.name) == (kind, name))
    if row.status.startswith("missing"):
        pytest.skip(row.status)
    cls = REGISTRY.get(kind, name)
    # An unknown key is refused by naming every known one, after which each known one is read.
    with pytest.raises(SceneError, match="unknown key"):
        build(cls, {"no_such_key": 1}, "test")
    for field in fields(cls):
        with pytest.raises(SceneError, match=rf"^test\.{field.name}: got"):
            build(cls, {field.name: object()}, "test")
