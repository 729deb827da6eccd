"""Commands of dacore as their help says them."""

from collections.abc import Iterator
from typing import Any

import typer


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
