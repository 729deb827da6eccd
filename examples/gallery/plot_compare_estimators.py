"""
Estimators side by side
=======================

Every estimator of a scene is judged on the same unseen cases with the same noise, beside guessing the training mean.
To the right of the dashed line an estimate is worse than none.
"""

import dacore
from dacore.plotting import plot_errors

regularised = (
    'estimator.regularised={kind="pbdw", title="PBDW, regularised", n=12, fit="regularised", weights="balanced"}'
)
scene = dacore.open_scene("ball.toml", [regularised])
print(scene.validation)
plot_errors(scene)
