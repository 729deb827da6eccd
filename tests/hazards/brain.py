"""The demo's brain on elements of every kind, against a mesh of a hundred thousand nodes."""

import time
from dataclasses import dataclass

import numpy as np

from dacore.core.timegrid import TimeGrid
from dacore.dynamics.march import MarchedModel
from dacore.geometry.locate import PointLocator
from dacore.plugins.registry import load
from dacore_biot.model import Biot
from tests.backends import backend

GRID = TimeGrid(5e-4, 40)
P_CSF = 1e4
KINDS = {
    "order 1": {},
    "order 1, lumped": {"stabilization": "lumped"},
    "order 1, projected": {"stabilization": "projected"},
    "u of order 2": {"displacement_order": 2},
}
REFERENCE = ("100k", "order 1, projected")


@dataclass(frozen=True)
class Found:
    """Fields at the sample points, extremes of the first pressures, CPU seconds of one solve, unknowns."""

    displacement: np.ndarray
    excess: np.ndarray
    lowest: float
    highest: float
    seconds: float
    unknowns: int


class Brain:
    """Meshes of several sizes, and points that are inside all of them."""

    def __init__(self, sizes):
        self.meshes = {size: load().get("domain", "brain")(nodes=size).mesh() for size in sizes}
        first = self.meshes[sizes[0]]
        shares = np.random.default_rng(0).dirichlet(np.ones(4), len(first.cells))
        points = np.einsum("ck,ckd->cd", shares, first.points[first.cells])
        inside = np.ones(len(points), dtype=bool)
        for mesh in self.meshes.values():
            inside &= PointLocator(mesh.points, mesh.cells).locate(points, outside="mark")[0] >= 0
        self.points, self.volumes = points[inside], first.volumes[inside]

    def solve(self, size, kind):
        """A cycle at the middle of the ranges, kappa, E at their geometric middle."""
        mesh = self.meshes[size]
        discretization = {}

        def discretize(fields):
            discretization["last"] = backend("skfem").discretize(mesh, fields)
            return discretization["last"]

        model = MarchedModel(Biot(**KINDS[kind]).build(discretize), GRID)
        theta = {p.name: 0.5 * (p.low + p.high) for p in model.parameters.parameters}
        theta |= {"kappa": 10**-8.5, "E": 10**5.5}
        assert model.analysis is not None
        begin = time.process_time()
        states = model.solve(theta).states
        seconds = time.process_time() - begin
        layout, forms = model.space.layout, discretization["last"]
        p = states[layout.block("p")]
        at_u, at_p = forms.evaluation(self.points, "u"), forms.evaluation(self.points, "p")
        u = np.stack([at_u @ states[layout.component("u", axis)] for axis in range(3)])
        lowest, highest = p[:, :2].min(), p[:, :2].max()
        return Found(u, at_p @ p - P_CSF, lowest, highest, seconds, layout.n_dofs)

    def errors(self, found, exact):
        """Relative L² errors over the cycle of u and p − p_csf, and of p − p_csf at its end."""

        def size(field):
            return np.sqrt(np.sum(self.volumes[:, None] * field**2))

        excess = found.excess - exact.excess
        return (
            size(np.linalg.norm(found.displacement - exact.displacement, axis=0))
            / size(np.linalg.norm(exact.displacement, axis=0)),
            size(excess) / size(exact.excess),
            size(excess[:, -1:]) / size(exact.excess[:, -1:]),
        )
