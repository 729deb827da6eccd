"""A small ball for tests of studies, trained by a reduced model in a second, and means to count what is computed."""

from collections import Counter

from dacore import open_scene
from dacore.workflow import trained

SCENE = """
title = "Tiny ball"

[domain]
kind = "ball"
edge = 2.5

[physics]
kind = "biot"

[time]
step = 5e-4
steps = 6

[training]
samples = 16
sampling = "latin_hypercube"
method = "reduced"
reduction = 1e-2

[observation.slice]
kind = "voxels"
size = 1.5
slices = [{ axis = "z", position = 6.5 }]
coverage = 0.6

[quantity.cavity_pressure]
kind = "boundary_mean"
role = "ventricles"
field = "p"

[noise]
levels = [0.0, 0.1]

[estimator.pbdw]
kind = "pbdw"
n = 3
spaces = "cycle"
centring = "none"
weights = { p = 1e-15 }

[estimator.mv]
kind = "minimum_variance"

[validation]
cases = 3
contrasts = [{ field = "p", minus = "p_csf" }]
"""


def opened(folder, more="", changes=(), cache=None, **options):
    """The small scene with further tables; scenes of one folder share a cache."""
    path = folder / f"tiny{abs(hash(more))}.toml"
    path.write_text(SCENE + more, encoding="utf-8")
    return open_scene(path, changes, cache or folder / "cache", **options)


def found(session, name="s"):
    """What a study found."""
    return session.runner[f"study.{name}"]


def counted(monkeypatch):
    """Count trainings and sets of unseen cases that are solved from now on."""
    counts = Counter()
    for name in ("train_reduced", "solve_all", "compress"):
        monkeypatch.setattr(trained, name, _counting(counts, name, getattr(trained, name)))
    return counts


def _counting(counts, name, real):
    def wrapped(*args, **options):
        counts[name] += 1
        return real(*args, **options)

    return wrapped
