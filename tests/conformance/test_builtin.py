"""What dacore itself declares or offers keeps the contracts of its kinds."""

from functools import partial

import meshio
import numpy as np

from dacore.algebra.solvers import Auto, Direct, Krylov
from dacore.domains.ball import Ball
from dacore.domains.box import Box
from dacore.domains.file import MeshFile
from dacore.estimators.minimum_variance import MinimumVariance
from dacore.estimators.pbdw import PBDW
from dacore.estimators.posterior import Posterior
from dacore.plugins.registry import load
from dacore.testing import (
    domain_suite,
    estimator_suite,
    model_suite,
    observation_suite,
    quantity_suite,
    run,
    solver_suite,
    space_suite,
)
from dacore.testing.meshes import shuffled_box
from dacore.testing.spaces import Chain, box_space
from tests.graph_plugin import Ring, Tank, Tanks, Thermometers

test_direct = solver_suite(Direct()).as_test()
test_krylov = solver_suite(Krylov()).as_test()
test_auto = solver_suite(Auto()).as_test()

test_minimum_variance = estimator_suite(MinimumVariance(), deviations=True).as_test()
test_minimum_variance_by_step = estimator_suite(MinimumVariance(window="step"), deviations=True).as_test()
# The posterior of few samples claims too little, as its docstring says.
test_minimum_variance_of_the_model = estimator_suite(MinimumVariance(floor=0.01, deviations="model")).as_test()
test_pbdw = estimator_suite(PBDW(weights={"p": 0.1}), deviations=True).as_test()
test_pbdw_as_published = estimator_suite(
    PBDW(n=4, weights={"p": 0.1}, spaces="cycle", centring="none", tails="training")
).as_test()
test_pbdw_regularised = estimator_suite(
    PBDW(n="noise", fit="regularised", weights={"p": 0.1}), deviations=True
).as_test()  # fmt: skip
test_pbdw_of_given_weight = estimator_suite(
    PBDW(n=5, fit="regularised", missed=0.5, weights={"p": 0.1}, spaces="cycle", centring="none"), deviations=True
).as_test()
test_pbdw_weighted_by_noise = estimator_suite(
    PBDW(n="noise", fit="noise_weighted", weights="balanced"), deviations=True
).as_test()  # fmt: skip
test_pbdw_by_cross_validation = estimator_suite(
    PBDW(n=5, fit="regularised", missed="gcv", weights={"p": 0.1}), affine=False, deviations=True
).as_test()
test_pbdw_by_discrepancy = estimator_suite(
    PBDW(n="discrepancy", fit="regularised", missed="discrepancy", weights={"p": 0.1}), affine=False
).as_test()
test_pbdw_in_a_box = estimator_suite(
    PBDW(n=6, fit="noise_weighted", box=1.0, weights={"p": 0.1}), affine=False, deviations=True
).as_test()
test_pbdw_without_correction = estimator_suite(PBDW(n=4, weights="balanced", correction=False)).as_test()

test_posterior = estimator_suite(Posterior(points=512), affine=False, deviations=True, forward=True).as_test()
test_posterior_by_laplace = estimator_suite(Posterior("laplace"), affine=False, deviations=True, forward=True).as_test()

test_box = domain_suite(Box(divisions=(3, 2, 2))).as_test()
test_ball = domain_suite(Ball()).as_test()

test_elements = space_suite(partial(box_space, hole=True), ["left", "hole"]).as_test()
test_elements_of_order_two = space_suite(partial(box_space, 2, order=2), ["right", "side"]).as_test()
test_chain = space_suite(partial(Chain, 14)).as_test()

# A graph in place of a mesh: no capabilities.
test_tanks = space_suite(partial(Tanks, 12)).as_test()
test_ring = model_suite(Ring(), affine_in=("source",)).as_test()
test_thermometers = observation_suite(Thermometers(), partial(Tanks, 12)).as_test()
test_tank = quantity_suite(Tank(), partial(Tanks, 12)).as_test()


def test_file(tmp_path):
    mesh, path = shuffled_box(3, 2), tmp_path / "box.vtu"
    tags = [np.zeros(len(mesh.cells), dtype=int), np.asarray(mesh.facet_tags)]
    cells = [("tetra", mesh.cells), ("triangle", mesh.facets)]
    meshio.Mesh(mesh.points, cells, cell_data={"tag": tags}).write(path)
    roles = {"left": 1, "rest": (2, 3)}
    suite = domain_suite(MeshFile(path, "cm", roles, expected_extent=(0.5, 2.0)))
    assert list(map(str, run(suite))) == []


def test_everything_that_dacore_declares_is_here():
    mine = {
        f"{declaration.kind} {declaration.spec.name}"
        for declaration in load().declarations
        if declaration.source.distribution == "dacore"
    }
    # Suites of formats are in test_formats.py.
    assert mine == {
        "domain ball", "domain box", "domain file", "estimator minimum_variance", "estimator pbdw",
        "estimator posterior", "solver auto", "solver direct", "solver krylov",
        "format csv", "format hdf5", "format npz",
        "study cohort", "study dimension", "study limits", "study mismatch", "study placement", "study variants",
        "study weights",
    }  # fmt: skip
