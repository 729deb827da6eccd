"""What the site's own extensions do: links out of the docs, docstrings, commands, and the look at built pages."""

import importlib
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from typer.testing import CliRunner

from dacore.cli.main import app
from dacore.plugins.spec import Hooks

ROOT = Path(__file__).resolve().parents[2]
EXTENSIONS = ROOT / "docs/_ext"


@pytest.fixture(autouse=True)
def _beside(monkeypatch):
    monkeypatch.syspath_prepend(str(EXTENSIONS))


def extension(name):
    return importlib.import_module(name)


def test_every_command_and_option_of_the_help_is_on_the_page():
    shown = {name: (usage, dict(rows)) for name, usage, _, rows in extension("described").described()}
    names = [name.partition(" ")[2] for name in shown]
    assert {"", "run", "plan", "compare", "bench", "stress", "plugins"} <= set(names)
    for name in names:
        out = CliRunner().invoke(app, [*name.split(), "--help"], env={"COLUMNS": "200", "TERM": "dumb"}).output
        usage, rows = shown[f"dacore {name}".strip()]
        options = {word.strip(",") for line in out.splitlines() for word in line.split()[:3] if word.startswith("--")}
        assert options
        assert options <= {word.strip(",") for row in rows for word in row.split()}, name
        for text in rows.values():
            assert " ".join(text.split())[:30] in " ".join(out.split()), name
        assert usage.startswith("dacore")


def test_links_out_of_the_docs_lead_to_the_site_s_pages():
    links = extension("links")

    def one(text, page):
        return links.rewritten(text, page, ROOT)

    assert one("[a](../CONTRIBUTING.md#where-things-go)", "architecture") == "[a](contributing.md#where-things-go)"
    assert one("[a](../../README.md)", "adr/README") == "[a](../index.md)"
    assert one("[all](../plugins)", "backends") == "all (`plugins`)"
    for kept in ("[a](../examples/toy/ball.toml)", "[a](time.md#starts)", "[a](https://x.org/../b)", "![a](../b.png)"):
        assert one(kept, "scenes") == kept


def test_formulas_in_docstrings_are_no_markup():
    plain = extension("docstrings").plain
    lines = ["Mean (1/|Ω|) ∫ v of `a|b` and ``x_``, a name_ with_many parts::", "", "    |code| x_", "", "|after|"]
    assert plain(lines) == [
        "Mean (1/\\|Ω\\|) ∫ v of `a|b` and ``x_``, a name\\_ with_many parts::", "", "    |code| x_", "", "\\|after\\|",
    ]  # fmt: skip
    assert plain(plain(lines)) == plain(lines)


def test_the_house_has_the_floors_and_the_kinds_of_plugins_of_the_code(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "docs/figures"))
    house = importlib.import_module("house")
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    floors = settings["tool"]["importlinter"]["contracts"][0]["layers"]
    assert [name.split(" · ") for name, _ in house.FLOORS] == [re.split(r" [|:] ", floor) for floor in reversed(floors)]
    hooks = [name.removeprefix("dacore_") for name in vars(Hooks) if name.startswith("dacore_")]
    assert sorted(house.OUTSIDE) == sorted(hooks)
    number = ("eight", "nine", "ten")[len(hooks) - 8]
    picture = (ROOT / "docs/figures/house.py").read_text(encoding="utf-8")
    assert f'"{number} kinds,' in picture


PAGE = "<html><head>{}</head><body><h1 id='top'>T</h1>{}</body></html>"


@pytest.mark.parametrize(
    ("head", "body", "fault"),
    [
        ("<script src='https://cdn.org/x.js'></script>", "", "fetches https://cdn.org/x.js"),
        ("<link rel='stylesheet' href='//fonts.org/x.css'>", "", "fetches //fonts.org/x.css"),
        ("", "<img src='https://x.org/a.png'>", "fetches https://x.org/a.png"),
        ("<script src='gone.js'></script>", "", "gone.js is not there"),
        ("", "<a href='gone.html'>x</a>", "gone.html leads nowhere"),
        ("", "<a href='#gone'>x</a>", "#gone leads to no place of its page"),
        ("", "<a href='other.html#gone'>x</a>", "other.html#gone leads to no place of its page"),
        ("", "<p>\n```{note}\n</p>", "raw directive '```{note}'"),
        ("", "<p>see {term}`x`</p>", "raw directive '{term}`'"),
        ("", "<pre>/home/somebody/x</pre>", "shows '/home/somebody'"),
    ],
)
def test_each_fault_of_a_page_is_seen(head, body, fault, tmp_path):
    look = extension("look")
    (tmp_path / "other.html").write_text(PAGE.format("", ""))
    (tmp_path / "index.html").write_text(PAGE.format(head, body))
    assert list(look.faults(tmp_path, ("/home/somebody",))) == [f"index.html: {fault}"]


def test_a_page_without_fault(tmp_path):
    look = extension("look")
    (tmp_path / "style.css").write_text("@import url('print.css'); body { background: url(data:image/png;base64,AA) }")
    (tmp_path / "other.html").write_text(PAGE.format("<link rel='stylesheet' href='style.css?v=1'>", ""))
    body = "<a href='other.html#top'>a</a><a href='https://x.org'>b</a><pre>```{note} $ curl https://x.org</pre>"
    (tmp_path / "index.html").write_text(PAGE.format("", body))
    assert list(look.faults(tmp_path)) == []


def test_a_style_that_fetches_is_seen_and_the_command_fails(tmp_path):
    (tmp_path / "theme.css").write_text("@font-face { src: url('https://fonts.org/a.woff2') }")
    done = subprocess.run(
        [sys.executable, EXTENSIONS / "look.py", tmp_path], capture_output=True, text=True, check=False
    )  # fmt: skip
    assert done.returncode == 1
    assert done.stderr == "theme.css: fetches from the web\n"


def test_a_cache_of_executed_pages_follows_the_code(tmp_path):
    clone = extension("clone")
    (tmp_path / "dacore").mkdir()
    (tmp_path / "dacore/a.py").write_text("x = 1\n")
    first = clone.cache(tmp_path, tmp_path / "_build")
    assert clone.cache(tmp_path, tmp_path / "_build") == first
    (tmp_path / "dacore/a.py").write_text("x = 2\n")
    assert clone.cache(tmp_path, tmp_path / "_build") != first
