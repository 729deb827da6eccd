"""Which components or directions of a field a sensor measures."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array, vstack

from dacore.core.arrays import Array, Sparse
from dacore.core.space import StateSpace
from dacore.errors import ShapeError
from dacore_imaging.grid import Axis, axis_number

_UNIT = 1e-6


@dataclass(frozen=True, eq=False)
class Measured:
    """One number measured of a field at each site: Σ_c weights[c] · component c.

    Parameters
    ----------
    name : str
        What a label calls it: "u_y", "p".
    weights : (components,) array
    direction : (d,) array
        Unit vector; zeros if the field is no vector field of space.
    """

    name: str
    weights: Array
    direction: Array


def measured(
    space: StateSpace,
    field: str,
    components: Sequence[Axis],
    directions: Sequence[Sequence[float]],
    dim: int,
) -> list[Measured]:
    """What is measured of `field`: given components, given directions, or else every component.

    Raises
    ------
    CapabilityError
        If the space has no such field.
    ShapeError
        If there is no such component, or directions are asked of a field that is no vector of space.
    """
    n = space.layout.field(field).components
    is_vector = n == dim
    if directions:
        if not is_vector:
            raise ShapeError(f"directions: field {field} has {n} components, expected {dim}; give components instead")
        vectors = np.array(_checked_directions(directions, dim))
        names = [f"{field}_[{', '.join(f'{value:.3g}' for value in vector)}]" for vector in vectors]
        return [Measured(name, vector, vector) for name, vector in zip(names, vectors, strict=True)]
    numbers = [_component(field, component, n, is_vector) for component in components] or list(range(n))
    if len(set(numbers)) < len(numbers):
        raise ShapeError(f"components of {field}: got {list(components)}, expected none twice")
    out = []
    for number in numbers:
        weights = np.eye(n)[number]
        suffix = "" if n == 1 else f"_{'xyz'[number]}" if is_vector else f"_{number}"
        out.append(Measured(f"{field}{suffix}", weights, weights if is_vector else np.zeros(dim)))
    return out


def place(space: StateSpace, scalar: Sparse, field: str, what: Sequence[Measured]) -> Sparse:
    """Scalar functionals (p, n_nodes) of each measured number: (p · len(what), n_dofs), one number after the other."""
    blocks = []
    for one in what:
        used = np.flatnonzero(one.weights)
        parts = [one.weights[c] * space.place(scalar, field, [int(c)]) for c in used]
        blocks.append(sum(parts[1:], start=parts[0]))
    return csr_array(vstack(blocks, format="csr"))


def stack_sites(what: Sequence[Measured], centres: Array) -> tuple[tuple[str, ...], Array, Array]:
    """Labels, centres and directions of the rows of `place` for sites at `centres` (p, d)."""
    places = ["(" + ", ".join(f"{value + 0.0:.6g}" for value in centre) + ")" for centre in centres]
    labels = tuple(f"{one.name} @ {where}" for one in what for where in places)
    directions = np.repeat(np.array([one.direction for one in what]), len(centres), axis=0)
    return labels, np.tile(centres, (len(what), 1)), directions


def unit_directions(directions: Sequence[Sequence[float]]) -> tuple[tuple[float, ...], ...]:
    """Directions as tuples of unit length; ShapeError if one is not a unit vector of 2 or 3 numbers."""
    return tuple(tuple(vector) for vector in _checked_directions(directions, None))


def _checked_directions(directions: Sequence[Sequence[float]], dim: int | None) -> list[list[float]]:
    out = []
    for direction in directions:
        vector = np.asarray(direction, dtype=np.float64)
        fits = vector.shape in ([(2,), (3,)] if dim is None else [(dim,)])
        if not fits or not abs(np.linalg.norm(vector) - 1.0) <= _UNIT:
            wanted = "2 or 3" if dim is None else str(dim)
            raise ShapeError(f"directions: got {list(direction)}, expected a unit vector of {wanted} numbers")
        out.append((vector / np.linalg.norm(vector)).tolist())
    return out


def _component(field: str, component: Axis, n: int, is_vector: bool) -> int:
    if is_vector:
        return axis_number(f"component of {field}", component, n)
    if isinstance(component, bool) or not isinstance(component, int) or not 0 <= component < n:
        raise ShapeError(f"component of {field}: got {component!r}, expected 0 to {n - 1}")
    return component
