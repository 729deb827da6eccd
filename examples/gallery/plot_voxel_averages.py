"""
Exact averages over voxels
==========================

A voxel's value is the mean of the field over it. Cutting every cell by the voxels gives it exactly; midpoints sampled
in each voxel come close slowly, and by how the points fall on the mesh.
"""

import matplotlib.pyplot as plt
import numpy as np

import dacore

scene = dacore.open_scene("ball.toml")
state = scene.truth[0].states[:, 5]
exact = scene.functionals(state)

counts, errors = np.array([1, 2, 3, 4, 6, 8]), []
for count in counts:
    sampled = dacore.open_scene("ball.toml", [f"observation.slice.quadrature={count}"]).functionals
    both = np.isin(scene.functionals.labels, sampled.labels)
    errors.append(np.linalg.norm(sampled(state)[np.isin(sampled.labels, scene.functionals.labels)] - exact[both]))

figure, ax = plt.subplots(figsize=(5.5, 3.4), layout="constrained")
ax.loglog(counts, 100 * np.array(errors) / np.linalg.norm(exact), "o-")
ax.set(xlabel="sample points along a voxel's edge", ylabel="difference from the exact means [%]")
ax.set_xticks(counts, [str(count) for count in counts])
ax.minorticks_off()
ax.grid(alpha=0.4)
