"""Tissue that is stiffer or softer somewhere: Young's modulus times a number on each cell.

With E(x) = s(x) E and everything else the same, shear and dilation are weighted by s on each cell, the storage, which
has E in its denominator, by 1/s. The model has as many terms as without, and stays affine in the same functions.
"""

from dataclasses import dataclass

from dacore.geometry.balls import Ball


@dataclass(frozen=True)
class Inclusion(Ball):
    """A ball of another stiffness: the cells whose centroids lie in it.

    Parameters
    ----------
    centre : tuple of float [cm]
        One coordinate a dimension.
    radius : float [cm]
    stiffness : float
        Young's modulus inside relative to the rest: 2 is twice as stiff.
    """

    stiffness: float

    def __post_init__(self) -> None:
        super().__post_init__()
        self.check_positive("stiffness")
