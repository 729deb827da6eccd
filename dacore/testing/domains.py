"""Contracts of a domain: the same mesh each time, and a fingerprint of what else it depends on."""

import pickle
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dacore.core.domain import Domain
from dacore.core.mesh import Mesh
from dacore.testing import settings
from dacore.testing.suite import Suite, bind, expect_kind, require

_ARRAYS = ("points", "cells", "facets", "facet_tags")


@dataclass(eq=False)
class Made:
    """A domain and its mesh.

    Parameters
    ----------
    domain : Domain
    """

    domain: Domain

    @property
    def name(self) -> str:
        """Name of the class, for messages."""
        return type(self.domain).__name__

    @cached_property
    def mesh(self) -> Mesh:
        """The mesh."""
        return self.domain.mesh()


def makes_a_mesh(made: Made) -> None:
    """`mesh` makes a `Mesh` with at least one role."""
    require(isinstance(made.mesh, Mesh), f"{made.name}: makes a {type(made.mesh).__name__}, expected Mesh")
    require(bool(made.mesh.roles), f"{made.name}: the boundary has no roles")


def the_same_mesh_again(made: Made) -> None:
    """The same settings, also pickled, make the same mesh bit for bit."""
    for how, domain in (("again", made.domain), ("from pickled settings", pickle.loads(pickle.dumps(made.domain)))):
        again = domain.mesh()
        for name in _ARRAYS:
            same = np.array_equal(getattr(again, name), getattr(made.mesh, name))
            require(same, f"{made.name}: made {how}, the {name} of the mesh differ; is there a random number?")
        require(dict(again.roles) == dict(made.mesh.roles), f"{made.name}: made {how}, the mesh has other roles")


def no_global_randomness(made: Made) -> None:
    """Making the mesh neither uses nor moves numpy's global random numbers."""
    before = np.random.get_state()  # noqa: NPY002  the global state is what must not be touched
    first = made.mesh.points
    try:
        np.random.seed(1)  # noqa: NPY002
        held = np.random.get_state()[1].tolist()  # type: ignore[index]  # noqa: NPY002
        second = made.domain.mesh().points
        moved = np.random.get_state()[1].tolist() != held  # type: ignore[index]  # noqa: NPY002
    finally:
        np.random.set_state(before)  # noqa: NPY002
    require(np.array_equal(first, second), f"{made.name}: the mesh depends on numpy's global random numbers")
    require(not moved, f"{made.name}: draws from numpy's global random numbers; use a Generator of its own")


def fingerprints_stay(made: Made) -> None:
    """`fingerprint` is a text, the same each time, for a copy too, and after the mesh was made."""
    first = made.domain.fingerprint()
    require(isinstance(first, str), f"{made.name}: fingerprint() is {first!r}, expected a text")
    made.mesh  # noqa: B018  made, so that an effect on the fingerprint shows
    for how, domain in (("asked again", made.domain), ("pickled", pickle.loads(pickle.dumps(made.domain)))):
        given = domain.fingerprint()
        require(given == first, f"{made.name}: fingerprint() is {given!r} when {how}, was {first!r}")


CHECKS = (makes_a_mesh, the_same_mesh_again, no_global_randomness, fingerprints_stay)


def domain_suite(domain: Domain) -> Suite:
    """Make every check of a domain, with one choice of its settings; the mesh is made four times.

    Parameters
    ----------
    domain : Domain

    Returns
    -------
    Suite

    Raises
    ------
    PluginError
        If it is no domain.
    """
    expect_kind("domain_suite", domain, Domain)
    return Suite((*bind(settings.CHECKS, domain), *bind(CHECKS, Made(domain))))
