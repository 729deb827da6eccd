"""From reduced trajectories to the background of estimation: POD of coefficients, never of snapshots.

The modes and the prescribed values of the loads together span all trajectories. Orthonormalised, they make
coordinates in which the inner product of each field is the Euclidean one; the POD of the samples there is a
decomposition of an (r_f, r_f) array, whatever the number of samples and steps.
"""

from collections.abc import Mapping

import numpy as np

from dacore.algebra.svd import left_svd
from dacore.core.arrays import Array
from dacore.core.background import Background
from dacore.core.parameters import ParameterSpace
from dacore.core.reduced import ReducedSpace, relative_tails
from dacore.core.space import StateSpace
from dacore.reduction.galerkin import Galerkin

# A load whose values the modes and the other loads hold to this share adds a direction of round-off only.
_SAME = 1e-9


def background_of(
    space: StateSpace,
    galerkin: Galerkin,
    lift_products: Mapping[str, Array],
    states: Array,
    times: Array,
    parameters: ParameterSpace,
    samples: Array,
    tolerance: float,
) -> tuple[Background, Array]:
    """Build the background of reduced trajectories.

    Parameters
    ----------
    space : StateSpace
    galerkin : Galerkin
        Holds the modes.
    lift_products : mapping of str to (r_f, n_loads) array
        Inner products of the modes with the loads' prescribed values.
    states : (r + n_loads, t, K) array
    times : (t,) array [s]
    parameters : ParameterSpace
    samples : (K, n_parameters) array
    tolerance : float
        Relative mean-square error that the POD of each field may leave.

    Returns
    -------
    Background
    onto : (r_b, r + n_loads) array
        From reduced states to the background's coefficients.
    """
    split = galerkin.split
    modes = galerkin.dimension
    bases, rows, reached, start = {}, [], {}, 0
    for name in split.fields:
        size = galerkin.sizes[name]
        extra, change = _lifted(galerkin, space, name, lift_products[name])
        # Coordinates of (a_f, w) in the modes and what the loads add to them.
        local = np.zeros((size + extra.shape[1], states.shape[0]))
        local[:size, start : start + size] = np.eye(size)
        local[:size, modes:] = lift_products[name]
        local[size:, modes:] = change
        start += size
        data = np.tensordot(local, states, axes=1).reshape(len(local), -1)
        vectors, values = left_svd(data)
        tails = relative_tails(values)
        keep = max(int(np.argmax(tails <= tolerance)), 1)
        full = np.zeros((space.layout.block(name).stop - space.layout.block(name).start, keep))
        full[split.free[name]] = galerkin.bases[name] @ vectors[:size, :keep]
        full += extra @ vectors[size:, :keep]
        bases[name] = ReducedSpace(full, values, space.field_product(name, split.kind))
        reached[name] = float(tails[keep])
        rows.append(vectors[:, :keep].T @ local)
    onto = np.concatenate(rows)
    coefficients = np.tensordot(onto, states, axes=1)
    return Background(space, bases, coefficients, times, parameters, samples, split.kind, reached), onto


def _lifted(galerkin: Galerkin, space: StateSpace, name: str, products: Array) -> tuple[Array, Array]:
    """Orthonormal directions (n_field, l) that the prescribed values add to the modes, and their share (l, n_loads)."""
    split = galerkin.split
    free, modes = split.free[name], galerkin.bases[name]
    values, product = split.prescribed[name].copy(), space.field_product(name, split.kind)
    size = np.sqrt(np.maximum(np.einsum("ij,ij->j", values, product @ values), 0.0))
    values[free] -= modes @ products
    # One load after the other, each cleaned again once it has length one: a Gram matrix would see half the digits
    # only, and take the round-off of dependent loads for directions.
    found: list[Array] = []
    for load in np.flatnonzero(size > 0):
        left = values[:, load] / size[load]
        for _ in range(2):
            left[free] -= modes @ (modes.T @ (product @ left)[free])
            for other in found:
                left -= other * (other @ (product @ left))
            length = np.sqrt(max(float(left @ (product @ left)), 0.0))
            if not length > _SAME:
                break
            left /= length
        else:
            found.append(left)
    directions = np.stack(found, axis=1) if found else np.zeros((len(values), 0))
    return directions, np.asarray(directions.T @ (product @ values))
