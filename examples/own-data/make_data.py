"""Stands in for somebody's sensors and scanner: data of a ball that the training never sees, with noise.

    python examples/own-data/make_data.py [FOLDER]

writes scan.nii.gz and mask.nii.gz, and scan.toml beside them, into FOLDER (runs/own-data by default). With --sensors it
prints what sensors.csv beside this file holds. The truth is the first unseen case of the scene, so that what is
reconstructed can be compared.
"""

import argparse
import gzip
from pathlib import Path

import nibabel as nib
import numpy as np

import dacore

HERE = Path(__file__).resolve().parent
NOISE = 0.05


def sensors_csv() -> str:
    """Displacements [um] of six sensors over eight steps, with 5% noise, as CSV."""
    scene = dacore.open_scene(HERE / "sensors.toml", cache=Path("runs/own-data/cache"))
    data, sigma = scene.observe(scene.truth[0], noise=NOISE, rng=np.random.default_rng(1))
    lines = ["# Made by examples/own-data/make_data.py: a ball that nobody trained on, 5% noise."]
    lines += ["x [mm],y [mm],z [mm],component,time [ms],value [um],sigma [um]"]
    f = scene.functionals
    for place, direction, row in zip(10 * f.centres, f.directions, 1e4 * data):
        start = f"{place[0]:g},{place[1]:g},{place[2]:g},{'xyz'[direction.argmax()]}"
        lines += [f"{start},{1e3 * t:g},{v:.3f},{1e4 * sigma:.3f}" for t, v in zip(scene.model.times, row)]
    return "\n".join(lines) + "\n"


def grid() -> tuple[np.ndarray, tuple[int, int, int]]:
    """Affine [mm] and shape of the image: 9 mm voxels in slices of 12 mm, tilted by 20 degrees about x."""
    tilt = np.radians(20.0)
    turn = np.array([[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]])
    shape = (12, 12, 3)
    affine = np.eye(4)
    affine[:3, :3] = turn * [9.0, 9.0, 12.0]
    affine[:3, 3] = [0.0, 0.0, 20.0] - affine[:3, :3] @ ((np.array(shape) - 1) / 2)
    return affine, shape


def save(values: np.ndarray, affine: np.ndarray, path: Path, step: float = 0.0, start: float = 0.0) -> None:
    """Write a NIfTI image in mm and ms, vectors as such."""
    image = nib.Nifti1Image(values, affine)
    image.set_sform(affine, code="scanner")
    image.header.set_xyzt_units("mm", "msec")
    if values.ndim == 5:
        image.header["pixdim"][4], image.header["toffset"] = step, start
        image.header.set_intent("vector", (), "u [um]")
    path.write_bytes(gzip.compress(image.to_bytes(), mtime=0))


def make_scan(folder: Path) -> None:
    """Write the image and its mask: what the scene measures of the truth, with 5% noise; two voxels are lost."""
    folder.mkdir(parents=True, exist_ok=True)
    affine, shape = grid()
    scan, mask = folder / "scan.nii.gz", folder / "mask.nii.gz"
    # First everything that the ball covers; the mask is then what the scanner saw of it.
    save(np.zeros(shape, np.uint8), affine, scan)
    save(np.ones(shape, np.uint8), affine, mask)
    (folder / "scan.toml").write_text((HERE / "scan.toml").read_text(encoding="utf-8"), encoding="utf-8")
    scene = dacore.open_scene(folder / "scan.toml", cache=folder / "cache")
    data, _ = scene.observe(scene.truth[0], noise=NOISE, rng=np.random.default_rng(2))
    f, times = scene.functionals, scene.model.times
    # From places in the scene [cm] to voxels of the image.
    world = np.linalg.inv(scene.builder.observations["scan"].to_scene)
    places = 10 * (f.centres @ world[:3, :3].T + world[:3, 3])
    index = np.rint(np.linalg.solve(affine[:3, :3], (places - affine[:3, 3]).T)).astype(int)
    values = np.zeros((*shape, len(times), 3), np.float32)
    values[(*index, slice(None), f.directions.argmax(axis=1))] = 1e4 * data
    inside = np.zeros(shape, np.uint8)
    inside[tuple(index)] = 1
    values[tuple(index[:, :2])] = np.nan  # two voxels without a signal
    save(values, affine, scan, 1e3 * (times[1] - times[0]), 1e3 * times[0])
    save(inside, affine, mask)
    true = scene.quantities["cavity_pressure"].functionals(scene.model.space)(scene.truth[0].states).mean()
    print(f"{scan}: {int(inside.sum())} voxels, {len(times)} times; the cavity pressure was {true:.0f} dyn/cm^2")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, nargs="?", default=Path("runs/own-data"))
    parser.add_argument("--sensors", action="store_true", help="print sensors.csv")
    given = parser.parse_args()
    if given.sensors:
        print(sensors_csv(), end="")
    else:
        make_scan(given.folder)
