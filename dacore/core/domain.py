"""Where the physics lives: a domain makes a mesh with roles."""

from abc import ABC, abstractmethod

from dacore.core.mesh import Mesh


class Domain(ABC):
    """Frozen settings of a domain; a plugin class of the hook ``dacore_domains``."""

    @abstractmethod
    def mesh(self) -> Mesh:
        """Make the mesh [cm]. The same settings give the same mesh, bit for bit."""

    def fingerprint(self) -> str:
        """What the mesh depends on besides the settings, such as a hash of a file's content.

        Returns
        -------
        str
        """
        return ""

    def expected_nodes(self) -> int | None:
        """About how many nodes the mesh will have, if that is known without making it: for estimates of cost."""
        return None
