"""Parameters over many decades, against a dense march in extended precision; units, through to the estimates."""

from dataclasses import replace

import numpy as np
import pytest

from dacore.algebra.compress import compress
from dacore.core.noise import WhiteNoise
from dacore.core.timegrid import TimeGrid
from dacore.domains.ball import Ball
from dacore.domains.box import Box
from dacore.dynamics.march import MarchedModel
from dacore.estimators.minimum_variance import MinimumVariance
from dacore.estimators.pbdw import PBDW
from dacore.plugins.registry import load
from dacore_biot.model import Biot
from tests.backends import backend
from tests.hazards.extended import march
from tests.hazards.manufactured import TISSUE

STEP = 5e-4
MODULI = [{"E": 10.0**k, "nu": nu} for k in (2, 4, 6, 8) for nu in (0.3, 0.425, 0.4999)]
PERMEABILITIES = [{"kappa": 10.0**k, "skempton": b} for k in (-20, -16, -12, -8, -6) for b in (0.99, 1.0)]


@pytest.mark.parametrize("stabilization", ["none", "lumped", "projected"])
def test_answers_over_six_decades_of_stiffness_and_fourteen_of_permeability(stabilization):
    mesh = Box((0.0, 0.0), (5.0, 5.0), (4, 4)).mesh()
    model = Biot(ventricles="", stabilization=stabilization).build(lambda f: backend("skfem").discretize(mesh, f))
    fixed = {p.name: p.low for p in model.parameters.parameters} | TISSUE
    worst = {"u": 0.0, "p": 0.0}
    for changes in MODULI + PERMEABILITIES:
        theta = fixed | changes
        found = MarchedModel(model, TimeGrid(STEP, 3)).solve(theta).states
        exact = march(model, theta, STEP, 3)
        for field in worst:
            block = model.space.layout.block(field)
            error = float(np.abs(found[block] - exact[block]).max() / np.abs(exact[block]).max())
            worst[field] = max(worst[field], error)
    assert worst["p"] < 1e-9
    assert worst["u"] < 1e-6


FACTORS = {"kappa": 1e-4, "E": 0.1, "p_ventricles": 0.1, "p_csf": 0.1, "xi": 0.1, "density": 1e3, "viscosity": 0.1}
LENGTH, PRESSURE = 1e-2, 0.1


def in_units(length, factors):
    """Two estimates of the pressure in the cavity of unseen balls and their deviations, all in units of one's own."""
    mesh = Ball(edge=2.0).mesh()
    mesh = replace(mesh, points=mesh.points * length)
    plain = Biot().parameters
    ranges = {p.name: (p.low * factors.get(p.name, 1.0), p.high * factors.get(p.name, 1.0)) for p in plain.parameters}
    model = MarchedModel(
        Biot(ranges=ranges).build(lambda fields: backend("skfem").discretize(mesh, fields)), TimeGrid(STEP, 4)
    )
    samples = model.parameters.sample(np.random.default_rng(3), 14, "latin_hypercube")
    runs = [model.solve(model.parameters.as_mapping(sample)) for sample in samples]
    background = compress(model.space, runs[:12], model.parameters, samples[:12])
    voxels = load().get("observation", "voxels")(size=2.0 * length)
    functionals = voxels.functionals(model.space)
    data = np.stack([functionals(run.states) for run in runs[12:]], axis=2)
    sigma = 0.05 * float(np.abs(data).max())
    data = data + sigma * np.random.default_rng(4).standard_normal(data.shape)
    cavity = load().get("quantity", "boundary_mean")()
    weight = 1e-18 * (length / factors.get("p_csf", 1.0)) ** 2
    out = []
    for estimator in (MinimumVariance(), PBDW(n=4, weights={"p": weight})):
        estimate = estimator.prepare(background, functionals, WhiteNoise(1.0)).estimate(data, noise_scale=sigma)
        out.append(estimate.quantity(cavity))
    return [np.asarray(value) for value in out], sigma


def test_si_and_cgs_give_the_same_estimates():
    """The whole way: mesh, motion, compression, voxels, noise, both estimators, pressure in the cavity."""
    cgs, noise = in_units(1.0, {})
    si, noise_si = in_units(LENGTH, FACTORS)
    assert noise_si == pytest.approx(LENGTH * noise, rel=1e-7)
    for one, other in zip(cgs, si, strict=True):
        assert one.size == 2
        np.testing.assert_allclose(other, PRESSURE * one, rtol=1e-5)
