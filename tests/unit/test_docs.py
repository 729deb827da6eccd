"""The documents say what the code does: keys, defaults, snippets, links, examples that run."""

import re
import subprocess
import sys
import tomllib
from dataclasses import MISSING, fields, replace
from pathlib import Path
from urllib.parse import unquote

import pytest
from pydantic import BaseModel
from pydantic_core import PydanticUndefined

from dacore.errors import MissingDependencyError
from dacore.io import scene as scenes
from dacore.io.scene import Scene, validate
from dacore.plugins.registry import load
from dacore.workflow.build import Builder
from dacore.workflow.open import open_scene
from dacore.workflow.stages import scene_pipeline
from dacore.workflow.studies.cohort import PatientGroup
from dacore.workflow.studies.mismatch import Truth
from dacore.workflow.studies.variants import Setting

ROOT = Path(__file__).resolve().parents[2]
SCENES = (ROOT / "docs/scenes.md").read_text(encoding="utf-8")
WRITTEN = [page for page in sorted((ROOT / "docs").rglob("*.md")) if "_build" not in page.parts]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *WRITTEN]
TESTS = [*ROOT.glob("tests/*/test_*.py"), *ROOT.glob("plugins/*/tests/test_*.py")]
REGISTRY = load()
TABLES = {
    "domain": "Domain", "model": "Physics", "observation": "Observation", "quantity": "Quantity",
    "estimator": "Estimator", "solver": "Solver", "study": "Study",
}  # fmt: skip
DECLARED = [(kind, spec.name) for kind in TABLES for spec in REGISTRY.specs(kind)]
CORE = {
    "discretization": scenes.Discretization, "time": scenes.Time, "solver": scenes.SolverTable,
    "training": scenes.Training, "observed": scenes.Observed, "noise": scenes.Noise,
    "validation": scenes.Validation, "report": scenes.Views,
}  # fmt: skip


def sections(text):
    """Text under each heading, up to the next heading of any depth; code blocks hold no headings."""
    found, heading, fenced = {}, "", False
    for line in text.splitlines():
        if line.startswith("```"):
            fenced = not fenced
        match = None if fenced else re.match(r"#+ (.*)", line)
        if match:
            heading = match[1]
            assert heading not in found, f"heading {heading!r} is there twice"
        found[heading] = found.get(heading, "") + line + "\n"
    return found


def blocks(text, language):
    return re.findall(rf"^```{language}\n(.*?)^```", text, re.MULTILINE | re.DOTALL)


def tables(text):
    """Every table with the columns key and default: {key: default}."""
    out = []
    for block in re.findall(r"(?:^\|.*\n)+", text, re.MULTILINE):
        rows = [[cell.strip() for cell in line.strip("|\n").split("|")] for line in block.splitlines()]
        if rows[0][0] == "key":
            assert {len(row) for row in rows} == {5}, rows
            assert all(row[4] for row in rows[2:]), f"a key without a meaning: {rows}"
            out.append({row[0].strip("`"): row[3] for row in rows[2:]})
    return out


def check_defaults(documented, expected, where):
    assert set(documented) == set(expected), where
    for key, default in expected.items():
        text = documented[key]
        if default is MISSING:
            assert text == "required", f"{where}: {key}"
        elif default is None:
            assert text == "–", f"{where}: {key}"
        else:
            assert re.fullmatch("`.*`", text), f"{where}: {key}"
            assert tomllib.loads(f"x = {text.strip('`')}")["x"] == plain(default), f"{where}: {key}"


def plain(value):
    return [plain(each) for each in value] if isinstance(value, tuple | list) else value


def expected_of_model(model):
    out = {}
    for name, field in model.model_fields.items():
        default = field.get_default(call_default_factory=True)
        out[name] = MISSING if default is PydanticUndefined else default
    return out


def expected_of_dataclass(cls):
    return {
        f.name: f.default if f.default_factory is MISSING else f.default_factory() for f in fields(cls) if f.init
    }  # fmt: skip


def plugin_class(kind, name):
    try:
        return REGISTRY.get(kind, name)
    except MissingDependencyError as error:
        pytest.skip(str(error))


@pytest.mark.parametrize(("kind", "name"), DECLARED)
def test_every_setting_of_every_plugin_is_documented_with_its_default(kind, name):
    heading = f"{TABLES[kind]} `{name}`"
    assert heading in sections(SCENES), f"docs/scenes.md has no section '### {heading}'"
    documented = next(iter(tables(sections(SCENES)[heading])), {})
    check_defaults(documented, expected_of_dataclass(plugin_class(kind, name)), heading)


def test_no_plugin_is_documented_that_is_not_there():
    headings = [f"{TABLES[kind]} `{name}`" for kind, name in DECLARED]
    words = "|".join(TABLES.values())
    assert set(re.findall(rf"^### ((?:{words}) `\w+`)$", SCENES, re.MULTILINE)) <= set(headings)


def test_every_backend_is_named():
    for spec in REGISTRY.specs("backend"):
        assert f"`{spec.name}`" in sections(SCENES)["`[discretization]`"]


@pytest.mark.parametrize("name", CORE)
def test_every_key_of_the_core_tables_is_documented_with_its_default(name):
    check_defaults(tables(sections(SCENES)[f"`[{name}]`"])[0], expected_of_model(CORE[name]), name)


def test_every_table_of_a_scene_is_documented():
    rows = re.findall(r"^\| `\[?([a-z]+)(?:\.NAME)?\]?` \|", sections(SCENES)["The tables of a scene"], re.MULTILINE)
    assert sorted(rows) == sorted(Scene.model_fields)
    tabled = {name for name, field in Scene.model_fields.items() if is_table(field.annotation)}
    assert tabled == set(CORE), "a table of the core without a section in this test"


def is_table(annotation):
    return (
        isinstance(annotation, type) and issubclass(annotation, BaseModel) and annotation is not scenes.PluginTable
    )  # fmt: skip


def test_tables_within_tables_are_documented():
    check_defaults(tables(sections(SCENES)["`[parameters]`"])[0], expected_of_model(scenes.Range), "parameters")
    check_defaults(tables(sections(SCENES)["`[validation]`"])[1], expected_of_model(scenes.Contrast), "contrasts")
    voxels = plugin_class("observation", "voxels")
    slices = sys.modules[voxels.__module__].Slice
    check_defaults(tables(sections(SCENES)["Observation `voxels`"])[1], expected_of_dataclass(slices), "slices")
    check_defaults(tables(sections(SCENES)["`[report]`"])[1], expected_of_model(scenes.Published), "published")
    for kind, cls in (("variants", Setting), ("mismatch", Truth), ("cohort", PatientGroup)):
        check_defaults(tables(sections(SCENES)[f"Study `{kind}`"])[1], expected_of_dataclass(cls), kind)


def test_parameters_of_the_physics_are_documented():
    space = plugin_class("model", "biot")().parameters
    rows = re.findall(r"^\| (`\w+`(?:, `\w+`)*) \| ([^|]*)\| ([^|]*)\|", sections(SCENES)["Physics `biot`"], re.M)
    ranges = {name.strip("`"): (unit.strip(), text.strip()) for names, unit, text in rows for name in names.split(", ")}
    for parameter in space.parameters:
        assert parameter.name in ranges
    for parameter in space.free:
        unit, text = ranges[parameter.name]
        assert unit == parameter.unit.replace("^2", "²")
        assert tomllib.loads(f"x = {text.strip('`')}")["x"] == [parameter.low, parameter.high]


SNIPPETS = [
    pytest.param(text, id=f"{page.name}-{number}")
    for page in PAGES
    for number, text in enumerate(blocks(page.read_text(encoding="utf-8"), "toml"))
]


@pytest.mark.parametrize("snippet", SNIPPETS)
def test_every_toml_snippet_is_a_scene_or_fits_onto_one(snippet, tmp_path):
    table = tomllib.loads(snippet)
    onto = re.match(r"# onto (\S+)\n", snippet)
    assert onto or snippet.startswith("# a whole scene\n"), "say in the first line what the snippet is"
    if onto:
        whole = tomllib.loads((ROOT / onto[1]).read_text(encoding="utf-8"))
        table = merged(whole, table)
    if "path" in table["domain"]:
        (tmp_path / table["domain"]["path"]).touch()
    builder = Builder(validate(table, "snippet"), "snippet", tmp_path)
    try:
        builder.check()
    except MissingDependencyError as error:
        pytest.skip(str(error))
    if builder.scene.study:
        scene_pipeline(builder)  # refuses variants that cannot be and names that are not there
    if any(isinstance(each, dict) and "unit" in each for each in table.get("parameters", {}).values()):
        pytest.importorskip("pint")
    ranges = {each.name: (each.low, each.high) for each in builder.parameters(builder.physics).parameters}
    replace(builder.physics, ranges=ranges)  # refuses what is not physical
    if table["domain"]["kind"] in ("ball", "box"):
        space = builder.model(builder.domain.mesh()).space
        assert builder.functionals(space).dropped >= 0  # refuses places outside the domain
        for quantity in builder.quantities.values():
            assert quantity.functionals(space).count == 1


def merged(whole, part):
    """Tables with a kind are replaced, others changed key by key, named ones added."""
    out = dict(whole)
    for key, value in part.items():
        replaces = not isinstance(value, dict) or "kind" in value
        out[key] = value if replaces else merged(out.get(key, {}), value)
    return out


def anchors(page):
    """GitHub's names of a page's headings."""
    names = [re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in sections(page) if heading]
    return set(names)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_relative_links_lead_somewhere(page):
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    for link in re.findall(r"\]\(([^)\s]+)\)", text):
        if re.match(r"[a-z]+:", link):
            continue
        target, _, anchor = unquote(link).partition("#")
        file = (page.parent / target).resolve() if target else page
        assert file.exists(), f"{page.name}: {link}"
        assert file.is_relative_to(ROOT), f"{page.name}: {link}"
        if anchor:
            assert anchor in anchors(file.read_text(encoding="utf-8")), f"{page.name}: {link}"


def test_every_decision_is_listed_with_its_title():
    folder = ROOT / "docs/adr"
    listing = (folder / "README.md").read_text(encoding="utf-8")
    files = sorted(folder.glob("[0-9]*.md"))
    assert [file.name[:4] for file in files] == [f"{k:04d}" for k in range(1, len(files) + 1)]
    for file in files:
        text = file.read_text(encoding="utf-8")
        assert text.startswith(f"# {file.name[:4]}: ")
        assert f"[{file.name[:4]}]({file.name})" in listing
        assert {"Context", "Decision", "Consequences"} <= set(sections(text))


@pytest.fixture(scope="module")
def clone(tmp_path_factory):
    """A folder with nothing but the examples, as a reader's clone; its cache serves all examples."""
    folder = tmp_path_factory.mktemp("clone")
    (folder / "examples").symlink_to(ROOT / "examples")
    return folder


def run_block(text, folder):
    done = subprocess.run([sys.executable, "-c", text], cwd=folder, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_example_of_the_readme_runs_and_does_what_it_says(clone):
    (block,) = blocks((ROOT / "README.md").read_text(encoding="utf-8"), "python")
    out = run_block(block, clone)
    value, deviation = map(float, re.search(r"estimated (\S+) \+- (\S+)", out).groups())
    true = float(re.search(r"true +(\S+)", out)[1])
    assert 0 < deviation < 1000
    assert abs(value - true) < 4 * deviation
    assert (clone / "runs/ball/cache").is_dir()


def test_the_example_of_the_posterior_does_what_its_page_says(clone):
    (block,) = blocks((ROOT / "docs/posterior.md").read_text(encoding="utf-8"), "python")
    careless = "\ncareless = estimator.estimate(data[:, :, None])\nprint('ratio', careless.misfit.ratio[0])\n"
    careless += "print('learned', abs(careless.parameters.learned).max())\n"
    careless += "print('true', pressure.functionals(scene.model.space)(truth.states).mean())\n"
    out = run_block(block + careless, clone)
    low, high = map(float, re.search(r"interval (\S+) to (\S+)", out).groups())
    assert low < float(re.search(r"true (\S+)", out)[1]) < high
    learned = {name: int(share) for name, share in re.findall(r"^(\w+) \[.*, (-?\d+)% of", out, re.MULTILINE)}
    assert learned["E"] > 90 > 10 > learned["kappa"]
    assert re.findall("alarm: (.*)", out) == ["False", "True"]
    assert float(re.search(r"ratio (\S+)", out)[1]) == pytest.approx(0.0009, rel=0.1)
    assert float(re.search(r"learned (\S+)\n", out)[1]) < 0.05


@pytest.mark.parametrize("page", [page for page in PAGES if page.parent.name == "docs"], ids=lambda page: page.name)
def test_every_python_example_of_the_docs_runs(page, clone):
    for block in blocks(page.read_text(encoding="utf-8"), "python"):
        run_block(block, clone)


def test_every_erratum_names_tests_that_exist():
    errata = sections((ROOT / "docs/method.md").read_text(encoding="utf-8"))["Errata"]
    rows = [line.strip("|").split("|") for line in errata.splitlines() if line.startswith("|")][2:]
    assert len(rows) > 15
    assert {len(row) for row in rows} == {4}
    code = "\n".join(file.read_text(encoding="utf-8") for file in TESTS)
    for row in rows:
        names = re.findall(r"`(test_\w+)`", row[3])
        assert names or row[3].strip() == "–", row[0]
        for name in names:
            assert f"\ndef {name}(" in code, f"{row[0]}: no test {name}"


def _of_any(stage):
    return re.sub(r"[.].*", ".NAME", stage)


def test_the_table_of_stages_is_that_of_the_code(tmp_path):
    text = sections((ROOT / "docs/architecture.md").read_text(encoding="utf-8"))["Stages and keys"]
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines() if line[:3] == "| `"]
    # "`NAME`, what of": how the stage differs, or that it is there, where training is reduced.
    always, reduced = ({row[0].split("`")[1]: row for row in rows if ("`," in row[0]) == other} for other in (0, 1))
    studies, groundwork = always.pop("study.NAME"), always.pop("groundwork.NAME")

    def stages(*changes, scene="ball"):
        pipeline = open_scene(ROOT / f"examples/toy/{scene}.toml", changes, cache=tmp_path).runner.pipeline
        found = {}
        for stage in pipeline.stages:
            needs = ", ".join(dict.fromkeys(f"`{_of_any(need)}`" for need in stage.needs))
            found[_of_any(stage.name)] = (needs, stage.codec is not None)
        return found

    assert {name: (row[1], bool(row[3])) for name, row in always.items()} == stages()
    found = {name: needs for name, (needs, _) in stages('training.method="reduced"').items()}
    assert {name: row[1] for name, row in (always | reduced).items()} == found
    # A study needs what its kind says; its findings are kept.
    with_studies = stages(scene="studies")
    assert with_studies.keys() - found.keys() == {"study.NAME", "groundwork.NAME"}
    assert (groundwork[1], bool(groundwork[3])) == with_studies["groundwork.NAME"]
    assert (studies[1], bool(studies[3])) == ("what its kind asks for", with_studies["study.NAME"][1])


def test_paths_in_the_docs_exist():
    for page in (ROOT / "docs").glob("*.md"):
        for path in re.findall(
            r"`((?:dacore|plugins|tests|docs|examples)/[\w./-]*)`", page.read_text(encoding="utf-8")
        ):
            assert (ROOT / path).exists(), f"{page.name}: {path}"


def test_every_kind_of_study_has_its_row_and_is_told_how_to_read():
    page = (ROOT / "docs/studies.md").read_text(encoding="utf-8")
    kinds = {spec.name for spec in REGISTRY.specs("study")}
    assert set(re.findall(r"^\| `(\w+)` \|", page, re.MULTILINE)) == kinds
    assert set(re.findall(r"^\*\*`(\w+)`\.\*\*", page, re.MULTILINE)) == kinds
    for scene in ("toy", "brain"):
        example = tomllib.loads((ROOT / f"examples/{scene}/studies.toml").read_text(encoding="utf-8"))
        assert {table["kind"] for table in example["study"].values()} == kinds, scene
