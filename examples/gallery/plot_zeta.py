"""
Choosing the weight between the fields
======================================

PBDW needs a weight ζ between the norms of displacement and pressure, and what it finds depends on it over many
decades. Minimum variance, drawn as a line, has no such number to choose.
"""

import matplotlib.pyplot as plt
import numpy as np

import dacore

weights = 10.0 ** np.arange(-24, -9, 2)
published = 'kind="pbdw", spaces="cycle", centring="none", n="bound", tails="training"'
tables = [f"estimator.w{k}={{{published}, weights={{p={weight:g}}}}}" for k, weight in enumerate(weights)]
validation = dacore.open_scene("ball.toml", tables).validation

figure, ax = plt.subplots(figsize=(5.5, 3.4), layout="constrained")
for level, colour in ((0.0, "tab:blue"), (0.1, "tab:orange")):
    errors = [100 * validation.outcome(f"w{k}", level).space_time["p"].mean() for k in range(len(weights))]
    other = 100 * validation.outcome("minimum_variance", level).space_time["p"].mean()
    ax.loglog(weights, errors, "o-", color=colour, label=f"PBDW, {100 * level:.0f}% noise")
    ax.axhline(other, color=colour, linestyle="--", label=f"minimum variance, {100 * level:.0f}% noise")
ax.set(xlabel="weight ζ of the pressure", ylabel="error of the pressure [%]")
ax.legend(fontsize=8)
