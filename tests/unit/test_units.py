"""Units with a zero of their own: no factor converts them, and pint's number for one of them is not one."""

import pytest

from dacore.errors import SceneError
from dacore.io.scene import Range, convert
from dacore.io.units import factor, parse_quantity


@pytest.mark.parametrize("unit", ["degC", "°C", "celsius", "degF"])
def test_temperatures_of_another_zero_are_refused(unit):
    """37 °C was taken for 10,144 K, and a noise of 0.1 °C for 27 K."""
    words = "has a zero of its own; give differences from the zero of the scene, in 'K'"
    for convert_it in (
        lambda: factor(unit, "K", "data.csv"),
        lambda: parse_quantity(f"0.1 {unit}", "K", "--noise"),
        lambda: convert(Range(low=36.0, high=38.0, unit=unit), "K", "parameters.initial"),
    ):
        with pytest.raises(SceneError, match=words):
            convert_it()
    with pytest.raises(SceneError, match="zero of its own"):
        factor("dB", "1", "here")


def test_differences_of_temperatures_are_factors():
    assert factor("delta_degC", "K", "") == pytest.approx(1.0)
    assert factor("mK", "K", "") == pytest.approx(1e-3)
    assert convert(Range(low=0.4, high=0.6, unit="W/m/K"), "erg/(cm*s*K)", "") == pytest.approx((4e4, 6e4))


@pytest.mark.parametrize("unit", ["rad/s", "rpm", "deg/s", "turn/s"])
def test_angular_frequencies_are_no_hertz(unit):
    """314 rad/s were 314 Hz."""
    with pytest.raises(SceneError, match="unit of angular frequency; give cycles a second, in 'Hz'"):
        parse_quantity(f"314 {unit}", "Hz", "--frequency")
    assert parse_quantity("0.05 kHz", "Hz", "--frequency") == pytest.approx(50.0)
    assert factor("1/s", "Hz", "") == pytest.approx(1.0)
    assert factor("deg", "rad", "") == pytest.approx(0.0174532925)
