"""Measure every hazard, and write the tables and the figure of docs/hazards.md anew.

``python -m tests.hazards`` does all but the brain, in a minute; ``python -m tests.hazards brain`` the brain too, in
ten minutes and 6 GB.
"""

import sys
from pathlib import Path

import numpy as np

from dacore.core.timegrid import TimeGrid
from dacore.domains.box import Box
from dacore.dynamics.march import MarchedModel
from dacore.figures.formula import FormulaPanel, Known, against_formula
from dacore.figures.style import png
from dacore_biot.cautions import Oscillation, cell_sizes
from dacore_biot.model import Biot
from tests.backends import backend
from tests.hazards.brain import KINDS, REFERENCE, Brain
from tests.hazards.column import SUDDEN, Column, at, difference
from tests.hazards.extended import march
from tests.hazards.manufactured import TISSUE, one_step
from tests.hazards.test_jump import GRADED, LAYER, PLAIN, column, errors
from tests.hazards.test_oscillation import inf_sup
from tests.verification.__main__ import fill, number, table

DOCS = Path(__file__).parents[2] / "docs"
ELEMENTS = {
    "order 1": {},
    "order 1, lumped": {"stabilization": "lumped"},
    "order 1, projected": {"stabilization": "projected"},
    "u of order 2": {"order": 2},
}


def percent(value):
    return f"{100 * value:.2g}%" if value < 0.0995 else f"{100 * value:.0f}%"


def oscillation_table():
    exact = Column(1000, width=1).solve("pressure", SUDDEN)
    rows = []
    for name, settings in ELEMENTS.items():
        sudden = Column(8, inertia=False, **settings).solve("load", SUDDEN)[1]
        rough = [one_step(cells, wild=True, kappa=1e-14, nu=0.3, **settings).pressure for cells in (8, 16, 32)]
        heights, wave, _ = Column(16, **settings).solve("pressure", SUDDEN)
        behind = at(heights, exact)[0]
        least = max(inf_sup(12, **settings), 0.0)
        rows.append(
            [
                name,
                f"{least:.2f}" if least > 1e-6 else "0",
                f"{sudden.max():.2f}",
                ", ".join(percent(one) for one in rough),
                percent(difference(wave, behind, behind - 1)),
            ]
        )
    head = ["elements", "inf-sup", "highest p, exact 0.99", "p, κ → 0, 8, 16, 32 cells a side", "wave of compression"]
    return table(head, rows)


def criterion_table():
    rows = []
    for ratio in (4.0, 2.0, 1.0, 0.5, 0.1, 0.01):
        row = [f"{ratio:g}"]
        tall = Column(32, inertia=False)
        unit = Oscillation(2, float(np.median(cell_sizes(tall.mesh())))).ratio(TISSUE, SUDDEN.step)
        for settings in ELEMENTS.values():
            chosen = Column(32, inertia=False, **settings)
            pressure = chosen.solve("load", SUDDEN, kappa=TISSUE["kappa"] * ratio / unit)[1]
            row.append(f"{max(0.0, pressure.max() - 1):.3f}")
        rows.append(row)
    return table(["seepage in a step / needed", *ELEMENTS], rows)


def locking_table():
    rows = []
    for nu in (0.3, 0.4, 0.45, 0.49, 0.499, 0.4999, 0.49999):
        row = [f"{nu:g}"]
        for settings in ({}, {"order": 2}):
            for kappa in (1e2, TISSUE["kappa"]):
                found = one_step(16, nu=nu, kappa=kappa, tolerance=1e-8, **settings)
                row.append(percent(found.displacement))
        rows.append(row)
    return table(["ν", "order 1, drained", "order 1, undrained", "order 2, drained", "order 2, undrained"], rows)


def limits_table():
    rows = []
    for label, changes in {
        "κ = 1e-8, B = 0.99, τ = 5e-4": {"kappa": 1e-8},
        "κ = 1e-11": {"kappa": 1e-11},
        "κ = 1e-14": {"kappa": 1e-14},
        "κ = 0": {"kappa": 0.0},
        "B = 1": {"skempton": 1.0},
        "B = 1, κ = 1e-14": {"skempton": 1.0, "kappa": 1e-14},
        "B = 1, κ = 1e-20": {"skempton": 1.0, "kappa": 1e-20},
        "τ = 1e-12": {"step": 1e-12},
    }.items():
        rows.append([label, *(percent(one_step(16, wild=True, **s, **changes).pressure) for s in ELEMENTS.values())])
    return table(["", *ELEMENTS], rows)


def jump_table():
    fine = column(1 / 64, width=1, stabilization="lumped").solve("load", TimeGrid(5e-4, 40, substeps=4, graded=10))
    rows = []
    for size in (5, 2, 1, 0.5, 0.25, 0.125):
        row = [f"{size:g}", f"{size * LAYER:.3f}"]
        row += [f"{100 * errors(fine, size, PLAIN, **settings)[3]:+.1f}%" for settings in ELEMENTS.values()]
        row += [percent(errors(fine, size, grid)[0]) for grid in (PLAIN, GRADED)]
        rows.append(row)
    head = [f"fluid left, {name}" for name in ELEMENTS]
    return table(["h/√(c_v T)", "h [cm]", *head, "first p, 40 equal steps", "first p, 8 halvings"], rows)


def precision_table():
    mesh = Box((0.0, 0.0), (5.0, 5.0), (4, 4)).mesh()
    model = Biot(ventricles="").build(lambda fields: backend("skfem").discretize(mesh, fields))
    fixed = {p.name: p.low for p in model.parameters.parameters} | TISSUE
    rows = []
    for label, sweep, step in (
        ("E = 1e2, 1e3, …, 1e8", [{"E": 10.0**k} for k in range(2, 9)], 5e-4),
        ("the same, ν = 0.4999", [{"E": 10.0**k, "nu": 0.4999} for k in range(2, 9)], 5e-4),
        ("κ = 1e-20, 1e-18, …, 1e-6", [{"kappa": 10.0**k} for k in range(-20, -5, 2)], 5e-4),
        ("the same, B = 1", [{"kappa": 10.0**k, "skempton": 1.0} for k in range(-20, -5, 2)], 5e-4),
        ("κ = 1e-4, 1e-2, 1, 100", [{"kappa": 10.0**k} for k in range(-4, 3, 2)], 5e-4),
        ("τ = 1e-8", [{}], 1e-8),
        ("τ = 1e-2", [{}], 1e-2),
    ):
        worst = dict.fromkeys("up", 0.0)
        for changes in sweep:
            theta = fixed | changes
            found, exact = MarchedModel(model, TimeGrid(step, 3)).solve(theta).states, march(model, theta, step, 3)
            for field in worst:
                block = model.space.layout.block(field)
                error = np.abs(found[block] - exact[block]).max() / np.abs(exact[block]).max()
                worst[field] = max(worst[field], float(error))
        rows.append([label, number(worst["u"]), number(worst["p"])])
    return table(["parameters", "largest error of u", "largest error of p"], rows)


def brain_table():
    brain = Brain(["5k", "33k", REFERENCE[0]])
    exact = brain.solve(*REFERENCE)
    rows = []
    for size, kinds in (("5k", list(KINDS)), ("33k", list(KINDS)[:3])):
        for kind in kinds:
            found = brain.solve(size, kind)
            errors_of = [percent(one) for one in brain.errors(found, exact)]
            extremes = f"{found.lowest:.0f} to {found.highest:.0f}"
            rows.append([size, kind, f"{found.unknowns:,}", f"{found.seconds:.1f}", extremes, *errors_of])
            sys.stdout.write(" ".join(rows[-1]) + "\n")
    head = [
        "mesh",
        "elements",
        "unknowns",
        "CPU s",
        "p in the first two steps",
        "u",
        "p − p_csf",
        "p − p_csf at the end",
    ]
    return table(head, rows)


def figure():
    """Pressure along the column after a sudden load."""
    exact = Column(1000, width=1, inertia=False, stabilization="lumped").solve("load", SUDDEN)
    panels = []
    for name, settings in ELEMENTS.items():
        found = Column(16, inertia=False, **settings).solve("load", SUDDEN)
        curves = [
            Known(f"{1e3 * SUDDEN.times[k]:g} ms", exact[0], exact[1][:, k], found[0], found[1][:, k]) for k in (0, 19)
        ]
        panels.append(FormulaPanel(name, "height [cm]", "p / load", curves))
    return against_formula(panels)


def main():
    page = DOCS / "hazards.md"
    text = page.read_text(encoding="utf-8")
    for name, make in {
        "oscillation": oscillation_table,
        "criterion": criterion_table,
        "locking": locking_table,
        "limits": limits_table,
        "jump": jump_table,
        "precision": precision_table,
    }.items():
        text = fill(text, name, make())
    if "brain" in sys.argv[1:]:
        text = fill(text, "brain", brain_table())
    page.write_text(text, encoding="utf-8")
    (DOCS / "figures" / "hazards.png").write_bytes(png(figure()))


if __name__ == "__main__":
    main()
