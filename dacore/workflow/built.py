"""What a physics built is a model, and its coefficients know its parameters."""

from dacore.core.model import AffineModel, ForwardModel
from dacore.errors import ShapeError


def check_built(built: object, name: str) -> None:
    """Raise ShapeError for what is no model, or a model whose coefficients ask for parameters that it does not have.

    Coefficients may be objects of the standard library, in which no traceback shows whose fault it is.
    """
    if not isinstance(built, AffineModel | ForwardModel):
        raise ShapeError(
            f"{name}.build gave a {type(built).__name__}, expected an AffineModel or a ForwardModel (dacore.core.model)"
        )
    if not isinstance(built, AffineModel):
        return
    middle = built.parameters.middle
    terms = [
        (f"term {each.name}: its coefficient", each.coefficient)
        for each in (*built.second_order, *built.first_order, *built.zeroth_order)
    ]
    loads = [(f"load {each.name}: its amplitude", each.amplitude) for each in built.loads]
    for what, function in (*terms, *loads):
        try:
            function(middle)
        except KeyError as error:
            raise ShapeError(f"{what} asks for the parameter {error}; there is {', '.join(middle)}") from error
