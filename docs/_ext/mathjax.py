"""MathJax from the package sphinx-mathjax-offline: one file beside the pages, and none from the web."""

from importlib.util import find_spec
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx
from sphinx.errors import ExtensionError
from sphinx.util.fileutil import copy_asset_file

_FILE = "tex-svg.js"  # glyphs are in it: no font is loaded, also not from file://


def setup(app: Sphinx) -> dict[str, Any]:
    """Use the bundled file."""
    app.setup_extension("sphinx.ext.mathjax")
    app.connect("config-inited", _configure)
    app.connect("build-finished", _copy)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _configure(_app: Sphinx, config: Any) -> None:
    config.mathjax_path = f"mathjax/{_FILE}"
    # The menu would load parts that are not copied.
    config.mathjax3_config = {"options": {"enableMenu": False}}


def _copy(app: Sphinx, error: Exception | None) -> None:
    if error is not None or app.builder.format != "html":
        return
    found = find_spec("sphinx-mathjax-offline")
    if found is None or found.origin is None:
        raise ExtensionError("sphinx-mathjax-offline is not installed: make docs installs it")
    source = Path(found.origin).parent / "static/mathjax" / _FILE
    target = Path(app.outdir) / "_static/mathjax"
    target.mkdir(parents=True, exist_ok=True)
    copy_asset_file(source, target)
