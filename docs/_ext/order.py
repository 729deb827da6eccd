"""The order of the gallery: what a reader wants first stands first; what is not named here comes last, by name."""

FIRST = (
    "plot_first_estimate.py",
    "plot_what_is_measured.py",
    "plot_noise_and_intervals.py",
    "plot_compare_estimators.py",
    "plot_parameters_posterior.py",
    "plot_masks.py",
    "plot_own_mesh.py",
)


class Order:
    """Sort key of sphinx-gallery.

    Parameters
    ----------
    folder : str
        Of the examples; not needed.
    """

    def __init__(self, folder: str) -> None:
        self.folder = folder

    def __call__(self, name: str) -> tuple[int, str]:
        """Return the place of an example by the name of its file."""
        return (FIRST.index(name) if name in FIRST else len(FIRST), name)

    def __repr__(self) -> str:
        return "Order"
