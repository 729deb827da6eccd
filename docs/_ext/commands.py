"""The directive ``command-line``: every command of dacore with its arguments and options, read from the program."""

from collections.abc import Iterator
from typing import Any

import typer
from docutils import nodes
from docutils.parsers.rst import Directive
from sphinx.application import Sphinx


def described() -> Iterator[tuple[str, str, str, list[tuple[str, str]]]]:
    """Every command as its help says it.

    Yields
    ------
    name : str
        How it is called, such as ``dacore run``.
    usage : str
        Its line of usage.
    text : str
        What it does.
    rows : list of (str, str)
        Arguments and options, and what they are for.
    """
    from dacore.cli.main import app

    root = typer.main.get_command(app)
    yield from _walk(root, typer.Context(root, info_name="dacore"))


def _walk(command: Any, context: Any) -> Iterator[tuple[str, str, str, list[tuple[str, str]]]]:
    rows = [record for each in command.get_params(context) if (record := _record(each, context)) is not None]
    usage = " ".join([context.command_path, *command.collect_usage_pieces(context)])
    yield context.command_path, usage, (command.help or "").strip(), rows
    for name, inner in getattr(command, "commands", {}).items():
        if not inner.hidden:
            yield from _walk(inner, typer.Context(inner, info_name=name, parent=context))


def _record(param: Any, context: Any) -> tuple[str, str] | None:
    found = param.get_help_record(context)
    if found is None:
        return None
    return str(found[0]), str(found[1])


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
