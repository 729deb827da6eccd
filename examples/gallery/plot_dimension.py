"""
The dimension of PBDW and its stability
=======================================

More modes approximate better and are seen less stably: the error is bounded by the tail over the stability constant.
One space for all times sees fewer modes stably than a space for each phase does.
"""

import matplotlib.pyplot as plt

import dacore
from dacore.plotting import plot_inf_sup, plot_spectrum

one = 'estimator.one={kind="pbdw", weights={p=1e-18}, spaces="cycle", centring="cycle", n=8}'
scene = dacore.open_scene("ball.toml", [one])
families = {"one space": scene.prepared("one"), "a space a phase": scene.prepared("pbdw")}

figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.4), layout="constrained")
plot_spectrum(families, left, tails=True, largest=30)
left.set_ylim(1e-5, 2.0)
plot_inf_sup(families, right)
