"""
Which slice sees the pressure
=============================

The claimed deviation of the cavity pressure is known before anybody is measured: it depends on where, not on what.
Low slices move against the held part of the ball and say most, the small one near the top says least; all are tried
with the same training set, read from the cache.
"""

import matplotlib.pyplot as plt
import numpy as np

import dacore

positions, deviations = np.arange(2.5, 9.0, 1.0), []
for position in positions:
    scene = dacore.open_scene("ball.toml", [f'observation.slice.slices=[{{axis="z", position={position}}}]'])
    pressure = scene.quantities["cavity_pressure"]
    readout = scene.prepared("minimum_variance").readout(pressure, noise_scale=1e-4)
    deviations.append(readout.deviation[-1])

figure, ax = plt.subplots(figsize=(5.5, 3.4), layout="constrained")
ax.bar(positions, deviations, width=0.8)
ax.axvspan(3.5, 6.5, color="0.92", zorder=0, label="height of the cavity")
ax.set(xlabel="height of the slice [cm]", ylabel="deviation of the cavity pressure [dyn/cm²]", ylim=(0, None))
ax.legend()
