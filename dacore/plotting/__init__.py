"""Pictures for a notebook: what you have in hand goes in, matplotlib's axes come out.

Every function takes a session, a background or an estimate, draws into `ax` or into a figure of its own, and returns
the axes. They look like the report's figures (`dacore.figures`), change none of matplotlib's settings and never call
``show``. Units are on every axis and colour bar.

===================  ==================================================
`plot_slice`         a field of a state on a plane
`plot_estimate`      an estimated field, its deviation, and the truth
`plot_mesh`          a mesh on a plane, its boundary by role
`plot_sensors`       where and in which direction is measured
`plot_quantity`      a number of interest over time with its interval
`plot_parameters`    parameters before and after the data
`plot_errors`        errors of every estimator on the unseen cases
`plot_spectrum`      singular values of a training set
`plot_inf_sup`       stability against the dimension
===================  ==================================================
"""

from importlib.util import find_spec

from dacore.errors import MissingDependencyError

if find_spec("matplotlib") is None:
    raise MissingDependencyError("plotting needs matplotlib, which is not installed; pip install 'dacore[figures]'")

from dacore.plotting.fields import plot_estimate, plot_slice
from dacore.plotting.places import plot_mesh, plot_sensors
from dacore.plotting.results import plot_errors, plot_parameters, plot_quantity
from dacore.plotting.spaces import plot_inf_sup, plot_spectrum

__all__ = [
    "plot_errors",
    "plot_estimate",
    "plot_inf_sup",
    "plot_mesh",
    "plot_parameters",
    "plot_quantity",
    "plot_sensors",
    "plot_slice",
    "plot_spectrum",
]
