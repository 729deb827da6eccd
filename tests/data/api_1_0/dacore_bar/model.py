from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from dacore.core.fespace import FiniteElementSpace
from dacore.core.fields import Field
from dacore.core.model import AffineModel, AffineTerm, Load, Physics
from dacore.core.parameters import Parameter, ParameterSpace
from dacore.dynamics.profiles import Constant


def one(parameters):
    return 1.0


def diffusivity(parameters):
    return parameters["D"]


def left(parameters):
    return parameters["T_left"]


def right(parameters):
    return parameters["T_right"]


@dataclass(frozen=True)
class Heat(Physics):
    """C dT/dt = D div grad T, given temperatures at both ends."""

    order: int = 1

    def build(self, discretize):
        forms = discretize([Field("T", 1, self.order, "K")])
        n, nodes = forms.layout.n_dofs, {r: forms.mesh.boundary_nodes(r, self.order) for r in ("left", "right")}
        constrained = np.zeros(n, dtype=bool)
        loads = []
        for name, amplitude in (("left", left), ("right", right)):
            constrained[nodes[name]] = True
            prescribed = np.zeros(n)
            prescribed[nodes[name]] = 1.0
            loads.append(Load(name, amplitude, Constant(), np.zeros(n), prescribed))
        parameters = ParameterSpace(
            (
                Parameter("D", "cm^2/s", 0.5, 2.0, "log_uniform"),
                Parameter("T_left", "K", 1.0, 3.0),
                Parameter("T_right", "K", -1.0, 1.0),
            )
        )
        return AffineModel(
            FiniteElementSpace(forms),
            parameters,
            (),
            (AffineTerm("capacity", csr_array(forms.scalar_mass("T")), one),),
            (AffineTerm("conduction", csr_array(forms.scalar_stiffness("T")), diffusivity),),
            tuple(loads),
            constrained,
            np.zeros(n, dtype=bool),
        )
