"""
Amplitude and phase
===================

Elastography measures the motion at one frequency, as amplitude and phase. The harmonic model has these as its two
times, in phase with the drive and a quarter of a period later, and everything else stays as it is.
"""

import numpy as np

import dacore
from dacore.plotting import plot_estimate

scene = dacore.open_scene("harmonic.toml")
truth = scene.truth[0]
data, sigma = scene.observe(truth, 0.05, np.random.default_rng(4))
print(scene.model)
plot_estimate(scene.estimate("minimum_variance", data, sigma), "u", truth, axis="y", time=0.0)
