"""Single backticks in docstrings: a link where the site documents the name, plain code elsewhere.

Docstrings name parameters, methods and classes alike in single backticks, as numpydoc does. Which of them the site
has is known when all pages are read; a name that leads nowhere is no error there, unlike an explicit reference.
"""

from typing import Any

from docstrings import plain
from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx
from sphinx.domains.python import PythonDomain
from sphinx.environment import BuildEnvironment
from sphinx.util.docutils import SphinxRole

_SOFT = "named-in-docstring"


def _escape(_app: Sphinx, _what: str, _name: str, _object: object, _options: object, lines: list[str]) -> None:
    lines[:] = plain(lines)


class Named(SphinxRole):
    """The role of single backticks."""

    def run(self) -> tuple[list[nodes.Node], list[nodes.system_message]]:
        """Leave the decision to when all is read."""
        text = nodes.literal(self.text, self.text)
        if not self.text.replace(".", "").replace("_", "").isalnum():
            return [text], []
        node = addnodes.pending_xref(
            "", text, refdomain="py", reftype="obj", reftarget=self.text, refexplicit=False, refspecific=True,
            refdoc=self.env.docname,
        )  # fmt: skip
        node[_SOFT] = True
        node["py:module"] = self.env.ref_context.get("py:module")
        node["py:class"] = self.env.ref_context.get("py:class")
        return [node], []


def _resolve(app: Sphinx, env: BuildEnvironment, node: addnodes.pending_xref, text: nodes.Element) -> Any:
    # Sphinx asks here first where several objects have the name, or none has.
    return text if node.get(_SOFT) else None


class Quiet(PythonDomain):
    """The domain of Python, but a name in a docstring that several objects have is no link instead of a warning."""

    def find_obj(self, env: BuildEnvironment, modname: Any, classname: Any, name: str, *rest: Any) -> Any:
        """Search as usual; of several places take that of the module itself, or none."""
        found = super().find_obj(env, modname, classname, name, *rest)
        if len(found) < 2:
            return found
        here = [each for each in found if modname and each[0].startswith(f"{modname}.")]
        return here if len(here) == 1 else []


def setup(app: Sphinx) -> dict[str, Any]:
    """Make it the role of single backticks."""
    app.add_domain(Quiet, override=True)
    app.add_role("named", Named())
    app.connect("missing-reference", _resolve)
    app.connect("autodoc-process-docstring", _escape, priority=100)  # before numpydoc's
    return {"parallel_read_safe": True, "parallel_write_safe": True}
