"""The formulas themselves: they satisfy the equations, their conditions, their limits and other people's numbers."""

import numpy as np
import pytest

from dacore.errors import ShapeError
from dacore_biot import material
from dacore_biot.analytic import Column, Cryer, Mandel, Medium, Pulse, SunkColumn, Terzaghi, Wave, drained, undrained
from dacore_biot.analytic.roots import roots

MEDIUM = Medium()
MEDIA = [MEDIUM, Medium(nu=0.45, alpha=1.0, skempton=0.99), Medium(nu=0.0, alpha=1.0, skempton=1.0)]


def derivative(function, at, step, order=1):
    """Central difference of fourth order."""
    if order == 1:
        return (8 * (function(at + step) - function(at - step)) - function(at + 2 * step) + function(at - 2 * step)) / (
            12 * step
        )
    return (
        16 * (function(at + step) + function(at - step))
        - function(at + 2 * step)
        - function(at - 2 * step)
        - 30 * function(at)
    ) / (12 * step**2)


def storage(medium):
    return material.storage(medium.parameters)


def lame(medium):
    return material.lame(medium.parameters)


@pytest.mark.parametrize("medium", MEDIA)
def test_coefficients_agree_with_the_model(medium):
    """Medium goes by way of ν_u, `material` by way of S: c = k/(S + α²/(λ + 2μ)), K_u = K + α²/S."""
    values = medium.parameters
    stiff = lame(medium) + material.twice_shear(values)
    assert medium.shear == pytest.approx(material.shear(values), rel=1e-14)
    assert medium.uniaxial == pytest.approx(stiff, rel=1e-13)
    capacity = storage(medium) + medium.alpha**2 / stiff
    assert medium.diffusivity == pytest.approx(material.mobility(values) / capacity, rel=1e-12)
    assert medium.loading_efficiency == pytest.approx(medium.alpha / stiff / capacity, rel=1e-12)
    if np.isfinite(medium.undrained_bulk):
        assert medium.undrained_bulk == pytest.approx(medium.bulk + medium.alpha**2 / storage(medium), rel=1e-12)


@pytest.mark.parametrize("medium", MEDIA)
@pytest.mark.parametrize("part", [0.003, 0.05, 0.4])
def test_terzaghi_satisfies_the_equations(medium, part):
    column = Terzaghi(medium, 2.0, 3e3)
    t, z, stiff = part * column.time_scale, np.linspace(0.1, 1.9, 19), medium.uniaxial
    p, u = (lambda s: column.pressure(z, s)), (lambda s: column.displacement(z, s))
    dz, dt = 1e-2 * np.sqrt(part), 0.01 * t
    strain_rate = derivative(lambda s: derivative(lambda x: column.displacement(x, s), z, dz), t, dt)
    seepage = medium.mobility * derivative(lambda x: column.pressure(x, t), z, dz, 2)
    balance = storage(medium) * derivative(p, t, dt) + medium.alpha * strain_rate - seepage
    assert np.abs(balance).max() < 2e-5 * np.abs(seepage).max()
    force = stiff * derivative(lambda x: column.displacement(x, t), z, dz) - medium.alpha * p(t) + column.load
    assert np.abs(force).max() < 1e-6 * column.load
    np.testing.assert_allclose(column.pressure(np.zeros(1), t), 0.0, atol=1e-9)
    np.testing.assert_allclose(column.displacement(np.array([2.0]), t), 0.0, atol=1e-12)
    assert u(t).max() < column.load * 2 / stiff


def test_terzaghi_from_its_images():
    """The same pressure by reflections of the error function, which converge where the series does not."""
    from scipy.special import erfc

    column = Terzaghi(MEDIUM, 2.0)
    z = np.linspace(0.01, 2, 40)
    for part in (1e-6, 1e-3, 0.1):
        reach = 2 * np.sqrt(part) * 2.0
        images = sum((-1) ** m * (erfc((4 * m + z) / reach) + erfc((4 * (m + 1) - z) / reach)) for m in range(20))
        p = column.pressure(z, part * column.time_scale) / column.initial_pressure
        np.testing.assert_allclose(p, 1 - images, atol=1e-12)


@pytest.mark.parametrize("medium", MEDIA)
def test_terzaghi_begins_undrained_and_ends_drained(medium):
    column = Terzaghi(medium)
    assert column.settlement(1e-8 * column.time_scale) == pytest.approx(
        column.load / medium.undrained_uniaxial, rel=1e-2, abs=3e-4 * column.load / medium.uniaxial
    )
    assert column.settlement(20 * column.time_scale) == pytest.approx(column.load / medium.uniaxial, rel=1e-12)
    # Consolidation of 50 and 90%: the time factors of every textbook (Terzaghi & Peck), 0.197 and 0.848.
    first = column.settlement(1e-10 * column.time_scale)
    for degree, factor in ((0.5, 0.197), (0.9, 0.848)):
        seen = column.settlement(factor * column.time_scale) - first
        assert seen / (column.load / medium.uniaxial - first) == pytest.approx(degree, abs=1e-3)


@pytest.mark.parametrize("medium", MEDIA)
@pytest.mark.parametrize("part", [0.003, 0.05, 0.4])
def test_mandel_satisfies_the_equations(medium, part):
    block = Mandel(medium, 2.0, 1.5, 3e3)
    t, x, a = part * block.time_scale, np.linspace(0.05, 1.95, 20), 2.0
    y = np.full_like(x, 0.7)
    dx, dt = 2e-2 * np.sqrt(part), 0.01 * t
    p = block.pressure(x, t)

    def strains(s):
        along = derivative(lambda z: block.displacement(z, y, s)[:, 0], x, dx)
        across = derivative(lambda z: block.displacement(x, z, s)[:, 1], y, 0.1)
        return along, across

    e_x, e_y = strains(t)
    seepage = medium.mobility * derivative(lambda z: block.pressure(z, t), x, dx, 2)
    rate = storage(medium) * derivative(lambda s: block.pressure(x, s), t, dt)
    rate += medium.alpha * derivative(lambda s: sum(strains(s)), t, dt)
    assert np.abs(rate - seepage).max() < 2e-4 * np.abs(seepage).max()
    two, lam = 2 * medium.shear, lame(medium)
    sigma_x = two * e_x + lam * (e_x + e_y) - medium.alpha * p
    sigma_y = two * e_y + lam * (e_x + e_y) - medium.alpha * p
    scale = block.force / a
    # σ_xx = 0 at the free side, so everywhere; σ_yy is what `stress` says and carries the whole force.
    assert np.abs(sigma_x).max() < 1e-5 * scale
    np.testing.assert_allclose(sigma_y, block.stress(x, t), atol=1e-5 * scale)
    nodes, weights = np.polynomial.legendre.leggauss(60)
    assert weights @ block.stress(1 + nodes, t) == pytest.approx(-block.force, rel=1e-9)
    np.testing.assert_allclose(block.pressure(np.array([a]), t), 0.0, atol=1e-9)


@pytest.mark.parametrize("medium", MEDIA)
def test_mandel_begins_undrained_and_ends_drained(medium):
    block = Mandel(medium, 2.0, 1.5, 3e3)
    stress = np.diag([0.0, -block.force / 2.0])
    x = np.array([0.0, 0.5, 1.0])
    for time, state, close in ((1e-7, undrained(medium, stress), 2e-3), (30.0, drained(medium, stress), 1e-10)):
        t = time * block.time_scale
        np.testing.assert_allclose(block.pressure(x, t), state.pressure, atol=close * block.initial_pressure)
        expected = state.displacement(np.stack([x, x], axis=1))
        seen = block.displacement(x, x, t)
        np.testing.assert_allclose(seen, expected, atol=close * np.abs(expected).max())
    history = np.array([block.pressure(np.zeros(1), s * block.time_scale)[0] for s in np.geomspace(1e-4, 1, 200)])
    assert history.max() > 1.02 * block.initial_pressure


def talbot(transform, time, count=24):
    """Inverse Laplace transform by Talbot's contour (Abate & Valkó 2004)."""
    k = np.arange(1, count)
    angle = k * np.pi / count
    r = 2 * count / (5 * time)
    s = r * angle * (1 / np.tan(angle) + 1j)
    sigma = angle + (angle / np.tan(angle) - 1) / np.tan(angle)
    total = 0.5 * np.exp(r * time) * transform(np.array([r + 0j]))[0].real
    return r / count * (total + np.sum((np.exp(s * time) * transform(s) * (1 + 1j * sigma)).real))


@pytest.mark.parametrize("medium", MEDIA)
@pytest.mark.parametrize("part", [0.002, 0.03, 0.3])
def test_cryer_satisfies_the_equations(medium, part):
    ball = Cryer(medium, 2.0, 3e3)
    t, r, a = part * ball.time_scale, np.linspace(0.1, 1.9, 19), 2.0
    dr, dt = 2e-2 * np.sqrt(part), 0.01 * t

    def swelling(at, s):
        return derivative(lambda x: x**2 * ball.displacement(x, s), at, dr) / at**2

    p = ball.pressure(r, t)
    seepage = medium.mobility * derivative(lambda x: x * ball.pressure(x, t), r, dr, 2) / r
    rate = storage(medium) * derivative(lambda s: ball.pressure(r, s), t, dt)
    rate += medium.alpha * derivative(lambda s: swelling(r, s), t, dt)
    assert np.abs(rate - seepage).max() < 2e-4 * np.abs(seepage).max()
    # Balance: (λ + 2μ) ∇·u − α p is the same everywhere; on the surface p = 0 and the radial stress is the load.
    level = medium.uniaxial * swelling(r, t) - medium.alpha * p
    assert np.ptp(level) < 1e-5 * ball.load
    surface = level[0] - 4 * medium.shear * ball.settlement(t) / a
    assert surface == pytest.approx(-ball.load, rel=1e-5)
    np.testing.assert_allclose(ball.pressure(np.array([a]), t), 0.0, atol=1e-9)


@pytest.mark.parametrize("medium", MEDIA)
def test_cryer_from_its_laplace_transform(medium):
    """The boundary value problem in the transform, inverted numerically: no residues and no roots."""
    ball, k, stiff, shear = Cryer(medium, 2.0, 3e3), medium.mobility, medium.uniaxial, medium.shear
    capacity = storage(medium) + medium.alpha**2 / stiff
    g, alpha, a = medium.alpha / stiff / capacity, medium.alpha, 2.0

    def transform(s, distance):
        x = a * np.sqrt(s * capacity / k)
        mean = 1 / 3 - 1 / np.tanh(x) / x + 1 / x**2
        f = -3e3 / s / (1 - 4 * shear / stiff * (1 / 3 - alpha * g * mean))
        ratio = x / np.sinh(x) if distance == 0 else a * np.sinh(x * distance / a) / (distance * np.sinh(x))
        return -g * f * (1 - ratio)

    for part in (0.003, 0.03, 0.3):
        t = part * ball.time_scale
        for distance in (0.0, 0.8, 1.7):
            series = ball.pressure(np.array([distance]), t)[0]
            assert talbot(lambda s, d=distance: transform(s, d), t) == pytest.approx(series, rel=1e-7)


@pytest.mark.parametrize("medium", MEDIA)
def test_cryer_begins_undrained_and_ends_drained(medium):
    ball = Cryer(medium, 2.0, 3e3)
    assert ball.pressure(np.zeros(1), 1e-6 * ball.time_scale)[0] == pytest.approx(ball.initial_pressure, rel=3e-3)
    long = 20 * ball.time_scale
    assert ball.settlement(long) == pytest.approx(-ball.load * 2.0 / (3 * medium.bulk), rel=1e-12)
    first = ball.settlement(1e-9 * ball.time_scale)
    expected = -ball.load * 2.0 / (3 * medium.undrained_bulk)
    assert first == pytest.approx(expected, abs=3e-4 * ball.load * 2.0 / medium.bulk)
    near = ball.displacement(np.array([1e-6, 1e-3]), 0.1 * ball.time_scale)
    assert near[1] == pytest.approx(1e3 * near[0], rel=1e-5)


@pytest.mark.parametrize("medium", [*MEDIA, Medium(nu=0.25, alpha=0.6, skempton=0.8)])
def test_cryer_as_verruijt_writes_it(medium):
    """Pressure at the centre (Verruijt, Theory and Problems of Poroelasticity, 2015, section 3.3)."""
    ball = Cryer(medium)
    extra = medium.bulk * storage(medium) / medium.alpha**2
    eta = (1 - medium.nu) / (1 - 2 * medium.nu) * (1 + extra)
    # A root in every interval of π, the first below π.
    low = np.pi * np.arange(60) + np.where(np.arange(60) == 0, 1e-3, 0.0)
    xi = roots(lambda x: (1 - eta * x**2 / 2) * np.sin(x) - x * np.cos(x), low, np.pi * np.arange(1, 61))
    weights = eta * (np.sin(xi) - xi) / ((eta - 1) * np.sin(xi) + eta * xi * np.cos(xi) / 2)
    for part in (0.005, 0.05, 0.2):
        expected = ball.load / (medium.alpha * (1 + extra)) * weights @ np.exp(-(xi**2) * part)
        assert ball.pressure(np.zeros(1), part * ball.time_scale)[0] == pytest.approx(expected, rel=1e-11)


def test_cryers_overshoot_is_the_higher_the_smaller_nu():
    """And none is left where ν = 1/2: there is no volume to give (Cryer 1963)."""
    peaks = []
    for nu in (0.0, 0.25, 0.4999):
        ball = Cryer(Medium(nu=nu, alpha=1.0, skempton=1.0))
        history = [ball.pressure(np.zeros(1), s * ball.time_scale)[0] for s in np.geomspace(1e-3, 0.5, 400)]
        peaks.append(max(history) / ball.load)
    assert peaks[0] > 1.5
    assert 1.2 < peaks[1] < 1.4
    assert 1.0 <= peaks[2] < 1.001


@pytest.mark.parametrize("make", [Terzaghi, Mandel, Cryer])
@pytest.mark.parametrize("part", [1e-6, 1e-3, 1.0])
def test_twice_as_many_terms_change_nothing(make, part):
    few, many = make(MEDIUM), make(MEDIUM, more=2)
    at, t = np.linspace(0.0, 1.0, 50), part * few.time_scale
    gap = np.abs(few.pressure(at, t) - many.pressure(at, t)).max()
    assert gap < 1e-9 * few.initial_pressure
    if make is Mandel:
        one, other = few.displacement(at, at, t), many.displacement(at, at, t)
    else:
        one, other = few.displacement(at, t), many.displacement(at, t)
    assert np.abs(one - other).max() < 1e-9 * np.abs(one).max()


@pytest.mark.parametrize("dim", [2, 3])
def test_uniform_states_obey_hooke_and_darcy(dim):
    rng = np.random.default_rng(1)
    stress = rng.standard_normal((dim, dim))
    stress = stress + stress.T
    for state in (undrained(MEDIUM, stress), drained(MEDIUM, stress)):
        e, p = state.strain, state.pressure
        total = 2 * MEDIUM.shear * e + (lame(MEDIUM) * np.trace(e) - MEDIUM.alpha * p) * np.eye(dim)
        np.testing.assert_allclose(total, stress, atol=1e-12)
    still = undrained(MEDIUM, stress)
    # Nothing has seeped: S p + α ∇·u = 0.
    assert storage(MEDIUM) * still.pressure == pytest.approx(-MEDIUM.alpha * np.trace(still.strain), rel=1e-11)


def test_sunk_column_obeys_the_balances():
    column, x = SunkColumn(MEDIUM, 2.0), np.linspace(0.1, 1.9, 7)
    strain = derivative(column.displacement, x, 0.01)
    slope = derivative(column.pressure, x, 0.01)
    force = MEDIUM.uniaxial * derivative(column.displacement, x, 0.01, 2) - MEDIUM.alpha * slope
    np.testing.assert_allclose(force, MEDIUM.density * column.gravity, rtol=1e-8)
    np.testing.assert_allclose(storage(MEDIUM) * column.pressure(x), -MEDIUM.alpha * strain, rtol=1e-9)


@pytest.mark.parametrize("undrained_bar", [False, True])
@pytest.mark.parametrize("fixed", [False, True])
def test_wave_satisfies_the_equations(undrained_bar, fixed):
    """Up to the fourth passage of the bar; velocities and strains are derivatives of the displacement."""
    pulse = Pulse(2e3, 2e-3)
    wave = Wave(MEDIUM, pulse, 2.0, undrained_bar, fixed)
    x, step, dt = np.linspace(0.1, 1.9, 30), 1e-3, 1e-3 / wave.speed
    for time in np.array([0.3, 0.9, 1.4, 2.7, 3.9]) * 2.0 / wave.speed:
        ddu = derivative(lambda s: wave.displacement(x, s), time, dt, 2)
        bent = derivative(lambda z, s=time: wave.displacement(z, s), x, step, 2)
        assert np.abs(MEDIUM.density * ddu - wave.modulus * bent).max() < 1e-5 * np.abs(wave.modulus * bent).max()
        rate = derivative(lambda s: wave.displacement(x, s), time, dt)
        np.testing.assert_allclose(wave.velocity(x, time), rate, atol=1e-6 * np.abs(rate).max())
        slope = derivative(lambda z, s=time: wave.displacement(z, s), x, step)
        np.testing.assert_allclose(wave.strain(x, time), slope, atol=1e-6 * np.abs(slope).max())
        ends = wave.strain(np.array([0.0, 2.0]), time)
        assert wave.modulus * ends[1] == pytest.approx(pulse(np.array([time]))[0], abs=1e-9 * pulse.load)
        if fixed:
            assert abs(wave.displacement(np.zeros(1), time)[0]) < 1e-12
        else:
            assert abs(ends[0]) < 1e-12
        p = wave.pressure(x, time)
        if undrained_bar:
            np.testing.assert_allclose(storage(MEDIUM) * p, -MEDIUM.alpha * wave.strain(x, time), atol=1e-12)
        else:
            assert not p.any()
    assert wave.modulus > MEDIUM.uniaxial if undrained_bar else wave.modulus == MEDIUM.uniaxial


@pytest.mark.parametrize("loss", [0.0, 0.3])
@pytest.mark.parametrize("frequency", [0.1, 20.0, 400.0])
def test_shaken_column_satisfies_the_equations(frequency, loss):
    medium = Medium(kappa=1e-6)
    column = Column(medium, frequency, 2.0, 3e3, loss)
    stiff = medium.uniaxial * (1 + 1j * loss)
    x, w, scale = np.linspace(0.05, 1.95, 25), column.omega, np.abs(column.wave_numbers).max()
    step = 0.02 / scale
    u, p = column.displacement(x), column.pressure(x)
    bent, slope = derivative(column.displacement, x, step, 2), derivative(column.pressure, x, step)
    inertia = -medium.density * w**2 * u
    force = inertia - stiff * bent + medium.alpha * slope
    size = np.abs(stiff * bent).max() + np.abs(inertia).max() + np.abs(slope).max()
    assert np.abs(force).max() < 1e-6 * size
    strain = derivative(column.displacement, x, step)
    seepage = medium.mobility * derivative(column.pressure, x, step, 2)
    mass = 1j * w * (storage(medium) * p + medium.alpha * strain) - seepage
    assert np.abs(mass).max() < 1e-6 * (np.abs(seepage).max() + w * np.abs(strain).max())
    top, bottom = np.array([2.0]), np.zeros(1)
    assert abs(column.pressure(top)[0]) < 1e-9 * column.load
    assert abs(column.displacement(bottom)[0]) < 1e-15
    pull = stiff * derivative(column.displacement, top, step)[0]
    assert pull == pytest.approx(column.load, rel=1e-6)


def test_shaken_column_at_low_frequency_is_terzaghis():
    """Far below every resonance and quickly drained: the static pull."""
    medium = Medium(kappa=1e-3)
    column = Column(medium, 1e-3, 1.0, 3e3)
    x = np.linspace(0, 1, 5)
    np.testing.assert_allclose(column.displacement(x), 3e3 * x / medium.uniaxial, atol=1e-6)
    assert np.abs(column.pressure(x)).max() < 1e-3 * column.load


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Medium(nu=0.5), "nu = 0.5"),
        (lambda: Medium(E=-1.0), "E = -1"),
        (lambda: Terzaghi(MEDIUM, 0.0), "height"),
        (lambda: Mandel(MEDIUM, 1.0, -1.0), "half widths"),
        (lambda: Cryer(MEDIUM, -1.0), "radius"),
        (lambda: SunkColumn(MEDIA[2]), "compressible"),
        (lambda: Wave(MEDIA[2], Pulse(1.0, 1.0), undrained=True), "compressible"),
        (lambda: Pulse(1.0, 0.0), "pulse"),
        (lambda: Column(Medium(kappa=0.0), 10.0), "kappa > 0"),
        (lambda: undrained(MEDIUM, [[1.0, 2.0], [0.0, 1.0]]), "symmetric"),
    ],
)
def test_unphysical_problems_are_refused(make, message):
    with pytest.raises(ShapeError, match=message):
        make()
