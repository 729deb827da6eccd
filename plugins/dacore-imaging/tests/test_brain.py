"""The MNI152 brain: figures of the mesh, roles, settings, and what is said when the template is not there."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.linalg import spsolve

from dacore.core.simplex import barycentric_gradients
from dacore.errors import DacoreError, MeshError, MissingDependencyError
from dacore.geometry.quality import enclosed_volume, facet_measures, measure
from dacore.plugins.settings import build
from dacore_imaging import template
from dacore_imaging.brain import LENGTH, Brain


@pytest.fixture(scope="module")
def brain():
    return Brain().mesh()


def areas(mesh):
    return {role: facet_measures(mesh.points, mesh.boundary_facets(role)).sum() for role in mesh.roles}


def test_size_volumes_and_areas(brain):
    assert 4800 < len(brain.points) < 5400
    found = measure(brain.points, brain.cells)
    assert found.euler == (2, 2)
    assert found.smallest_angle > 15.0
    assert found.largest_angle < 150.0
    assert 1466 < found.volume < 1482
    assert 14.0 < -enclosed_volume(brain.points, brain.boundary_facets("ventricles")) < 17.6
    held = areas(brain)
    assert set(held) == {"neck", "ventricles", "mre"}
    assert 20.0 < held["neck"] < 23.0
    assert 64.0 < held["ventricles"] < 78.0
    assert 705.0 < held["neck"] + held["mre"] < 735.0


def test_coordinates(brain):
    low, high = brain.points.min(axis=0), brain.points.max(axis=0)
    assert low[1] == pytest.approx(0.0, abs=0.1)
    assert high[1] == pytest.approx(LENGTH, abs=0.15)
    assert low[2] == 0.0
    assert high[2] == pytest.approx(14.18, abs=0.1)
    assert abs(low[0] + high[0]) < 0.15
    assert high[0] - low[0] == pytest.approx(13.4, abs=0.15)


def test_the_cut_is_planar_and_the_brainstem_whole(brain):
    cut = (brain.points[brain.facets][:, :, 2] == 0.0).all(axis=1)
    assert facet_measures(brain.points, brain.facets[cut]).sum() == pytest.approx(1.19, rel=0.15)
    assert (brain.facet_tags[cut] == brain.roles["neck"]).all()


def test_the_ventricles_lie_deep_inside_and_on_both_sides(brain):
    nodes = brain.points[brain.boundary_nodes("ventricles")]
    np.testing.assert_allclose(nodes.min(axis=0), [-3.19, 4.71, 5.55], atol=0.3)
    np.testing.assert_allclose(nodes.max(axis=0), [3.19, 12.76, 9.24], atol=0.6)
    outside = brain.points[np.concatenate([brain.boundary_nodes("mre"), brain.boundary_nodes("neck")])]
    gap = np.linalg.norm(nodes[:, None] - outside[None], axis=2).min()
    assert gap > 0.45


def test_neck_height_sorts_the_outer_facets_only(brain):
    heights = {role: brain.points[brain.boundary_facets(role)][:, :, 2].mean(axis=1) for role in ("neck", "mre")}
    assert heights["neck"].max() < 1.0 <= heights["mre"].min()
    higher = Brain(neck_height=2.0).mesh()
    assert higher.points.tobytes() == brain.points.tobytes()
    assert higher.cells.tobytes() == brain.cells.tobytes()
    assert areas(higher)["neck"] == pytest.approx(56.0, rel=0.1)
    assert areas(higher)["ventricles"] == areas(brain)["ventricles"]


def test_laplace_equation_keeps_its_maximum_principle_and_balance(brain):
    gradients, volumes = barycentric_gradients(brain.points, brain.cells)
    local = np.einsum("cia,cja,c->cij", gradients, gradients, volumes)
    rows, columns = np.repeat(brain.cells, 4, axis=1).ravel(), np.tile(brain.cells, (1, 4)).ravel()
    stiffness = coo_array((local.ravel(), (rows, columns)), shape=(len(brain.points),) * 2).tocsr()
    inner, outer = brain.boundary_nodes("ventricles"), brain.boundary_nodes("mre")
    value = np.zeros(len(brain.points))
    value[inner] = 1.0
    free = np.setdiff1d(np.arange(len(value)), np.concatenate([inner, outer]))
    value[free] = spsolve(stiffness[free][:, free].tocsc(), -(stiffness @ value)[free])
    assert value.min() > -1e-3
    assert value.max() < 1.0 + 1e-3
    flux = stiffness @ value
    assert flux[inner].sum() > 1.0
    assert flux[inner].sum() == pytest.approx(-flux[outer].sum(), rel=1e-9)


def test_an_edge_may_be_asked_for_instead(brain):
    finer = Brain(edge=0.9).mesh()
    assert len(finer.points) > 1.3 * len(brain.points)
    assert measure(finer.points, finer.cells).smallest_angle >= 10.0


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"nodes": "10k"}, "brain nodes: got '10k', expected one of 5k, 33k, 100k"),
        ({"edge": 2.0}, "brain edge: got 2.0 cm, expected 0.15 to 1.15"),
        ({"edge": float("nan")}, "brain edge: got nan cm"),
        ({"neck_height": 0.0}, "brain neck_height: got 0.0 cm"),
        ({"neck_height": 12.0}, "brain neck_height: got 12.0 cm"),
    ],
)
def test_settings_out_of_range(settings, message):
    with pytest.raises(MeshError, match=message):
        Brain(**settings)


def test_from_a_scene():
    assert build(Brain, {"nodes": "33k", "neck_height": 2}, "a.toml: domain") == Brain("33k", None, 2.0)
    with pytest.raises(DacoreError, match="nodes"):
        build(Brain, {"nodes": "50k"}, "a.toml: domain")


def test_the_template_is_found_without_importing_nilearn():
    before = "nilearn" in sys.modules
    files = template.template_files()
    assert all(path.is_file() for path in files.values())
    assert ("nilearn" in sys.modules) == before
    assert Brain().fingerprint() == Brain("33k").fingerprint()
    assert len(Brain().fingerprint()) == 64


def test_what_is_said_without_nilearn_or_its_files(monkeypatch, tmp_path):
    found = importlib.util.find_spec("nilearn")
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(MissingDependencyError, match="pip install nilearn"):
        Brain().mesh()
    found.submodule_search_locations = [str(tmp_path)]
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: found)
    with pytest.raises(MissingDependencyError, match="mni_icbm152_t1_tal_nlin_sym_09a_converted"):
        Brain().mesh()


def test_another_template_is_refused(monkeypatch, tmp_path):
    import nibabel

    path = tmp_path / "t1.nii.gz"
    nibabel.save(nibabel.Nifti1Image(np.zeros((5, 5, 5), np.uint8), np.diag([2.0, 2, 2, 1])), path)
    monkeypatch.setattr(template, "template_files", lambda: dict.fromkeys(("t1", "gm", "wm"), Path(path)))
    with pytest.raises(MeshError, match=r"got shape \(5, 5, 5\)"):
        Brain().mesh()


@pytest.mark.slow
@pytest.mark.parametrize(("nodes", "count", "cavity"), [("33k", 33_000, 16.85), ("100k", 100_000, 17.17)])
def test_finer_meshes(nodes, count, cavity):
    mesh = Brain(nodes).mesh()
    assert len(mesh.points) == pytest.approx(count, rel=0.05)
    found = measure(mesh.points, mesh.cells)
    assert found.smallest_angle > 15.0
    assert found.largest_angle < 150.0
    assert 1473.0 < found.volume < 1479.0
    assert -enclosed_volume(mesh.points, mesh.boundary_facets("ventricles")) == pytest.approx(cavity, abs=0.15)
