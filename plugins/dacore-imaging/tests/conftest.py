"""A state space of its own, so that these tests need no finite element library."""

from itertools import permutations, product

import numpy as np
import pytest
from scipy.sparse import csr_array, eye_array

from dacore.core.fields import Field, Layout
from dacore.core.mesh import Mesh, exterior_facets
from dacore.core.space import CellGeometry, StateSpace
from dacore.geometry.interpolate import interpolation_matrix
from dacore.geometry.locate import PointLocator


class MeshSpace(StateSpace):
    """Lagrange fields on a mesh: cells and evaluation; its products are identities."""

    def __init__(self, mesh, fields):
        self.mesh = mesh
        self._layout = Layout(fields, {field.name: len(mesh.nodes(field.order)) for field in fields})
        self.locator = PointLocator(mesh.points, mesh.cells)

    @property
    def layout(self):
        return self._layout

    def scalar_product(self, field, kind="l2"):
        return csr_array(eye_array(self.layout.nodes[field]))

    def evaluation(self, points, field, derivative=None):
        one = self.layout.field(field)
        scalar = interpolation_matrix(self.mesh, self.locator, points, one.order, derivative)
        return self.place(scalar, field, range(one.components))

    def cells(self):
        return CellGeometry(
            self.mesh.points,
            self.mesh.cells,
            {field.name: self.mesh.cell_nodes(field.order) for field in self.fields},
            {field.name: field.order for field in self.fields},
        )

    def state(self, **functions):
        """Interpolate functions of points (n, d), given by field name, with values (n,) or (n, c)."""
        columns = []
        for field in self.fields:
            values = functions[field.name](self.mesh.nodes(field.order)) if field.name in functions else 0.0
            shape = (self.layout.nodes[field.name], field.components)
            values = np.asarray(values, dtype=float)
            columns.append(np.broadcast_to(values[:, None] if values.ndim == 1 else values, shape).T.ravel())
        return np.concatenate(columns)


class PointSpace(MeshSpace):
    """The same without cells: points only."""

    cells = StateSpace.cells


class BoundarySpace(MeshSpace):
    """With means over boundaries, for P1: a facet's weight shared by its vertices."""

    def boundary_mean(self, role, field):
        facets = self.mesh.boundary_facets(role)
        edges = self.mesh.points[facets[:, 1:]] - self.mesh.points[facets[:, :1]]
        area = np.sqrt(np.linalg.det(edges @ np.swapaxes(edges, 1, 2)))
        weights = np.bincount(facets.ravel(), np.repeat(area, facets.shape[1]), minlength=self.layout.nodes[field]) / (
            area.sum() * facets.shape[1]
        )
        return self.place(csr_array(weights[None]), field, range(self.layout.field(field).components))


def _box_mesh(dim, n, lengths, jitter, seed, renumber):
    rng = np.random.default_rng(seed)
    counts = np.broadcast_to(np.asarray(n), (dim,))
    lengths = np.broadcast_to(np.asarray(lengths, dtype=float), (dim,))
    grid = np.stack(np.meshgrid(*[np.arange(k + 1) for k in counts], indexing="ij"), axis=-1).reshape(-1, dim)
    inner = ((grid > 0) & (grid < counts)).all(axis=1)
    points = (grid + rng.uniform(-jitter, jitter, grid.shape) * inner[:, None]) * lengths / counts
    strides = np.array([np.prod(counts[a + 1 :] + 1, dtype=int) for a in range(dim)])
    corners = np.array(list(product(*[range(k) for k in counts]))) @ strides
    cells = np.concatenate(
        [corners[:, None] + np.concatenate([[0], np.cumsum(strides[list(o)])]) for o in permutations(range(dim))]
    )
    if renumber:
        new = rng.permutation(len(points))
        moved = np.empty_like(points)
        moved[new] = points
        points, cells = moved, rng.permuted(new[cells], axis=1)
    negative = np.linalg.det(points[cells[:, 1:]] - points[cells[:, :1]]) < 0
    cells[negative, :2] = cells[negative, 1::-1]
    facets = exterior_facets(cells)
    tags = np.where(np.isclose(points[facets][:, :, 0], 0.0).all(axis=1), 1, 2)
    return Mesh(points, cells, facets, tags, {"left": 1, "rest": 2})


@pytest.fixture(scope="session")
def make_space():
    """Factory of state spaces on a box [0, lengths] cut in n^d cubes, inner points jittered."""

    def make(dim=3, n=3, lengths=3.0, order=1, jitter=0.25, seed=0, renumber=False, kind=MeshSpace):
        mesh = _box_mesh(dim, n, lengths, jitter, seed, renumber)
        fields = [Field("u", dim, order, "cm"), Field("p", 1, 1, "dyn/cm^2"), Field("c", 2, 1, "1")]
        return kind(mesh, fields)

    return make


@pytest.fixture(scope="session")
def point_space(make_space):
    """Factory of spaces that have no cells."""
    return lambda **settings: make_space(kind=PointSpace, **settings)


@pytest.fixture(scope="session")
def boundary_space(make_space):
    """Factory of spaces with boundary means."""
    return lambda **settings: make_space(kind=BoundarySpace, **settings)
