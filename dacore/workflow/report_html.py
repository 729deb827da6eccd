"""A report as HTML. Every piece of text is escaped here, in one place."""

import base64
import html
import re
from collections.abc import Mapping, Sequence
from itertools import count

from dacore.workflow.report_parts import Card, Cell, Picture, Provenance, Report, Table, Timing
from dacore.workflow.report_style import POLICY, STYLE

_E_OF = "e\N{NO-BREAK SPACE}of\N{NO-BREAK SPACE}"
_BACK = '<a class="back" href="#top" aria-label="Back to the contents">↑</a>'
# Longer tables are folded; print shows them whole.
_LONG = 14
# Tables of more columns are set smaller, to fit the page.
_WIDE = 8


def render_report(report: Report) -> str:
    """Turn a report into HTML; the same report gives the same text."""
    numbers = {"Figure": count(1), "Table": count(1)}
    sections = [
        f'<section id="s{i}">\n<h2>{_inline(section.title)}{_BACK}</h2>\n{_paragraphs(section.text)}'
        + "".join(_part(part, numbers) for part in section.parts)
        + "</section>\n"
        for i, section in enumerate(report.sections, start=1)
    ]
    titles = [section.title for section in report.sections]
    if report.provenance is not None or report.scene:
        sections.append(_provenance(report.provenance or Provenance(), report.scene, len(titles) + 1))
        titles.append("Provenance")
    links = "".join(f'<li><a href="#s{i}">{_inline(title)}</a></li>' for i, title in enumerate(titles, start=1))
    navigation = f'<nav aria-label="Contents"><ol>{links}</ol></nav>\n' if len(titles) > 1 else ""
    cards = "".join(_card(card) for card in report.cards)
    subtitle = f'<p class="subtitle">{_inline(report.subtitle)}</p>\n' if report.subtitle else ""
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">\n'
        f"<title>{_escape(report.title)}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n"
        f'<header id="top">\n<h1>{_inline(report.title)}</h1>\n{subtitle}{navigation}'
        + (f'<div class="cards">{cards}</div>\n' if cards else "")
        + f"</header>\n<main>\n{''.join(sections)}</main>\n"
        "<footer>\n<p>Made by dacore.</p>\n</footer>\n</body>\n</html>\n"
    )


def _part(part: Table | Picture, numbers: "Mapping[str, count[int]]") -> str:
    return _picture(part, next(numbers["Figure"])) if isinstance(part, Picture) else _table(part, numbers)


def _card(card: Card) -> str:
    note = f'<dd class="note">{_inline(card.note)}</dd>' if card.note else ""
    number, _, unit = card.value.partition(" ")
    value = _inline(number) + (f' <span class="unit">{_inline(unit)}</span>' if unit else "")
    return f'<dl class="card {card.tone}"><dt>{_inline(card.label)}</dt><dd class="value">{value}</dd>{note}</dl>'


def _picture(picture: Picture, number: int) -> str:
    size = picture.size
    shape = f' width="{size[0]}" height="{size[1]}"' if size else ""
    data = base64.b64encode(picture.data).decode("ascii")
    caption = f'<span class="number">Figure {number}.</span> {_inline(_sentence(picture.caption))}'
    return (
        f'<figure>\n<div class="plate"><img src="data:{picture.mime};base64,{data}" '
        f'alt="{_escape(picture.alt)}"{shape}></div>\n<figcaption>{caption}</figcaption>\n'
        "</figure>\n"
    )


def _table(table: Table, numbers: "Mapping[str, count[int]]") -> str:
    caption = ""
    if table.caption:
        folded = len(table.rows) > _LONG
        tag = "span" if folded else "p"
        count_of = f' <span class="count">· {len(table.rows)} rows</span>' if folded else ""
        caption = f'<{tag} class="caption"><span class="number">Table {next(numbers["Table"])}.</span> '
        caption += f"{_inline(_sentence(table.caption))}{count_of}</{tag}>\n"
    # The first column names its rows, even by numbers.
    numeric = [k > 0 and _numeric([_cell(row[k]).text for row in table.rows]) for k in range(len(table.headers))]
    head = "".join(
        f'<th scope="col"{_classes("r" if right else "")}>{_inline(name.replace("e of ", _E_OF))}</th>'
        for name, right in zip(table.headers, numeric)
    )
    body = []
    grouped = any(not _cell(row[0]).text for row in table.rows)
    for row in table.rows:
        cells = [_cell(entry) for entry in row]
        first = f'<th scope="row"{_classes(cells[0].tone)}>{_inline(cells[0].text)}</th>'
        rest = "".join(
            f"<td{_classes('r' if right else '', cell.tone)}>{_inline(_tight(cell.text))}</td>"
            for cell, right in zip(cells[1:], numeric[1:])
        )
        # Rows without a name belong to the one above.
        starts = grouped and bool(cells[0].text)
        body.append(f"<tr{_classes('group' if starts else '')}>{first}{rest}</tr>\n")
    note = f'<p class="note">{_inline(table.note)}</p>\n' if table.note else ""
    whole = (
        f'<div class="scroll" tabindex="0">\n<table{_classes("many" if len(table.headers) > _WIDE else "")}>\n'
        f"<thead><tr>{head}</tr></thead>\n"
        f"<tbody>\n{''.join(body)}</tbody>\n</table>\n</div>\n{note}"
    )
    if len(table.rows) > _LONG and caption:
        whole = f'<details class="long">\n<summary>{caption}</summary>\n{whole}</details>\n'
        return f'<div class="table">\n{whole}</div>\n'
    return f'<div class="table">\n{caption}{whole}</div>\n'


def _provenance(provenance: Provenance, scene: str, number: int) -> str:
    facts = "".join(
        f"<div><h3>{_inline(title)}</h3><table><tbody>"
        + "".join(
            f'<tr><th scope="row">{_inline(name)}</th><td class="muted">{_escape(value)}</td></tr>'
            for name, value in entries.items()
        )
        + "</tbody></table></div>\n"
        for title, entries in provenance.facts.items()
    )
    longest = max((timing.seconds for timing in provenance.timings), default=0.0) or 1.0
    rows = "".join(
        f'<tr><th scope="row">{_inline(timing.stage)}</th><td class="muted">{_escape(timing.state)}</td>'
        f'<td class="r">{_duration(timing.seconds)}</td><td class="r muted">{_expected(timing)}</td>'
        f'<td class="metered">'
        f'<span class="meter" style="width:{100 * timing.seconds / longest:.1f}%"></span></td></tr>\n'
        for timing in provenance.timings
    )
    total = sum(timing.seconds for timing in provenance.timings)
    memory = f", peak memory {provenance.peak_memory / 2**30:.2f} GiB" if provenance.peak_memory is not None else ""
    if rows:
        facts += f'<div class="wide"><h3>Time: {_duration(total)} in all{memory}</h3>'
        facts += f'<div class="scroll" tabindex="0"><table><tbody>{rows}</tbody></table></div></div>\n'
    elif memory:
        facts += f'<div class="wide"><h3>{memory[2:].capitalize()}</h3></div>\n'
    folded = f"<details>\n<summary>The scene</summary>\n<pre>{_escape(scene)}</pre>\n</details>\n" if scene else ""
    return f'<section id="s{number}">\n<h2>Provenance</h2>\n<div class="facts">\n{facts}</div>\n{folded}</section>\n'


def _expected(timing: Timing) -> str:
    return "" if timing.expected is None else f"expected {_duration(timing.expected)}"


def _cell(entry: str | Cell) -> Cell:
    return entry if isinstance(entry, Cell) else Cell(entry)


def _numeric(texts: Sequence[str]) -> bool:
    """Whether a column is of numbers: most cells that are not empty start with one."""
    filled = [text for text in texts if text.strip(" –-—")]
    return bool(filled) and sum(bool(re.match(r"[<>≈±+−-]?\s*\d", text)) for text in filled) > 0.5 * len(filled)


def _classes(*names: str) -> str:
    used = " ".join(name for name in names if name)
    return f' class="{used}"' if used else ""


def _duration(seconds: float) -> str:
    if seconds < 60:
        return f"{seconds:.2g} s" if seconds < 10 else f"{seconds:.0f} s"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest:02d} s" if minutes < 60 else f"{minutes // 60} h {minutes % 60:02d} min"


def _tight(text: str) -> str:
    """Keep a number and what belongs to it on one line: "0.1% (0.3%)", "16 of 16", "(0.55 to 0.96)"."""
    if not re.match(r"[<>≈±+−-]?\d", text):
        return text
    if len(text) <= 18:
        return text.replace(" ", "\N{NO-BREAK SPACE}")
    return re.sub(r"\([^()]{1,24}\)", lambda found: found[0].replace(" ", "\N{NO-BREAK SPACE}"), text)


def _sentence(text: str) -> str:
    """Begin a caption with a capital, if it begins with a word and not with the name of a quantity."""
    return text[0].upper() + text[1:] if re.match(r"[a-z]{2,}(?![\w./^])", text) else text


def _escape(text: str) -> str:
    # Control characters are not allowed in HTML, even escaped.
    return html.escape(re.sub(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f]", "\N{REPLACEMENT CHARACTER}", text), quote=True)


def _paragraphs(text: str) -> str:
    return "".join(f"<p>{_inline(part)}</p>\n" for part in re.split(r"\n\s*\n", text.strip()) if part)


def _inline(text: str) -> str:
    """Escape text, then set `code`, **strong** and short names with subscripts."""
    pieces = re.split(r"`([^`]+)`", _escape(text))
    for index, piece in enumerate(pieces):
        if index % 2:
            pieces[index] = f"<code>{piece}</code>"
        else:
            tied = re.sub(r"(?<=\d) (?=%)", "\N{NO-BREAK SPACE}", piece)
            strong = re.sub(r"\*\*(.+?)\*\*", r"<strong>\1</strong>", tied)
            pieces[index] = re.sub(
                r"(?<![\w./&])([^\W\d_]{1,2}\u0302?)_([A-Za-z0-9]+)(?![\w/;]|\.\w)", r"\1<sub>\2</sub>", strong
            )
    return "".join(pieces)
