"""scikit-fem as a backend; scikit-fem itself is imported when a form is first asked for."""

from importlib.metadata import version

from dacore.core.discretization import Assembler, Backend
from dacore.core.mesh import Mesh


class SkfemBackend(Backend):
    """scikit-fem: P1 and P2 on triangles and tetrahedra, pure Python."""

    name = "skfem"

    def assembler(self, mesh: Mesh) -> Assembler:
        """Put scikit-fem on a mesh."""
        from dacore_skfem.assembler import SkfemAssembler

        return SkfemAssembler(mesh)

    def version(self) -> str:
        """Version of scikit-fem."""
        return version("scikit-fem")
