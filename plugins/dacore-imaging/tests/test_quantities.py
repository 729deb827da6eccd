"""Means over a boundary and over the domain."""

import numpy as np
import pytest

from dacore.errors import CapabilityError, SceneError, ShapeError
from dacore.plugins.settings import build
from dacore.testing.spaces import without
from dacore_imaging.quantities import BoundaryMean, VolumeMean


def test_mean_over_a_boundary(make_space):
    # A face of the cube: the mean of a linear function is its value at the face's middle.
    space = make_space(n=3, lengths=3.0)
    found = BoundaryMean(role="left").functionals(space)
    assert found.count == 1
    assert found.labels == ("mean of p over left",)
    assert found.unit == "dyn/cm^2"
    assert found(space.state(p=lambda x: 5.0 + x @ [1.0, 2.0, 3.0]))[0] == pytest.approx(5.0 + 3.0 + 4.5, rel=1e-13)
    np.testing.assert_allclose(found.centres, [[0.0, 1.5, 1.5]], atol=1e-13)
    assert not found.directions.any()


def test_one_component_of_a_vector(make_space):
    space = make_space(dim=2, n=3, lengths=3.0)
    found = BoundaryMean(role="left", field="u", component=1).functionals(space)
    assert found.labels == ("mean of u_y over left",)
    np.testing.assert_array_equal(found.directions, [[0.0, 1.0]])
    assert found(space.state(u=lambda x: x + np.array([3.0, 7.0])))[0] == pytest.approx(8.5, rel=1e-13)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("order", [1, 2])
def test_mean_over_the_domain(make_space, dim, order):
    space = make_space(dim, n=3, lengths=3.0, order=order)
    found = VolumeMean(field="u", component=dim - 1).functionals(space)
    state = space.state(u=lambda x: 1.0 + x**order)
    assert found(state)[0] == pytest.approx(1.0 + {1: 1.5, 2: 3.0}[order], rel=1e-13)
    np.testing.assert_allclose(found.centres, 1.5, atol=1e-13)
    assert found.labels == (f"mean of u_{'xyz'[dim - 1]} over the domain",)
    other = VolumeMean(field="c", component=1).functionals(make_space(3))
    assert other.labels == ("mean of c_1 over the domain",)


@pytest.mark.parametrize("quantity", [BoundaryMean(role="left"), VolumeMean()])
def test_over_time(quantity):
    # Errata of Galarce et al. 2023: the biomarker's time integral carries 1/T.
    np.testing.assert_allclose(quantity.time_weights(4), [[0.25] * 4])
    each = type(quantity)(over_time="each")
    np.testing.assert_array_equal(each.time_weights(3), np.eye(3))


def test_what_a_space_lacks_is_refused(make_space, point_space):
    with pytest.raises(CapabilityError, match="no boundary"):
        BoundaryMean(role="left").functionals(without(make_space(), "boundary"))
    with pytest.raises(CapabilityError, match="no cells"):
        VolumeMean().functionals(point_space())
    with pytest.raises(CapabilityError, match="'q'"):
        BoundaryMean(role="left", field="q").functionals(make_space())
    for quantity in (BoundaryMean(role="left", component=1), VolumeMean(component=1)):
        with pytest.raises(ShapeError, match="component of p: got 1"):
            quantity.functionals(make_space())


@pytest.mark.parametrize("kind", [BoundaryMean, VolumeMean])
def test_wrong_settings_are_refused_when_made(kind):
    with pytest.raises(ShapeError, match="component: got -1"):
        kind(component=-1)
    with pytest.raises(ShapeError, match="over_time: got 'sum'"):
        kind(over_time="sum")
    assert build(kind, {"over_time": "each"}, "s") == kind(over_time="each")
    with pytest.raises(SceneError):
        build(kind, {"over_time": "sum"}, "s")
