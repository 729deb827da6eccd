"""Contracts of a physics and of the model it builds."""

from collections.abc import Callable

from dacore.core.discretization import Backend
from dacore.core.mesh import Mesh
from dacore.core.model import Physics
from dacore.core.timegrid import TimeGrid
from dacore.testing import settings
from dacore.testing.models import affine, forward
from dacore.testing.models.stand import Stand
from dacore.testing.spaces import ReferenceBackend
from dacore.testing.suite import Suite, bind, expect_kind, expect_maker


def model_suite(
    physics: Physics,
    mesh: Callable[[], Mesh] | None = None,
    grid: TimeGrid | None = None,
    backend: Backend | None = None,
    affine_in: tuple[str, ...] = (),
) -> Suite:
    """Make every check of a physics, with one choice of its settings; those of an affine model if it builds one.

    Parameters
    ----------
    physics : Physics
    mesh : callable, optional
        Makes a small mesh with the roles that the physics asks for (some hundred cells).
    grid : TimeGrid, optional
        Of an affine model, which is marched in time; a few steps of 0.5 ms by default.
    backend : Backend, optional
        By default `dacore.testing.spaces.ReferenceBackend`, which needs no library.
    affine_in : tuple of str
        Parameters in which the trajectory is claimed to be affine: amplitudes of loads.

    Returns
    -------
    Suite

    Raises
    ------
    PluginError
        If it is no physics, or `mesh` cannot be called.
    """
    expect_kind("model_suite", physics, Physics)
    if mesh is not None:
        expect_maker("model_suite", "mesh", mesh)
    stand = Stand(physics, mesh, grid or TimeGrid(5e-4, 4), backend or ReferenceBackend(), affine_in)
    return Suite((*bind(settings.CHECKS, physics), *bind((*forward.CHECKS, *affine.CHECKS), stand)))
