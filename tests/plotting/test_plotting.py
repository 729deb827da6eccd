"""Pictures for a notebook: axes come out, units are on them, what is given is used, and no setting is changed."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("matplotlib")
pytest.importorskip("skfem")

import matplotlib as mpl
from matplotlib import pyplot
from matplotlib.axes import Axes

import dacore
from dacore.core.quantity import QuantityOfInterest
from dacore.domains.box import Box
from dacore.errors import CapabilityError, ShapeError
from dacore.plotting import (
    plot_errors,
    plot_estimate,
    plot_inf_sup,
    plot_mesh,
    plot_parameters,
    plot_quantity,
    plot_sensors,
    plot_slice,
    plot_spectrum,
)
from dacore.plotting.places import _boundary, _cell_edges
from dacore.plotting.subject import view_of
from dacore.testing.spaces import Chain

GALLERY = Path(__file__).parents[2] / "examples" / "gallery"
REDUCED = ["training.method='reduced'", "training.samples=16", "training.reduction=1e-2"]


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    changes = [*REDUCED, "estimator.posterior.kind='posterior'", "validation.cases=2"]
    return dacore.open_scene(GALLERY / "ball.toml", changes, cache=tmp_path_factory.mktemp("plotting"))


@pytest.fixture(scope="module")
def truth(scene):
    return scene.truth[0]


@pytest.fixture(scope="module")
def estimate(scene, truth):
    return scene.estimate("minimum_variance", *scene.observe(truth, 0.1, np.random.default_rng(0)))


@pytest.fixture(autouse=True)
def untouched():
    """Every call leaves matplotlib's settings, and no figure open."""
    pyplot.switch_backend("Agg")
    before = dict(mpl.rcParams)
    yield
    assert dict(mpl.rcParams) == before
    for number in pyplot.get_fignums():
        pyplot.figure(number).canvas.draw()
    pyplot.close("all")


def bars(ax):
    return [each.get_ylabel() for each in ax.figure.axes if each.get_label() == "<colorbar>"]


def test_a_slice_shows_a_field_with_units(scene, truth):
    ax = plot_slice(scene, truth.states[:, 3], "u", axis="z", position=6.5)
    assert ax.get_xlabel() == "x [cm]"
    assert ax.get_ylabel() == "y [cm]"
    assert "6.5 cm" in ax.get_title()
    assert bars(ax)[0].startswith("|u|")
    assert "cm]" in bars(ax)[0]
    other = plot_slice(scene.model.space, truth.states[:, 3], "u", "y", limits=(-1.0, 2.0))
    assert bars(other)[0].startswith("u$_{")
    assert other.figure is not ax.figure


@pytest.mark.parametrize("which", ["session", "model", "space", "background", "estimate"])
def test_a_slice_takes_whatever_has_a_space(scene, truth, estimate, which):
    subject = {
        "session": scene, "model": scene.model, "space": scene.model.space, "background": scene.background,
        "estimate": estimate,
    }[which]  # fmt: skip
    assert bars(plot_slice(subject, truth.states[:, 3], "p"))[0].startswith("p ")


def test_axes_that_are_given_are_used(scene, truth, estimate):
    figure, panels = pyplot.subplots(2, 2)
    assert plot_slice(scene, truth.states[:, 3], "p", ax=panels[0, 0], colorbar=False) is panels[0, 0]
    assert plot_mesh(scene, ax=panels[0, 1]) is panels[0, 1]
    assert plot_sensors(scene, ax=panels[1, 0]) is panels[1, 0]
    assert plot_quantity(estimate, scene.quantities["cavity_pressure"], ax=panels[1, 1]) is panels[1, 1]
    assert pyplot.get_fignums() == [figure.number]
    assert len(figure.axes) == 4
    with pytest.raises(ShapeError, match="ax: got ndarray"):
        plot_mesh(scene, ax=panels)


def test_states_and_planes_that_do_not_fit_are_refused(scene, truth):
    with pytest.raises(ShapeError, match=r"state: got shape .*take one step"):
        plot_slice(scene, truth.states, "p")
    with pytest.raises(ShapeError, match="misses the domain"):
        plot_slice(scene, truth.states[:, 0], "p", position=99.0)
    with pytest.raises(ShapeError, match="axis: got 'q'"):
        plot_slice(scene, truth.states[:, 0], "p", axis="q")
    with pytest.raises(ShapeError, match="component of u: got 'w'"):
        plot_slice(scene, truth.states[:, 0], "u", "w")
    with pytest.raises(CapabilityError, match="fields u, p"):
        plot_slice(scene, truth.states[:, 0], "T")
    with pytest.raises(CapabilityError, match="no cells"):
        plot_slice(Chain(5), np.zeros(15), "p")


def test_an_estimate_stands_beside_the_truth_on_its_scale(estimate, truth):
    row = plot_estimate(estimate, "p", truth, time=3e-3)
    assert [ax.get_title() for ax in row] == ["truth", "estimate", "standard deviation"]
    assert "3 ms" in row[0].get_title(loc="left")
    labels = bars(row[0])
    assert labels[0] == labels[1]
    assert all("[dyn/cm²]" in label for label in labels)
    alone = plot_estimate(estimate, "u", component="x")
    assert [ax.get_title() for ax in alone] == ["estimate", "standard deviation"]
    state = truth.states[:, estimate.nearest(3e-3)]
    same = plot_estimate(estimate, "p", state, time=3e-3)
    assert bars(same[0]) == labels
    _, given = pyplot.subplots(1, 3)
    assert list(plot_estimate(estimate, "p", truth, axes=given)) == list(given)
    with pytest.raises(ShapeError, match="axes: got 2, expected 3"):
        plot_estimate(estimate, "p", truth, axes=given[:2])
    with pytest.raises(ShapeError, match="series: got 1"):
        plot_estimate(estimate, "p", series=1)
    for wrong in (3.0, -1.0, np.nan):
        with pytest.raises(ShapeError, match=r"time: got .* s, expected 0\.0005 to 0\.005 s as the estimate has"):
            plot_estimate(estimate, "p", time=wrong)


def test_a_mesh_shows_every_role_and_its_cells(scene):
    ax = plot_mesh(scene)
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["neck", "ventricles", "mre"]
    assert "608 nodes" in ax.get_title()
    flat = plot_mesh(Box((0.0, 0.0), (2.0, 1.0), (4, 2)).mesh())
    assert "planar mesh: 15 nodes" in flat.get_title()
    with pytest.raises(CapabilityError, match="Chain has no mesh"):
        plot_mesh(Chain(5))


def test_the_lines_of_a_cut_are_those_of_the_cells_and_of_the_boundary():
    mesh = Box((0.0, 0.0, 0.0), (1.0, 2.0, 3.0), (2, 2, 3)).mesh()
    view = view_of(mesh.points, mesh.cells, "z", 1.3)
    lines = np.concatenate([_boundary(mesh, role, view) for role in mesh.roles])
    assert np.isclose(np.linalg.norm(lines[:, 1] - lines[:, 0], axis=1).sum(), 6.0)
    edges = _cell_edges(view)
    assert len(np.unique(edges.reshape(-1, 4), axis=0)) == len(edges)
    assert edges.min() >= 0.0
    assert np.allclose(edges.reshape(-1, 2).max(axis=0), [1.0, 2.0])
    # What is inside one cell is no line: no more than the sides of triangles, and fewer where cells are cut in four.
    assert len(edges) < len(
        np.unique(np.sort(view.cut.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0)
    )


def test_sensors_show_places_directions_and_values(scene, truth):
    f = scene.functionals
    ax = plot_sensors(scene)
    assert ax.get_title() == f"{f.count} values at {f.n_sites} voxels"
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("x [cm]", "y [cm]")  # the slice is seen along its normal
    data = f(truth.states)[:, 3]
    coloured = plot_sensors(scene, axis="x", values=np.where(f.centres[:, 0] < 0, data, np.nan))
    assert coloured.get_xlabel() == "y [cm]"
    assert "cm]" in bars(coloured)[0]
    bare = plot_sensors(f)
    assert bare.collections
    with pytest.raises(ShapeError, match="values: got shape"):
        plot_sensors(f, values=data[:-1])


def test_a_quantity_over_time_has_its_interval_and_the_truth(scene, truth, estimate):
    quantity = scene.quantities["cavity_pressure"]
    ax = plot_quantity(estimate, quantity, truth, name="cavity pressure", level=0.8)
    assert ax.get_xlabel() == "time [ms]"
    assert ax.get_ylabel() == "cavity pressure  [dyn/cm²]"
    assert {text.get_text() for text in ax.get_legend().get_texts()} == {"80% interval", "estimate", "truth"}
    drawn = {line.get_label(): line for line in ax.lines}
    assert np.allclose(drawn["truth"].get_ydata(), quantity.of(truth.states, scene.model.space))
    assert np.allclose(drawn["estimate"].get_ydata(), estimate.quantity(quantity)[:, 0])
    assert np.allclose(drawn["estimate"].get_xdata(), 1e3 * estimate.times)
    both = plot_quantity({"a": estimate, "b": estimate}, quantity)
    assert {text.get_text() for text in both.get_legend().get_texts()} == {"a", "b"}

    class Two(QuantityOfInterest):
        over_time = "each"

        def functionals(self, space):
            return scene.functionals

    with pytest.raises(ShapeError, match="numbers a step"):
        plot_quantity(estimate, Two())


def test_errors_of_every_estimator_are_drawn(scene):
    ax = plot_errors(scene)
    assert ax.get_xlabel() == "error  [%]"
    assert [label.get_text() for label in ax.get_yticklabels()][1] == "minimum variance"
    value = 100 * scene.validation.outcome("minimum_variance", 0.1).space_time[scene.validation.headline].mean()
    assert any(np.isclose(line.get_xdata()[1], value) for line in ax.lines if len(line.get_xdata()) == 3)
    pressure = plot_errors(scene, "cavity_pressure")
    assert pressure.get_xlabel() == "error  [dyn/cm²]"
    named = plot_errors(scene.validation, "p", names={"pbdw": "mine"})
    assert "mine" in [label.get_text() for label in named.get_yticklabels()]
    with pytest.raises(ShapeError, match=r"error: got 'T', expected one of u, p"):
        plot_errors(scene, "T")


def test_spaces_are_drawn_of_backgrounds_and_estimators(scene):
    ax = plot_spectrum(scene)
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["u", "p"]
    tails = plot_spectrum({"a space a phase": scene.prepared("pbdw")}, tails=True, largest=5)
    assert "varepsilon" in tails.get_ylabel()
    beta = plot_inf_sup({"a": scene.prepared("pbdw"), "b": scene.judged("pbdw")})
    assert len(beta.get_legend().get_texts()) == 2
    one = plot_inf_sup(scene.prepared("pbdw").spaces()[0])
    assert one.get_legend() is None
    with pytest.raises(ShapeError, match="no background spaces"):
        plot_inf_sup(scene.prepared("minimum_variance"))


def test_parameters_before_and_after_the_data(scene, truth, estimate):
    found = scene.estimate("posterior", *scene.observe(truth, 0.1, np.random.default_rng(0)))
    values = dict(zip(scene.parameters.names, scene.truth.samples[0], strict=True))
    ax = plot_parameters(found, values)
    assert len(ax.get_yticks()) == 4
    assert {text.get_text() for text in ax.get_legend().get_texts()} == {
        "before the data", "after, 90% interval", "truth",
    }  # fmt: skip
    stiffness = scene.parameters["E"]
    there = (values["E"] - stiffness.low) / (stiffness.high - stiffness.low)
    assert any(np.isclose(line.get_xdata()[0], there) for line in ax.lines if line.get_marker() == "D")
    with pytest.raises(ShapeError, match="no parameters"):
        plot_parameters(estimate)


def test_matplotlib_is_asked_for_in_one_line_where_it_is_missing(tmp_path):
    code = (
        "import importlib.util as u, sys; find = u.find_spec\n"
        "u.find_spec = lambda name, *a: None if name == 'matplotlib' else find(name, *a)\n"
        "from dacore.errors import MissingDependencyError\n"
        "try:\n    import dacore.plotting\n"
        "except MissingDependencyError as error:\n    print(error)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=tmp_path)
    assert done.stdout == "plotting needs matplotlib, which is not installed; pip install 'dacore[figures]'\n"


def test_every_function_returns_axes():
    import dacore.plotting as module

    assert sorted(module.__all__) == module.__all__
    for name in module.__all__:
        assert "Axes" in str(getattr(module, name).__annotations__["return"]) or name == "plot_estimate"
    assert Axes is not None
