"""
An alarm under a wrong model
============================

Data of a ball whose held part moves by a tenth of a millimetre, which the training knows nothing of: the residuals are
far larger than the stated noise explains, and the estimate says so instead of being silently wrong.
"""

import matplotlib.pyplot as plt
import numpy as np

import dacore

scene = dacore.open_scene("ball.toml")
moves, ratios, alarms = np.array([0.0, 1e-5, 1e-4, 1e-3, 1e-2]), [], []
for move in moves:
    other = dacore.open_scene("ball.toml", [f"physics.neck_displacement={move:g}"])
    truth = other.model.solve(other.parameters.middle)
    data, sigma = scene.observe(truth, 0.02, np.random.default_rng(3))
    misfit = scene.estimate("minimum_variance", data, sigma).misfit
    ratios.append(misfit.ratio[0])
    alarms.append(misfit.alarm[0])

figure, ax = plt.subplots(figsize=(5.5, 3.4), layout="constrained")
ax.bar(range(len(moves)), ratios, color=["tab:red" if alarm else "tab:green" for alarm in alarms])
ax.axhline(1.0, color="black", linewidth=0.8)
ax.set_xticks(range(len(moves)), [f"{move:g}" for move in moves])
ax.set(xlabel="motion of the held part [cm]", ylabel="residuals over what is expected")
ax.set_title("red: the data contradict the model")
