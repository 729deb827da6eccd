"""The directive ``command-line``: every command of dacore with its arguments and options, read from the program."""

from typing import Any

from described import described
from docutils import nodes
from docutils.parsers.rst import Directive
from sphinx.application import Sphinx


class CommandLine(Directive):
    """A section for every command."""

    def run(self) -> list[nodes.Node]:
        """Read the commands now."""
        sections: list[nodes.Node] = []
        for name, usage, text, rows in described():
            section = nodes.section(ids=[nodes.make_id(name)], names=[name])
            section += nodes.title(name, "", nodes.literal(name, name))
            for paragraph in text.split("\n\n"):
                section += nodes.paragraph("", " ".join(paragraph.split()))
            section += nodes.literal_block(usage, usage, language="text")
            section += _table(rows)
            sections.append(section)
        return sections


def _table(rows: list[tuple[str, str]]) -> nodes.Node:
    items = nodes.definition_list(classes=["options"])
    for name, text in rows:
        term = nodes.term("", "", nodes.literal(name, name))
        items += nodes.definition_list_item("", term, nodes.definition("", nodes.paragraph("", " ".join(text.split()))))
    return items


def setup(app: Sphinx) -> dict[str, Any]:
    """Offer the directive."""
    app.add_directive("command-line", CommandLine)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
