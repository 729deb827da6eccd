"""MFEM as a backend; MFEM itself is imported when a form is first asked for."""

from importlib.metadata import version

from dacore.core.discretization import Assembler, Backend
from dacore.core.mesh import Mesh


class MfemBackend(Backend):
    """MFEM: P1 and P2 on triangles and tetrahedra, in C++."""

    name = "mfem"

    def assembler(self, mesh: Mesh) -> Assembler:
        """Put MFEM on a mesh."""
        from dacore_mfem.assembler import MfemAssembler

        return MfemAssembler(mesh)

    def version(self) -> str:
        """Version of PyMFEM, whose first three numbers are MFEM's."""
        return version("mfem")
