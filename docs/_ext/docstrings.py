"""Docstrings as reStructuredText."""

import re

_CODE = re.compile(r"(``.+?``|`[^`]+`)")
_MARKUP = re.compile(r"(?<!\\)\||(?<=\w)_(?=\W|$)")


def plain(lines: list[str]) -> list[str]:
    """Escape what formulas in docstrings have and reStructuredText would read as markup: ``|x|`` and ``x_``.

    Parameters
    ----------
    lines : list of str
        A docstring.

    Returns
    -------
    list of str
        The same with backslashes, but in code and in literal blocks.
    """
    out: list[str] = []
    block: int | None = None
    for line in lines:
        indent = len(line) - len(line.lstrip())
        if block is not None and line.strip() and indent <= block:
            block = None
        if block is None:
            parts = _CODE.split(line)
            parts[::2] = [_MARKUP.sub(r"\\\g<0>", part) for part in parts[::2]]
            out.append("".join(parts))
            block = indent if line.rstrip().endswith("::") else None
        else:
            out.append(line)
    return out
