"""
What is measured
================

A scene's functionals know where, in which direction and in which unit they measure, so they can be drawn.
Here three components of the displacement are averaged over each voxel of one slice.
"""

import matplotlib.pyplot as plt

import dacore
from dacore.plotting import plot_mesh, plot_sensors

scene = dacore.open_scene("ball.toml")
print(scene.functionals)

figure, (left, middle, right) = plt.subplots(1, 3, figsize=(11, 3.6), layout="constrained")
plot_mesh(scene, axis="x", ax=left)
plot_sensors(scene, axis="z", ax=middle)
data, _ = scene.observe(scene.truth[0])
plot_sensors(scene, axis="x", values=data[:, 5], ax=right)
