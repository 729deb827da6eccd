"""An affine model cut into the blocks of its fields on the free dofs, as projecting it needs them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from dacore.core.arrays import Array, BoolArray, IntArray, Sparse
from dacore.core.display import Displayed
from dacore.core.model import AffineModel, AffineTerm, Coefficient
from dacore.core.parameters import Parameters
from dacore.core.space import Product
from dacore.dynamics.system import initial_states, stack
from dacore.errors import CapabilityError


@dataclass(frozen=True, eq=False, repr=False)
class SplitTerm(Displayed):
    """One term of the operator by fields.

    Parameters
    ----------
    name : str
    order : int
        Of the time derivative it multiplies: 0, 1 or 2.
    coefficient : callable
        θ -> float.
    blocks : mapping of (str, str) to (n_f, n_g) csr_array
        Rows of field f, columns of field g, free dofs only; blocks of zeros are left out.
    lifted : mapping of str to (n_f, n_loads) array
        The term applied to the prescribed values of each load.
    """

    name: str
    order: int
    coefficient: Coefficient
    blocks: Mapping[tuple[str, str], Sparse]
    lifted: Mapping[str, Array]


class SplitModel:
    """An affine model by fields.

    Parameters
    ----------
    model : AffineModel
    kind : {"l2", "h1"}
        Inner product of the fields.

    Attributes
    ----------
    fields : tuple of str
    free : dict of str to (n_f,) int array
        Free dofs of each field, as numbers in the field's block.
    products : dict of str to (n_f, n_f) csr_array
        Inner product on the free dofs of each field.
    prescribed : dict of str to (n_field, n_loads) array
        Values of the constrained dofs, zero at the free ones; of an initial state those at t = 0.
    forces : dict of str to (n_f, n_loads) array
    initial : dict of str to (n_f, n_loads) array
        Values of the initial states at the free dofs.
    terms : tuple of SplitTerm
    flow : dict of str to bool
        Whether the field's rows are those marked as antisymmetric.

    Raises
    ------
    CapabilityError
        If only some rows of a field are marked as antisymmetric, or a field has no free dof.
    """

    def __init__(self, model: AffineModel, kind: Product = "l2") -> None:
        self.model, self.kind = model, kind
        layout = model.space.layout
        self.fields = tuple(field.name for field in layout.fields)
        self.free: dict[str, IntArray] = {}
        self.products: dict[str, Sparse] = {}
        self.flow: dict[str, bool] = {}
        for name in self.fields:
            block = layout.block(name)
            free = np.flatnonzero(~model.constrained[block])
            if not free.size:
                raise CapabilityError(
                    f"reduced training: every dof of {name} is prescribed; set training.method = 'full'"
                )
            self.free[name] = free
            self.products[name] = csr_array(model.space.field_product(name, kind)[free][:, free])
            self.flow[name] = _all_or_none(model.antisymmetric[block][free], name)
        n = model.space.n_dofs
        start = initial_states(model)
        # A load that gives an initial state prescribes nothing: its column holds the constrained dofs at t = 0.
        values = stack([load.prescribed for load in model.loads], n)
        values = values + np.where(model.constrained[:, None], start, 0.0)
        force = stack([load.force for load in model.loads], n)
        self.prescribed = {name: values[layout.block(name)] for name in self.fields}
        self.forces = {name: force[layout.block(name)][self.free[name]] for name in self.fields}
        self.initial = {name: start[layout.block(name)][self.free[name]] for name in self.fields}
        self.terms = tuple(self._split(order, term, values) for order, term in _terms(model))

    def _split(self, order: int, term: AffineTerm, values: Array) -> SplitTerm:
        layout = self.model.space.layout
        blocks, lifted = {}, {}
        image = np.asarray(term.matrix @ values)
        for row in self.fields:
            rows = csr_array(term.matrix[layout.block(row)])
            lifted[row] = image[layout.block(row)][self.free[row]]
            for column in self.fields:
                part = csr_array(rows[:, layout.block(column)])
                if part.nnz:
                    part = csr_array(part[self.free[row]][:, self.free[column]])
                    part.eliminate_zeros()
                if part.nnz:
                    blocks[row, column] = part
        return SplitTerm(term.name, order, term.coefficient, blocks, lifted)

    def free_parts(self, states: Array) -> dict[str, Array]:
        """Values (n_f, k) of states (n_dofs, k) at the free dofs of each field."""
        layout = self.model.space.layout
        return {name: states[layout.block(name)][self.free[name]] for name in self.fields}


def _all_or_none(flags: BoolArray, name: str) -> bool:
    if flags.any() and not flags.all():
        raise CapabilityError(
            f"reduced training: only some rows of {name} are antisymmetric, expected all or none of a field; "
            "set training.method = 'full'"
        )
    return bool(flags.any())


def coefficients_of(model: AffineModel, points: Sequence[Parameters]) -> Array:
    """Coefficients (n_terms, K) at K parameter vectors of all terms, in the order of `SplitModel.terms`."""
    return np.array([[term.coefficient(point) for point in points] for _, term in _terms(model)])


def amplitudes_of(model: AffineModel, points: Sequence[Parameters]) -> Array:
    """Amplitudes (n_loads, K) of all loads at K parameter vectors."""
    return np.stack([model.amplitudes(point) for point in points], axis=1)


def _terms(model: AffineModel) -> list[tuple[int, AffineTerm]]:
    orders = ((2, model.second_order), (1, model.first_order), (0, model.zeroth_order))
    return [(order, term) for order, terms in orders for term in terms]
