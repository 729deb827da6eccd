"""The kinds of plugin that can be begun with, and how each is declared."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Kind:
    """A kind of plugin.

    Parameters
    ----------
    hook : str
    word : str
        What a scene calls the plugin, after the stem of the distribution's name; the stem alone if empty.
    target : str
        Class in the module that is named like the kind.
    summary : str
        One line for ``dacore plugins``.
    suite : str
        What its tests are.
    """

    hook: str
    word: str
    target: str
    summary: str
    suite: str


KINDS = {
    "model": Kind("dacore_models", "", "ReactionDiffusion", "reaction and diffusion of a substance", "model_suite"),
    "observation": Kind("dacore_observations", "lines", "LineMeans", "means along lines", "observation_suite"),
    "quantity": Kind("dacore_quantities", "mean", "DomainMean", "mean over the domain", "quantity_suite"),
    "estimator": Kind(
        "dacore_estimators", "nearest", "Nearest", "training trajectories near the data", "estimator_suite"
    ),
    "solver": Kind("dacore_solvers", "minres", "MinimalResiduals", "minimal residuals", "solver_suite"),
    "domain": Kind("dacore_domains", "disk", "Disk", "a disk with an opening", "domain_suite"),
    "backend": Kind("dacore_backends", "numpy", "NumpyBackend", "finite elements in plain numpy", "backend_suite"),
    "format": Kind("dacore_formats", "log", "LoggerFile", "files of a data logger", "format_suite"),
    "study": Kind("dacore_studies", "samples", "Samples", "what fewer training samples cost", "tests of its own"),
}
DEFAULT = ("model", "observation")
