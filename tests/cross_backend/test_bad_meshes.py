"""A bad mesh is the same clear line on every backend, and one that can be mended gives the same answer on all."""

import re

import meshio
import numpy as np
import pytest

from dacore import open_scene
from dacore.core.fields import Field
from dacore.core.mesh import Mesh
from dacore.domains.box import Box
from dacore.errors import DacoreError
from dacore.plugins.registry import load

BACKENDS = [row.name for row in load().table() if row.kind == "backend" and row.status == "ready"]
CUBE = Box(upper=(3.0, 3.0, 3.0), divisions=(2, 2, 2)).mesh()
PLATE = Box(lower=(0.0, 0.0), upper=(3.0, 3.0), divisions=(3, 3)).mesh()
IN_SPACE = np.pad(PLATE.points, ((0, 0), (0, 1)), constant_values=2.0)

SCENE = """
title = "A mesh of one's own"
[domain]
kind = "file"
path = "%s"
unit = "cm"
roles = { neck = 1, mre = 2 }
[physics]
kind = "biot"
ventricles = ""
[time]
steps = 2
[training]
samples = 2
[observation.point]
kind = "points"
positions = [[1.0, 1.0, 1.0]]
[estimator.minimum_variance]
kind = "minimum_variance"
"""


def solid(path, points=CUBE.points, cells=CUBE.cells, facets=CUBE.facets, tags=CUBE.facet_tags, more=()):
    return write(path, points, [("tetra", cells, 9), *more, ("triangle", facets, tags)])


def plate(path, points=IN_SPACE, cells=PLATE.cells, facets=PLATE.facets, tags=PLATE.facet_tags, more=()):
    return write(path, points, [("triangle", cells, 9), *more, ("line", facets, tags)])


def write(path, points, blocks):
    """Write (kind, cells, tags) blocks to a .vtu file, or a .msh file of Gmsh 2.2."""
    tags = [np.broadcast_to(tag, len(cells)).astype(np.int32) for _, cells, tag in blocks]
    name = "gmsh:physical" if path.suffix == ".msh" else "tag"
    data = {name: tags} | ({"gmsh:geometrical": tags} if path.suffix == ".msh" else {})
    content = meshio.Mesh(points, [(kind, np.asarray(cells)) for kind, cells, _ in blocks], cell_data=data)
    meshio.write(path, content, file_format="gmsh22" if path.suffix == ".msh" else "vtu")
    return path


def changed(table, row, values):
    out = table.copy()
    out[row] = values
    return out


def lifted(points):
    out = points.copy()
    out[0, 2] += 0.5
    return out


def inner_facet():
    """One facet between two cells."""
    boundary = {tuple(facet) for facet in np.sort(CUBE.facets, axis=1)}
    return next(facet for cell in CUBE.cells for facet in (cell[:3], cell[1:]) if tuple(np.sort(facet)) not in boundary)


def with_flat_cell(path):
    """A cell over a boundary facet cut into three by a point on that facet, and a fourth without volume left there."""
    a, b, c = CUBE.facets[0]
    owner = next(k for k, cell in enumerate(CUBE.cells) if {a, b, c} <= set(cell))
    e = len(CUBE.points)
    parts = [np.where(CUBE.cells[owner] == old, e, CUBE.cells[owner]) for old in (a, b, c)]
    cells = np.concatenate([np.delete(CUBE.cells, owner, axis=0), parts, [[a, b, c, e]]])
    return solid(path, np.concatenate([CUBE.points, [CUBE.points[[a, a, b, c]].mean(axis=0)]]), cells)


def with_fin(path):
    """A cell more on a facet that has two already."""
    points = np.concatenate([CUBE.points, [[1.5, 1.4, 1.3]]])
    fin = np.array([*INNER, len(CUBE.points)])
    if np.linalg.det(points[fin[1:]] - points[fin[0]]) < 0:
        fin = fin[[1, 0, 2, 3]]
    return solid(path, points, np.concatenate([CUBE.cells, [fin]]))


def with_crack(path):
    """Two cubes that touch and share no point."""
    n, beside = len(CUBE.points), CUBE.points + np.array([3.0, 0.0, 0.0])
    return solid(
        path, np.concatenate([CUBE.points, beside]), np.concatenate([CUBE.cells, CUBE.cells + n]),
        np.concatenate([CUBE.facets, CUBE.facets + n]), [*CUBE.facet_tags] * 2,
    )  # fmt: skip


FAR = np.array([[9.0, 9.0, 9.0]])
INNER = inner_facet()

REFUSED = {
    "orphan nodes": (
        lambda path: solid(path, np.concatenate([CUBE.points, FAR])),
        "1 points belong to no cell; set drop_orphans = true",
        ["domain.drop_orphans=false"],
    ),
    "orphan nodes in the middle, with facets": (
        lambda path: solid(
            path, np.concatenate([CUBE.points, FAR, FAR + 1, FAR * np.array([1, 2, 1])]),
            facets=np.concatenate([CUBE.facets, [[27, 28, 29]]]), tags=[*CUBE.facet_tags, 1],
        ),
        "tagged facets use points that belong to no cell; remove those facets",
        [],
    ),
    "inverted cells": (
        lambda path: solid(path, cells=changed(CUBE.cells, 7, CUBE.cells[7, [1, 0, 2, 3]])),
        r"1 of 48 cells are inverted \(first: 7\); set reorient = true",
        [],
    ),
    "inverted triangles": (
        lambda path: plate(path, cells=PLATE.cells[:, [1, 0, 2]]),
        r"18 of 18 cells are inverted \(first: 0\); set reorient = true",
        [],
    ),
    "a flat cell": (
        with_flat_cell, r"1 of 51 are inverted or flat \(first: 50, volume 0\); .* remove flat ones", [],
    ),
    "a cell of three points": (
        lambda path: solid(path, cells=changed(CUBE.cells, 5, CUBE.cells[5, [0, 1, 2, 2]])),
        r"1 of 48 name the same point twice \(first: 5\)",
        [],
    ),
    "duplicated cells": (
        lambda path: solid(path, cells=np.concatenate([CUBE.cells, CUBE.cells[3:5][:, [1, 2, 0, 3]]])),
        r"2 repeat an earlier one \(first: 48\); remove the duplicates",
        [],
    ),
    "three cells on one facet": (with_fin, "1 facets belong to more than two cells; expected a manifold", []),
    "points that coincide": (with_crack, r"9 coincide with another \(first pair: 18 and 27\); merge the points", []),
    "a role with an unknown tag": (
        solid, "role 'mre' has tag 5, but no facet; the file has tags 1, 2", ["domain.roles={neck=1, mre=5}"],
    ),
    "a role with an unknown name": (
        solid, "role 'neck' names 'stem', which is no physical group", ["domain.roles={neck='stem', mre=2}"],
    ),
    "a boundary that has no role": (
        lambda path: solid(path, tags=changed(CUBE.facet_tags, 3, 8)),
        "boundary facets with tag 8 have no role; add the tag to a role",
        [],
    ),
    "a boundary that has no tag": (
        lambda path: solid(path, facets=CUBE.facets[4:], tags=CUBE.facet_tags[4:]),
        "4 of 48 boundary facets are not tagged",
        [],
    ),
    "a role that the physics does not know": (
        solid,
        "physics: Biot: the mesh has no role mre, neck; it has stem, outside",
        ["domain.roles={stem=1, outside=2}"],
    ),
    "a role that the physics misses": (
        solid,
        "physics: Biot: the mesh has no role ventricles; it has neck, mre",
        ["physics.ventricles='ventricles'"],
    ),
    "tetrahedra and a hexahedron": (
        lambda path: solid(path, more=[("hexahedron", [[0, 1, 4, 3, 9, 10, 13, 12]], 9)]),
        "has hexahedron cells, expected triangles or tetrahedra only",
        [],
    ),
    "tetrahedra and a prism": (
        lambda path: solid(path, more=[("wedge", [[0, 1, 3, 9, 10, 12]], 9)]), "has wedge cells", [],
    ),
    "triangles and a quadrilateral": (
        lambda path: plate(path, more=[("quad", [[0, 1, 5, 4]], 9)]), "has quad cells", [],
    ),
    "tetrahedra and triangles inside them": (
        lambda path: solid(path, facets=np.concatenate([CUBE.facets, [INNER]]), tags=[*CUBE.facet_tags, 1]),
        "1 tagged facets are not on the boundary; remove their tags",
        [],
    ),
    "cells of higher order": (
        lambda path: write(path, np.random.default_rng(0).random((10, 3)), [("tetra10", [np.arange(10)], 9)]),
        "has cells of higher order",
        [],
    ),
    "a curved surface": (
        lambda path: plate(path, lifted(IN_SPACE)), "it is a surface, fill it with tetrahedra", [],
    ),
    "a plane x = const": (
        lambda path: plate(path, IN_SPACE[:, [2, 0, 1]]),
        "they lie in a plane x = const, turn it so that z is constant",
        [],
    ),
    "points that are no numbers": (
        lambda path: solid(path, changed(CUBE.points, 4, [0.0, np.nan, 0.0])), "1 coordinates are NaN or infinite", [],
    ),
    "another unit": (solid, "extent 300 cm, expected 1 to 100 cm; is the unit cm, not m", ["domain.unit='m'"]),
}  # fmt: skip


def scene(folder, name):
    path = folder / "scene.toml"
    path.write_text(SCENE % name)
    return path


def refusal(path, backend, changes):
    """The line that a run on `backend` ends with."""
    session = open_scene(path, [f"discretization.backend={backend}", *changes], cache=path.parent / backend)
    with pytest.raises(DacoreError) as caught:
        session.model  # noqa: B018
    return str(caught.value)


def test_some_backend_is_there():
    assert BACKENDS


@pytest.mark.parametrize("case", REFUSED)
def test_a_bad_mesh_is_the_same_line_on_every_backend(case, tmp_path):
    make, pattern, changes = REFUSED[case]
    make(tmp_path / "mesh.vtu")
    lines = {refusal(scene(tmp_path, "mesh.vtu"), backend, changes) for backend in BACKENDS}
    assert len(lines) == 1
    line = lines.pop()
    assert "\n" not in line
    assert line.startswith(str(tmp_path / "scene.toml"))
    assert re.search(pattern, line), line


MENDED = {
    "orphan nodes, left out": (
        lambda path: solid(path, np.concatenate([FAR, CUBE.points, FAR]), CUBE.cells + 1, CUBE.facets + 1), CUBE, [],
    ),
    "inverted cells, turned": (
        lambda path: solid(path, cells=changed(CUBE.cells, 7, CUBE.cells[7, [1, 0, 2, 3]])),
        CUBE, ["domain.reorient=true"],
    ),
    "a plane z = const in space": (plate, PLATE, []),
    "facets with more points and inner facets without a role": (
        lambda path: solid(
            path, facets=np.concatenate([CUBE.facets[:, [2, 0, 1]], [INNER]]), tags=[*CUBE.facet_tags, 77],
            more=[("vertex", [[0]], 5), ("line", [[0, 1]], 6)],
        ),
        CUBE, [],
    ),
}  # fmt: skip


@pytest.mark.parametrize("suffix", [".vtu", ".msh"])
@pytest.mark.parametrize("case", MENDED)
def test_a_mesh_that_can_be_mended_gives_one_answer(case, suffix, tmp_path):
    make, same, changes = MENDED[case]
    name = make(tmp_path / f"mesh{suffix}").name
    if same.dim == 2:
        changes = [*changes, "observation.point.positions=[[1.0, 1.0]]"]
    states = {}
    for backend in BACKENDS:
        session = open_scene(scene(tmp_path, name), [f"discretization.backend={backend}", *changes], tmp_path / backend)
        assert session.mesh.points.tobytes() == same.points.tobytes()
        states[backend] = session.truth[0].states
    first = states[BACKENDS[0]]
    assert abs(first).max() > 0
    for backend in BACKENDS[1:]:
        assert abs(states[backend] - first).max() < 1e-9 * abs(first).max()


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(
    ("points", "cells", "facets", "message"),
    [
        pytest.param(
            IN_SPACE, PLATE.cells, PLATE.facets, r"leave out the constant coordinate \(points\[:, :2\]\)",
            id="triangles in space",
        ),
        pytest.param(
            PLATE.points, [[0, 1, 5, 4]], PLATE.facets, "cut quadrilaterals into two triangles", id="quadrilaterals"
        ),
        pytest.param(
            np.concatenate([PLATE.points, [[9.0, 9.0]]]), PLATE.cells, PLATE.facets, "remove the orphan points",
            id="orphans",
        ),
        pytest.param(
            PLATE.points, PLATE.cells[:, [1, 0, 2]], PLATE.facets, "swap two vertices of inverted cells", id="inverted"
        ),
    ],
)  # fmt: skip
def test_a_mesh_made_in_python_is_checked_before_a_backend_sees_it(backend, points, cells, facets, message):
    made = load().get("backend", backend)()
    with pytest.raises(DacoreError, match=message):
        made.discretize(Mesh(points, cells, facets, PLATE.facet_tags, PLATE.roles), [Field("p", 1, 1)])
