"""Fields of a state and the one order in which their degrees of freedom stand."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from dacore.core.display import Card, Displayed, Rows, count, unit_text
from dacore.errors import CapabilityError, ShapeError


@dataclass(frozen=True)
class Field:
    """One physical field of a state.

    Parameters
    ----------
    name : str
        Short name, "u" or "p".
    components : int
        1 for a scalar, d for a vector.
    order : int
        Polynomial order of its continuous Lagrange elements (1 or 2).
    unit : str
        Unit of its values.
    """

    name: str
    components: int
    order: int = 1
    unit: str = "1"

    def __post_init__(self) -> None:
        if not self.name.isidentifier():
            raise ShapeError(f"field name: got {self.name!r}, expected an identifier such as 'u'")
        if self.components < 1:
            raise ShapeError(f"field {self.name}: got {self.components} components, expected at least 1")
        if self.order not in (1, 2):
            raise ShapeError(f"field {self.name}: got element order {self.order}, expected 1 or 2")


@dataclass(frozen=True, repr=False)
class Layout(Displayed):
    """The canonical dof order: field by field, component by component, node by node.

    Parameters
    ----------
    fields : sequence of Field
    nodes : mapping of str to int
        Number of nodes of each field, by field name.
    """

    fields: tuple[Field, ...]
    nodes: Mapping[str, int]

    def __init__(self, fields: Sequence[Field], nodes: Mapping[str, int]) -> None:
        names = [field.name for field in fields]
        if len(set(names)) != len(names) or not names:
            raise ShapeError(f"fields: got {names}, expected at least one and no name twice")
        object.__setattr__(self, "fields", tuple(fields))
        object.__setattr__(self, "nodes", {name: int(nodes[name]) for name in names})

    def _card(self) -> Card:
        rows = tuple(
            (each.name, unit_text(each.unit), str(each.components), str(each.order), count(self.nodes[each.name]))
            for each in self.fields
        )
        table = Rows(("field", "unit", "components", "order", "nodes"), rows)
        return Card("Layout", (("degrees of freedom", count(self.n_dofs)),), (table,))

    @property
    def n_dofs(self) -> int:
        """Number of degrees of freedom of the whole state."""
        return sum(field.components * self.nodes[field.name] for field in self.fields)

    def field(self, name: str) -> Field:
        """Return the field called `name`; CapabilityError if there is none.

        Parameters
        ----------
        name : str

        Returns
        -------
        Field

        Raises
        ------
        CapabilityError
            If there is none.
        """
        for field in self.fields:
            if field.name == name:
                return field
        known = ", ".join(field.name for field in self.fields)
        raise CapabilityError(f"field {name!r}: this state has the fields {known}")

    def block(self, name: str) -> slice:
        """Slice of the dofs of field `name`.

        Parameters
        ----------
        name : str

        Returns
        -------
        slice

        Raises
        ------
        CapabilityError
            If there is no such field.
        """
        start = 0
        for field in self.fields:
            size = field.components * self.nodes[field.name]
            if field.name == name:
                return slice(start, start + size)
            start += size
        self.field(name)
        raise AssertionError

    def component(self, name: str, index: int) -> slice:
        """Slice of the dofs of component `index` of field `name`.

        Parameters
        ----------
        name : str
        index : int

        Returns
        -------
        slice

        Raises
        ------
        ShapeError
            If the field has no such component.
        """
        field = self.field(name)
        if not 0 <= index < field.components:
            raise ShapeError(f"component of {name}: got {index}, expected 0 to {field.components - 1}")
        start = self.block(name).start + index * self.nodes[name]
        return slice(start, start + self.nodes[name])
