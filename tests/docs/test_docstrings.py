"""Docstrings keep to numpydoc: all that the reference shows, more strictly what users and authors of plugins call."""

import importlib
import inspect
import re
from pathlib import Path

import pytest

pytest.importorskip("numpydoc")

from numpydoc.validate import validate

ROOT = Path(__file__).parents[2]
PAGES = sorted((ROOT / "docs" / "reference").glob("*.md"))
SHOWN = sorted({name for page in PAGES for name in re.findall(r"^   (dacore[\w.]*)$", page.read_text(), re.MULTILINE)})

# There is a docstring with a first line of its own, sections are known and in order, and every parameter that it names
# is there.
ALWAYS = {"GL08", "GL06", "GL07", "SS01", "SS03", "PR02", "RT02", "YD01"}
# Every parameter with its type, in order, and what is returned.
STRICTLY = ALWAYS | {"PR01", "PR03", "PR04", "RT01"}
# numpydoc takes a first parameter called cls for the class of a class method.
EXEMPT = {"dacore.plugins.settings.build: PR02 Unknown parameters {'cls'}"}

# What is called by users and implemented by authors of plugins.
STRICT = (
    "dacore.workflow.open", "dacore.workflow.session", "dacore.workflow.reconstruct.run", "dacore.studies.outcomes",
    "dacore.errors", "dacore.plugins.spec", "dacore.plugins.registry",
    "dacore.plotting.fields", "dacore.plotting.places", "dacore.plotting.results", "dacore.plotting.spaces",
    "dacore.core.arrays", "dacore.core.background", "dacore.core.checks", "dacore.core.display", "dacore.core.domain",
    "dacore.core.estimate", "dacore.core.estimator", "dacore.core.fespace", "dacore.core.fields", "dacore.core.mesh",
    "dacore.core.misfit", "dacore.core.model", "dacore.core.noise", "dacore.core.observation",
    "dacore.core.parameters", "dacore.core.quantity", "dacore.core.reduced", "dacore.core.simplex",
    "dacore.core.solver", "dacore.core.space", "dacore.core.timegrid", "dacore.core.uncertainty",
)  # fmt: skip


def public(module):
    """Full names of the public classes, methods and functions that a module makes."""
    for name, value in vars(module).items():
        if name.startswith("_") or getattr(value, "__module__", None) != module.__name__:
            continue
        if inspect.isclass(value):
            yield f"{module.__name__}.{name}"
            for key, member in vars(value).items():
                inner = member.__func__ if isinstance(member, classmethod | staticmethod) else member
                if not key.startswith("_") and inspect.isfunction(inner) and not inherited(value, key):
                    yield f"{module.__name__}.{name}.{key}"
        elif inspect.isfunction(value):
            yield f"{module.__name__}.{name}"


def inherited(cls, key):
    """Whether a class above says what the method takes and returns: one line says what is special here."""
    return any(key in vars(base) for base in cls.__mro__[1:] if base.__module__.startswith("dacore"))


def faults(name, codes):
    for code, message in validate(name)["errors"]:
        if code in codes:
            fault = f"{name}: {code} {message}"
            if fault not in EXEMPT:
                yield fault


def test_the_reference_shows_what_is_strict():
    assert len(SHOWN) > 100
    missing = set(STRICT) - set(SHOWN) - {"dacore.workflow.reconstruct.run"}
    assert missing == set()


@pytest.mark.parametrize("name", sorted({*SHOWN, *STRICT}))
def test_docstrings_keep_to_numpydoc(name):
    try:
        module = importlib.import_module(name)
    except ImportError as error:
        if (error.name or "").partition(".")[0].startswith("dacore"):
            raise
        pytest.skip(f"{name} needs {error.name}")
    found = [fault for each in public(module) for fault in faults(each, STRICTLY if name in STRICT else ALWAYS)]
    assert found == []


def test_a_fault_is_found():
    def wrong(one, two):
        """Add.

        Parameters
        ----------
        two, three : int
        """

    module = type(importlib)("dacore_wrong")
    wrong.__module__, wrong.__qualname__ = module.__name__, "wrong"
    module.wrong = wrong
    import sys

    sys.modules["dacore_wrong"] = module
    try:
        assert list(public(module)) == ["dacore_wrong.wrong"]
        text = " ".join(faults("dacore_wrong.wrong", STRICTLY))
        assert "PR01" in text
        assert "PR02" in text
    finally:
        del sys.modules["dacore_wrong"]
