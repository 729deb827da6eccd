"""Mistakes that a type checker must find: the line below each ``E:`` has one of that kind."""

import numpy as np

import dacore
from dacore.core.mesh import Mesh
from dacore.plotting import plot_slice

scene = dacore.open_scene("ball.toml")
data = np.zeros((3, 4))

# E: call-arg
scene.estimate("minimum_variance", data)
# E: attr-defined
print(scene.vaildation)
# E: arg-type
plot_slice(scene, scene.truth[0], "p")
# E: arg-type
plot_slice(scene, scene.truth[0].states[:, 0], "p", axis="q")
# E: attr-defined
print(dacore.open_scnee)
# E: arg-type
dacore.open_scene(3)
# E: assignment
mesh: Mesh = scene.model
