"""Links that lead somewhere on a code host, led to where the same thing is on the site."""

import re
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sphinx.application import Sphinx

# Pages of the repository's root that the site shows under another name.
_PAGES = {"README.md": "index.md", "CONTRIBUTING.md": "contributing.md", "CHANGELOG.md": "changelog.md"}
# What a code host would show raw, so that it is no part of the page's file.
_APPENDED = {"adr/README": "```{toctree}\n:hidden:\n:glob:\n\n0*\n```\n"}
_LINK = re.compile(r"(?<!!)\[((?:[^\[\]]|\[[^\]]*\])*)\]\((\.\./[^)\s]*)\)")


def rewritten(text: str, page: str, root: Path) -> str:
    """Relative links out of `docs` as they must be on the site.

    Parameters
    ----------
    text : str
        Markdown of a page.
    page : str
        Name of the page below `docs`, without ending.
    root : Path
        The repository.

    Returns
    -------
    str
        The same with links to root pages led to the site's pages of them, links to files in the repository left
        (they become downloads), and links to folders replaced by their names.
    """
    folder = PurePosixPath("docs", page).parent

    def one(match: re.Match[str]) -> str:
        label, link = match.groups()
        target, _, anchor = link.partition("#")
        path = _normal(folder / target)
        if str(path) in _PAGES:
            up = "../" * (len(folder.parts) - 1)
            return f"[{label}]({up}{_PAGES[str(path)]}{'#' + anchor if anchor else ''})"
        if (root / path).is_dir():
            return f"{label} (`{path}`)"
        return match[0]

    return _LINK.sub(one, text)


def setup(app: "Sphinx") -> dict[str, Any]:
    """Rewrite links of every page that is read."""

    def read(app: "Sphinx", page: str, source: list[str]) -> None:
        if app.env.doc2path(page).suffix == ".md":
            source[0] = rewritten(source[0], page, Path(app.srcdir).parent)
            source[0] += "\n" + _APPENDED.get(page, "")

    app.connect("source-read", read)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _normal(path: PurePosixPath) -> PurePosixPath:
    parts: list[str] = []
    for part in path.parts:
        if part == "..":
            parts.pop()
        else:
            parts.append(part)
    return PurePosixPath(*parts)
