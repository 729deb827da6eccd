"""Marching in extended precision: dense, straight from the equations, without any of dacore's solvers or schemes.

`numpy.longdouble` has 64 bits of mantissa on x86 and 113 on 64-bit ARM; where it is no more than a double, elimination
with pivoting in double precision is still the better of the two.
"""

import numpy as np

Wide = np.longdouble


def dense(terms, theta):
    return sum(Wide(term.coefficient(theta)) * term.matrix.toarray().astype(Wide) for term in terms)


def solve(matrix, right):
    """Gaussian elimination with partial pivoting of rows scaled to their largest entry."""
    size = np.abs(matrix).max(axis=1)
    work = np.concatenate([matrix, right[:, None]], axis=1) / size[:, None]
    n = len(right)
    for k in range(n):
        best = k + int(np.argmax(np.abs(work[k:, k])))
        work[[k, best]] = work[[best, k]]
        work[k + 1 :] -= np.outer(work[k + 1 :, k] / work[k, k], work[k])
    out = np.zeros(n, dtype=Wide)
    for k in range(n - 1, -1, -1):
        out[k] = (work[k, n] - work[k, k + 1 : n] @ out[k + 1 :]) / work[k, k]
    return out


def march(model, theta, step, steps):
    """β = 1/2, γ = 1 with backward Euler for the first-order terms, from rest: states (n_dofs, steps)."""
    mass, damping, stiffness = (
        dense(terms, theta) for terms in (model.second_order, model.first_order, model.zeroth_order)
    )
    tau, free = Wide(step), np.flatnonzero(~model.constrained)
    matrix = 2 / tau**2 * mass + damping / tau + stiffness
    value = np.zeros(model.space.n_dofs, dtype=Wide)
    rate, out = value.copy(), []
    for k in range(steps):
        force, new = value * 0, value * 0
        for load in model.loads:
            factor = Wide(load.amplitude(theta)) * Wide(load.profile(np.array([(k + 1) * step]))[0])
            force, new = force + factor * load.force, new + factor * load.prescribed
        right = force + 2 / tau**2 * (mass @ (value + tau * rate)) + damping @ value / tau - matrix @ new
        new[free] = solve(matrix[np.ix_(free, free)], right[free])
        rate = rate + 2 / tau * (new - value - tau * rate)  # γ = 1: the rate takes the new acceleration alone
        value = new
        out.append(value)
    return np.stack(out, axis=1)
