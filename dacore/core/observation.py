"""What is measured: linear functionals of the state. An operator knows no data."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from scipy.sparse import csr_array

from dacore.core.arrays import Array, IntArray, Sparse
from dacore.core.display import Card, Displayed, count, listed, unit_text
from dacore.core.space import StateSpace
from dacore.errors import CapabilityError, ShapeError


@dataclass(frozen=True, eq=False, repr=False)
class Functionals(Displayed):
    """Linear functionals of a state, with what a plot needs to know of them.

    Parameters
    ----------
    matrix : (m, n_dofs) csr_array
    labels : tuple of str, length m
    unit : str
        Unit of the measured values.
    centres : (m, d) array [cm]
        Where each value is measured.
    directions : (m, d) array
        Direction of a vector field's measured component; zeros for a scalar field.
    sites : (m,) int array
        Number of the voxel or sensor; the components measured at one place share it.
    spacing : tuple of float [cm]
        Voxel edge lengths; empty for points.
    dropped : int
        How many places the operator left out because they lie outside the domain.
    """

    matrix: Sparse
    labels: tuple[str, ...]
    unit: str
    centres: Array
    directions: Array
    sites: IntArray
    spacing: tuple[float, ...] = ()
    dropped: int = 0

    def __post_init__(self) -> None:
        if not isinstance(self.matrix, csr_array):
            raise ShapeError(
                f"functionals: got a matrix of type {type(self.matrix).__name__}, expected a csr_array (m, n_dofs) of "
                "scipy.sparse; make one of it: csr_array(matrix)"
            )
        m = self.matrix.shape[0]
        if m == 0:
            raise ShapeError("functionals: got none, expected at least one; is the grid inside the domain?")
        if not len(self.labels) == len(self.centres) == len(self.directions) == len(self.sites) == m:
            given = ", ".join(
                f"{len(getattr(self, name))} {name}" for name in ("labels", "centres", "directions", "sites")
            )
            raise ShapeError(f"functionals: got {given} for a matrix of {m} rows, expected {m} of each")
        if not np.isfinite(self.matrix.data).all():
            rows = np.repeat(np.arange(m), np.diff(self.matrix.indptr))[~np.isfinite(self.matrix.data)]
            raise ShapeError(
                f"functionals: {len(np.unique(rows))} hold NaN or infinite weights (first: {self.labels[rows[0]]}); "
                "leave them out"
            )
        # Zeros may be stored, so the number of entries says nothing.
        empty = np.flatnonzero(np.asarray(abs(self.matrix).sum(axis=1)).ravel() == 0)
        if empty.size:
            raise ShapeError(
                f"functionals: {empty.size} see nothing of the state (first: {self.labels[empty[0]]}); leave them out"
            )

    def _card(self) -> Card:
        centres = np.asarray(self.centres)
        extent = ", ".join(
            f"{axis} {low:.4g} to {high:.4g}"
            for axis, low, high in zip("xyz", centres.min(axis=0), centres.max(axis=0), strict=False)
        )
        places = count(self.n_sites, "voxel" if self.spacing else "place")
        return Card(
            "Functionals",
            (
                ("number", f"{count(self.count)} at {places}"),
                ("unit", unit_text(self.unit)),
                ("directions", listed(self._kinds())),
                ("extent [cm]", extent),
                ("voxel [cm]", " × ".join(f"{edge:.4g}" for edge in self.spacing)),
                ("left out", count(self.dropped, "place") + " outside" if self.dropped else ""),
            ),
        )

    def _kinds(self) -> list[str]:
        """Directions that are measured, each once: axes by their letter."""
        found = []
        for direction in np.unique(np.round(np.asarray(self.directions, dtype=np.float64), 9) + 0.0, axis=0):
            axis = np.flatnonzero(direction)
            plain = len(axis) == 1 and direction[axis[0]] == 1.0 and axis[0] < 3
            shown = "xyz"[axis[0]] if plain else f"({', '.join(f'{each:.3g}' for each in direction)})"
            found.append("none (scalar)" if not len(axis) else shown)
        return sorted(found)

    @property
    def count(self) -> int:
        """Number m of functionals."""
        return int(self.matrix.shape[0])

    @cached_property
    def n_sites(self) -> int:
        """Number of voxels or sensors."""
        return len(np.unique(self.sites))

    def __call__(self, states: Array) -> Array:
        """Apply to states (n_dofs, ...): (m, ...)."""
        flat = states.reshape(states.shape[0], -1)
        return np.asarray(self.matrix @ flat).reshape(self.count, *states.shape[1:])


class ObservationOperator(ABC):
    """Frozen settings of a kind of measurement; a plugin class of the hook ``dacore_observations``."""

    needs: ClassVar[frozenset[str]] = frozenset()

    @abstractmethod
    def functionals(self, space: StateSpace) -> Functionals:
        """Return the functionals of what is measured on `space`.

        Parameters
        ----------
        space : StateSpace

        Returns
        -------
        Functionals
        """

    def fingerprint(self) -> str:
        """Hash of the content of files that the settings name; empty without any.

        Returns
        -------
        str
        """
        return ""

    def check(self, space: StateSpace) -> None:
        """Raise CapabilityError if `space` lacks what the operator needs.

        Parameters
        ----------
        space : StateSpace

        Raises
        ------
        CapabilityError
            If something is missing.
        """
        missing = self.needs - space.capabilities
        if missing:
            raise CapabilityError(
                f"{type(self).__name__} needs a state space with {', '.join(sorted(missing))}; "
                f"{type(space).__name__} offers {', '.join(sorted(space.capabilities)) or 'none'}"
            )
