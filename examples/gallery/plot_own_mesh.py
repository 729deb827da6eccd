"""
A mesh of your own
==================

Any mesh that meshio reads is a domain: cells, facets with tags, and which tag plays which role.
Here a beam is written to a file, as Gmsh or a segmentation would, and its sides play the roles that the model asks for.
"""

from pathlib import Path

import meshio
import numpy as np

import dacore
from dacore.domains.box import Box
from dacore.plotting import plot_mesh

beam = Box((0.0, 0.0, 0.0), (8.0, 2.0, 2.0), (12, 4, 4)).mesh()
bent = beam.points + np.outer(0.05 * beam.points[:, 0] ** 2, [0.0, 0.0, 1.0])
held = beam.points[beam.facets][:, :, 0].max(axis=1) < 1e-9
loaded = beam.points[beam.facets][:, :, 2].min(axis=1) > 2.0 - 1e-9
tags = np.where(held, 1, np.where(loaded, 2, 3))

folder = Path("runs")
folder.mkdir(exist_ok=True)
cells = [("tetra", beam.cells), ("triangle", beam.facets)]
data = {"tag": [np.zeros(len(beam.cells), dtype=int), tags]}
meshio.Mesh(bent, cells, cell_data=data).write(folder / "beam.vtu")

roles = "{neck = 1, ventricles = 2, mre = 3}"
table = f'domain={{kind="file", path="{(folder / "beam.vtu").resolve()}", unit="cm", roles={roles}}}'
scene = dacore.open_scene("ball.toml", [table])
print(scene.mesh)
plot_mesh(scene, axis="y")
