"""A small state space without meshes or PDEs, for tests of estimation."""

from dacore.testing.backgrounds import functionals_of, random_background, random_functionals
from dacore.testing.spaces import Chain

__all__ = ["Chain", "functionals_of", "random_background", "random_functionals"]
