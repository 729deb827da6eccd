"""Fixtures for the tests of the backend."""

from collections.abc import Callable

import pytest

from dacore.core.mesh import Mesh
from tests import meshes


@pytest.fixture
def shuffled_box() -> Callable[..., Mesh]:
    """Make a mesh of the unit box: ``shuffled_box(dim, n=3, seed=0, perturb=0.1, bumpy=False)``."""
    return meshes.shuffled_box
