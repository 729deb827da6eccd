"""
Noise and intervals
===================

More noise, wider intervals: the same patient is measured at three noise levels, and 90% intervals are asked for.
The noise level is stated with the data, so nothing is prepared again.
"""

import matplotlib.pyplot as plt
import numpy as np

import dacore
from dacore.plotting import plot_quantity

scene = dacore.open_scene("ball.toml", ["training.method='reduced'", "training.samples=64", "training.reduction=1e-3"])
truth, pressure = scene.truth[1], scene.quantities["cavity_pressure"]

figure, panels = plt.subplots(1, 3, figsize=(10, 3.2), sharey=True, layout="constrained")
for ax, level in zip(panels, (0.02, 0.1, 0.3), strict=True):
    data, sigma = scene.observe(truth, level, np.random.default_rng(7))
    estimate = scene.estimate("minimum_variance", data, sigma)
    plot_quantity(estimate, pressure, truth, ax, name="cavity pressure")
    ax.label_outer()
    ax.set_title(f"{100 * level:.0f}% noise")
