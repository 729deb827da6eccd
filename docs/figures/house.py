"""Draw docs/images/house.svg: the floors of dacore, its plugin door, and the two waists. Takes no arguments."""

from pathlib import Path

import matplotlib as mpl

mpl.use("svg")
from matplotlib import pyplot as plt
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch, Polygon, Rectangle

INK, SOFT, PAPER = "#1d2b36", "#5b6b78", "#ffffff"
STORE, PLUGIN, WAIST, ROOF = "#e8eef3", "#dcefe4", "#f6c667", "#c9d9e6"

FLOORS = (
    ("errors · deprecation", "one tree of exceptions; names on their way out"),
    ("core", "abstractions and values, no algorithm"),
    ("plugins · builtin", "the door: hooks, declarations, settings"),
    ("algebra · geometry", "POD, Gram matrices, solvers; cutting, locating"),
    ("io · execution", "scenes, snapshots, fields; many workers"),
    ("estimators · dynamics · domains", "the online phase; time steps; meshes"),
    ("reduction", "reduced models, training by them"),
    ("pipeline", "stages, keys, what is kept"),
    ("studies · figures", "questions asked of many runs; their pictures"),
    ("workflow · testing · scaffold", "a scene's stages; suites; templates"),
    ("plotting", "pictures for a notebook"),
    ("cli", "parse, call, print"),
)
# Kinds of plugins, as the hooks name them.
OUTSIDE = (
    "backends", "domains", "models", "observations", "quantities", "estimators", "solvers", "formats", "studies",
)  # fmt: skip


def house(ax: plt.Axes) -> None:
    """Floors that imports only go down, and plugins that come through one door."""
    left, width, height = 0.0, 6.6, 0.57
    for k, (name, text) in enumerate(FLOORS):
        ax.add_patch(Rectangle((left, k * height), width, height, fc=STORE if k % 2 else PAPER, ec=INK, lw=1.1))
        ax.text(left + 0.18, (k + 0.5) * height, name, va="center", size=10.5, weight="bold", color=INK)
        ax.text(left + width - 0.18, (k + 0.5) * height, text, va="center", ha="right", size=8.2, color=SOFT)
    top = len(FLOORS) * height
    ax.add_patch(Polygon([(-0.25, top), (width + 0.25, top), (width / 2, top + 1.25)], fc=ROOF, ec=INK, lw=1.3))
    ax.text(width / 2, top + 0.52, "scene.toml", ha="center", va="center", size=12, weight="bold", color=INK)
    ax.add_patch(FancyArrowPatch((-0.42, top - 0.1), (-0.42, 0.1), arrowstyle="-|>", mutation_scale=16, color=SOFT))
    ax.text(-0.62, top / 2, "imports go down", rotation=90, va="center", ha="center", size=10, color=SOFT)
    door = 2 * height
    ax.add_patch(Rectangle((left + width - 0.09, door + 0.06), 0.18, height - 0.12, fc=WAIST, ec=INK, lw=1.1))
    x, step = 8.35, 0.54
    bottom = door + height / 2 - step * (len(OUTSIDE) - 1) / 2 + 1.15
    for k, name in enumerate(reversed(OUTSIDE)):
        y = bottom + k * step
        ax.add_patch(
            FancyBboxPatch(
                (x, y - 0.2), 1.75, 0.4, boxstyle="round,pad=0.02,rounding_size=0.1", fc=PLUGIN, ec=INK, lw=1
            )
        )
        ax.text(x + 0.875, y, name, ha="center", va="center", size=9.2, color=INK)
        ax.plot([x - 0.02, left + width + 0.1], [y, door + height / 2], color=SOFT, lw=0.8, zorder=0)
    ax.text(x + 0.875, bottom + len(OUTSIDE) * step - 0.1, "plugins", ha="center", size=11, weight="bold", color=INK)
    ax.text(x + 0.875, bottom - 0.62, "nine kinds,\none door", ha="center", va="center", size=9, color=SOFT)


def waists(ax: plt.Axes, x: float) -> None:
    """What is on either side of the two narrow interfaces."""
    rows = (
        ("finite element backends", "skfem · dolfinx · mfem · yours", PLUGIN),
        ("Discretization", "first waist: standard forms as matrices", WAIST),
        ("physics", "biot · heat · elastodynamics · yours", PLUGIN),
        ("StateSpace", "second waist: fields, products, evaluation", WAIST),
        ("estimation", "compression · observations · estimators · studies", STORE),
    )
    wide, narrow, high = 6.6, 4.6, 0.86
    gap, y = 0.34, -1.75
    centre = x + wide / 2
    previous = None
    for title, text, colour in rows:
        waist = colour == WAIST
        width = narrow if waist else wide
        ax.add_patch(
            FancyBboxPatch(
                (centre - width / 2, y - high), width, high, boxstyle="round,pad=0.0,rounding_size=0.14",
                fc=colour, ec=INK, lw=1.6 if waist else 1.1, zorder=2,
            )
        )  # fmt: skip
        ax.text(centre, y - 0.3, title, ha="center", va="center", size=11.5, weight="bold", color=INK, zorder=3)
        ax.text(centre, y - 0.62, text, ha="center", va="center", size=9.2,
                color=INK if waist else SOFT, zorder=3)  # fmt: skip
        if previous is not None:
            ax.add_patch(
                Polygon(
                    [(centre - previous / 2, y + gap), (centre + previous / 2, y + gap),
                     (centre + width / 2, y), (centre - width / 2, y)],
                    fc="#f1f4f7", ec="none", zorder=0,
                )
            )  # fmt: skip
        previous = width
        y -= high + gap
    ax.text(centre, -1.45, "two narrow waists", ha="center", size=12, weight="bold", color=INK)
    ax.text(
        centre + wide / 2 + 0.3, -4.2,
        "P physics,\nB backends and\nO measurements\ncost P + B + O\nplugins, not P · B · O",
        ha="left", va="center", size=9.6, color=SOFT,
    )  # fmt: skip


def main() -> None:
    """Write the picture."""
    mpl.rcParams.update({"svg.hashsalt": "dacore", "font.family": "DejaVu Sans", "svg.fonttype": "path"})
    figure, ax = plt.subplots(figsize=(9.0, 13.1))
    house(ax)
    waists(ax, 0.0)
    ax.set(xlim=(-0.95, 10.3), ylim=(-7.7, 8.2), aspect="equal")
    ax.axis("off")
    figure.subplots_adjust(0, 0, 1, 1)
    target = Path(__file__).resolve().parents[1] / "images/house.svg"
    figure.savefig(target, metadata={"Date": None}, facecolor=PAPER)


if __name__ == "__main__":
    main()
