"""
Missing voxels
==============

Voxels are lost to motion or to signal that is too weak. A mask leaves them out without preparing anything again,
and the interval says what the loss costs: half of the voxels here, at the same noise.
"""

import matplotlib.pyplot as plt
import numpy as np

import dacore
from dacore.plotting import plot_quantity, plot_sensors

scene = dacore.open_scene("ball.toml")
truth, pressure = scene.truth[1], scene.quantities["cavity_pressure"]
data, sigma = scene.observe(truth, 0.1, np.random.default_rng(1))

kept = scene.functionals.centres[:, 0] < 0.0
spoiled = np.where(kept[:, None], data, np.nan)
estimates = {
    "all voxels": scene.estimate("minimum_variance", data, sigma),
    "left half only": scene.estimate("minimum_variance", spoiled, sigma, mask=kept),
}

figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
plot_sensors(scene, ax=left, values=spoiled[:, 5])
left.set_title("what is left of the data")
plot_quantity(estimates, pressure, truth, right, name="cavity pressure")
