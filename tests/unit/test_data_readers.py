"""Files of sensors and of arrays: what they hold comes back, and whatever is wrong is said in one line."""

import h5py
import numpy as np
import pytest

from dacore.core.data import Asked, ImageData, SensorData
from dacore.errors import DacoreError, SceneError, ShapeError, StoreError
from dacore.io.data_arrays import Hdf5Data, NpzData
from dacore.io.data_csv import CsvSensors
from dacore.io.units import factor, parse_quantity, split_header


def read(tmp_path, text, asked=None, name="data.csv"):
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return CsvSensors().read([path], asked or Asked())


def test_units_as_people_write_them():
    assert factor("mm", "cm", "") == pytest.approx(0.1)
    assert factor("µm", "cm", "") == factor("μm", "cm", "") == factor("um", "cm", "") == pytest.approx(1e-4)
    assert factor("Pa", "dyn/cm^2", "") == pytest.approx(10.0)
    assert factor("dyn/cm²", "dyn/cm^2", "") == pytest.approx(1.0)
    assert split_header(" value [mm] ") == ("value", "mm")
    assert split_header("value") == ("value", None)
    assert parse_quantity("0.5 ms", "s", "") == pytest.approx(5e-4)
    assert parse_quantity(" -1e-3", "s", "") == -1e-3
    for wrong in ("kg", "smoots per", "%%", "[", "cm!", "cm)"):
        with pytest.raises(SceneError, match="expected one that converts to 'cm'"):
            factor(wrong, "cm", "here")
    with pytest.raises(SceneError, match="expected a number"):
        parse_quantity("soon", "s", "--times")


def test_a_row_a_sensor_and_time(tmp_path):
    data = read(
        tmp_path,
        "# somebody's remark\nx [mm];y [mm];z [mm];component;time [ms];value [um];sigma [nm]\n"
        "10;20;30;x;1;5.5;100\n10;20;30;x;2;6.5;200\n\n10;20;30;z;2;NA;100\n10;20;30;z;1;-1;100\n",
    )
    assert isinstance(data, SensorData)
    assert np.allclose(data.places, [[1, 2, 3], [1, 2, 3]])
    assert np.array_equal(data.directions, [[1, 0, 0], [0, 0, 1]])
    assert np.allclose(data.times, [1e-3, 2e-3])
    assert np.allclose(data.values, [[5.5, 6.5], [-1, np.nan]], equal_nan=True)
    assert np.allclose(data.sigma, [[0.1, 0.2], [0.1, 0.1]])
    assert data.unit == "um"


def test_labels_directions_and_complex_values(tmp_path):
    data = read(tmp_path, "label,amplitude [um],phase [deg]\na,2,90\nb,1,180\n", Asked(frequency=50.0))
    assert data.labels == ("a", "b")
    assert np.allclose(data.values[:, 0], [2j, -1])
    assert data.frequency == 50.0
    data = read(tmp_path, "x,y,nx,ny,real,imag\n0,1,0.6,0.8,1,2\n", Asked(unit="mm"))
    assert np.allclose(data.directions, [[0.6, 0.8]])
    assert data.values[0, 0] == 1 + 2j
    assert data.unit == "mm"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", ["is empty", "header"]),
        ("\n\n# only remarks\n", ["is empty"]),
        ("x,y,z,value\n", ["no rows"]),
        ("x,y,z,valeu\n1,2,3,4\n", ["unknown column 'valeu'", "did you mean 'value'"]),
        ("x,y,z,mood,value\n1,2,3,4,5\n", ["unknown column 'mood'", "allowed are"]),
        ("x,y,z\n1,2,3\n", ["expected value, or real and imag"]),
        ("x,y,z,real\n1,2,3,4\n", ["real and imag"]),
        ("value\n1\n", ["label", "x, y, z"]),
        ("x,z,value\n1,2,3\n", ["x, z", "expected x, y, z"]),
        ("x,y,z,value\n1,2,3\n", ["line 2", "3 cells", "expected 4"]),
        ("x,y,z,value\n1,2,3,big\n", ["line 2", "value is 'big'"]),
        ("x,y,z,value\n1,2,,4\n", ["line 2", "z is missing"]),
        ("x,y,z,value\n1,2,3,inf\n", ["line 2", "infinite"]),
        ("x,y,z,value\n1,2,3,\n", ["holds no value"]),
        ("x,y,z,component,value\n1,2,3,w,1\n", ["line 2", "component is 'w'", "x, y, z"]),
        ("x,y,z,nx,ny,nz,value\n1,2,3,1,1,0,1\n", ["length 1.41", "expected 1"]),
        ("x,y,z,value,sigma\n1,2,3,1,-0.5\n", ["line 2", "sigma is -0.5", "positive"]),
        ("x,y,z,value,sigma\n1,2,3,1,0\n", ["sigma is 0"]),
        ("x,y,z,value\n1,2,3,1\n1,2,3,2\n", ["lines 2 and 3", "same sensor", "column time"]),
        ("x,y,z,time,value\n1,2,3,0,1\n1,2,3,0,1\n", ["lines 2 and 3", "same sensor and time"]),
        ("x,y,z,value,value\n1,2,3,1,1\n", ["'value' is there twice"]),
        ("x [kg],y,z,value\n1,2,3,1\n", ["unit 'kg'", "'cm'"]),
        ("label,value\n,1\n", ["line 2", "label is empty"]),
        ("label;value\na;0,305\n", ["line 2", "'0,305'", "a number with a decimal point"]),
        ("label,value\na,0,305\n", ["line 2", "3 cells, expected 2", "decimal commas"]),
        ("x (mm),y,z,value\n1,2,3,1\n", ["unknown column 'x (mm)'", "square brackets, as 'x [mm]'"]),
        ('label,value\n"a,1\nb,2\n', ["quotation mark", "not closed"]),
        ("label,amplitude,phase\na,1,90\nb,1,180\n", ["goes up to 180", "'phase [deg]'"]),
        ("label,amplitude,phase\na,1,1\nb,-1,2\n", ["line 3", "amplitude is negative"]),
    ],
)
def test_what_is_wrong_with_a_csv(tmp_path, text, words):
    with pytest.raises(DacoreError) as caught:
        read(tmp_path, text)
    for word in words:
        assert word in str(caught.value)
    assert "\n" not in str(caught.value)


def test_what_spreadsheets_add_is_left_out(tmp_path):
    plain = read(tmp_path, "label;value [mm]\na;1.5\nb;2\n")
    for text in (
        "\ufeffsep=;\nlabel;value [mm]\na;1.5\nb;2\n",
        "label;value [mm];\na;1.5;\nb;2;\n;;\n",
        "label\tvalue [mm]\n\t\na\t1.5\nb\t2\n",
    ):
        data = read(tmp_path, text)
        assert data.labels == plain.labels == ("a", "b")
        assert np.array_equal(data.values, plain.values)
        assert data.unit == "mm"
    turn = read(tmp_path, "label,amplitude,phase\na,1,6.29\n", Asked(frequency=50.0))  # rounding of a whole turn
    assert np.allclose(turn.values, np.exp(6.29j))


def test_files_that_are_not_there_or_no_text(tmp_path):
    with pytest.raises(StoreError, match="no such file"):
        CsvSensors().read([tmp_path / "none.csv"], Asked())
    (tmp_path / "bytes.csv").write_bytes(b"\xff\xfe\x00\x81")
    with pytest.raises(StoreError, match="cannot be read"):
        CsvSensors().read([tmp_path / "bytes.csv"], Asked())


def write_arrays(path, arrays):
    if path.suffix == ".npz":
        np.savez(path, **arrays)
        return NpzData()
    with h5py.File(path, "w") as file:
        for name, value in arrays.items():
            if name == "unit":
                file.require_dataset("values", np.shape(arrays["values"]), float, data=arrays["values"])
                file["values"].attrs["unit"] = value
            elif name == "labels":
                file.create_dataset(name, data=value, dtype=h5py.string_dtype())
            elif name not in file:
                file[name] = value
    return Hdf5Data()


@pytest.mark.parametrize("suffix", [".npz", ".h5"])
def test_arrays_of_sensors(tmp_path, suffix):
    path = tmp_path / f"sensors{suffix}"
    arrays = {
        "values": np.arange(6.0).reshape(3, 2), "positions": np.eye(3), "length_unit": "mm", "times": [1.0, 2.0],
        "time_unit": "ms", "unit": "um", "sigma": 0.5, "components": np.array([0, 1, 2]),
        "mask": np.array([1, 1, 0]), "labels": ["a", "b", "c"],
    }  # fmt: skip
    data = write_arrays(path, arrays).read([path], Asked())
    assert isinstance(data, SensorData)
    assert np.allclose(data.places, 0.1 * np.eye(3))
    assert np.allclose(data.times, [1e-3, 2e-3])
    assert np.allclose(data.values[:2], [[0, 1], [2, 3]])
    assert np.isnan(data.values[2]).all()
    assert np.array_equal(data.directions, np.eye(3))
    assert (data.sigma == 0.5).all()
    assert (data.unit, data.labels) == ("um", ("a", "b", "c"))


@pytest.mark.parametrize("suffix", [".npz", ".h5"])
def test_an_image_of_arrays_and_back(tmp_path, suffix):
    rng = np.random.default_rng(0)
    affine = np.array([[10.0, 1, 0, -5], [0, 20, 2, 3], [0, 0, 5, 1], [0, 0, 0, 1]])
    values = rng.standard_normal((4, 3, 2, 2, 3))
    path = tmp_path / f"image{suffix}"
    reader = write_arrays(path, {"values": values, "affine": affine, "length_unit": "mm", "unit": "um"})
    image = reader.read([path], Asked(times=(0.1, 0.2)))
    assert isinstance(image, ImageData)
    assert np.allclose(image.affine[:3], 0.1 * affine[:3])
    assert np.array_equal(image.values, values)
    written = reader.write_image(tmp_path / "back", values, image, "u", "cm", np.array([0.1, 0.2]))
    again = reader.read([written], Asked())
    assert np.allclose(again.affine, image.affine)
    assert np.array_equal(again.values, values)
    assert np.allclose(again.times, [0.1, 0.2])
    assert again.unit == "cm"


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"valeus": 1.0}, ["unknown array 'valeus'", "did you mean 'values'"]),
        ({"values": None}, ["no array 'values'"]),
        ({"positions": np.eye(2)}, ["positions of shape (2, 2)", "expected 3 rows"]),
        ({"positions": None}, ["neither labels nor positions"]),
        ({"values": np.zeros((3, 2, 2))}, ["(3, 2, 2)", "needs an affine"]),
        ({"values": np.full(3, np.nan)}, ["holds no value"]),
        ({"values": np.array([1.0, np.inf, 0.0])}, ["1 values are infinite"]),
        ({"values": np.array(["a", "b", "c"])}, ["type <U1", "expected real or complex"]),
        ({"sigma": -1.0}, ["sigma", "-1", "positive"]),
        ({"sigma": np.ones(2)}, ["sigma of shape (2,)"]),
        ({"times": [0.0, 1.0]}, ["2 times for 1 volumes"]),
        ({"mask": np.ones(2)}, ["mask of shape (2,)"]),
        ({"affine": np.eye(4)}, ["values of 1 axes with an affine of (4, 4)"]),
        ({"affine": np.eye(4), "values": np.zeros((2, 2, 2)), "mask": np.ones((2, 2))}, ["mask of shape (2, 2)"]),
        ({"affine": np.zeros((4, 4)) + np.diag([0, 0, 0, 1.0]), "values": np.zeros((2, 2, 2))}, ["singular"]),
    ],
)
def test_what_is_wrong_with_arrays(tmp_path, changes, words):
    arrays = {"values": np.arange(3.0), "positions": np.eye(3), "unit": "cm"} | changes
    path = tmp_path / "a.npz"
    np.savez(path, **{name: value for name, value in arrays.items() if value is not None})
    with pytest.raises(ShapeError) as caught:
        NpzData().read([path], Asked())
    for word in words:
        assert word in str(caught.value)


def test_damaged_files_and_objects_are_refused(tmp_path):
    path = tmp_path / "a.npz"
    np.savez(path, values=np.zeros(1000), labels=np.array(["a"] * 1000))
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(StoreError, match="cannot be read"):
        NpzData().read([path], Asked())
    np.savez(path, values=np.array([{"a": 1}], dtype=object))
    with pytest.raises(StoreError, match="no objects"):
        NpzData().read([path], Asked())
    other = tmp_path / "a.h5"
    with h5py.File(other, "w") as file:
        file["values"] = np.zeros(100_000)
    other.write_bytes(other.read_bytes()[:5000])
    with pytest.raises(StoreError, match="cannot be read"):
        Hdf5Data().read([other], Asked())
