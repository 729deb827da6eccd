"""The report: well-formed, self-contained, escaped, written whole."""

import base64
import struct
import zlib
from html.parser import HTMLParser

import pytest

from dacore.errors import ShapeError, StoreError
from dacore.workflow.report import (
    Card,
    Cell,
    Picture,
    Provenance,
    Report,
    Section,
    Table,
    Timing,
    render_report,
    write_report,
)  # fmt: skip
from dacore.workflow.tables import number_text, percent, value_text

VOID = {"meta", "img", "br", "hr", "link", "input"}


def tiny_png(width=3, height=2):
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    rows = b"".join(b"\x00" + b"\xff" * 3 * width for _ in range(height))
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")


SVG = b'<?xml version="1.0"?><svg xmlns="http://www.w3.org/2000/svg" width="72pt" height="36pt"></svg>'


class Reader(HTMLParser):
    """Checks that tags nest, and collects attributes and text."""

    def __init__(self, text):
        super().__init__(convert_charrefs=True)
        self.open, self.tags, self.text = [], [], ""
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text += data

    def all(self, tag):
        return [attrs for name, attrs in self.tags if name == tag]


def full_report():
    table = Table(
        ["estimator", "e_u", "note"],
        [[Cell("guess", "muted"), "20 %", "a"], ["PBDW", Cell("0.2 %", "best"), "b"], ["x", Cell("28 %", "bad"), "c"]],
        caption="Errors of p_csf",
        note="same discretisation",
    )
    return Report(
        "Brain <zero> & co",
        "scene `a_b.toml`",
        [Card("e of p − p_csf", "2.1 %", "guessing the mean: 39 %", "good"), Card("p_v", "114 dyn/cm²")],
        [
            Section("Results", "First **bold**.\n\nSecond.", [table, Picture(tiny_png(), "A plot of e_u.", "a plot")]),
            Section("More", parts=[Picture(SVG, "Vector", 'a "quoted" plot')]),
        ],
        Provenance(
            {"Versions": {"dacore": "0.1.0"}, "Seeds": {"noise": "7"}},
            [Timing("train", 83.0), Timing("observe", 0.25, "cached")],
            3 * 2**30,
        ),
        scene='title = "<script>alert(1)</script>"\n',
    )


def test_is_well_formed_and_holds_everything():
    text = render_report(full_report())
    page = Reader(text)
    assert text.startswith("<!DOCTYPE html>")
    assert len(page.all("h1")) == 1
    assert len(page.all("h2")) == 3
    for expected in ("2.1", "guessing the mean: 39\u00a0%", "1 min 23 s", "cached", "peak memory 3.00 GiB",
                     "Figure 1.", "Figure 2.", "Table 1.", "same discretisation", "0.1.0"):  # fmt: skip
        assert expected in page.text, expected
    assert "e<sub>u</sub>" in text
    assert "<strong>bold</strong>" in text
    assert "<code>a_b.toml</code>" in text
    assert text.count("<p>First") == text.count("<p>Second") == 1


def test_links_lead_to_sections():
    page = Reader(render_report(full_report()))
    targets = {"#" + attrs["id"] for attrs in page.all("section")}
    links = [attrs["href"] for attrs in page.all("a") if attrs.get("class") != "back"]
    assert len(links) == 3
    assert set(links) == targets
    back = [attrs["href"] for attrs in page.all("a") if attrs.get("class") == "back"]
    assert back == ["#top"] * 2
    assert [attrs["id"] for attrs in page.all("header")] == ["top"]


def test_loads_and_runs_nothing():
    text = render_report(full_report())
    page = Reader(text)
    assert page.all("script") == page.all("link") == []
    for tag, attrs in page.tags:
        for name, value in attrs.items():
            assert not name.startswith("on")
            if name in ("src", "href"):
                assert value.startswith(("data:image/", "#")), (tag, value)
    style = text[text.index("<style>") : text.index("</style>")]
    assert "url(" not in style
    assert "@import" not in style
    policy = next(a for a in page.all("meta") if a.get("http-equiv") == "Content-Security-Policy")
    assert policy["content"].startswith("default-src 'none'")


def test_every_text_is_escaped():
    evil = '<img src=x onerror="alert(1)">&amp; \'"'
    report = Report(
        evil, evil, [Card(evil, evil, evil)],
        [Section(evil, evil, [Table([evil, evil], [[evil, Cell(evil, "bad")]], evil, evil), Picture(SVG, evil, evil)])],
        Provenance({evil: {evil: evil}}, [Timing(evil, 1.0, evil)]), evil,
    )  # fmt: skip
    text = render_report(report)
    page = Reader(text)
    assert len(page.all("img")) == 1
    assert page.all("img")[0]["alt"] == evil
    assert not any("onerror" in attrs for _, attrs in page.tags)
    assert page.text.count('<img src=x onerror="alert(1)">&amp;') >= 14


def test_control_characters_are_replaced():
    assert "\x00" not in render_report(Report("a\x00b", scene="c\x1bd"))


def test_pictures_are_embedded_whole_with_their_size():
    page = Reader(render_report(Report("t", sections=[Section("s", parts=[Picture(tiny_png(30, 15), "c", "a")])])))
    (image,) = page.all("img")
    kind, data = image["src"].split(",")
    assert kind == "data:image/png;base64"
    assert base64.b64decode(data) == tiny_png(30, 15)
    assert (image["width"], image["height"]) == ("20", "10")
    assert Picture(SVG, "c", "a").size == (96, 48)
    assert Picture(b"<svg></svg>", "c", "a").size is None


def test_columns_of_numbers_are_aligned_right():
    text = render_report(Report("t", sections=[Section("s", parts=[Table(["a", "b", "c"], [["x", "−1.5", "y"]])])]))
    assert '<td class="r">−1.5</td><td>y</td>' in text


def one_table(rows, caption="errors"):
    return render_report(Report("t", sections=[Section("s", parts=[Table(["a", "b"], rows, caption)])]))


def test_a_table_of_many_columns_is_set_smaller():
    for columns, small in ((8, False), (9, True)):
        table = Table([f"h{k}" for k in range(columns)], [["1"] * columns])
        text = render_report(Report("r", sections=[Section("s", parts=[table])]))
        assert ('<table class="many">' in text) is small


def test_long_tables_are_folded_and_named_before_they_are_opened():
    short, long = (one_table([[f"row {k}", "1"] for k in range(n)]) for n in (14, 15))
    assert "details" not in {tag for tag, _ in Reader(short).tags}
    page = Reader(long)
    assert len(page.all("details")) == 1
    assert "Table 1. Errors · 15 rows" in " ".join(page.text.split())
    assert long.index("</summary>") < long.index("row 0")
    assert "::details-content" in long  # print shows what is folded


def test_rows_without_a_name_belong_to_the_one_above():
    text = one_table([["x", "1"], ["", "2"], ["y", "3"]])
    assert [attrs.get("class") for attrs in Reader(text).all("tr")][1:] == ["group", None, "group"]
    assert 'class="group"' not in one_table([["x", "1"], ["y", "2"]])


@pytest.mark.parametrize(
    ("caption", "expected"),
    [
        ("no noise: errors", "No noise: errors"),
        ("p − p_csf at 3 ms", "p − p<sub>csf</sub> at 3 ms"),
        ("|u| at 3 ms", "|u| at 3 ms"),
        ("u_x", "u<sub>x</sub>"),
        ("10% noise", "10% noise"),
        ("dacore/io is", "dacore/io is"),
    ],
)
def test_captions_begin_with_a_capital_unless_with_a_symbol(caption, expected):
    assert f"</span> {expected}" in one_table([["x", "1"]], caption)


def test_a_mean_and_its_worst_stay_on_one_line():
    assert "0.061%\u00a0(0.073%)" in one_table([["x", "0.061% (0.073%)"]])
    assert "1e-5\u00a0(2e-4)" in one_table([["x", "1e-5 (2e-4)"]])
    assert "16\u00a0of\u00a016" in one_table([["x", "16 of 16"]])
    assert ">1.000 (0.756\u00a0to\u00a01.000)<" in one_table([["x", "1.000 (0.756 to 1.000)"]])
    assert ">minimum variance<" in one_table([["x", "minimum variance"]])


def test_the_first_column_is_never_one_of_numbers():
    text = one_table([["10% noise", "1"], ["20% noise", "2"]])
    assert '<th scope="col">a</th><th scope="col" class="r">b</th>' in text


def test_file_is_written_whole_and_the_same_each_time(tmp_path):
    target = tmp_path / "out" / "report.html"
    assert write_report(target, full_report()) == target
    first = target.read_bytes()
    write_report(target, full_report())
    assert target.read_bytes() == first
    assert first.decode() == render_report(full_report())
    assert list(target.parent.iterdir()) == [target]
    with pytest.raises(StoreError):
        write_report(tmp_path, full_report())


def test_a_large_report_says_so(tmp_path, caplog):
    data = tiny_png() + b"\x00" * 10_000_000
    write_report(tmp_path / "r.html", Report("t", sections=[Section("s", parts=[Picture(data, "c", "a")])]))
    assert "MB; use SVG" in caplog.text


def test_wrong_parts_are_refused():
    with pytest.raises(ShapeError, match="row 1 has 1 cells, expected 2"):
        Table(["a", "b"], [["1", "2"], ["1"]])
    with pytest.raises(ShapeError, match="neither PNG nor SVG"):
        Picture(b"GIF89a", "c", "a")
    with pytest.raises(ShapeError, match="alternative text"):
        Picture(SVG, "c", " ")


def test_an_empty_report_is_a_page():
    page = Reader(render_report(Report("Only a title")))
    assert page.all("nav") == []
    assert page.all("section") == []


def test_exponents_are_short():
    assert [number_text(each) for each in (1e-9, 2.6e-9, 7.964e-11, 1.5e8, float("nan"))] == [
        "1e-9", "2.6e-9", "7.96e-11", "1.5e8", "nan",
    ]  # fmt: skip


def test_numbers_are_as_long_as_they_mean_something():
    assert [percent(each) for each in (2e4, 2.6e4, 0.93, 0.0012, 2e-7)] == ["2e6%", "2.6e6%", "93%", "0.12%", "2e-5%"]
    assert value_text(10252.4, 41.3) == "10,252 ± 41"
    assert value_text(3.14159, 0.0123) == "3.142 ± 0.012"
    assert value_text(3.14159, float("nan")) == value_text(3.14159, 0.0) == "3.14"
