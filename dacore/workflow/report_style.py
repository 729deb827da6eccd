"""The look of a report: one style sheet, no scripts, nothing from outside the file."""

STYLE = """
:root {
  color-scheme: light dark;
  --ink: #1d2228; --soft: #5b6570; --line: #dfe3e8; --page: #f6f7f9; --card: #ffffff; --accent: #0b5e99;
  --good: #0a6b4d; --good-bg: #e4f3ec; --bad: #a83f00; --bad-bg: #fbece2; --bar: #bcd6ea;
}
@media (prefers-color-scheme: dark) {
  :root {
    --ink: #e6e9ed; --soft: #9aa5b1; --line: #333b45; --page: #14181d; --card: #1c2229; --accent: #74b9ec;
    --good: #6fd3aa; --good-bg: #17342a; --bad: #f2a172; --bad-bg: #3a2518; --bar: #2c516d;
  }
}
* { box-sizing: border-box; }
html { scroll-behavior: smooth; -webkit-text-size-adjust: 100%; }
body {
  margin: 0; background: var(--page); color: var(--ink);
  font: 16px/1.6 system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif;
}
main, header, footer { max-width: 1080px; margin: 0 auto; padding: 0 24px; }
header { padding-top: 48px; }
h1 { font-size: 2rem; line-height: 1.2; margin: 0 0 .35em; letter-spacing: -.015em; text-wrap: balance; }
h2 { font-size: 1.35rem; line-height: 1.3; margin: 0 0 .6em; letter-spacing: -.01em; }
p { margin: 0 0 1em; max-width: 70ch; overflow-wrap: anywhere; }
.subtitle { color: var(--soft); font-size: 1.05rem; }
a { color: var(--accent); }
sub { font-size: .72em; line-height: 0; }
code, pre { font-family: ui-monospace, SFMono-Regular, Menlo, Consolas, "DejaVu Sans Mono", monospace; }
code { font-size: .88em; background: var(--page); padding: .1em .3em; border-radius: 4px; overflow-wrap: anywhere; }
nav ol {
  list-style: none; columns: 210px 4; column-gap: 24px; padding: 14px 18px; margin: 22px 0 0;
  font-size: .9rem; line-height: 1.75; border: 1px solid var(--line); border-radius: 10px; background: var(--card);
  counter-reset: part;
}
nav li { break-inside: avoid; padding-left: 1.9em; text-indent: -1.9em; counter-increment: part; }
nav li::before {
  content: counter(part); display: inline-block; width: 1.9em; text-indent: 0; color: var(--soft);
  font-variant-numeric: tabular-nums;
}
.back { float: right; font-size: .9rem; font-weight: 400; text-decoration: none; color: var(--soft); padding: 0 .3em; }
@media (min-width: 1540px) {
  nav { position: fixed; top: 0; bottom: 0; left: calc(50% - 766px); width: 206px; overflow-y: auto; }
  nav ol { columns: 1; margin: 48px 0 24px; padding: 0; border: 0; background: none; font-size: .84rem; }
  .back { display: none; }
}
nav a { text-decoration: none; } nav a:hover { text-decoration: underline; }
.cards {
  display: grid; grid-template-columns: repeat(auto-fit, minmax(190px, 1fr)); gap: 14px; margin: 28px 0 0;
  padding: 0;
}
.card { background: var(--card); border: 1px solid var(--line); border-radius: 10px; padding: 16px 18px; margin: 0; }
.card .unit { font-size: .62em; font-weight: 600; white-space: nowrap; }
.card dt { color: var(--soft); font-size: .86rem; }
.card dd { margin: 0; }
.card .value { font-size: 1.75rem; font-weight: 650; line-height: 1.25; font-variant-numeric: tabular-nums; }
.card .note { color: var(--soft); font-size: .86rem; }
.card.good .value { color: var(--good); } .card.bad .value { color: var(--bad); }
section {
  background: var(--card); border: 1px solid var(--line); border-radius: 12px; padding: 28px; margin: 28px 0;
}
figure { margin: 22px 0 0; }
figure + figure, .table + figure, figure + .table, .table + .table { margin-top: 30px; }
.plate { background: #ffffff; border: 1px solid var(--line); border-radius: 8px; padding: 12px; text-align: center; }
.plate img { max-width: 100%; height: auto; display: inline-block; vertical-align: top; }
figcaption, .table .caption, .table .note {
  color: var(--soft); font-size: .9rem; line-height: 1.5; margin: 10px 0 0; max-width: 78ch;
}
.table { margin: 22px 0 0; }
.table .caption { margin: 0 0 8px; }
.number { color: var(--ink); font-weight: 600; }
.scroll {
  overflow-x: auto;
  background: linear-gradient(to left, var(--card) 40%, transparent) right / 36px 100% no-repeat local,
    linear-gradient(to left, var(--bar), transparent) right / 14px 100% no-repeat scroll;
}
table {
  border-collapse: collapse; width: 100%; font-size: .88rem; line-height: 1.45; font-variant-numeric: tabular-nums;
}
th, td { padding: 6px 10px; border-bottom: 1px solid var(--line); text-align: left; vertical-align: baseline; }
thead th { color: var(--soft); font-weight: 600; border-bottom-width: 2px; vertical-align: bottom; }
tbody th { font-weight: 500; min-width: 8.5em; }
tbody tr:last-child > * { border-bottom: 0; }
.r { text-align: right; }
tbody td:not(.r) { min-width: 8.5em; }
table.many { font-size: .78rem; }
.many th, .many td { padding: 5px 6px; }
.many tbody th, .many tbody td:not(.r) { min-width: 6em; }
tr:not(.group) > th:empty { border-bottom-color: transparent; }
tr.group > * { border-top: 1px solid var(--soft); }
tbody tr.group:first-child > * { border-top: 0; }
td.best { font-weight: 700; color: var(--good); background: var(--good-bg); }
td.bad { color: var(--bad); background: var(--bad-bg); }
td.muted, th.muted { color: var(--soft); }
.meter { display: block; height: 8px; border-radius: 4px; background: var(--bar); min-width: 2px; }
td.metered { width: 38%; vertical-align: middle; }
.facts { display: grid; grid-template-columns: repeat(auto-fit, minmax(280px, 1fr)); gap: 0 32px; }
.facts h3 { font-size: 1rem; margin: 18px 0 4px; }
.facts td { overflow-wrap: anywhere; }
.facts .wide { grid-column: 1 / -1; }
details.long { margin: 0; border: 1px solid var(--line); border-radius: 8px; padding: 10px 14px; }
details.long .caption { margin: 0; font-weight: 400; }
details.long .scroll { margin-top: 10px; }
.count { white-space: nowrap; }
details { margin-top: 22px; border-top: 1px solid var(--line); padding-top: 14px; }
summary { cursor: pointer; font-weight: 600; }
pre {
  overflow-x: auto; font-size: .84rem; line-height: 1.5; background: var(--page);
  border: 1px solid var(--line); border-radius: 8px; padding: 14px 16px;
}
footer { color: var(--soft); font-size: .86rem; padding-bottom: 48px; }
@media (max-width: 640px) {
  main, header, footer { padding-left: 14px; padding-right: 14px; }
  header { padding-top: 28px; } h1 { font-size: 1.55rem; }
  section { padding: 18px 14px; } .plate { padding: 6px; } th, td { padding: 6px 8px; }
}
@media print {
  :root {
    --ink: #000; --soft: #444; --line: #ccc; --page: #fff; --card: #fff; --accent: #000;
    --good: #000; --good-bg: #eee; --bad: #000; --bad-bg: #fff; --bar: #bbb;
  }
  body { font-size: 10.5pt; } nav { display: none; } main, header, footer { max-width: none; padding: 0; }
  section { border: 0; padding: 0; } h2 { break-after: avoid; }
  figure, tr, .card { break-inside: avoid; } .plate { border: 0; padding: 0; } .scroll { overflow: visible; }
  pre { white-space: pre-wrap; }
  .back { display: none; }
  details.long { border: 0; padding: 0; } details.long::details-content { content-visibility: visible; }
  details.long > summary { list-style: none; }
  th, td { padding: 3px 5px; } table { font-size: 8.5pt; } .scroll { background: none; }
  table.many { font-size: 7pt; } .many th, .many td { padding: 2px 3px; }
  tbody th, tbody td:not(.r), .many tbody th, .many tbody td:not(.r) { min-width: 0; }
  thead { display: table-header-group; }
  .cards { grid-template-columns: repeat(3, 1fr); } figure { margin-top: 12px; } .plate img { max-height: 22cm; }
}
"""

POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"
"""Nothing is loaded from anywhere and nothing runs, whatever a scene's text may hold."""
