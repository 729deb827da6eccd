"""The brain at one frequency: parameters, loads with phases, what is shared with the marched model, units."""

from itertools import product

import numpy as np
import pytest

from dacore.core.timegrid import TimeGrid
from dacore.dynamics.harmonic import HarmonicModel, amplitude
from dacore.dynamics.march import MarchedModel
from dacore.dynamics.newmark import Newmark
from dacore.dynamics.scheme import State
from dacore.errors import MeshError, ShapeError
from dacore_biot.harmonic import BiotHarmonic, Part
from dacore_biot.inclusions import Inclusion
from dacore_biot.model import Biot


@pytest.fixture
def built(head, on):
    return BiotHarmonic().build(on(head()))


def solved(model, **changes):
    return amplitude(model.solve(model.parameters.middle | changes).states)


def near(found, wanted, tolerance=1e-8):
    return np.abs(found - wanted).max() < tolerance * np.abs(wanted).max()


def test_parameters_are_those_of_the_tissue_and_of_the_oscillation():
    space = BiotHarmonic().parameters
    assert [p.name for p in space.free] == ["kappa", "E", "nu", "p_ventricles", "loss"]
    assert {p.name for p in Biot().parameters.parameters} < set(space.names)
    assert (space["loss"].low, space["loss"].high, space["loss"].unit) == (0.2, 0.6, "1")
    assert (space["p_ventricles"].low, space["p_ventricles"].high) == (0.0, 500.0)
    assert {name: space[name].low for name in ("p_csf", "phase_xi", "phase_csf", "phase_ventricles")} == dict.fromkeys(
        ("p_csf", "phase_xi", "phase_csf", "phase_ventricles"), 0.0
    )
    assert space["phase_csf"].unit == "rad"
    assert "loss" not in Biot().parameters.names
    changed = BiotHarmonic(ranges={"loss": (0.0, 0.1), "phase_csf": (-1.0, 1.0)}, log_uniform=("E",)).parameters
    assert {p.name for p in changed.free} == {"kappa", "E", "nu", "p_ventricles", "loss", "phase_csf"}
    assert changed["E"].distribution == "log_uniform"


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"tolerance": 0.0}, "tolerance: got 0.0"),
        ({"frequency": -1.0}, "frequency: got -1.0"),
        ({"ranges": {"loss": (-0.1, 0.2)}}, r"loss: got -0.1, expected a value in \[0, inf\)"),
        ({"ranges": {"loss": (0.3, 0.1)}}, "low <= high"),
        ({"ranges": {"ramp": (0.0, 1.0)}}, "Biot parameters: got ramp, expected any of kappa, E"),
        ({"ventricles": "", "ranges": {"phase_ventricles": (0.0, 1.0)}}, "got phase_ventricles"),
        ({"stabilization": "projected", "displacement_order": 2}, "which needs none"),
        ({"neck": "mre"}, "three different"),
    ],
)
def test_settings_are_checked_when_made(settings, message):
    with pytest.raises(ShapeError, match=message) as caught:
        BiotHarmonic(**settings)
    assert "\n" not in str(caught.value)


def test_a_jump_or_ramp_is_no_setting_of_an_oscillation():
    with pytest.raises(TypeError, match="ramp"):
        BiotHarmonic(ramp=0.1)


def test_meshes_that_do_not_fit_are_refused_as_those_of_the_marched_model(head, on):
    with pytest.raises(MeshError, match="no role chiasm"):
        BiotHarmonic(ventricles="chiasm", mre="ventricles").build(on(head()))


def test_what_it_builds(built):
    assert isinstance(built, HarmonicModel)
    assert [load.name for load in built.model.loads] == [
        "pulse cos", "pulse sin", "csf cos", "csf sin", "ventricles cos", "ventricles sin", "neck",
    ]  # fmt: skip
    assert np.array_equal(built.times, [0.0, 0.005])
    assert set(built.losses) == {"shear", "dilation"}


def test_matrices_and_what_is_held_are_those_of_the_marched_model(head, on):
    settings = {
        "pressure_on_neck": "csf", "inclusions": (Inclusion((2.0, 1.0, 1.0), 1.5, 4.0),), "stabilization": "lumped"
    }  # fmt: skip
    marched, harmonic = Biot(**settings).build(on(head())), BiotHarmonic(**settings).build(on(head())).model
    for group in ("second_order", "first_order", "zeroth_order"):
        for one, other in zip(getattr(marched, group), getattr(harmonic, group), strict=True):
            assert one.name == other.name
            assert (one.matrix != other.matrix).nnz == 0
            assert one.coefficient is other.coefficient
    assert np.array_equal(marched.constrained, harmonic.constrained)
    loads = {load.name: load for load in harmonic.loads}
    for load in marched.loads:
        for part in (f"{load.name} cos", f"{load.name} sin") if load.name != "neck" else ("neck",):
            assert np.array_equal(loads[part].force, load.force)
            assert np.array_equal(loads[part].prescribed, load.prescribed)
    assert len(harmonic.cautions) == len(marched.cautions) == 1


def test_domain_without_ventricles(head, on):
    mesh = head()
    roles = {"neck": 1, "mre": 3}
    tags = np.where(mesh.facet_tags == 2, 3, mesh.facet_tags)
    model = BiotHarmonic(ventricles="").build(on(type(mesh)(mesh.points, mesh.cells, mesh.facets, tags, roles)))
    assert not {"p_ventricles", "phase_ventricles"} & set(model.parameters.names)
    assert np.isfinite(solved(model)).all()


def test_a_phase_turns_what_its_load_does(built):
    """a cos(ωt + φ) is Re(a e^{iφ} e^{iωt}): a positive phase is early."""
    quiet = {"xi": 0.0, "p_ventricles": 0.0}
    for size, phase, value in (("xi", "phase_xi", -300.0), ("p_csf", "phase_csf", 80.0),
                               ("p_ventricles", "phase_ventricles", 200.0)):  # fmt: skip
        plain = solved(built, **quiet | {size: value})
        assert np.abs(plain).max() > 0
        for angle in (0.7, -2.0):
            assert near(solved(built, **quiet | {size: value, phase: angle}), np.exp(1j * angle) * plain)
    theta = {"a": 3.0, "φ": 0.4}
    parts = [Part("a", "φ", part)(theta) for part in ("cos", "sin")]
    t = np.linspace(0, 6, 7)
    assert np.allclose(parts @ np.array([np.cos(t), np.sin(t)]), 3.0 * np.cos(t + 0.4))


def test_prescribed_amplitudes_hold(built, head):
    mesh, layout = head(), built.space.layout
    y = solved(built, p_csf=50.0, phase_csf=0.3, p_ventricles=200.0, phase_ventricles=-0.5, neck_displacement=1e-4)
    p = y[layout.block("p")]
    assert np.allclose(p[mesh.boundary_nodes("mre")], 50.0 * np.exp(0.3j))
    assert np.allclose(p[mesh.boundary_nodes("ventricles")], 200.0 * np.exp(-0.5j))
    for axis in range(3):
        assert np.allclose(y[layout.component("u", axis)][mesh.boundary_nodes("neck")], 1e-4)


def test_the_marched_model_goes_on_as_the_harmonic_one(head, on):
    """Without loss; the pressures do not move there, and the traction goes as a sine: phase −π/2."""
    settings = {"ranges": {"p_ventricles": (0.0, 0.0), "kappa": (1e-6, 1e-6), "E": (3e4, 3e4)}, "p_csf": 0.0}
    plain = Biot(**settings).build(on(head()))
    harmonic = BiotHarmonic(**settings).build(on(head()))
    y = solved(harmonic, loss=0.0, phase_xi=-np.pi / 2)
    turn, found = 2j * np.pi * 50.0, []
    start = State(*((y * turn**k).real[:, None] for k in range(3)))
    for steps in (40, 80):
        marched = MarchedModel(plain, TimeGrid(0.02 / steps, steps), Newmark(0.25, 0.5, "newmark"), tolerance=1e-12)
        last = marched.march(plain.parameters.middle, start).states[:, -1]
        found.append(np.linalg.norm(last - y.real) / np.linalg.norm(y.real))
    assert found[1] < 5e-2
    assert np.log2(found[0] / found[1]) > 1.8


def test_far_below_resonance_it_is_the_steady_state(head, on):
    settings = {"ranges": {"p_ventricles": (200.0, 200.0), "kappa": (1e-6, 1e-6)}, "p_csf": 50.0}
    slow = BiotHarmonic(frequency=1e-5, **settings).build(on(head()))
    still = MarchedModel(Biot(**settings).build(on(head())), TimeGrid(1e-3, 1), start="steady")
    y = solved(slow, loss=0.0, xi=0.0)
    wanted = still.solve(still.parameters.middle | {"xi": 0.0}).states[:, 0]
    for field in ("u", "p"):
        rows = slow.space.layout.block(field)
        assert near(y[rows].real, wanted[rows], 1e-4)
        assert np.abs(y[rows].imag).max() < 1e-3 * np.abs(wanted[rows]).max()


def test_si_and_cgs_are_the_same_physics(head, on):
    """Lengths in m, pressures in Pa, permeability in m², density in kg/m³, viscosity in Pa s."""
    cgs = BiotHarmonic(p_csf=30.0).build(on(head()))
    factors = {"kappa": 1e-4, "E": 0.1, "p_ventricles": 0.1, "p_csf": 0.1, "xi": 0.1, "density": 1e3, "viscosity": 0.1}
    ranges = {
        p.name: (p.low * factors.get(p.name, 1), p.high * factors.get(p.name, 1)) for p in cgs.parameters.parameters
    }
    si = BiotHarmonic(ranges=ranges).build(on(head(length=0.05)))
    one, other = solved(cgs), solved(si)
    for field, factor in (("u", 1e-2), ("p", 0.1)):
        rows = cgs.space.layout.block(field)
        assert near(one[rows] * factor, other[rows], 1e-7)


def test_corners_of_the_ranges_and_beyond_are_solved(built):
    free = [p for p in built.parameters.free if p.name != "p_ventricles"]
    names = [p.name for p in free]
    corners = [dict(zip(names, v, strict=True)) for v in product(*[(p.low, p.high) for p in free])]
    extremes = [
        {"nu": 0.4999},
        {"kappa": 1e-14},
        {"kappa": 1e-2},
        {"E": 1e2},
        {"E": 1e8},
        {"skempton": 1.0},
        {"loss": 0.0},
    ]
    for change in corners + extremes:
        assert np.isfinite(solved(built, **change)).all(), change
