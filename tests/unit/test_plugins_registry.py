"""The plugin door against plugins that are broken in every way we know."""

import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

from dacore.errors import MissingDependencyError, PluginError
from dacore.plugins.registry import BASES, Registry, load

HEALTHY = """
    from dacore.plugins import PluginSpec, hookimpl

    @hookimpl
    def dacore_quantities():
        return [PluginSpec("healthy", "healthy_plugin_code:Healthy", summary="works")]
"""

HEALTHY_CODE = """
    from dataclasses import dataclass
    from dacore.core.quantity import QuantityOfInterest

    @dataclass(frozen=True)
    class Healthy(QuantityOfInterest):
        over_time: str = "mean"

        def functionals(self, space):
            raise NotImplementedError
"""


class Installer:
    """Puts plugins on the path as pip would: modules and a dist-info folder with an entry point."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.modules: list[str] = []

    def module(self, name: str, code: str) -> None:
        (self.folder / f"{name}.py").write_text(textwrap.dedent(code))
        self.modules.append(name)

    def plugin(self, name: str, code: str, version: str = "1.2.3") -> None:
        self.module(name, code)
        info = self.folder / f"{name}-{version}.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name.replace('_', '-')}\nVersion: {version}\n")
        (info / "entry_points.txt").write_text(f"[dacore]\n{name} = {name}\n")


@pytest.fixture
def installer(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    installer = Installer(tmp_path)
    installer.plugin("healthy_plugin", HEALTHY)
    installer.module("healthy_plugin_code", HEALTHY_CODE)
    yield installer
    for name in installer.modules:
        sys.modules.pop(name, None)


def reasons(registry: Registry, distribution: str) -> list[str]:
    return [each.reason for each in registry.failures if each.source.distribution == distribution]


def check_others_work(registry: Registry) -> None:
    assert registry.get("quantity", "healthy").__name__ == "Healthy"
    assert "pbdw" in [spec.name for spec in registry.specs("estimator")]


def declare(hook: str, *specs: str) -> str:
    return (
        "from dacore.plugins import PluginSpec, hookimpl\n\n"
        f"@hookimpl\ndef {hook}():\n    return [{', '.join(specs)}]\n"
    )


def test_a_healthy_plugin_is_ready_and_reported_with_its_distribution(installer):
    registry = load()
    assert reasons(registry, "healthy-plugin") == []
    (row,) = [row for row in registry.table() if row.name == "healthy"]
    assert (row.kind, row.distribution, row.version, row.status) == ("quantity", "healthy-plugin", "1.2.3", "ready")
    assert (row.install, row.summary) == ("", "works")


def test_declaring_and_listing_import_no_class(installer):
    registry = load()
    registry.table()
    assert "healthy_plugin_code" not in sys.modules
    registry.get("quantity", "healthy")
    assert "healthy_plugin_code" in sys.modules


BROKEN_MODULES = {
    "import_error": ("import no_such_library", "could not be loaded: ModuleNotFoundError: No module named 'no_such"),
    "syntax_error": ("def broken(:\n", "could not be loaded: SyntaxError"),
    "exits": ("raise SystemExit(3)", "could not be loaded: SystemExit: 3"),
    "misspelt": (
        declare("dacore_backend"),
        "hook dacore_backend does not exist (did you mean dacore_backends?); plugin interface 1.",
    ),
    "argument": (
        "from dacore.plugins import hookimpl\n\n@hookimpl\ndef dacore_backends(context):\n    return []\n",
        "could not be loaded: PluginValidationError: Plugin 'argument'",
    ),
    "unmarked": ("def dacore_models():\n    return []\n", "function dacore_models is not marked with @hookimpl"),
    "nothing": ("answer = 42\n", "declares nothing; expected at least one of the hooks dacore_backends"),
    "raises": (
        "from dacore.plugins import hookimpl\n\n@hookimpl\ndef dacore_models():\n    raise OSError('disk\\nfull')\n",
        "hook dacore_models raised OSError: disk full",
    ),
    "no_list": (
        "from dacore.plugins import hookimpl\n\n@hookimpl\ndef dacore_models():\n    return None\n",
        "hook dacore_models returned NoneType, expected a list of PluginSpec",
    ),
    "no_spec": (declare("dacore_models", "'biot'"), "hook dacore_models returned a list with str in it"),
    "other_api": (
        declare("dacore_models", "PluginSpec('other', 'a.b:C', api='99.0')"),
        "written for plugin interface 99.0, this dacore has 1.",
    ),
    "bad_target": (declare("dacore_models", "PluginSpec('t', 'a.b.C')"), "target: got 'a.b.C', expected 'package.mod"),
    "bad_name": (
        declare("dacore_models", "PluginSpec('two words', 'a:C')"),
        "name: got 'two words', expected one word",
    ),
    "bad_requires": (
        declare("dacore_models", "PluginSpec('r', 'a:C', requires='skfem')"),
        "requires: got 'skfem', expected a tuple of module names",
    ),
}


@pytest.mark.parametrize("case", BROKEN_MODULES)
def test_a_broken_plugin_is_reported_and_stops_nobody(installer, case):
    code, message = BROKEN_MODULES[case]
    installer.plugin(case, code)
    registry = load()
    (reason,) = reasons(registry, case.replace("_", "-"))
    assert reason.startswith(message)
    assert "\n" not in reason
    (row,) = [row for row in registry.table() if row.distribution == case.replace("_", "-")]
    assert row.status == f"failed: {reason}"
    assert row.version == "1.2.3"
    check_others_work(registry)


def test_many_broken_plugins_at_once_are_each_reported(installer):
    for case, (code, _) in BROKEN_MODULES.items():
        installer.plugin(case, code)
    registry = load()
    for case, (_, message) in BROKEN_MODULES.items():
        (reason,) = reasons(registry, case.replace("_", "-"))
        assert reason.startswith(message)
    check_others_work(registry)


def test_one_wrong_hook_leaves_the_plugins_other_hooks_alone(installer):
    installer.plugin(
        "half",
        declare("dacore_quantities", "PluginSpec('half', 'healthy_plugin_code:Healthy')", "PluginSpec('x', 'nowhere')")
        + "\n\n@hookimpl\ndef dacore_model():\n    return []\n",
    )
    registry = load()
    assert len(reasons(registry, "half")) == 2
    assert registry.get("quantity", "half").__name__ == "Healthy"


def test_a_name_declared_twice_goes_to_nobody(installer):
    installer.plugin("first", declare("dacore_models", "PluginSpec('same', 'healthy_plugin_code:Healthy')"))
    installer.plugin("second", declare("dacore_models", "PluginSpec('same', 'other:Other')"), version="9.9")
    registry = load()
    assert "same" not in [spec.name for spec in registry.specs("model")]
    assert len(reasons(registry, "first")) == len(reasons(registry, "second")) == 1
    with pytest.raises(
        PluginError, match=r"declared more than once.*first 1\.2\.3.*second 9\.9.*uninstall all but one"
    ):
        registry.get("model", "same")
    check_others_work(registry)


def test_the_same_name_in_two_kinds_is_no_duplicate(installer):
    installer.plugin("other_kind", declare("dacore_models", "PluginSpec('healthy', 'healthy_plugin_code:Healthy')"))
    registry = load()
    assert registry.failures == ()
    check_others_work(registry)


def test_a_missing_library_says_what_to_install(installer):
    installer.plugin(
        "needy",
        declare(
            "dacore_backends",
            "PluginSpec('needy', 'x:Y', requires=('sys', 'no_such_library'), install='pip install no-such==1')",
            "PluginSpec('hintless', 'x:Y', requires=('no_such_library', 'email.no_such_part'))",
        ),
    )
    registry = load()
    with pytest.raises(MissingDependencyError) as caught:
        registry.get("backend", "needy")
    assert str(caught.value) == ("backend 'needy' needs no_such_library; install it with: pip install no-such==1")
    assert isinstance(caught.value, ImportError)
    with pytest.raises(MissingDependencyError, match=r"pip install no_such_library email\.no_such_part$"):
        registry.get("backend", "hintless")
    rows = {row.name: row for row in registry.table()}
    assert (rows["needy"].status, rows["needy"].install) == ("missing no_such_library", "pip install no-such==1")
    check_others_work(registry)


def test_requirements_are_looked_for_without_importing_them(installer):
    installer.module("heavy_solver", "raise RuntimeError('imported')")
    (installer.folder / "heavy_package").mkdir()
    (installer.folder / "heavy_package" / "__init__.py").write_text("raise RuntimeError('imported')")
    (installer.folder / "heavy_package" / "part.py").write_text("raise RuntimeError('imported')")
    installer.plugin(
        "user",
        declare(
            "dacore_backends",
            "PluginSpec('user', 'heavy_package.part:C', requires=('heavy_solver', 'heavy_package.part'))",
        ),
    )
    (row,) = [row for row in load().table() if row.name == "user"]
    assert row.status == "ready"


def test_a_library_that_a_plugin_forgot_to_declare(installer):
    installer.module("forgetful_code", "import no_such_library")
    installer.plugin("forgetful", declare("dacore_models", "PluginSpec('forgetful', 'forgetful_code:Model')"))
    with pytest.raises(MissingDependencyError, match=r"needs no_such_library, which it does not declare.*pip install"):
        load().get("model", "forgetful")


WRONG_CLASSES = {
    "class Model: pass": "is not a subclass of dacore.core.model.Physics",
    "Model = 42": "is not a subclass of dacore.core.model.Physics",
    "Other = 42": "wrong_code has no Model",
    "from dacore.core.model import Physics\nclass Model(Physics): pass": "leaves build abstract",
    "1 / 0": "could not be imported: ZeroDivisionError: division by zero",
    "from email import nothing_of_the_kind": "could not be imported: ImportError: cannot import name",
    "from dacore.errors import MissingDependencyError as E\nraise E('install it so')": "^install it so$",
}


@pytest.mark.parametrize("code", WRONG_CLASSES)
def test_a_class_that_is_not_what_its_kind_promises(installer, code):
    installer.module("wrong_code", code)
    installer.plugin("wrong", declare("dacore_models", "PluginSpec('wrong', 'wrong_code:Model')"))
    registry = load()
    with pytest.raises(PluginError, match=WRONG_CLASSES[code]):
        registry.get("model", "wrong")
    check_others_work(registry)


def test_a_target_that_does_not_exist_shows_in_the_table(installer):
    installer.plugin("gone", declare("dacore_models", "PluginSpec('gone', 'gone.part:Model')"))
    registry = load()
    (row,) = [row for row in registry.table() if row.name == "gone"]
    assert row.status == "failed: module gone.part does not exist"
    with pytest.raises(PluginError, match=r"gone 1\.2\.3: gone\.part could not be imported"):
        registry.get("model", "gone")


def test_an_unknown_name_lists_what_there_is_and_what_was_meant(installer):
    installer.plugin("import_error", "import no_such_library")
    with pytest.raises(PluginError) as caught:
        load().get("quantity", "helthy")
    message = str(caught.value)
    assert message.startswith("quantity 'helthy' is not installed (did you mean 'healthy'?); there is ")
    assert "healthy" in message.partition("there is ")[2]
    assert message.endswith("; 1 plugin(s) failed to load, see `dacore plugins`")


def test_an_unknown_kind_lists_the_kinds():
    with pytest.raises(PluginError, match="got 'magic', expected one of backend, domain, model"):
        load([]).specs("magic")


def test_damaged_metadata_does_not_hide_the_others(installer):
    info = installer.folder / "damaged-1.0.dist-info"
    info.mkdir()
    (info / "entry_points.txt").write_text("[dacore]\ndamaged = damaged_module\n")
    registry = load()
    assert any("damaged_module" in each.reason for each in registry.failures)
    check_others_work(registry)


def test_loading_keeps_nothing(installer):
    before = load()
    installer.plugin("later", declare("dacore_models", "PluginSpec('later', 'healthy_plugin_code:Healthy')"))
    assert "later" not in [spec.name for spec in before.specs("model")]
    assert "later" in [spec.name for spec in load().specs("model")]


def test_every_kind_has_a_base_class():
    for kind, target in BASES.items():
        module, _, name = target.partition(":")
        __import__(module)
        assert isinstance(getattr(sys.modules[module], name), type), kind


def test_reading_the_declarations_imports_no_numerical_library():
    code = (
        "import sys\n"
        "from dacore.plugins.registry import load\n"
        "load().table()\n"
        "print([name for name in ('numpy', 'scipy', 'h5py', 'pydantic', 'skfem', 'nibabel') if name in sys.modules])"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "[]"
