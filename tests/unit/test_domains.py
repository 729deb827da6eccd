"""Box and ball: geometry, roles and refused settings."""

import tomllib

import numpy as np
import pytest

from dacore.domains.ball import Ball
from dacore.domains.box import Box
from dacore.errors import DacoreError, MeshError
from dacore.geometry.quality import enclosed_volume, facet_measures, measure
from dacore.plugins.settings import build

# --- box


@pytest.mark.parametrize(
    ("box", "nodes", "cells", "volume"),
    [
        (Box(), 729, 3072, 1.0),
        (Box((-1.0, 0.0, 2.0), (1.0, 3.0, 6.0), (2, 3, 5)), 72, 180, 24.0),
        (Box((0.0, 0.0), (2.0, 1.0), (5, 3)), 24, 30, 2.0),
        (Box((0.0, 0.0), (1.0, 1.0), (1, 1)), 4, 2, 1.0),
    ],
)
def test_box_counts_and_volume(box, nodes, cells, volume):
    mesh = box.mesh()
    assert (len(mesh.points), len(mesh.cells)) == (nodes, cells)
    assert measure(mesh.points, mesh.cells).volume == pytest.approx(volume, rel=1e-12)
    assert (mesh.points.min(axis=0) == box.lower).all()
    assert (mesh.points.max(axis=0) == box.upper).all()


def test_box_roles_are_the_named_sides():
    box = Box(
        (0.0, 0.0, 0.0), (1.0, 2.0, 3.0), (2, 2, 2), {"hot": ("x+",), "cold": ("y-", "z+"), "free": ("x-", "y+", "z-")}
    )
    mesh = box.mesh()
    areas = {role: facet_measures(mesh.points, mesh.boundary_facets(role)).sum() for role in mesh.roles}
    assert areas == pytest.approx({"hot": 6.0, "cold": 3.0 + 2.0, "free": 6.0 + 3.0 + 2.0})
    assert (mesh.points[mesh.boundary_nodes("hot"), 0] == 1.0).all()


def test_box_holds_its_lowest_side_unless_told_otherwise():
    mesh = Box((0.0, 0.0), (3.0, 1.0), (3, 2)).mesh()
    assert (mesh.points[mesh.boundary_nodes("neck"), 1] == 0.0).all()
    assert facet_measures(mesh.points, mesh.boundary_facets("mre")).sum() == pytest.approx(5.0)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"lower": (0.0, 0.0)}, "box: got 2 lower and 3 upper coordinates and 3 divisions"),
        ({"lower": (0.0,), "upper": (1.0,), "divisions": (1,)}, "expected 2 or 3 of each"),
        ({"upper": (1.0, 1.0, -1.0)}, "box z: got 0.0 to -1.0 cm, expected lower < upper"),
        ({"upper": (1.0, float("inf"), 1.0)}, "box y: got 0.0 to inf cm"),
        ({"divisions": (4, 0, 4)}, "box divisions along y: got 0"),
        ({"divisions": (2000, 2000, 2000)}, "expected at most 20000000"),
        ({"roles": {"neck": ("x-",)}}, "no role has the sides x[+], y-, y[+], z-, z[+]"),
        ({"roles": {"neck": ("w-",)}}, "got side 'w-', expected one of x-"),
        ({"roles": {"a": ("x-", "x+", "y-"), "b": ("x-", "y+", "z-", "z+")}}, "side 'x-' is named 2 times"),
        ({"roles": {"a": ("x-", "x+", "y-", "y+", "z-", "z+"), "b": ()}}, "'b' has no side"),
    ],
)
def test_box_refuses(settings, message):
    with pytest.raises(MeshError, match=message):
        Box(**settings)


def test_box_from_a_scene():
    table = tomllib.loads(
        'lower = [0, 0]\nupper = [2, 1]\ndivisions = [4, 2]\nroles = {neck = ["x-"], mre = ["x+", "y-", "y+"]}'
    )
    assert build(Box, table, "a.toml: domain").mesh().roles == {"neck": 1, "mre": 2}
    with pytest.raises(DacoreError, match="divisons"):
        build(Box, {"divisons": [1, 1, 1]}, "a.toml: domain")


# --- ball


@pytest.fixture(scope="module")
def ball():
    return Ball().mesh()


def test_ball_is_small_and_good(ball):
    assert len(ball.points) < 1500
    found = measure(ball.points, ball.cells)
    assert found.smallest_angle > 15.0
    assert found.euler == (2, 2)
    assert set(ball.roles) == {"neck", "ventricles", "mre"}


def test_ball_volume_and_areas_converge_to_the_exact_ones():
    errors = []
    for edge in (1.6, 0.8):
        domain = Ball(edge=edge)
        mesh = domain.mesh()
        cavity = -enclosed_volume(mesh.points, mesh.boundary_facets("ventricles"))
        area = facet_measures(mesh.points, mesh.boundary_facets("ventricles")).sum()
        errors.append(
            [
                abs(mesh.volumes.sum() / domain.volume - 1),
                1 - cavity / (4 / 3 * np.pi * 1.5**3),
                1 - area / (4 * np.pi * 1.5**2),
            ]
        )
    coarse, fine = np.array(errors)
    assert (fine < 0.45 * coarse).all()
    assert fine[0] < 0.01


def test_ball_roles_lie_where_they_should(ball):
    centre = np.array([0.0, 0.0, 5.0])
    np.testing.assert_allclose(
        np.linalg.norm(ball.points[ball.boundary_nodes("ventricles")] - centre, axis=1), 1.5, rtol=1e-6
    )
    outside = np.concatenate([ball.boundary_nodes("neck"), ball.boundary_nodes("mre")])
    np.testing.assert_allclose(np.linalg.norm(ball.points[outside] - centre, axis=1), 5.0, rtol=1e-6)
    heights = {role: ball.points[ball.boundary_facets(role)][:, :, 2].mean(axis=1) for role in ("neck", "mre")}
    assert heights["neck"].max() < 1.0 <= heights["mre"].min()
    # A spherical cap of height h has the area 2 π r h.
    held = facet_measures(ball.points, ball.boundary_facets("neck")).sum()
    assert held == pytest.approx(2 * np.pi * 5.0 * 1.0, rel=0.25)


def test_a_higher_neck_holds_more():
    areas = []
    for height in (0.8, 1.6, 3.0):
        mesh = Ball(neck_height=height).mesh()
        areas.append(facet_measures(mesh.points, mesh.boundary_facets("neck")).sum())
    assert np.all(np.diff(areas) > 0)


def test_the_cavity_may_lie_off_the_centre():
    mesh = Ball(cavity_offset=(1.0, -0.5, 1.5)).mesh()
    nodes = mesh.points[mesh.boundary_nodes("ventricles")]
    np.testing.assert_allclose(np.linalg.norm(nodes - [1.0, -0.5, 6.5], axis=1), 1.5, rtol=1e-6)


def test_a_cavity_with_more_facets_than_the_outside_is_still_the_cavity():
    mesh = Ball(radius=5.0, cavity_radius=4.0, edge=1.0).mesh()
    assert len(mesh.boundary_facets("ventricles")) > len(mesh.boundary_facets("mre")) + len(
        mesh.boundary_facets("neck")
    )
    assert enclosed_volume(mesh.points, mesh.boundary_facets("ventricles")) < 0


def test_same_ball_bit_for_bit(ball):
    again = Ball().mesh()
    assert again.points.tobytes() == ball.points.tobytes()
    assert again.cells.tobytes() == ball.cells.tobytes()
    assert again.facet_tags.tobytes() == ball.facet_tags.tobytes()


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"radius": -1.0}, "ball radius: got -1.0 cm, expected a positive length"),
        ({"edge": float("nan")}, "ball edge: got nan cm"),
        ({"cavity_radius": 4.9}, "the wall round the cavity is 0.1 cm thin"),
        ({"cavity_offset": (3.4, 0.0, 0.0)}, "the wall round the cavity is 0.1 cm thin"),
        ({"cavity_offset": (1.0, 0.0)}, "expected three lengths"),
        ({"cavity_radius": 0.5}, "ball edge: got 1.6 cm, expected at most 1 cm"),
        ({"edge": 0.05}, "makes too many cells"),
        ({"neck_height": 10.0}, "expected less than 10 cm"),
    ],
)
def test_ball_refuses(settings, message):
    with pytest.raises(MeshError, match=message):
        Ball(**settings)
