"""Look at built pages: nothing is fetched from the web, no link is dead, no directive is raw, no machine is named.

Run as ``python docs/_ext/look.py docs/_build/html``; prints what is wrong, one line each, and fails if anything is.
"""

import os
import re
import sys
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

# Attributes whose value a browser fetches by itself.
_FETCHED = {("script", "src"), ("img", "src"), ("iframe", "src"), ("source", "src"), ("video", "src"), ("audio", "src")}
_FETCHED_LINKS = {"stylesheet", "icon", "shortcut icon", "preload", "prefetch", "modulepreload", "apple-touch-icon"}
_REMOTE = re.compile(r"(?:https?:)?//", re.IGNORECASE)
_REMOTE_STYLE = re.compile(r"(?:@import\s+|url\()\s*['\"]?\s*(?:https?:)?//", re.IGNORECASE)
_RAW = re.compile(r"(?:^|\n)\s*(?:`{3,}|:{3,})\{[a-z-]+\}|\{(?:term|doc|ref|py:[a-z]+)\}`")


class Page(HTMLParser):
    """What matters of a page: its anchors, what it links to and fetches, its text apart from code."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.anchors: set[str] = set()
        self.links: list[str] = []
        self.fetched: list[str] = []
        self.text: list[str] = []
        self._silent = 0
        self._script = ""
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Keep ids, links and what is fetched."""
        values = {name: value or "" for name, value in attrs}
        self.anchors |= {values[key] for key in ("id", "name") if key in values}
        if tag == "a" and "href" in values:
            self.links.append(values["href"])
        if tag == "link" and values.get("rel", "").lower() in _FETCHED_LINKS:
            self.fetched.append(values.get("href", ""))
        self.fetched += [value for name, value in values.items() if (tag, name) in _FETCHED]
        self._silent += tag in ("script", "style", "pre", "code")

    def handle_endtag(self, tag: str) -> None:
        """Code may hold anything."""
        self._silent -= tag in ("script", "style", "pre", "code")

    def handle_data(self, data: str) -> None:
        """Keep text that is read."""
        if not self._silent:
            self.text.append(data)


def faults(folder: Path, private: tuple[str, ...] = ()) -> Iterator[str]:
    """What is wrong with a built site.

    Parameters
    ----------
    folder : Path
        The pages.
    private : tuple of str
        Texts that must not be seen, such as the path of the folder the site was built in.

    Yields
    ------
    str
        One line a fault: the file, and what.
    """
    pages = {
        file: Page(file.read_text(encoding="utf-8"))
        for file in sorted(folder.rglob("*.html"))
        if "_static" not in file.parts
    }
    for file, page in pages.items():
        name = file.relative_to(folder)
        for address in page.fetched:
            if _REMOTE.match(address):
                yield f"{name}: fetches {address}"
            elif not address.startswith("data:") and not _target(file, address).is_file():
                yield f"{name}: {address} is not there"
        for link in page.links:
            yield from _dead(name, file, link, pages)
        if raw := _RAW.search("".join(page.text)):
            yield f"{name}: raw directive {raw[0].strip()!r}"
        html = file.read_text(encoding="utf-8")
        yield from (f"{name}: shows {text!r}" for text in private if text in html)
    for file in sorted(folder.rglob("*.css")):
        if _REMOTE_STYLE.search(file.read_text(encoding="utf-8")):
            yield f"{file.relative_to(folder)}: fetches from the web"


def _dead(name: Path, file: Path, link: str, pages: dict[Path, Page]) -> Iterator[str]:
    if not link or re.match(r"[a-z]+:|//", link, re.IGNORECASE):
        return
    address, _, anchor = link.partition("#")
    target = _target(file, address) if address else file
    if not target.exists():
        yield f"{name}: {link} leads nowhere"
    elif anchor and target in pages and unquote(anchor) not in pages[target].anchors:
        yield f"{name}: {link} leads to no place of its page"


def _target(file: Path, address: str) -> Path:
    path = unquote(address.partition("?")[0].partition("#")[0])
    return Path(os.path.normpath(file.parent / path))


def main() -> int:
    """Print the faults of the site named on the command line."""
    folder = Path(sys.argv[1]).resolve()
    root = Path(__file__).resolve().parents[2]
    found = list(faults(folder, (str(root), str(Path.home()) + os.sep)))
    sys.stderr.write("".join(f"{fault}\n" for fault in found))
    return bool(found)


if __name__ == "__main__":
    sys.exit(main())
