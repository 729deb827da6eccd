"""A poroelastic rod without any finite element library: an affine model whose parameters have ranges."""

from operator import itemgetter

import numpy as np
from scipy.sparse import coo_array, csr_array, diags_array

from dacore.core.fields import Field, Layout
from dacore.core.model import AffineModel, AffineTerm, Load
from dacore.core.parameters import Parameter, ParameterSpace
from dacore.core.space import StateSpace
from dacore.dynamics.profiles import Constant, Sine

RANGES = {
    "rho": (1.0, 1.0),
    "modulus": (4.0, 80.0),
    "alpha": (0.8, 0.8),
    "storage": (0.01, 0.05),
    "mobility": (0.003, 0.5),
    "pull": (-2.0, -2.0),
    "inflow": (4.0, 6.0),
    "outflow": (1.0, 1.0),
}


class RodSpace(StateSpace):
    """u and p on n points of [0, 1], in the mass matrix of linear elements."""

    def __init__(self, n):
        self.n = n

    @property
    def layout(self):
        return Layout((Field("u", 1), Field("p", 1)), {"u": self.n, "p": self.n})

    def scalar_product(self, field, kind="l2"):
        mass, stiffness, _ = matrices(self.n)
        return mass if kind == "l2" else csr_array(mass + stiffness)


def matrices(n):
    """Mass, stiffness and ∫ a b' of linear elements."""
    h = 1.0 / (n - 1)
    weights = np.full(n, 2.0)
    weights[[0, -1]] = 1.0
    mass = h / 6 * diags_array([np.ones(n - 1), 2 * weights, np.ones(n - 1)], offsets=[-1, 0, 1])
    stiffness = diags_array([-np.ones(n - 1), weights, -np.ones(n - 1)], offsets=[-1, 0, 1]) / h
    ends = np.zeros(n)
    ends[[0, -1]] = -0.5, 0.5
    derivative = diags_array([np.full(n - 1, -0.5), ends, np.full(n - 1, 0.5)], offsets=[-1, 0, 1])
    return csr_array(mass), csr_array(stiffness), csr_array(derivative)


def place(matrix, row, column):
    """Put an (n, n) block for u (0) and p (1) into a (2 n, 2 n) matrix."""
    block, n = coo_array(matrix), matrix.shape[0]
    entries = (block.data, (block.row + row * n, block.col + column * n))
    return csr_array(entries, shape=(2 * n, 2 * n))


def rod(n=60, ranges=None, **changes):
    """Held at the left, pulled at the right, with given pressures at both ends; `changes` replaces parts."""
    mass, stiffness, derivative = matrices(n)

    def term(name, matrix, row, column):
        return AffineTerm(name, place(matrix, row, column), itemgetter(name))

    constrained, flow = np.zeros(2 * n, dtype=bool), np.arange(2 * n) >= n
    constrained[[0, n, 2 * n - 1]] = True
    none = np.zeros(2 * n)
    force, left, right = np.eye(2 * n)[[n - 1, n, 2 * n - 1]]
    every = {**RANGES, **(ranges or {})}
    parts = {
        "space": RodSpace(n),
        "parameters": ParameterSpace(tuple(Parameter(name, "1", *ends) for name, ends in every.items())),
        "second_order": (term("rho", mass, 0, 0),),
        "first_order": (term("storage", mass, 1, 1), term("alpha", derivative, 1, 0)),
        "zeroth_order": (
            term("modulus", stiffness, 0, 0),
            term("alpha", derivative, 0, 1),
            term("mobility", stiffness, 1, 1),
        ),
        "loads": (
            Load("pull", itemgetter("pull"), Sine(2.0), force, none),
            Load("inflow", itemgetter("inflow"), Constant(), none, left),
            Load("outflow", itemgetter("outflow"), Constant(), none, right),
        ),
        "constrained": constrained,
        "antisymmetric": flow,
    }
    return AffineModel(**{**parts, **changes})
