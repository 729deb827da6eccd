"""DOLFINx as a backend; DOLFINx itself is imported when a form is first asked for."""

from importlib.metadata import version

from dacore.core.discretization import Assembler, Backend
from dacore.core.mesh import Mesh


class DolfinxBackend(Backend):
    """DOLFINx of the FEniCS project: P1 and P2 on triangles and tetrahedra, forms compiled to C."""

    name = "dolfinx"

    def assembler(self, mesh: Mesh) -> Assembler:
        """Put DOLFINx on a mesh."""
        from dacore_dolfinx.assembler import DolfinxAssembler

        return DolfinxAssembler(mesh)

    def version(self) -> str:
        """Version of DOLFINx."""
        return version("fenics-dolfinx")
