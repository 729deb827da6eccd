"""Measure everything, and write the tables and figures of docs/verification.md anew."""

import re
import sys
from pathlib import Path

import numpy as np

from dacore.figures.style import png
from tests.backends import READY
from tests.convergence.test_biot_rates import SCHEMES, SPACES, errors_in_space, errors_in_time
from tests.verification import pictures
from tests.verification.norms import rates
from tests.verification.problems import PROBLEMS

DOCS = Path(__file__).parents[2] / "docs"


def measured(sizes_of):
    """Errors by problem and backend, with a line of progress each."""
    out = {}
    for key, problem in PROBLEMS.items():
        sizes = sizes_of(problem)
        for name in READY:
            found = problem.study(name, sizes)
            problem.check(found, sizes)
            out[key, name] = found
            sys.stdout.write(f"{key} on {name}: {', '.join(f'{q} {e:.2e}' for q, e in found[-1].items())}\n")
            sys.stdout.flush()
    return out


def table(head, rows):
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    return "\n".join([*lines, *("| " + " | ".join(row) + " |" for row in rows)])


def number(value):
    return "–" if value is None else f"{value:.1e}".replace("e-0", "e-")


def rates_table(errors):
    """Finest errors and the last observed rate of every problem that has rates, by the first backend."""
    rows = []
    for key, problem in PROBLEMS.items():
        if not problem.orders:
            continue
        found = errors[key, READY[0]]
        row = [problem.label, problem.elements, " ".join(map(str, problem.fine))]
        for quantity in ("u", "grad u", "p", "grad p"):
            if quantity not in found[-1]:
                row += ["–"]
                continue
            rate = rates(problem.fine, [one[quantity] for one in found])[-1]
            row.append(f"{number(found[-1][quantity])} ({rate:.2f})")
        rows.append(row)
    return table(["problem", "elements", "cells a side", "u", "∇u", "p", "∇p"], rows)


def exact_table(errors):
    """Problems whose solution the elements contain: largest errors over meshes and backends."""
    rows = []
    for key, problem in PROBLEMS.items():
        if not problem.orders:
            every = [one for name in READY for one in errors[key, name]]
            worst = {q: max(one.get(q, 0.0) for one in every) for q in ("u", "p")}
            shown = number(worst["p"]) if "p" in every[0] else "zero"
            rows.append([problem.label, problem.elements, number(worst["u"]), shown])
    return table(["problem", "elements", "u", "p"], rows)


def backends_table(errors):
    """u and p with many digits on each backend."""
    rows = []
    for key, problem in PROBLEMS.items():
        if not problem.orders:
            continue
        for quantity in ("u", "p"):
            if quantity not in errors[key, READY[0]][-1]:
                continue
            values = [errors[key, name][-1][quantity] for name in READY]
            order = [f"{rates(problem.fine, [one[quantity] for one in errors[key, name]])[-1]:.3f}" for name in READY]
            gap = np.ptp(values) / values[0]
            cells = [f"{value:.3e} ({rate})" for value, rate in zip(values, order, strict=True)]
            rows.append([f"{problem.label}, {problem.elements}", quantity, *cells, number(gap)])
    return table(["problem", "", *READY, "apart by"], rows)


def rises_table():
    return table(
        ["problem", "elements, cells a side", "p/p₀ by formula", "computed", "at c t/a², formula", "computed"],
        pictures.rises(),
    )


def manufactured_table():
    """Orders of u and p in space on each backend, P1–P1 and P2–P1, with every term of the equations at work."""
    rows = []
    for label, (dim, order, sizes, _) in SPACES.items():
        found = {name: errors_in_space(name, dim, order, sizes) for name in READY}
        for quantity, shown in (("u", "u"), ("grad u", "∇u"), ("p", "p"), ("grad p", "∇p")):
            seen = {name: [one[quantity] for one in errors] for name, errors in found.items()}
            cells = [f"{number(values[-1])} ({rates(sizes, values)[-1]:.3f})" for values in seen.values()]
            rows.append([label, " ".join(map(str, sizes)), shown, *cells])
    return table(["elements", "cells a side", "", *READY], rows)


def time_table():
    """Orders of u and p in time of each scheme."""
    rows = []
    for scheme, order in SCHEMES:
        counts, errors = errors_in_time(scheme)
        cells = [f"{number(seen[-1])} ({rates(counts, seen)[-1]:.3f})" for seen in (errors["u"], errors["p"])]
        rows.append([scheme.label, str(order), *cells])
    return table(["scheme", "order by theory", "u", "p"], rows)


def fill(text, name, content):
    """Replace what stands between the two marks of `name`."""
    marks = f"<!-- {name} -->", f"<!-- end of {name} -->"
    pattern = re.compile(re.escape(marks[0]) + ".*?" + re.escape(marks[1]), re.DOTALL)
    assert len(pattern.findall(text)) == 1, name
    return pattern.sub(lambda _: f"{marks[0]}\n{content}\n{marks[1]}", text)


def main():
    errors = measured(lambda problem: problem.fine)
    page = DOCS / "verification.md"
    text = page.read_text(encoding="utf-8")
    for name, content in (
        ("rates", rates_table(errors)),
        ("exact", exact_table(errors)),
        ("backends", backends_table(errors)),
        ("rises", rises_table()),
        ("manufactured", manufactured_table()),
        ("time", time_table()),
    ):
        text = fill(text, name, content)
    page.write_text(text, encoding="utf-8")
    (DOCS / "figures").mkdir(exist_ok=True)
    for name, figure in pictures.figures(errors).items():
        (DOCS / "figures" / f"{name}.png").write_bytes(png(figure))


if __name__ == "__main__":
    main()
