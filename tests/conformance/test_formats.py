"""The formats of dacore keep the contracts of a format; files are written as others write them."""

import re
from pathlib import Path

import h5py
import numpy as np
import pytest

from dacore.core.data import Asked, ImageData, SensorData
from dacore.errors import PluginError
from dacore.io.data_arrays import Hdf5Data, NpzData
from dacore.io.data_csv import CsvSensors
from dacore.testing import format_suite, run

PLACES = np.array([[1.0, 2.0, 3.0], [-1.5, 0.0, 0.25]])
TIMES = np.array([1e-3, 2e-3, 3.5e-3])
VALUES = np.array([[5.5, np.nan, -1e-7], [0.1, 2.0, 3.0]])
SIGMA = np.array([[0.1, 0.2, 0.3], [0.1, 0.1, 0.1]])
AXES = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
SENSORS = SensorData("any", VALUES, "um", ("a", "b"), PLACES, AXES, ("u", "u"), TIMES, SIGMA)
AFFINE = np.array([[0.5, 0.0, 0.1, -3.0], [0.0, 0.4, 0.0, 2.0], [0.0, 0.0, 0.3, 1.0], [0.0, 0.0, 0.0, 1.0]])
PHASORS = np.arange(48.0).reshape(4, 2, 2, 1, 3) * (1 + 2j)
IMAGE = ImageData("any", PHASORS, AFFINE, "mm", (0, 1, 2), frequency=50.0)


def csv(folder):
    rows = ["label;x [mm];y [mm];z [mm];component;field;time [ms];value [um];sigma [nm]"]
    for n, axis in ((0, "x"), (1, "z")):
        place = ";".join(repr(10 * each) for each in PLACES[n].tolist())
        for time, value, sigma in zip(TIMES.tolist(), VALUES[n].tolist(), SIGMA[n].tolist(), strict=True):
            rows.append(f"{'ab'[n]};{place};{axis};u;{1e3 * time!r};{value!r};{1e3 * sigma!r}")
    (folder / "sensors.csv").write_text("\n".join(rows), encoding="utf-8")
    return folder / "sensors.csv"


ARRAYS = {
    "values": VALUES, "labels": np.array(["a", "b"]), "positions": 10 * PLACES, "directions": AXES,
    "field": np.array("u"), "times": 1e3 * TIMES, "time_unit": np.array("ms"), "length_unit": np.array("mm"),
    "unit": np.array("um"), "sigma": SIGMA,
}  # fmt: skip
OF_IMAGE = {"values": PHASORS, "affine": AFFINE, "unit": np.array("mm"), "frequency": np.array(50.0)}


def npz(arrays):
    def write(folder):
        np.savez(folder / "data.npz", **arrays)
        return folder / "data.npz"

    return write


def hdf5(arrays):
    def write(folder):
        with h5py.File(folder / "data.h5", "w") as file:
            for name, array in arrays.items():
                file[name] = (
                    [str(each) for each in array] if name == "labels" else array.item() if array.ndim == 0 else array
                )
        return folder / "data.h5"

    return write


test_csv = format_suite(CsvSensors(), csv, SENSORS).as_test()
test_npz = format_suite(NpzData(), npz(ARRAYS), SENSORS).as_test()
test_npz_of_an_image = format_suite(NpzData(), npz(OF_IMAGE), IMAGE).as_test()
test_hdf5 = format_suite(Hdf5Data(), hdf5(ARRAYS), SENSORS).as_test()
test_hdf5_of_an_image = format_suite(Hdf5Data(), hdf5(OF_IMAGE), IMAGE).as_test()


def test_what_is_no_format_is_refused_when_the_suite_is_made():
    with pytest.raises(PluginError, match="got the class CsvSensors, expected an instance"):
        format_suite(CsvSensors, csv, SENSORS)
    with pytest.raises(PluginError, match="write is a str, expected a function"):
        format_suite(CsvSensors(), "sensors.csv", SENSORS)
    with pytest.raises(PluginError, match="expected is a ndarray, should be the SensorData or ImageData"):
        format_suite(CsvSensors(), csv, VALUES, Asked())


def test_the_example_of_the_page_passes():
    page = (Path(__file__).resolve().parents[2] / "docs/conformance.md").read_text(encoding="utf-8")
    (block,) = (
        each for each in re.findall(r"^```python\n(.*?)^```", page, re.MULTILINE | re.DOTALL) if "CsvSensors" in each
    )
    names = {}
    exec(block, names)
    assert [str(each) for each in run(format_suite(CsvSensors(), names["write"], names["held"]))] == []
    assert callable(names["test_csv"])
