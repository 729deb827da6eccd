"""
Reduced training against full
=============================

A training set of many samples by few full solves: a reduced model is trained and makes the rest.
The unseen cases are estimated as well as with every sample solved in full.
"""

import matplotlib.pyplot as plt

import dacore
from dacore.plotting import plot_errors

full = dacore.open_scene("ball.toml")
reduced = dacore.open_scene("ball.toml", ["training.method='reduced'", "training.reduction=1e-2"])
print(reduced.reduced)

figure, panels = plt.subplots(2, 1, figsize=(7, 5.2), sharex=True, layout="constrained")
for ax, scene in zip(panels, (full, reduced), strict=True):
    plot_errors(scene, ax=ax)
    ax.set_title(f"p − p_csf, {scene.scene.training.method} training")
panels[0].get_legend().remove()
panels[0].set_xlabel("")
