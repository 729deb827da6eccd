"""
Time schemes and the jump
=========================

The pressure of the walls is there at once, so everything jumps at t = 0. A scheme that does not damp carries the jump
on as an oscillation from step to step; the default is damped, and shorter steps show what it smooths.
"""

import matplotlib.pyplot as plt

import dacore

schemes = {
    "default: β = 1/2, γ = 1": [],
    "undamped: β = 1/4, γ = 1/2": ["time.beta=0.25", "time.gamma=0.5"],
    "generalized α, ρ = 0.5": ["time.scheme='generalized_alpha'"],
    "default, steps of a quarter": ["time.substeps=4"],
}

figure, ax = plt.subplots(figsize=(6, 3.6), layout="constrained")
for label, changes in schemes.items():
    scene = dacore.open_scene("ball.toml", ["time.steps=30", *changes])
    trajectory = scene.model.solve(scene.parameters.middle)
    pressure = scene.model.space.evaluation([[0.0, 0.0, 7.0]], "p") @ trajectory.states
    ax.plot(1e3 * trajectory.times, pressure[0], ".-", markersize=4, label=label)
ax.set(xlabel="time [ms]", ylabel="pressure near the cavity [dyn/cm²]")
ax.legend(fontsize=8)
