"""What `dacore new-plugin` writes is installed in a clean environment, tested and run there, and then broken.

The environment is a new one: an interpreter whose only installed distributions are a wheel of dacore built from this
checkout, the plugins that the scenes borrow, and what is written here. Third-party libraries are not downloaded again:
links to those of the running environment, without its dacore and its plugins, stand in for them.
"""

import json
import os
import re
import site
import subprocess
import sys
from pathlib import Path

import pytest

from dacore.scaffold.kinds import KINDS

ROOT = Path(__file__).resolve().parents[2]
BORROWED = ("dacore-skfem", "dacore-biot", "dacore-imaging")
PIP = ("-m", "pip", "install", "-q", "--disable-pip-version-check", "--no-deps", "--no-build-isolation")


class Environment:
    """A virtual environment and what is done in it."""

    def __init__(self, folder):
        self.folder = folder
        subprocess.run([sys.executable, "-m", "venv", str(folder)], check=True)
        self.packages = next(folder.glob("lib/python*/site-packages"))
        self._link_libraries()
        self.run(*PIP, str(ROOT))
        for name in BORROWED:
            self.run(*PIP, str(ROOT / "plugins" / name))

    def _link_libraries(self):
        """Link all that is installed for the running interpreter, but dacore, its plugins, and what is there."""
        libraries = self.folder / "libraries"
        libraries.mkdir()
        places = [Path(place) for place in (*site.getsitepackages(), *sys.path) if "-packages" in place]
        for place in places:
            for entry in place.iterdir() if place.is_dir() else ():
                ours = re.match(r"(_*editable_*.*)?_?dacore|.*\.(pth|egg-link)$|__editable__|__pycache__", entry.name)
                link = libraries / entry.name
                if not ours and not link.exists() and not (self.packages / entry.name).exists():
                    link.symlink_to(entry)
        (self.packages / "libraries.pth").write_text(f"{libraries}\n")

    def variables(self):
        """Environment variables of its processes; nothing of the running environment reaches them."""
        kept = ("HOME", "LANG", "TMPDIR", "SSL_CERT_FILE")
        environment = {key: os.environ[key] for key in kept if key in os.environ}
        environment |= {"PATH": f"{self.folder / 'bin'}:/usr/bin:/bin", "PYTHONNOUSERSITE": "1"}
        environment |= dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
        return environment

    def start(self, *arguments, cwd):
        """Start its Python; it is asked and answers by lines."""
        return subprocess.Popen(
            [str(self.folder / "bin/python"), *arguments], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
            env=self.variables(), cwd=cwd,
        )  # fmt: skip

    def run(self, *arguments, check=True, cwd=None):
        """Run its Python to the end."""
        done = subprocess.run(
            [str(self.folder / "bin/python"), *arguments], capture_output=True, text=True, env=self.variables(),
            cwd=cwd or self.folder,
        )  # fmt: skip
        assert not check or done.returncode == 0, done.stdout + done.stderr
        return done

    def dacore(self, *arguments, cwd, check=True):
        """Run the command line that pip installed."""
        return self.run(str(self.folder / "bin/dacore"), *arguments, cwd=cwd, check=check)


@pytest.fixture(scope="module")
def environment(tmp_path_factory):
    return Environment(tmp_path_factory.mktemp("clean") / "venv")


def made(environment, place, name, *kinds):
    """Write a plugin by the command line of the environment, and install it there as its README says."""
    options = [part for kind in kinds for part in ("--kind", kind)]
    environment.dacore("new-plugin", name, *options, cwd=place)
    environment.run(*PIP, "-e", str(place / name))
    return place / name


@pytest.fixture(scope="module")
def plugin(environment, tmp_path_factory):
    """The default kinds, installed; the package is put back after each test that breaks it."""
    return made(environment, tmp_path_factory.mktemp("plugin"), "dacore-tumour")


def passed(done):
    assert done.returncode == 0, done.stdout + done.stderr
    assert "skipped" not in done.stdout
    return int(re.search(r"(\d+) passed", done.stdout)[1])


def test_the_environment_is_clean(environment):
    """dacore is a wheel of its own there, and its templates came with it."""
    code = (
        "import dacore, sys; from importlib.metadata import entry_points; print(dacore.__file__); print(sys.prefix);"
        "print(*sorted({p.dist.name for p in entry_points(group='dacore')}))"
    )
    file, prefix, distributions = environment.run("-c", code).stdout.splitlines()
    assert file.startswith(str(environment.packages))
    assert prefix == str(environment.folder)
    assert not any(str(ROOT) in str(path) for path in environment.packages.glob("*.pth"))
    assert set(distributions.split()) - {"dacore-tumour", "dacore-all"} == {"dacore", *BORROWED}


def test_it_passes_its_tests_and_runs_from_its_scene(environment, plugin):
    assert passed(environment.run("-m", "pytest", "-q", "-p", "no:cacheprovider", cwd=plugin)) >= 40
    environment.dacore("run", "scene.toml", "--workers", "1", cwd=plugin)
    results = json.loads((plugin / "runs/scene/results.json").read_text())
    assert results["versions"]["dacore-tumour"] == "0.1.0"
    (found,) = [o for o in results["validation"] if o["estimator"] == "minimum_variance" and o["noise"] == 0.0]
    assert found["errors"]["c"]["mean"] < 0.1 * found["errors"]["c"]["of_the_training_mean"]
    listed = environment.dacore("plugins", cwd=plugin).stdout
    assert re.search(r"model +tumour +ready", listed)
    assert re.search(r"observation +tumour_lines +ready", listed)


def edited(old, new, where="model", *more):
    """Replace texts in a module: old, new, and further pairs of them."""

    def edit(package):
        file = package / f"{where}.py"
        text = file.read_text()
        for before, after in ((old, new), *zip(more[::2], more[1::2], strict=True)):
            assert before in text
            text = text.replace(before, after)
        file.write_text(text)

    return edit


def renamed(package):
    (package / "model.py").rename(package / "modell.py")


TYPE = "dacore_tumour.model:ReactionDiffusion"
FAULTS = {
    "module renamed": (
        renamed,
        "physics: model 'tumour' of dacore-tumour 0.1.0: dacore_tumour.model could not be imported: "
        "ModuleNotFoundError: No module named 'dacore_tumour.model'; PluginSpec names it, so correct that or the file",
    ),
    "class renamed": (
        edited("class ReactionDiffusion(", "class Reaction("),
        "dacore_tumour.model has no ReactionDiffusion; PluginSpec names it, so correct that or the class",
    ),
    "base class missing": (
        edited("ReactionDiffusion(Physics)", "ReactionDiffusion"),
        f"{TYPE} is not a subclass of dacore.core.model.Physics; derive it from that",
    ),
    "no dataclass": (
        edited("@dataclass(frozen=True)\nclass R", "class R", "model", 'inlet: str = "inlet"', "inlet: str"),
        f"{TYPE} has the setting inlet, but is no dataclass; put @dataclass(frozen=True) above it",
    ),
    "abstract method missing": (
        edited("def build(", "def built("),
        f"{TYPE} leaves build abstract; implement every abstract method",
    ),
    "setting without a default": (
        edited('inlet: str = "inlet"', "inlet: str"),
        "scene.toml: physics.inlet: missing; expected text in quotes",
    ),
    "setting of an unsupported type": (
        edited("rise: float = 2.0", "rise: np.ndarray | float = 2.0"),
        "field rise is annotated numpy.ndarray | float, which no value of a scene can fill; annotate it with plain",
    ),
    "functionals of another space": (
        edited('csr_array(vstack(rows, format="csr"))', 'csr_array(vstack(rows, format="csr"))[:, :-1]', "observation"),
        "observation.lines: functionals have 152 columns, expected 153, one for each degree of freedom of the state",
    ),
    "functionals of another type": (
        edited('csr_array(vstack(rows, format="csr"))', "vstack(rows).toarray()", "observation"),
        "observation.lines: functionals: got a matrix of type ndarray, expected a csr_array",
    ),
    "no functionals": (
        edited("return Functionals(", "return (", "observation"),
        "observation.lines: functionals gave a tuple, expected Functionals",
    ),
    "unknown parameter": (
        edited('parameters["k"]', 'parameters["rate"]'),
        "physics: term reaction: its coefficient asks for the parameter 'rate'; there is D, k, c_in",
    ),
    "no model": (
        edited("return AffineModel(", "AffineModel("),
        "physics: ReactionDiffusion.build gave a NoneType, expected an AffineModel or a ForwardModel",
    ),
    "force of another length": (
        edited("np.zeros(n), held", "np.zeros(n + 1), held"),
        "physics: load inlet: got a force of shape (154,) and prescribed values of shape (153,), expected (153,)",
    ),
    "wrong dependence": (
        edited("api=API", 'requires=("no_such_library",), api=API', "__init__"),
        "model 'tumour' needs no_such_library; install it with: pip install no_such_library",
    ),
    "missing library": (
        edited("import numpy as np", "import no_such_library"),
        "needs no_such_library, which it does not declare; install it with: pip install no_such_library",
    ),
    "later interface": (
        edited('API = "1.', 'API = "7.', "__init__"),
        "model 'tumour' cannot be used: dacore-tumour 0.1.0: written for plugin interface 7.",
    ),
    "duplicate name": (
        edited('"tumour_lines"', '"voxels"', "__init__"),
        "observation 'tumour_lines' is not installed",
    ),
    "syntax error in the module": (edited("def build(", "def build(("), "could not be imported: SyntaxError"),
    "syntax error in the declarations": (
        edited("@hookimpl", "@@hookimpl", "__init__"),
        "1 plugin(s) failed to load, see `dacore plugins`",
    ),
    "hook misspelt": (edited("def dacore_models", "def dacore_model", "__init__"), "see `dacore plugins`"),
    "hook unmarked": (edited("@hookimpl\n", "", "__init__"), "see `dacore plugins`"),
    "fault in the code": (
        edited("n = forms.layout.n_dofs", "n = forms.layout.n_dofs // 0"),
        "physics: its plugin failed (ZeroDivisionError",
    ),
}


# dacore's own modules and the libraries are imported once; each fault is met in a fork of that process, which knows no
# plugin yet. Nothing compiled is kept, since two faults may be written in one second.
FORKS = """
import os, sys
sys.dont_write_bytecode = True
import dacore.cli.progress, dacore.workflow.run, scipy.sparse.linalg
from dacore.cli.main import main

def both():
    try:
        main(["run", "scene.toml", "--workers", "1", "--out", "runs/broken"])
    except SystemExit as left:
        print("LISTED", flush=True)
        try:
            main(["plugins"])
        except SystemExit:
            return left.code
    return 0

assert not any(name.startswith("dacore_") for name in sys.modules), "a plugin is imported before it is broken"
print("ready", flush=True)
for folder in sys.stdin:
    child = os.fork()
    if not child:
        for number, name in ((1, "out"), (2, "err")):
            os.dup2(os.open(os.path.join(folder.strip(), name), os.O_WRONLY | os.O_CREAT), number)
        code = 70  # what nothing else ends with: a traceback
        try:
            code = both()
        except BaseException:
            sys.excepthook(*sys.exc_info())
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(code)
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
"""


@pytest.fixture(scope="module")
def run_and_list(environment, plugin, tmp_path_factory):
    """Runs the scene and lists the plugins: (exit code, standard output, standard error)."""
    asked = environment.start("-c", FORKS, cwd=plugin)
    assert asked.stdout.readline() == "ready\n"

    def ask():
        folder = tmp_path_factory.mktemp("told")
        asked.stdin.write(f"{folder}\n")
        asked.stdin.flush()
        return int(asked.stdout.readline()), (folder / "out").read_text(), (folder / "err").read_text()

    yield ask
    asked.stdin.close()
    assert asked.wait() == 0
    asked.stdout.close()


@pytest.mark.parametrize("fault", FAULTS)
def test_each_way_to_break_it_is_told_in_one_line(run_and_list, plugin, fault):
    """And the list of plugins goes on."""
    package = plugin / "src/dacore_tumour"
    before = {file: file.read_text() for file in package.glob("*.py")}
    breaking, message = FAULTS[fault]
    try:
        breaking(package)
        code, out, err = run_and_list()
    finally:
        for file in package.glob("*.py"):
            file.unlink()
        for file, text in before.items():
            file.write_text(text)
    told = [line for line in err.splitlines() if line.strip()]
    assert code in (1, 2), out + err
    listed = out.partition("LISTED")[2]
    assert len(told) == 1, err
    assert told[0].startswith("error: ")
    assert message in told[0]
    assert re.search("estimator +minimum_variance +ready", listed)


LISTED_AS_BROKEN = {
    "duplicate name": "the name 'voxels' is declared more than once",
    "syntax error in the declarations": "could not be loaded: SyntaxError",
    "hook misspelt": "hook dacore_model does not exist (did you mean dacore_models?)",
    "hook unmarked": "function dacore_models is not marked with @hookimpl",
    "later interface": "update dacore",
}


@pytest.mark.parametrize("fault", LISTED_AS_BROKEN)
def test_what_the_scene_cannot_tell_the_list_tells(environment, plugin, fault):
    package = plugin / "src/dacore_tumour"
    before = (package / "__init__.py").read_text()
    try:
        FAULTS[fault][0](package)
        code = "from dacore.plugins.registry import load\nfor each in load().failures:\n    print(each)"
        told = environment.run("-c", code, cwd=plugin).stdout
    finally:
        (package / "__init__.py").write_text(before)
    assert LISTED_AS_BROKEN[fault] in told
    assert "dacore-tumour 0.1.0" in told


def test_every_kind_together_passes_its_tests_and_the_linters(environment, tmp_path):
    folder = made(environment, tmp_path, "dacore-all", *KINDS)
    assert passed(environment.run("-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", cwd=folder)) >= 300
    environment.dacore("run", "scene.toml", "--workers", "1", cwd=folder)
    results = json.loads((folder / "runs/scene/results.json").read_text())
    assert results["scene"]["discretization"]["backend"] == "all_numpy"
    assert set(results["studies"]) == {"samples"}
    environment.run("-m", "pip", "uninstall", "-q", "-y", "dacore-all")
