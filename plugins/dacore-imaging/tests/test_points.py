"""Point sensors: interpolation, derivatives, Gaussian kernels against closed forms."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import chi2

from dacore.errors import CapabilityError, SceneError, ShapeError
from dacore.plugins.settings import build
from dacore_imaging import kernel
from dacore_imaging.points import PointSensors

POSITIONS = {2: ((1.1, 1.7), (0.4, 2.2), (2.9, 0.1)), 3: ((1.1, 1.7, 0.8), (0.4, 2.2, 1.3), (2.9, 0.1, 2.95))}


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("order", [1, 2])
def test_values_and_derivatives_of_polynomials(make_space, dim, order):
    space = make_space(dim, order=order)
    x = np.array(POSITIONS[dim])
    slope = np.arange(1.0, dim + 1.0)

    def function(x):
        return np.stack([(k + 1.0) * (x @ slope) ** order for k in range(dim)], axis=1)

    state = space.state(u=function)
    found = PointSensors(positions=POSITIONS[dim]).functionals(space)
    np.testing.assert_allclose(found(state), function(x).T.ravel(), atol=1e-11)
    for axis in range(dim):
        derivative = PointSensors(positions=POSITIONS[dim], derivative=axis).functionals(space)
        expected = order * (x @ slope) ** (order - 1) * slope[axis]
        np.testing.assert_allclose(
            derivative(state), np.concatenate([(k + 1) * expected for k in range(dim)]), atol=1e-11
        )
        assert derivative.unit == "cm/cm"
        assert derivative.labels[0].startswith(f"d/d{'xyz'[axis]} u_x @ (1.1, ")


def test_order_labels_sites_and_directions(make_space):
    space = make_space(3)
    found = PointSensors(positions=POSITIONS[3], components=("z", 0)).functionals(space)
    assert found.labels[0] == "u_z @ (1.1, 1.7, 0.8)"
    assert found.labels[3] == "u_x @ (1.1, 1.7, 0.8)"
    np.testing.assert_array_equal(found.sites, [0, 1, 2, 0, 1, 2])
    np.testing.assert_array_equal(found.directions[2:4], [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    np.testing.assert_array_equal(found.centres, np.tile(np.array(POSITIONS[3]), (2, 1)))
    assert found.spacing == ()
    e = (0.0, 0.6, -0.8)
    along = PointSensors(positions=POSITIONS[3], directions=(e,)).functionals(space)
    state = space.state(u=lambda x: x**2)
    every = PointSensors(positions=POSITIONS[3]).functionals(space)(state).reshape(3, -1)
    np.testing.assert_allclose(along(state), np.array(e) @ every, atol=1e-14)


@pytest.mark.parametrize(("dim", "position"), [(2, (1.0, 1.0, 0.0)), (3, (1.0, 1.0))])
def test_points_of_another_dimension_are_not_called_outside(make_space, dim, position):
    with pytest.raises(ShapeError, match=f"sensor positions: got {len(position)} coordinates each, expected as many"):
        PointSensors(positions=(position,), field="p").functionals(make_space(dim))


def test_points_outside_are_named_or_counted(make_space):
    space = make_space(3)
    lost = ((9.0, 1.0, 1.0), (1.0, -0.5, 1.0))
    positions = (POSITIONS[3][0], lost[0], *POSITIONS[3][1:], lost[1])
    with pytest.raises(ShapeError, match=r"2 of 5 lie outside the domain: \(9, 1, 1\); \(1, -0.5, 1\) cm"):
        PointSensors(positions=positions).functionals(space)
    for width in (0.0, 0.3):
        found = PointSensors(positions=positions, width=width, components=(0,), outside="drop").functionals(space)
        assert found.dropped == 2
        np.testing.assert_array_equal(found.sites, [0, 2, 3])
        np.testing.assert_array_equal(found.centres, POSITIONS[3])
    with pytest.raises(ShapeError, match="2 of 2 lie outside"):
        PointSensors(positions=lost, outside="drop").functionals(space)
    with pytest.raises(ShapeError, match=r"7 of 7 .* and 2 more cm"):
        PointSensors(positions=[(9.0 + k, 1.0, 1.0) for k in range(7)]).functionals(space)


def test_a_space_without_cells_has_points_but_no_kernel(point_space):
    space = point_space()
    assert PointSensors(positions=POSITIONS[3], field="p").functionals(space).count == 3
    with pytest.raises(CapabilityError, match="no cells"):
        PointSensors(positions=POSITIONS[3], field="p", width=0.2).functionals(space)
    with pytest.raises(CapabilityError, match="'q'"):
        PointSensors(positions=POSITIONS[3], field="q").functionals(space)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("width", [0.02, 0.2, 3.0])
def test_a_kernel_reproduces_constants_exactly(make_space, dim, order, width):
    # Cells far larger and far smaller than the kernel, sensors at corners too.
    space = make_space(dim, order=order)
    positions = (*POSITIONS[dim], (0.0,) * dim)
    found = PointSensors(positions=positions, width=width, components=(0,)).functionals(space)
    np.testing.assert_allclose(found(space.state(u=lambda x: np.full((len(x), dim), 4.0))), 4.0, rtol=1e-13)
    slope = PointSensors(positions=positions, width=width, components=(0,), derivative="y").functionals(space)
    np.testing.assert_allclose(slope(space.state(u=lambda x: 7.0 * x[:, [1] * dim])), 7.0, rtol=1e-11)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("width", [0.05, 0.15, 0.28])
def test_moments_of_a_kernel_inside_the_domain(make_space, dim, width):
    # Well inside, the mean of a linear function is its value and that of x² adds the kernel's
    # variance, which the end at five deviations makes a little smaller.
    space = make_space(dim, n=4, order=2)
    centre = (1.45, 1.55, 1.5)[:dim]
    found = PointSensors(positions=(centre,), width=width, components=(0,)).functionals(space)
    linear = found(space.state(u=lambda x: np.stack([x.sum(axis=1)] * dim, axis=1)))
    assert linear[0] == pytest.approx(sum(centre), abs=1e-6 * width)
    end = kernel.TRUNCATION**2
    variance = width**2 * chi2(dim + 2).cdf(end) / chi2(dim).cdf(end)
    square = found(space.state(u=lambda x: x**2))
    assert square[0] - centre[0] ** 2 == pytest.approx(variance, rel=3e-5)


@pytest.mark.parametrize("width", [0.1, 0.4])
def test_a_kernel_at_a_face_is_normalised_over_the_domain(make_space, width):
    space = make_space(3, n=3, order=2)
    found = PointSensors(positions=((0.3, 1.5, 1.5),), width=width, components=(0,)).functionals(space)

    def gauss(x):
        return np.exp(-0.5 * ((x - 0.3) / width) ** 2)

    # Along x; across, the domain hardly cuts the kernel (its end at five deviations, 1e-4 of width 0.4).
    mass = quad(gauss, 0, 3, points=[0.3], epsabs=1e-13)[0]
    for power in (1, 2):
        expected = quad(lambda x, n=power: x**n * gauss(x), 0, 3, points=[0.3], epsabs=1e-13)[0] / mass
        value = found(space.state(u=lambda x, n=power: x**n))[0]
        assert value == pytest.approx(expected, rel=3e-4 if width > 0.3 else 3e-5)


@pytest.mark.parametrize("dim", [2, 3])
def test_quadrature_of_a_kernel_has_converged(make_space, dim, monkeypatch):
    # A function with kinks at cell facets: halving the pieces must not change its mean.
    space = make_space(dim, n=3, order=2, seed=3)
    state = space.state(u=lambda x: np.sin(4 * x))
    sensors = [PointSensors(positions=POSITIONS[dim][::2], width=width, components=(0,)) for width in (0.08, 0.3, 1.0)]
    values = [sensor.functionals(space)(state) for sensor in sensors]
    monkeypatch.setattr(kernel, "_RULES", tuple((limit / 2, points) for limit, points in kernel._RULES))
    finer = [sensor.functionals(space)(state) for sensor in sensors]
    np.testing.assert_allclose(values, finer, atol=2e-6)
    monkeypatch.setattr(kernel, "_RULES", ((8.0, 1),))
    coarse = [sensor.functionals(space)(state) for sensor in sensors]
    assert np.abs(np.array(coarse) - finer).max() > 1e-3


def test_a_narrow_kernel_tends_to_the_point_at_second_order(make_space):
    space = make_space(3, n=3, order=2)
    position = ((1.21, 1.33, 1.47),)
    state = space.state(u=lambda x: np.sin(2 * x))
    point = PointSensors(positions=position, components=(0,)).functionals(space)(state)
    widths = np.array([0.01, 0.02])
    errors = [
        abs(PointSensors(positions=position, width=w, components=(0,)).functionals(space)(state) - point)[0]
        for w in widths
    ]
    assert np.log2(errors[1] / errors[0]) == pytest.approx(2.0, abs=0.1)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("per_axis", [2, 3, 4])
def test_the_conical_rule_is_exact_to_its_degree(dim, per_axis):
    # ∫ λ^a over a simplex / volume = d! Π aᵢ! / (d + |a|)!
    from math import factorial, prod

    places, weights = kernel._rule(dim, per_axis)
    assert (weights > 0).all()
    assert (places > 0).all()
    for powers in np.ndindex(*[2 * per_axis] * (dim + 1)):
        degree = sum(powers)
        exact = factorial(dim) * prod(map(factorial, powers)) / factorial(dim + degree)
        value = weights @ np.prod(places ** np.array(powers), axis=1)
        if degree <= 2 * per_axis - 1:
            assert value == pytest.approx(exact, rel=1e-12)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"positions": ()}, "sensor positions"),
        ({"positions": ((1.0,),)}, "1 coordinates"),
        ({"positions": ((1.0, np.nan),)}, "NaN"),
        ({"positions": ((1.0, 2.0), (1.0, 2.0))}, r"\(1.0, 2.0\) twice"),
        ({"positions": ((1.0, 2.0),), "derivative": "z"}, "derivative: got 'z'"),
        ({"positions": ((1.0, 2.0),), "width": -1.0}, "width: got -1.0"),
        ({"positions": ((1.0, 2.0),), "outside": "keep"}, "outside: got 'keep'"),
        ({"positions": ((1.0, 2.0),), "components": (0,), "directions": ((1.0, 0.0),)}, "both components"),
    ],
)
def test_wrong_settings_are_refused_when_made(settings, message):
    with pytest.raises(ShapeError, match=message):
        PointSensors(**settings)


def test_settings_come_from_a_scene():
    table = {"positions": [[1, 2, 3]], "derivative": "x", "width": 0.5}
    assert build(PointSensors, table, "s") == PointSensors(positions=((1.0, 2.0, 3.0),), derivative="x", width=0.5)
    with pytest.raises(SceneError, match="positions: missing"):
        build(PointSensors, {}, "s")
