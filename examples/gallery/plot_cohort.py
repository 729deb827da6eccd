"""
A cohort of patients
====================

Once prepared, an estimator takes a product of small matrices a patient. Here five hundred come from the reduced model
that the training left behind, and each one's cavity pressure is read from noisy data.
"""

import matplotlib.pyplot as plt
import numpy as np

import dacore

scene = dacore.open_scene("ball.toml", ["training.method='reduced'", "training.samples=32", "training.reduction=1e-2"])
rng, background = np.random.default_rng(5), scene.background
pressure = scene.quantities["cavity_pressure"]

patients = scene.parameters.sample(rng, 500)
trajectories = background.parametric("a cohort needs a reduced model").coefficients(patients)
clean = np.tensordot(background.observe(scene.functionals.matrix), trajectories, axes=1)
sigma = 0.1 * np.abs(clean).max(axis=(0, 1))
data = clean + sigma * rng.standard_normal(clean.shape)

estimate = scene.estimate("minimum_variance", data, sigma)
found, (low, high) = estimate.quantity(pressure)[-1], (end[-1] for end in estimate.interval(pressure))
true = patients[:, scene.parameters.names.index("p_ventricles")]
inside = np.mean((low < true) & (true < high))

figure, ax = plt.subplots(figsize=(4.6, 4.2), layout="constrained")
ax.errorbar(true, found, yerr=[found - low, high - found], fmt=".", markersize=4, elinewidth=0.4, alpha=0.6)
ax.axline((1.05e4, 1.05e4), slope=1.0, color="black", linewidth=0.8)
ax.set(xlabel="true cavity pressure [dyn/cm²]", ylabel="estimated cavity pressure [dyn/cm²]")
ax.set_title(f"{100 * inside:.0f}% of the 90% intervals hold the truth")
