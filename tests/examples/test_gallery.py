"""Every example of the gallery runs by itself, ends in a figure with labelled axes, and is short."""

import ast
import runpy
import shutil
from pathlib import Path

import pytest

pytest.importorskip("matplotlib")

GALLERY = Path(__file__).parents[2] / "examples" / "gallery"
EXAMPLES = sorted(GALLERY.glob("plot_*.py"))
LINES = 60


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The gallery's scenes in a folder of their own, where results are kept between examples."""
    found = tmp_path_factory.mktemp("gallery")
    for scene in GALLERY.glob("*.toml"):
        shutil.copy(scene, found)
    return found


def test_there_are_examples():
    assert len(EXAMPLES) >= 12
    assert (GALLERY / "GALLERY_HEADER.rst").exists()


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_runs_and_ends_in_a_figure(path, folder, monkeypatch):
    import matplotlib as mpl
    from matplotlib import pyplot

    monkeypatch.chdir(folder)
    pyplot.switch_backend("Agg")
    before = dict(mpl.rcParams)
    try:
        runpy.run_path(str(path), run_name="__main__")
        numbers = pyplot.get_fignums()
        assert len(numbers) == 1
        figure = pyplot.figure(numbers[0])
        figure.canvas.draw()
        shown = [ax for ax in figure.axes if ax.get_label() != "<colorbar>" and ax.get_visible()]
        assert shown
        assert any(ax.get_xlabel() for ax in shown)
        assert any(ax.get_ylabel() for ax in shown) or any(len(ax.get_yticklabels()) for ax in shown)
        for bar in (ax for ax in figure.axes if ax.get_label() == "<colorbar>"):
            assert "[" in (bar.get_ylabel() or bar.get_xlabel())
        assert dict(mpl.rcParams) == before
    finally:
        pyplot.close("all")


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_is_short_and_told(path):
    text = path.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= LINES
    told = (ast.get_docstring(ast.parse(text)) or "").splitlines()
    assert set(told[1]) == {"="}
    assert len(told[1]) == len(told[0])
    assert len(" ".join(told[3:])) > 80
    assert "show()" not in text
    assert "rcParams" not in text
