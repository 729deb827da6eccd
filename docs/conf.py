"""How the documentation site is built: `make docs`. Nothing is fetched, neither while building nor while reading."""

import shutil
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
sys.path.insert(0, str(HERE / "_ext"))

import clone  # noqa: E402  (lies in docs/_ext)

from dacore import __version__  # noqa: E402

project = "dacore"
author = "The dacore developers"
copyright = "The dacore developers, BSD-3-Clause"  # noqa: A001
version = release = __version__

extensions = [
    "myst_nb",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.viewcode",
    "sphinx_copybutton",
    "sphinx_design",
    "sphinx_gallery.gen_gallery",
    "mathjax",
    "commands",
    "links",
    "references",
]
default_role = "named"
exclude_patterns = ["_build", "_ext", "gallery/*.ipynb", "gallery/sg_execution_times.rst", "sg_execution_times.rst"]
templates_path = ["_templates"]
nitpicky = True
nitpick_ignore_regex = [
    # No inventory of another project is fetched, so what other libraries define leads nowhere.
    (r"py:.*", r"(numpy|np|npt|scipy|sp|pluggy|matplotlib|collections|pathlib|typing|types|abc|dataclasses)(\..*)?"),
    (r"py:.*", r"(argparse|contextlib|logging|functools|os|multiprocessing|concurrent|distributed|dask)(\..*)?"),
    (r"py:.*", r"(pydantic|pytest|typer)(\..*)?"),
    (r"py:obj", r"dacore\.studies\.placement\.State"),  # a type variable
]
suppress_warnings = ["config.cache"]  # functions among the settings of the gallery cannot be kept

# Pages and notebooks. A page whose front matter says `file_format: mystnb` is executed.
myst_enable_extensions = ["amsmath", "attrs_inline", "colon_fence", "deflist", "dollarmath", "fieldlist"]
myst_heading_anchors = 4
myst_dmath_double_inline = True
nb_execution_mode = "cache"
nb_execution_cache_path = str(clone.cache(ROOT, HERE / "_build"))
if not Path(nb_execution_cache_path).exists():
    # The code has changed, but the gallery looks at its own files only.
    shutil.rmtree(HERE / "gallery", ignore_errors=True)
nb_execution_raise_on_error = True
nb_execution_show_tb = True
nb_execution_timeout = 300
nb_merge_streams = True
nb_output_stderr = "show"
clone.prepare(ROOT, HERE / "_build")

# Reference of the Python interface.
# Named, because pages that an earlier build did not know would not be looked at.
autosummary_generate = sorted(str(page.relative_to(HERE)) for page in HERE.glob("reference/*.md"))
autosummary_ignore_module_all = False
autosummary_imported_members = False
viewcode_follow_imported_members = False
# kstest of scipy has a signature that autodoc stumbles over before it sees that the module only imports it.
autodoc_default_options = {"show-inheritance": True, "exclude-members": "kstest"}
autodoc_member_order = "bysource"
autodoc_typehints = "none"  # numpydoc shows types with shapes and units
autodoc_preserve_defaults = True
numpydoc_show_class_members = False
numpydoc_class_members_toctree = False
numpydoc_xref_param_type = False
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 88
add_module_names = False

# Examples that are run and shown.
sphinx_gallery_conf = {
    "examples_dirs": [str(ROOT / "examples/gallery")],
    "gallery_dirs": ["gallery"],
    "filename_pattern": r"/plot_",
    "within_subsection_order": "order.Order",
    "abort_on_example_error": True,
    "download_all_examples": False,
    "show_memory": False,
    "show_signature": False,
    "min_reported_time": 1e9,
    "remove_config_comments": True,
    "capture_repr": (),
}
if not any(ROOT.glob("examples/gallery/plot_*.py")):
    extensions.remove("sphinx_gallery.gen_gallery")

# Looks.
html_theme = "pydata_sphinx_theme"
html_title = "dacore"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sourcelink = False
html_sidebars = {"index": []}
html_theme_options = {
    "logo": {"text": "dacore"},
    "navigation_with_keys": False,
    "show_toc_level": 2,
    "navigation_depth": 3,
    "header_links_before_dropdown": 8,
    "navbar_end": ["theme-switcher"],
    "footer_start": ["copyright"],
    "footer_end": [],
    "show_prev_next": True,
    "pygments_light_style": "a11y-high-contrast-light",
    "pygments_dark_style": "a11y-high-contrast-dark",
}
copybutton_prompt_text = r">>> |\.\.\. |\$ "
copybutton_prompt_is_regexp = True
