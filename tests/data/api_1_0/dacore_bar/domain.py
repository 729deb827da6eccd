from dataclasses import dataclass

from dacore.core.domain import Domain
from dacore.core.mesh import Mesh
from dacore.domains.box import Box


@dataclass(frozen=True)
class Bar(Domain):
    length: float = 4.0
    cells: int = 8

    def mesh(self) -> Mesh:
        sides = {"left": ("x-",), "right": ("x+",), "side": ("y-", "y+")}
        return Box((0.0, 0.0), (self.length, 1.0), (self.cells, 2), sides).mesh()

    def expected_nodes(self) -> int:
        return 3 * (self.cells + 1)
