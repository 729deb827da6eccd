"""Data of an unseen case of the ball, written into files as somebody might have them."""

import csv
from pathlib import Path

import nibabel as nib
import numpy as np

TOY = Path(__file__).resolve().parents[1] / "examples" / "toy" / "ball.toml"
SMALL = ("training.samples=12", "time.steps=4", "time.step=2e-3", "noise.levels=[0.0]", "validation.cases=2")


SMALLER = np.diag([0.1, 0.1, 0.1, 1.0])


def volume(scene, data, pad=1):
    """Displacements [um] of the measured slice as an image (x, y, z, t, c), and its affine [mm]."""
    f = scene.functionals
    low = f.centres.min(axis=0) - [pad, pad, 0]
    index = np.round(f.centres - low).astype(int)
    shape = index.max(axis=0) + np.array([pad + 1, pad + 1, 1])
    values = np.zeros((*shape, data.shape[1], 3), np.float32)
    for k in range(f.count):
        values[tuple(index[k])][:, f.directions[k].argmax()] = 1e4 * data[k]
    affine = np.diag([10.0, 10.0, 10.0, 1.0])
    affine[:3, 3] = 10.0 * low
    return values, affine


def save(path, values, affine, text="u [um]", units=("mm", "msec")):
    image = nib.Nifti1Image(values, affine)
    image.header.set_xyzt_units(*units)
    if values.ndim > 3:
        image.header["pixdim"][4], image.header["toffset"] = 2.0, 2.0
    image.header["descrip"] = text.encode()
    nib.save(image, path)
    return path


def write_csv(path, scene, data, rows=None, unit="um", scale=1e4):
    f = scene.functionals
    with path.open("w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(["x [mm]", "y [mm]", "z [mm]", "component", "time [ms]", f"value [{unit}]"])
        for k in range(f.count) if rows is None else rows:
            for t, moment in enumerate(scene.model.times):
                place = [f"{10 * x:.6g}" for x in f.centres[k]]
                writer.writerow(
                    [*place, "xyz"[f.directions[k].argmax()], f"{1e3 * moment:.6g}", repr(scale * data[k, t])]
                )
    return path


def close(result, data, tolerance):
    steps, mask = result.used.steps, result.used.mask
    assert np.abs(result.used.values[mask] - data[mask][:, steps]).max() <= tolerance * np.abs(data).max()


def error_of(scene, estimate, states, field):
    block = scene.model.space.layout.block(field)
    return np.linalg.norm(estimate[block] - states[block]) / np.linalg.norm(states[block])


def shift(row, column, value):
    out = np.zeros((4, 4))
    out[row, column] = value
    return out


def turned_by(angle):
    out = np.eye(4)
    out[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    return out
