"""The plugin of docs/plugins.md is written as the page says, declared, and passes the suites the page shows."""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from dacore.plugins import spec

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs/plugins.md").read_text(encoding="utf-8")
PYTHON = re.findall(r"^```py(?:thon)?\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
NAMES = (
    "__init__.py", "gauge.py", "test_gauge.py", "solver.py", "test_solver.py", "nearest.py", "test_nearest.py",
)  # fmt: skip
FILES = dict(zip(NAMES, PYTHON, strict=False))


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    """The distribution of the page, its tests beside its package."""
    folder = tmp_path_factory.mktemp("dacore-gauge")
    (toml,) = re.findall(r"^```TOML\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
    (folder / "pyproject.toml").write_text(toml, encoding="utf-8")
    for name, text in FILES.items():
        place = folder / "tests" if name.startswith("test_") else folder / "src/dacore_gauge"
        place.mkdir(parents=True, exist_ok=True)
        (place / name).write_text(text, encoding="utf-8")
    return folder


def run(package, *command):
    path = f"import sys; sys.path.insert(0, {str(package / 'src')!r}); "
    return subprocess.run([sys.executable, "-c", path + command[0]], capture_output=True, text=True, cwd=package)


def test_the_declarations_name_classes_that_are_there_and_the_door_takes_them(package):
    toml = tomllib.loads((package / "pyproject.toml").read_text(encoding="utf-8"))
    assert toml["project"]["entry-points"][spec.GROUP] == {"dacore_gauge": "dacore_gauge"}
    done = run(
        package,
        "import dacore_gauge, importlib\n"
        "assert 'scipy.sparse' not in sys.modules\n"
        "hooks = (dacore_gauge.dacore_observations, dacore_gauge.dacore_solvers, dacore_gauge.dacore_estimators)\n"
        "for spec in (spec for hook in hooks for spec in hook()):\n"
        "    module, name = spec.target.split(':')\n"
        "    print(getattr(importlib.import_module(module), name).__name__)\n",
    )
    assert done.stdout.split() == ["StrainGauge", "MinimalResiduals", "Nearest"], done.stderr


@pytest.mark.parametrize(("name", "least"), [("test_gauge.py", 14), ("test_solver.py", 15), ("test_nearest.py", 24)])
def test_the_tests_of_the_page_pass(package, name, least):
    done = run(package, f"import pytest; sys.exit(pytest.main(['-q', '-p', 'no:cacheprovider', 'tests/{name}']))")
    assert done.returncode == 0, done.stdout + done.stderr
    assert int(re.search(r"(\d+) passed", done.stdout)[1]) >= least
    assert "skipped" not in done.stdout


def test_the_pieces_of_a_backend_are_right(package):
    block, study = PYTHON[len(FILES) :]
    done = run(package, "\n" + block)
    assert done.returncode == 0, done.stderr
    done = run(package, f"\n{study}\nprint(*(spec.name for spec in dacore_studies()))")
    assert done.stdout.split() == ["dropout"], done.stderr
