"""Stability of the time schemes: the figure docs/images/stability.png and the tables of docs/time.md.

Run from the root of the clone, with the Biot and scikit-fem plugins installed; a few CPU minutes::

    python tests/benchmarks/stability_map.py
"""

from itertools import product
from pathlib import Path

import numpy as np

from dacore.algebra.threads import one_blas_thread
from dacore.domains.box import Box
from dacore.dynamics.amplification import Amplification
from dacore.dynamics.generalized_alpha import GeneralizedAlpha
from dacore.dynamics.newmark import Newmark
from dacore.dynamics.system import StepSystem
from dacore.figures.stability import RadiusCurve, RadiusMap, stability
from dacore.figures.style import png
from dacore.studies.stability import STABLE, Modes, UncheckedNewmark, newmark_map, oscillator_radii
from dacore_biot.model import Biot
from dacore_skfem.backend import SkfemBackend

ROLES = {"neck": ("y-",), "ventricles": ("y+",), "mre": ("x-", "x+")}
DIVISIONS, STEPS, KAPPAS, SKEMPTONS = (3, 6), (1e-7, 5e-4, 1.0), (1e-16, 3e-9, 1e-4), (0.99, 1.0)
RULES = ("backward_euler", "newmark")
NUMBERS = [(0.25, 0.5), (0.3025, 0.6), (0.5, 1.0), (0.5, 0.5), (0.25, 0.75), (0.25, 1.0), (0.49, 1.0), (0.25, 0.45)]


def physical_radii(scheme):
    """Largest radius of Biot's matrices over meshes, steps, permeabilities and storages, and where."""
    found = []
    for divisions, skempton in product(DIVISIONS, SKEMPTONS):
        mesh = Box((0.0, 0.0), (4.0, 4.0), (divisions, divisions), ROLES).mesh()
        model = Biot(skempton=skempton).build(lambda fields, mesh=mesh: SkfemBackend().discretize(mesh, fields))
        middle = model.parameters.middle
        for step in STEPS:
            system = StepSystem(model, scheme, step)
            for kappa in KAPPAS:
                radius = Amplification(system, middle | {"kappa": kappa}).radius()
                found.append((radius, f"h = {4 / divisions:.2g} cm, τ = {step:g} s, κ = {kappa:g} cm², B = {skempton}"))
    return max(found)


def show(radius):
    """A radius, 1 where it is that to round-off."""
    return "1" if abs(radius - 1) < STABLE - 1 else f"{radius:.4g}"


def main():
    """Print the table and write the figure."""
    modes = Modes.extreme()
    print(f"{len(modes.mass)} modes\n")
    print("| scheme | 2β ≥ γ ≥ 1/2 | modes | Biot's matrices | where |")
    print("|---|---|---|---|---|")
    schemes = [UncheckedNewmark(beta, gamma, rule) for rule in RULES for beta, gamma in NUMBERS]
    for scheme in [*schemes, *(GeneralizedAlpha(rho) for rho in (0.0, 0.5, 1.0))]:
        radius, where = physical_radii(scheme)
        numbers = "–"
        if isinstance(scheme, Newmark):
            numbers = "yes" if 2 * scheme.beta >= scheme.gamma >= 0.5 else "no"
        place = where if radius > STABLE else ""
        print(
            f"| {scheme.label} | {numbers} | {show(modes.radii(scheme).max())} | {show(radius)} | {place} |", flush=True
        )
    maps = []
    for rule in RULES:
        found = newmark_map(np.linspace(0.05, 0.75, 29), np.linspace(0.3, 1.3, 41), rule, Modes.extreme(6.0, 4))
        wrong = found.stable != found.admitted
        print(f"\n{rule}: {wrong.size} pairs, {wrong.sum()} where the measured region is not the theory's", flush=True)
        for k, j in np.argwhere(wrong):
            print(f"    β = {found.betas[k]:g}, γ = {found.gammas[j]:g}: {found.radii[k, j]:.9g}")
        maps.append(RadiusMap(rule.replace("_", " "), found.betas, found.gammas, found.radii))
    frequencies = np.logspace(-1, 3, 200)
    curves = [
        RadiusCurve(scheme.label, frequencies, oscillator_radii(scheme, frequencies))
        for scheme in (Newmark(), Newmark(0.25, 0.5, "newmark"), *(GeneralizedAlpha(r) for r in (0.0, 0.5, 0.8)))
    ]
    target = Path("docs/images/stability.png")
    target.write_bytes(png(stability(maps, curves), dpi=110))
    print(f"\nwrote {target}")


if __name__ == "__main__":
    with one_blas_thread():
        main()
