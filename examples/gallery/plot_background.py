"""
The spectrum of a training set
==============================

Each field is compressed by itself, until the modes left out are a millionth of what there is.
The singular values fall fast, which is why few measurements say so much.
"""

import matplotlib.pyplot as plt
import numpy as np

import dacore
from dacore.plotting import plot_slice, plot_spectrum

scene = dacore.open_scene("ball.toml")
background = scene.background
print(background)

figure, (left, middle, right) = plt.subplots(1, 3, figsize=(11, 3.2), layout="constrained")
plot_spectrum(background, left)
for ax, number in ((middle, 0), (right, 1)):
    state = np.zeros(background.space.n_dofs)
    state[background.space.layout.block("p")] = background.bases["p"].basis[:, number]
    plot_slice(background, state, "p", axis="x", ax=ax, colorbar=False)
    ax.set_title(f"mode {number + 1} of the pressure")
