"""Draw docs/figures/frequency_response.png: a ball's amplitudes over the frequency, with and without a loss.

About a CPU minute. Takes no arguments; needs dacore[figures], dacore-biot, dacore-imaging and dacore-skfem.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import dacore
from dacore.dynamics.harmonic import HarmonicModel, amplitude
from dacore.figures.style import COLOURS, styled

ROOT = Path(__file__).resolve().parents[2]
FREQUENCIES = np.geomspace(5.0, 150.0, 120)
LOSSES = (0.0, 0.1, 0.4)
DRIVE = {"p_ventricles": 0.0, "p_csf": 0.0}  # the traction alone


def at(model: HarmonicModel, frequency: float) -> HarmonicModel:
    """Return the model driven at another frequency, with the ordering that is known."""
    loads = tuple(replace(load, profile=type(load.profile)(frequency)) for load in model.model.loads)
    return HarmonicModel(replace(model.model, loads=loads), frequency, model.losses, analysis=model.analysis)


def responses(model: HarmonicModel) -> dict[str, np.ndarray]:
    """Root of the mean square amplitude (losses, frequencies) of each field."""
    layout = model.space.layout
    found = {field.name: np.empty((len(LOSSES), len(FREQUENCIES))) for field in layout.fields}
    for k, frequency in enumerate(FREQUENCIES):
        driven = at(model, float(frequency))
        for j, loss in enumerate(LOSSES):
            states = amplitude(driven.solve(model.parameters.middle | DRIVE | {"loss": loss}).states)
            for name, values in found.items():
                rows = states[layout.block(name)]
                mass = model.space.field_product(name)
                volume = mass.sum() / layout.field(name).components
                values[j, k] = np.sqrt((np.conj(rows) @ (mass @ rows)).real / volume)
    return found


@styled
def draw(found: dict[str, np.ndarray], model: HarmonicModel) -> Figure:
    """One panel a field, one line a loss."""
    figure = Figure(figsize=(9.0, 3.4), layout="constrained")
    names = {"u": "displacement [cm]", "p": "pressure [dyn/cm²]"}
    for axes, (name, values) in zip(figure.subplots(1, 2), found.items(), strict=True):
        for j, loss in enumerate(LOSSES):
            label = "no loss: seepage alone" if loss == 0 else f"loss factor {loss:g}"
            axes.loglog(FREQUENCIES, values[j], color=COLOURS[j], label=label, linewidth=1.4)
        axes.axvline(50.0, color="#8A8A8A", linewidth=0.8, linestyle=":")
        axes.set(xlabel="frequency [Hz]", title=f"rms amplitude of the {names[name]}")
        axes.set_xticks([5, 10, 20, 50, 100], ["5", "10", "20", "50", "100"])
        axes.minorticks_off()
    figure.axes[0].legend(frameon=False, loc="lower left")
    theta = model.parameters.middle
    nodes = len(model.space.discretization.mesh.points)
    figure.suptitle(
        f"Ball with a cavity, {nodes:,} nodes, traction of {abs(theta['xi']):g} dyn/cm², E = {theta['E']:.3g} dyn/cm², "
        f"ν = {theta['nu']:.3g}, κ = {theta['kappa']:.2g} cm²",
        fontsize=9,
    )
    return figure


def main() -> None:
    """Solve, draw and write."""
    scene = dacore.open_scene(ROOT / "examples" / "toy" / "harmonic.toml")
    found = responses(scene.model)
    for name, values in found.items():
        for loss, line in zip(LOSSES, values, strict=True):
            k = int(np.argmax(line))
            print(f"{name}, loss {loss}: largest {line[k]:.3g} at {FREQUENCIES[k]:.3g} Hz, first {line[0]:.3g}")  # noqa: T201
    draw(found, scene.model).savefig(ROOT / "docs" / "figures" / "frequency_response.png", dpi=160)


if __name__ == "__main__":
    main()
