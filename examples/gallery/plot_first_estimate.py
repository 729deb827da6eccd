"""
A first estimate
================

Displacements of one slice, with noise, become the pressure of the whole ball, though no pressure is measured.
The standard deviation says how far to trust it: it is least near what is measured and what the walls prescribe.
"""

import numpy as np

import dacore
from dacore.plotting import plot_estimate

scene = dacore.open_scene("ball.toml")
truth = scene.truth[0]  # a case that the training never saw
data, sigma = scene.observe(truth, noise=0.1, rng=np.random.default_rng(0))

estimate = scene.estimate("minimum_variance", data, sigma)
plot_estimate(estimate, "p", truth, time=3e-3)
