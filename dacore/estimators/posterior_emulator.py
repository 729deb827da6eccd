"""A parametric map as polynomials on the coordinates of its trajectories: thousands of trajectories in milliseconds.

Trajectories of all training samples, weighted so that the fields count alike, span a space of a few hundred
space–time modes; nodes outside it add their own. Parameters in which trajectories are affine, as they are in the
amplitudes of loads, are found by trying, and kept apart: f(x, a) = f₀(x) + Σ_l a_l f_l(x), with f₀ and f_l
interpolated over the others (`dacore.estimators.posterior_interpolant`).
"""

import logging
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from dacore.core.arrays import Array, IntArray
from dacore.core.background import Background, ParametricMap
from dacore.estimators.posterior_coordinates import Coordinates
from dacore.estimators.posterior_interpolant import Interpolant, interpolate
from dacore.estimators.posterior_smooth import fitted

logger = logging.getLogger(__name__)

# Trajectories that differ from an affine function of a parameter by less than this share are affine in it.
_AFFINE = 1e-8
# Share of the tolerance that modes of trajectories may leave.
_MODES = 3e-2
# Errors above this share of what the training set varies are worth a warning.
_WORRYING = 1e-2
_CHUNK = 64
# Training samples whose whole marches say which modes the nodes need.
_PLACES = 24


@dataclass(frozen=True, eq=False)
class Emulator:
    """Trajectories of a background's forward map, from coordinates of its parameters.

    Parameters
    ----------
    coordinates : Coordinates
    curved, affine : int arrays
        Columns of the coordinates in which trajectories are polynomials, and those in which they are affine.
    mean : (r, t) array
        Of the training set.
    scale : (r,) array
        One over the root-mean-square size of what each row's field varies in the training set.
    modes : (r, t, q) array
        Of scaled trajectories less their mean, orthonormal over space and time.
    interpolant : Interpolant
        Of (1 + number of affine parameters) · q values.
    training : (K, p) array
        Coordinates of the training samples.
    missed : (q, K) array
        What the emulation misses of the modes' coefficients of each training sample, as if it were not one of them.
    errors : (r, t, K) array
        The same as trajectories, with what the modes leave.
    left : float
        Largest surplus that was not refined, relative to what the training set varies.
    """

    coordinates: Coordinates
    curved: IntArray
    affine: IntArray
    mean: Array
    scale: Array
    modes: Array
    interpolant: Interpolant
    training: Array
    missed: Array
    errors: Array
    left: float

    @property
    def q(self) -> int:
        """Number of modes."""
        return int(self.modes.shape[2])

    def blocks(self, onto: Array | None = None) -> Array:
        """Polynomial weights (1 + affine, n, d) of what is `onto` (d, q) of the modes' coefficients, all for None."""
        n = len(self.interpolant.indices)
        blocks = self.interpolant.weights.reshape(n, 1 + len(self.affine), self.q).swapaxes(0, 1)
        return blocks if onto is None else blocks @ onto.T

    def basis(self, x: Array) -> Array:
        """Polynomials (k, n) of the curved parameters at coordinates (k, p)."""
        return self.interpolant.basis(x[:, self.curved])

    def values(self, x: Array, blocks: Array) -> Array:
        """Values (k, d) at coordinates (k, p), with weights from `blocks`."""
        basis = self.basis(x)
        out = basis @ blocks[0]
        for column, block in zip(self.affine, blocks[1:], strict=True):
            out += x[:, column, None] * (basis @ block)
        return np.asarray(out)

    def slopes(self, x: Array, blocks: Array) -> tuple[Array, Array]:
        """Values (k, d) and derivatives (k, d, p) by the coordinates."""
        basis, along = self.interpolant.slopes(x[:, self.curved])
        out = np.empty((len(x), blocks.shape[2], x.shape[1]))
        value = basis @ blocks[0]
        for column, block in zip(self.affine, blocks[1:], strict=True):
            out[:, :, column] = basis @ block
            value += x[:, column, None] * out[:, :, column]
        for column, part in zip(self.curved, along, strict=True):
            out[:, :, column] = part @ blocks[0]
            for other, block in zip(self.affine, blocks[1:], strict=True):
                out[:, :, column] += x[:, other, None] * (part @ block)
        return value, out

    def mean_values(self, x: Array, weights: Array, blocks: Array) -> Array:
        """Weighted mean (d,) of the values at coordinates (k, p), without making each of them."""
        basis = self.basis(x)
        out = (weights @ basis) @ blocks[0]
        for column, block in zip(self.affine, blocks[1:], strict=True):
            out += ((weights * x[:, column]) @ basis) @ block
        return np.asarray(out)

    def lift(self, coefficients: Array) -> Array:
        """Trajectories (r, t, k) in the background's bases, of coefficients (q, k) of the modes."""
        out = np.tensordot(self.modes, coefficients, axes=1)
        out /= self.scale[:, None, None]
        out += self.mean[:, :, None]
        return np.asarray(out)

    def project(self, on_modes: Array) -> tuple[Array, Array]:
        """Turn weights (s, t, r) on trajectories to weights (s, q) on the modes and an offset (s,)."""
        scaled = np.einsum("str,r->srt", on_modes, 1.0 / self.scale).reshape(len(on_modes), -1)
        offset = np.einsum("str,rt->s", on_modes, self.mean)
        return scaled @ self.modes.reshape(-1, self.q), np.asarray(offset)


def emulate(background: Background, tolerance: float, most: int) -> Emulator:
    """Emulate the forward map of a background; once for each background and setting.

    Parameters
    ----------
    background : Background
    tolerance : float
        Largest surplus of a polynomial that may be left, relative to what the training set varies.
    most : int
        Nodes at most.

    Raises
    ------
    CapabilityError
        If the background has no forward map.
    """
    forward = forward_of(background)
    known = _MADE.setdefault(background, {})
    if (tolerance, most) not in known:
        known[tolerance, most] = _Maker(background, forward, tolerance, most).run()
    return known[tolerance, most]


def packed(emulator: Emulator) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return an emulator as named arrays and facts, without what its background knows."""
    arrays = {
        "modes": emulator.modes.reshape(-1, emulator.q), "missed": emulator.missed,
        "indices": emulator.interpolant.indices, "weights": emulator.interpolant.weights,
    }  # fmt: skip
    return arrays, {"affine": emulator.affine.tolist(), "left": emulator.left}


def unpacked(
    arrays: Mapping[str, Array], facts: Mapping[str, Any], background: Background, tolerance: float, most: int
) -> None:
    """Take an emulator of `packed` for that of a background and settings, unless one is there.

    Raises
    ------
    KeyError, ValueError
        If it is not whole, or of another background.
    """
    known = _MADE.setdefault(background, {})
    if (tolerance, most) in known:
        return
    frame = _Frame(background)
    frame.modes, frame.affine = arrays["modes"], np.array(facts["affine"], dtype=np.int64)
    frame.curved = np.setdiff1d(frame.curved, frame.affine)
    interpolant = Interpolant(arrays["indices"].astype(np.int64), arrays["weights"])
    q = frame.modes.shape[1]
    expected = (
        ("modes", (len(frame.scaled), q)), ("missed", (q, background.n_samples)),
        ("indices", (len(interpolant.indices), len(frame.curved))),
        ("weights", (len(interpolant.indices), (1 + len(frame.affine)) * q)),
    )  # fmt: skip
    for name, shape in expected:
        if arrays[name].shape != shape:
            raise ValueError(f"{name}: got shape {arrays[name].shape}, expected {shape}")
    known[tolerance, most] = frame.made(interpolant, arrays["missed"], float(facts["left"]))


def forward_of(background: Background) -> ParametricMap:
    """Return the forward map of a background; CapabilityError if it has none."""
    return background.parametric("posterior: this training left no map from parameters to trajectories")


# Masks, steps and other functionals need the same emulator; it goes when its background goes.
_MADE: "WeakKeyDictionary[Background, dict[tuple[float, int], Emulator]]" = WeakKeyDictionary()


def _spread(x: Array, count: int) -> IntArray:
    """Rows of points (k, p) that are far from each other, the first in the middle."""
    chosen = [int(np.abs(x).max(axis=1).argmin())]
    away = np.linalg.norm(x - x[chosen[0]], axis=1)
    while len(chosen) < min(count, len(x)):
        chosen.append(int(away.argmax()))
        away = np.minimum(away, np.linalg.norm(x - x[chosen[-1]], axis=1))
    return np.array(chosen, dtype=np.int64)


class _Frame:
    """What an emulator takes from its background: coordinates, mean, scales and the training set."""

    def __init__(self, background: Background) -> None:
        self.background = background
        self.coordinates = Coordinates.of(background.parameters)
        self.training = self.coordinates.of_points(background.samples)
        self.mean = background.mean()
        self.scale = np.ones(background.dimension)
        for field in background.space.fields:
            rows = background.block(field.name)
            varied = background.coefficients[rows] - self.mean[rows][:, :, None]
            size = float(np.sqrt((varied**2).sum() / background.n_samples))
            if size > 0:
                self.scale[rows] = 1.0 / size
        self.scaled = self._scaled(background.coefficients)
        p = len(self.coordinates.free)
        self.affine, self.curved = np.arange(0), np.arange(p)
        self.modes = np.zeros((len(self.scaled), 0))

    def made(self, interpolant: Interpolant, missed: Array, left: float) -> Emulator:
        """Return the emulator of what is found."""
        modes = np.ascontiguousarray(self.modes)
        errors = modes @ missed - (self.scaled - modes @ (modes.T @ self.scaled))
        r, t = self.mean.shape
        errors = errors.reshape(r, t, -1) / self.scale[:, None, None]
        return Emulator(
            self.coordinates, self.curved, self.affine, self.mean, self.scale, modes.reshape(r, t, -1), interpolant,
            self.training, missed, errors, left,
        )  # fmt: skip

    def _scaled(self, coefficients: Array) -> Array:
        out = (coefficients - self.mean[:, :, None]) * self.scale[:, None, None]
        return np.asarray(out.reshape(-1, coefficients.shape[2]))


class _Maker(_Frame):
    """Finds the emulator of a background's forward map."""

    def __init__(self, background: Background, forward: ParametricMap, tolerance: float, most: int) -> None:
        super().__init__(background)
        self.tolerance, self.most = tolerance, most
        # Nodes are many: the map on fewer modes makes them; what that misses is found on the training set, below.
        self.forward = forward.coarse(background.samples[_spread(self.training, _PLACES)], tolerance)
        self.floor = _MODES * tolerance
        self.modes = self._modes(self.scaled, self.floor * np.sqrt(background.n_samples))
        p = len(self.coordinates.free)
        self.affine = self._find_affine()
        self.curved = np.setdiff1d(np.arange(p), self.affine)

    def run(self) -> Emulator:
        parts = 1 + len(self.affine)

        def size(surplus: Array) -> Array:
            return np.asarray(np.sqrt((surplus.reshape(len(surplus), parts, -1) ** 2).sum(axis=(1, 2))))

        if len(self.curved):
            interpolant, left = interpolate(self._nodes, size, len(self.curved), self.tolerance, self.most, self._wider)
        else:
            nothing = np.zeros((1, 0))
            interpolant, left = Interpolant(np.zeros((1, 0), dtype=np.int64), self._nodes(nothing)), 0.0
        nodes = len(interpolant.indices)
        missed = self._values(interpolant) - self.modes.T @ self.scaled
        smooth, rest = fitted(self.training[:, self.curved], self.training[:, self.affine], missed.T)
        if smooth is not None:
            interpolant = interpolant.plus(smooth.indices, -smooth.weights)
        made = self.made(interpolant, np.ascontiguousarray(rest.T), left)
        spread = float(np.sqrt(((made.errors * self.scale[:, None, None]) ** 2).sum() / self.background.n_samples))
        if spread > _WORRYING:
            logger.warning(
                "posterior: the emulated trajectories are off by %.1g of what the training set varies after %d solves; "
                "raise solves", spread, nodes,
            )  # fmt: skip
        return made

    def _values(self, interpolant: Interpolant) -> Array:
        """Coefficients (q, K) of the modes of the training samples, as emulated."""
        basis = interpolant.basis(self.training[:, self.curved])
        amplitudes = np.column_stack([np.ones(len(basis)), self.training[:, self.affine]])
        parts = (basis @ interpolant.weights).reshape(len(basis), amplitudes.shape[1], -1)
        return np.asarray(np.einsum("ka,kaq->qk", amplitudes, parts))

    def _modes(self, scaled: Array, allowed: float) -> Array:
        """Orthonormal directions of columns (n, k) that leave no more than `allowed` of all of them together."""
        squares, vectors = np.linalg.eigh(scaled.T @ scaled)
        squares = np.maximum(squares, 0.0)
        keep = (np.cumsum(squares) > allowed**2) & (squares > 1e-14 * squares[-1])
        if not keep.any():
            return np.zeros((len(scaled), 0))
        found, _ = np.linalg.qr(scaled @ vectors[:, keep])
        return np.asarray(found)

    def _solve(self, x: Array) -> Array:
        """Scaled trajectories (r · t, k) at coordinates (k, p), in pieces."""
        return self._scaled(self.forward.coefficients(self.coordinates.points(x)))

    def _find_affine(self) -> IntArray:
        """Columns in all of which trajectories are affine at once, wherever the other parameters are."""
        p = len(self.coordinates.free)
        candidates = [d for d in range(p) if not self.coordinates.logarithmic[d]]
        # A place without symmetry, and steps of different lengths, so that nothing cancels.
        centre = 0.37 * np.cos(1.0 + 2.0 * np.arange(p))

        def at(steps: dict[int, float]) -> Array:
            x = centre.copy()
            for d, step in steps.items():
                x[d] += step
            return self._solve(x[None])[:, 0]

        base = at({})
        size = float(np.linalg.norm(base)) or 1.0
        single = {d: at({d: 0.5}) - base for d in candidates}
        affine = []
        for d in candidates:
            bent = at({d: -0.4}) - base + 0.8 * single[d]
            if np.linalg.norm(bent) <= _AFFINE * max(size, float(np.linalg.norm(single[d]))):
                affine.append(d)
        # Two that multiply each other are not affine together.
        for one, other in combinations(tuple(affine), 2):
            if one in affine and other in affine:
                both = at({one: 0.5, other: 0.5}) - base - single[one] - single[other]
                if np.linalg.norm(both) > _AFFINE * size:
                    affine.remove(other)
        return np.array(affine, dtype=np.int64)

    def _nodes(self, nodes: Array) -> Array:
        """Coefficients (k, (1 + affine) · q) at nodes (k, curved) of trajectories and their affine parts."""
        p, parts = len(self.coordinates.free), 1 + len(self.affine)
        out: list[Array] = []
        for first in range(0, len(nodes), _CHUNK):
            some = nodes[first : first + _CHUNK]
            x = np.zeros((len(some), parts, p))
            x[:, :, self.curved] = some[:, None]
            for part, column in enumerate(self.affine, start=1):
                x[:, part, column] = 1.0
            states = self._solve(x.reshape(-1, p)).reshape(-1, len(some), parts)
            states[:, :, 1:] -= states[:, :, :1]
            out.append(self._coefficients(states))
        q = self.modes.shape[1]
        padded = [np.concatenate([c, np.zeros((len(c), parts, q - c.shape[2]))], axis=2) for c in out]
        return np.concatenate(padded).reshape(len(nodes), parts * q)

    def _coefficients(self, states: Array) -> Array:
        """Coefficients (k, parts, q) of states (r · t, k, parts); what the modes leave of them enters the modes."""
        flat = states.reshape(len(states), -1)
        left = flat - self.modes @ (self.modes.T @ flat)
        if (np.linalg.norm(left, axis=0) > self.floor).any():
            # Cleaned once more, for round-off; the modes there were stay as they are.
            news = self._modes(left, self.floor)
            news, _ = np.linalg.qr(news - self.modes @ (self.modes.T @ news))
            self.modes = np.concatenate([self.modes, news], axis=1)
        return (self.modes.T @ flat).T.reshape(*states.shape[1:], -1)

    def _wider(self, weights: Array, width: int) -> Array:
        """Weights (n, parts · q) of fewer modes than there are now, as (n, width)."""
        parts = 1 + len(self.affine)
        old = weights.reshape(len(weights), parts, -1)
        out = np.zeros((len(weights), parts, width // parts))
        out[:, :, : old.shape[2]] = old
        return out.reshape(len(weights), width)
