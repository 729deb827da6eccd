"""What data can tell of parameters near a point: Fisher information, its bounds, and directions nobody can see.

Derivatives are differences of the forward map itself, not of an emulation. The bounds (Cramér and Rao) hold for
unbiased estimates; with the prior's information added they are the local deviations of a posterior.
"""

from dataclasses import dataclass

import numpy as np

from dacore.core.arrays import Array, IntArray
from dacore.core.background import Background
from dacore.core.estimator import check_scale, observed_steps, weights_of
from dacore.core.noise import NoiseModel
from dacore.core.observation import Functionals
from dacore.core.quantity import QuantityOfInterest
from dacore.errors import ShapeError
from dacore.estimators.posterior_coordinates import Coordinates
from dacore.estimators.posterior_emulator import forward_of

# Half-step of differences as a share of half the range: errors of the second order, far from round-off.
_STEP = 1e-3


@dataclass(frozen=True, eq=False)
class Information:
    """Fisher information at k points, with parameters in units of their prior's standard deviation.

    Parameters
    ----------
    background : Background
    coordinates : Coordinates
    matrices : (k, p, p) array
    slopes : (r, t, k, p) array
        Derivatives of the trajectories.
    """

    background: Background
    coordinates: Coordinates
    matrices: Array
    slopes: Array

    @property
    def names(self) -> tuple[str, ...]:
        """Names (p) of the parameters that vary."""
        return self.coordinates.names

    def covariance(self, prior: bool = True) -> Array:
        """Bound (k, p, p) on covariances, in units of the prior; infinite without a prior where nothing is seen."""
        p = self.matrices.shape[1]
        total = self.matrices + (np.eye(p) if prior else 0.0)
        values, vectors = np.linalg.eigh(total)
        with np.errstate(divide="ignore"):
            least = 0.5 if prior else 1e-14 * np.abs(values).max(axis=1, keepdims=True)
            # With the prior's information no eigenvalue is below one but by rounding.
            inverse = np.where(values > least, 1.0 / values, 1.0 if prior else np.inf)
        if np.isfinite(inverse).all():
            return np.asarray((vectors * inverse[:, None]) @ vectors.swapaxes(1, 2))
        # Infinite along an unseen direction: of each parameter that has a part in it.
        finite = np.where(np.isfinite(inverse), inverse, 0.0)
        out = (vectors * finite[:, None]) @ vectors.swapaxes(1, 2)
        share = ((vectors**2) * np.isinf(inverse)[:, None]).sum(axis=2)
        every = np.arange(p)
        out[:, every, every] = np.where(share > 1e-12, np.inf, out[:, every, every])
        return np.asarray(out)

    def deviations(self, prior: bool = True) -> Array:
        """Bounds (p, k) on the standard deviations of the parameters, in their units."""
        variance = np.diagonal(self.covariance(prior), axis1=1, axis2=2)
        return np.asarray((np.sqrt(variance) * self.coordinates.prior).T)

    def quantity_deviations(self, quantity: QuantityOfInterest, prior: bool = True) -> Array:
        """Bounds (s, k) on the standard deviations of a quantity."""
        on_modes, _ = weights_of(quantity, self.background, len(self.background.times))
        along = np.einsum("str,rtkp->skp", on_modes, self.slopes, optimize=True)
        covariance = self.covariance(prior)
        if not np.isfinite(covariance).all():
            raise ShapeError("information: data see nothing of some direction; ask with prior=True")
        return np.asarray(np.sqrt(np.einsum("skp,kpq,skq->sk", along, covariance, along, optimize=True)))

    def unseen(self, share: float = 0.1) -> list[Array]:
        """For each point, directions (u, p) whose prior variance the data reduce by less than `share` of it."""
        values, vectors = np.linalg.eigh(self.matrices)
        learned = values / (1.0 + values)
        return [v[:, kept].T for v, kept in zip(vectors, learned < share, strict=True)]


def fisher(
    background: Background,
    functionals: Functionals,
    noise: NoiseModel,
    points: Array,
    noise_scale: Array | float = 1.0,
    steps: IntArray | None = None,
) -> Information:
    """Fisher information of what is measured about the parameters that vary.

    Parameters
    ----------
    background : Background
        With a forward map.
    functionals : Functionals
    noise : NoiseModel
    points : (k, n_parameters) array
    noise_scale : float or (k,) array
        Positive.
    steps : (t,) int array, optional
        Times observed; None for all.

    Raises
    ------
    CapabilityError
        If the background has no forward map.
    ShapeError
        If a noise scale is zero.
    """
    forward = forward_of(background)
    scale = check_scale(noise_scale, len(points))
    if not (scale > 0).all():
        raise ShapeError("noise_scale: got 0, expected a positive number: exact data have no Fisher information")
    coordinates, chosen = Coordinates.of(background.parameters), observed_steps(background, steps)
    x = coordinates.of_points(points)
    k, p = x.shape
    if (np.abs(x) > 1.0 + 1e-9).any():
        raise ShapeError("points: some lie outside the ranges of the parameters; expected them inside")
    # Differences to one side at the end of a range: nothing is asked of the map outside it.
    ahead = np.clip(x[None] + _STEP * np.eye(p)[:, None], -1.0, 1.0)
    behind = np.clip(x[None] - _STEP * np.eye(p)[:, None], -1.0, 1.0)
    width = np.einsum("pkp->pk", ahead - behind)
    asked = coordinates.points(np.concatenate([ahead, behind]).reshape(-1, p))
    made = forward.coefficients(asked)
    made = made.reshape(*made.shape[:2], 2, p, k)
    by_coordinate = (made[:, :, 0] - made[:, :, 1]) / width
    prior = coordinates.prior / coordinates.slopes(x)
    slopes = (by_coordinate * prior.T).swapaxes(2, 3)
    seen = noise.whiten(background.observe(functionals.matrix))
    images = np.tensordot(seen, slopes[:, chosen], axes=1).reshape(-1, k, p)
    matrices = np.einsum("dkp,dkq->kpq", images, images, optimize=True) / scale[:, None, None] ** 2
    return Information(background, coordinates, matrices, slopes)
