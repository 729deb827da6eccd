"""
Parameters and what the data say of them
========================================

The posterior finds the parameters of the model beside the state. The stiffness and the cavity's pressure are learned;
of what hardly moves what is measured nothing is learned, and the interval stays as wide as the range.
"""

import numpy as np

import dacore
from dacore.plotting import plot_parameters

reduced = ["training.method='reduced'", "training.samples=32", "training.reduction=1e-2"]
scene = dacore.open_scene("ball.toml", [*reduced, "estimator.posterior.kind='posterior'"])

truth = scene.parameters.middle | {"E": 3e5, "p_ventricles": 10800.0}
data, sigma = scene.observe(scene.model.solve(truth), 0.05, np.random.default_rng(2))
estimate = scene.estimate("posterior", data, sigma)
plot_parameters(estimate, truth)
