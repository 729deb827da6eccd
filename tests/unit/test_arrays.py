import h5py
import numpy as np
import pytest

from dacore.errors import StoreError
from dacore.io.arrays import read_arrays, write_arrays
from dacore.io.sealed import BLOCK

KIND = "dacore example 1"
ARRAYS = {
    "u/α.": np.arange(6.0).reshape(2, 3).T,
    "none": np.zeros((0, 3)),
    "one": np.float64(2.5),
    "mask": np.array([True, False]),
    "numbers": np.array([3, -1], dtype=np.int64),
}
FACTS = {"label": "p − p_csf", "n": [1, 2], "nothing": None}


@pytest.fixture
def path(tmp_path):
    write_arrays(tmp_path / "kept.h5", KIND, ARRAYS, FACTS)
    return tmp_path / "kept.h5"


def test_arrays_and_facts_come_back_as_they_were(path):
    arrays, facts = read_arrays(path, KIND)
    assert facts == FACTS
    assert list(arrays) == list(ARRAYS)
    for name, values in ARRAYS.items():
        assert arrays[name].dtype == values.dtype
        assert arrays[name].shape == values.shape
        assert np.array_equal(arrays[name], values)


def test_the_same_arrays_give_the_same_bytes(path, tmp_path):
    write_arrays(tmp_path / "again.h5", KIND, ARRAYS, FACTS)
    assert (tmp_path / "again.h5").read_bytes() == path.read_bytes()


def test_one_bit_anywhere_is_found(path):
    whole, rng = path.read_bytes(), np.random.default_rng(0)
    for at in rng.integers(len(whole), size=60):
        changed = bytearray(whole)
        changed[at] ^= 1 << int(rng.integers(8))
        path.write_bytes(changed)
        with pytest.raises(StoreError, match=r"damaged|other settings|schema|expected a"):
            read_arrays(path, KIND)


@pytest.mark.parametrize("length", [0, BLOCK - 1, BLOCK, -1])
def test_a_file_cut_short_is_damaged(path, length):
    path.write_bytes(path.read_bytes()[:length])
    with pytest.raises(StoreError, match="damaged"):
        read_arrays(path, KIND)


def test_a_file_of_another_kind_or_version_is_refused(path, tmp_path):
    with pytest.raises(StoreError, match="a dacore example 1, expected a dacore example 2"):
        read_arrays(path, "dacore example 2")
    with h5py.File(tmp_path / "old.h5", "w") as file:
        file.attrs["magic"] = KIND
    with pytest.raises(StoreError, match="no seal"):
        read_arrays(tmp_path / "old.h5", KIND)
    with pytest.raises(StoreError, match="cannot be read"):
        read_arrays(tmp_path / "missing.h5", KIND)
