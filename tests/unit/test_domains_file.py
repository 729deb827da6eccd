"""Meshes from files: round trips, Gmsh's own files, and every way a file can be wrong."""

from pathlib import Path

import meshio
import numpy as np
import pytest

from dacore.domains.ball import Ball
from dacore.domains.box import Box
from dacore.domains.file import MeshFile
from dacore.errors import MeshError
from dacore.geometry.quality import facet_measures, measure
from dacore.io.mesh import write_mesh
from dacore.plugins.settings import build

DATA = Path(__file__).parent / "data"
ROLES = {"neck": 1, "mre": 2}
CUBE = Box((0.0, 0.0, 0.0), (3.0, 2.0, 2.0), (2, 2, 2)).mesh()


def write(path, points=CUBE.points, cells=(), **data):
    """Write blocks (kind, rows) with cell data given block by block."""
    meshio.Mesh(points, list(cells), cell_data={name: list(values) for name, values in data.items()}).write(path)
    return path


def cube(path, points=CUBE.points, cells=CUBE.cells, facets=CUBE.facets, tags=CUBE.facet_tags, more=(), more_tags=()):
    blocks = [("tetra", cells), ("triangle", facets), *more]
    return write(path, points, blocks, tag=[np.full(len(cells), 9), np.asarray(tags), *more_tags])


# --- what works


@pytest.mark.parametrize("suffix", [".msh", ".vtu", ".xdmf"])
@pytest.mark.parametrize("mesh", [Ball().mesh(), Box((0.0, 0.0), (3.0, 1.0), (4, 3)).mesh()], ids=["ball", "plate"])
def test_round_trip_is_exact(tmp_path, suffix, mesh):
    path = tmp_path / f"mesh{suffix}"
    write_mesh(mesh, path)
    roles = {} if suffix == ".msh" else mesh.roles
    again = MeshFile(path, "cm", roles).mesh()
    assert again.points.tobytes() == mesh.points.tobytes()
    np.testing.assert_array_equal(again.cells, mesh.cells)
    assert set(again.roles) == set(mesh.roles)
    for role in mesh.roles:
        np.testing.assert_array_equal(again.boundary_facets(role), mesh.boundary_facets(role))


@pytest.mark.parametrize("name", ["arc_22.msh", "arc_41.msh"])
def test_files_of_gmsh_itself(name):
    mesh = MeshFile(DATA / name, "cm").mesh()
    assert mesh.dim == 2
    assert set(mesh.roles) == {"bottom", "rest"}
    assert measure(mesh.points, mesh.cells).volume == pytest.approx(4.0 + np.pi / 2, rel=0.03)
    assert facet_measures(mesh.points, mesh.boundary_facets("bottom")).sum() == pytest.approx(2.0)
    assert (mesh.points[mesh.boundary_nodes("bottom"), 1] == 0.0).all()
    by_tag = MeshFile(DATA / name, "cm", {"neck": 7, "mre": "rest"}).mesh()
    np.testing.assert_array_equal(by_tag.boundary_facets("neck"), mesh.boundary_facets("bottom"))
    joined = MeshFile(DATA / name, "cm", {"mre": ("bottom", 5)}).mesh()
    assert len(joined.boundary_facets("mre")) == len(mesh.facets)
    by_line = MeshFile(DATA / name, "cm", {"neck": 1, "mre": (2, 3, 4)}, tag_data="gmsh:geometrical").mesh()
    np.testing.assert_array_equal(by_line.boundary_facets("neck"), mesh.boundary_facets("bottom"))


def test_units_scale_to_centimetres(tmp_path):
    for unit, factor in (("m", 0.01), ("cm", 1.0), ("mm", 10.0)):
        path = cube(tmp_path / f"{unit}.vtu", CUBE.points * factor)
        mesh = MeshFile(path, unit, ROLES).mesh()
        np.testing.assert_allclose(mesh.points, CUBE.points, rtol=1e-14)


def test_inner_facets_and_edges_with_other_tags_are_left_out(tmp_path):
    inner = np.array([CUBE.cells[0][:3]])
    if (np.sort(CUBE.facets, axis=1) == np.sort(inner)).all(axis=1).any():
        inner = np.array([CUBE.cells[0][1:]])
    path = cube(
        tmp_path / "a.vtu", facets=np.concatenate([CUBE.facets, inner]), tags=[*CUBE.facet_tags, 77],
        more=[("line", np.array([[0, 1]])), ("vertex", np.array([[0]]))], more_tags=[np.array([5]), np.array([6])],
    )  # fmt: skip
    assert len(MeshFile(path, "cm", ROLES).mesh().facets) == len(CUBE.facets)
    with pytest.raises(MeshError, match=r"a.vtu: mesh facets: 1 tagged facets are not on the boundary"):
        MeshFile(path, "cm", {**ROLES, "wall": 77}).mesh()


def test_orphans_are_dropped_or_refused(tmp_path):
    points = np.concatenate([[[50.0, 50, 50]], CUBE.points, [[-9.0, 0, 0]]])
    path = cube(tmp_path / "a.vtu", points, CUBE.cells + 1, CUBE.facets + 1)
    mesh = MeshFile(path, "cm", ROLES).mesh()
    assert mesh.points.tobytes() == CUBE.points.tobytes()
    np.testing.assert_array_equal(mesh.facets, CUBE.facets)
    with pytest.raises(MeshError, match="2 points belong to no cell; set drop_orphans = true"):
        MeshFile(path, "cm", ROLES, drop_orphans=False).mesh()


def test_inverted_cells_are_refused_or_turned(tmp_path):
    cells = CUBE.cells.copy()
    cells[3:5] = cells[3:5, [1, 0, 2, 3]]
    path = cube(tmp_path / "a.vtu", cells=cells)
    with pytest.raises(MeshError, match=r"2 of 48 cells are inverted \(first: 3\); set reorient = true"):
        MeshFile(path, "cm", ROLES).mesh()
    mesh = MeshFile(path, "cm", ROLES, reorient=True).mesh()
    assert mesh.volumes.sum() == pytest.approx(12.0)


def test_fingerprint_follows_the_content(tmp_path):
    path = cube(tmp_path / "a.xdmf")
    assert (tmp_path / "a.h5").is_file()
    first = MeshFile(path, "cm", ROLES).fingerprint()
    assert first == MeshFile(path, "mm", ROLES).fingerprint()
    heavy = bytearray((tmp_path / "a.h5").read_bytes())
    heavy[-1] ^= 1
    (tmp_path / "a.h5").write_bytes(heavy)
    second = MeshFile(path, "cm", ROLES).fingerprint()
    path.write_text(path.read_text() + "\n")
    assert len({first, second, MeshFile(path, "cm", ROLES).fingerprint()}) == 3


def test_from_a_scene(tmp_path):
    write_mesh(CUBE, tmp_path / "brain.msh")
    table = {"path": "brain.msh", "unit": "cm", "roles": {"held": [1], "free": "mre"}}
    domain = build(MeshFile, table, "a.toml: domain", tmp_path)
    assert domain.mesh().roles == {"held": 1, "free": 2}


# --- what does not


def refused(path, message, **settings):
    with pytest.raises(MeshError, match=message) as caught:
        MeshFile(path, **({"unit": "cm", "roles": ROLES} | settings)).mesh()
    assert "\n" not in str(caught.value)
    assert path.name in str(caught.value)


def test_missing_damaged_and_foreign_files(tmp_path):
    refused(tmp_path / "none.msh", "no such file")
    for name in ("a.msh", "a.vtu", "a.xdmf"):
        (tmp_path / name).write_text("$MeshFormat\n4.1 0 8\n")
        refused(tmp_path / name, f"cannot be read as {name[2:]} .*export it again")
        (tmp_path / name).write_bytes(b"")
        refused(tmp_path / name, "cannot be read")
    (tmp_path / "a.stl").write_text("solid")
    refused(tmp_path / "a.stl", "got a file of type '.stl', expected one of .msh, .vtu, .xdmf")


@pytest.mark.parametrize("name", ["a.msh", "a.vtu", "a.xdmf"])
def test_truncated_files(tmp_path, name):
    write_mesh(CUBE, tmp_path / name)
    whole = (tmp_path / name).read_bytes()
    for share in (0.3, 0.6, 0.9):
        (tmp_path / name).write_bytes(whole[: int(share * len(whole))])
        refused(tmp_path / name, r"\S")


def test_wrong_units(tmp_path):
    path = cube(tmp_path / "a.vtu", CUBE.points * 10.0)
    refused(path, "extent 3000 cm, expected 1 to 100 cm; is the unit cm, not m", unit="m")
    path = cube(tmp_path / "b.vtu", CUBE.points * 1e-2)
    refused(path, "extent 0.03 cm, expected 1 to 100 cm; is the unit m, not cm")
    path = cube(tmp_path / "c.vtu", CUBE.points * 1e6)
    refused(path, "set expected_extent")
    assert MeshFile(path, "cm", ROLES, expected_extent=(1.0, 1e7)).mesh().dim == 3


@pytest.mark.parametrize(
    ("roles", "message"),
    [
        ({}, "names no groups of facets; set roles.*tags: 1, 2"),
        ({"neck": 1, "mre": 5}, "role 'mre' has tag 5, but no facet; the file has tags 1, 2"),
        ({"neck": 1}, "boundary facets with tag 2 have no role"),
        ({"neck": 1, "mre": (1, 2)}, "tag 1 is given to the roles 'neck' and 'mre'"),
        ({"neck": "stem", "mre": 2}, "role 'neck' names 'stem', which is no physical group"),
        ({"neck": 1, "mre": 2, "ventricles": ()}, "role 'ventricles' has no tags"),
    ],
)
def test_roles_that_do_not_fit(tmp_path, roles, message):
    refused(cube(tmp_path / "a.vtu"), message, roles=roles)


def test_facets_without_tags_or_missing(tmp_path):
    blocks = [("tetra", CUBE.cells), ("triangle", CUBE.facets)]
    refused(write(tmp_path / "a.vtu", cells=blocks), "triangles are not tagged")
    refused(write(tmp_path / "b.vtu", cells=blocks[:1]), "has no triangles; save the boundary's")
    refused(
        cube(tmp_path / "c.vtu", facets=CUBE.facets[5:], tags=CUBE.facet_tags[5:]),
        "5 of 48 boundary facets are not tagged",
    )
    twice = np.concatenate([CUBE.facets, CUBE.facets[:1]])
    refused(cube(tmp_path / "d.vtu", facets=twice, tags=[*CUBE.facet_tags, 1]), "listed twice")


def test_which_cell_data_are_the_tags(tmp_path):
    blocks = [("tetra", CUBE.cells), ("triangle", CUBE.facets)]
    inside = np.full(len(CUBE.cells), 9)
    fraction = [inside + 0.5, CUBE.facet_tags + 0.5]
    two = {"tag": [inside, CUBE.facet_tags], "colour": [inside, 3 - CUBE.facet_tags]}
    path = write(tmp_path / "a.vtu", cells=blocks, **two, size=fraction)
    refused(path, "tags may be colour, tag; set tag_data")
    refused(path, "has no cell data 'tags', expected one of colour, size, tag", tag_data="tags")
    refused(path, "'size' are not whole numbers", tag_data="size")
    plain, swapped = (MeshFile(path, "cm", ROLES, tag_data=name).mesh() for name in two)
    np.testing.assert_array_equal(plain.boundary_facets("neck"), swapped.boundary_facets("mre"))
    floats = write(tmp_path / "b.vtu", cells=blocks, tag=[inside * 1.0, CUBE.facet_tags * 1.0], size=fraction)
    assert MeshFile(floats, "cm", ROLES).mesh().roles == ROLES


def test_cells_that_are_no_simplices(tmp_path):
    square = np.array([[0.0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]])
    quads = [("quad", [[0, 1, 2, 3]]), ("line", [[0, 1], [1, 2], [2, 3], [3, 0]])]
    refused(write(tmp_path / "a.vtu", square, quads), "has quad cells, expected triangles or tetrahedra only")
    both = [("triangle", [[0, 1, 2]]), ("quad", [[0, 1, 2, 3]])]
    refused(write(tmp_path / "b.vtu", square, both), "has quad cells")
    hexahedron = [("hexahedron", [[0, 1, 2, 3, 4, 5, 6, 7]])]
    refused(
        write(tmp_path / "c.vtu", np.concatenate([square, square + np.array([0, 0, 2])]), hexahedron),
        "hexahedron cells",
    )
    curved = [("triangle6", [[0, 1, 2, 3, 4, 5]])]
    refused(write(tmp_path / "d.vtu", np.random.default_rng(0).random((6, 3)), curved), "cells of higher order")


def test_surfaces_are_no_domains(tmp_path):
    refused(write(tmp_path / "a.vtu", cells=[("triangle", CUBE.facets)]), "it is a surface, fill it with tetrahedra")
    refused(write(tmp_path / "b.vtu", cells=[("line", CUBE.facets[:, :2])]), "has no triangles or tetrahedra")


def test_flat_points_cannot_hold_tetrahedra(tmp_path):
    path = write(tmp_path / "a.xdmf", CUBE.points[:, :2], [("tetra", CUBE.cells)])
    refused(path, "tetrahedra need points in 3-D, got 2 coordinates")


def test_points_of_two_coordinates_make_a_plate(tmp_path):
    plate = Box((0.0, 0.0), (3.0, 1.0), (4, 3)).mesh()
    blocks = [("triangle", plate.cells), ("line", plate.facets)]
    path = write(tmp_path / "a.xdmf", plate.points, blocks, tag=[np.zeros(len(plate.cells), int), plate.facet_tags])
    assert MeshFile(path, "cm", ROLES).mesh().points.tobytes() == plate.points.tobytes()


def test_points_that_are_not_numbers_or_coincide(tmp_path):
    points = CUBE.points.copy()
    points[4, 1] = np.nan
    refused(cube(tmp_path / "a.vtu", points), "1 coordinates are NaN or infinite")
    doubled = np.concatenate([CUBE.cells, CUBE.cells[:1]])
    refused(cube(tmp_path / "b.vtu", cells=doubled), r"cells: 1 repeat an earlier one \(first: 48\)")


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"unit": "inch"}, "unit: got 'inch', expected one of m, cm, mm"),
        ({"expected_extent": (5.0, 2.0)}, "0 < low < high"),
    ],
)
def test_settings_out_of_range(tmp_path, settings, message):
    path = cube(tmp_path / "a.vtu")
    with pytest.raises(MeshError, match=message):
        MeshFile(path, **({"unit": "cm", "roles": ROLES} | settings))


def test_write_mesh_refuses_other_formats(tmp_path):
    with pytest.raises(MeshError, match=r"cannot write a \.stl file"):
        write_mesh(CUBE, tmp_path / "a.stl")
    assert not list(tmp_path.iterdir())
