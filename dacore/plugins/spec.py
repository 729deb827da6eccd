"""The plugin door: nine hooks, each a list of declarations. Declaring imports nothing.

A plugin is an installed distribution with an entry point in the group ``dacore`` that names a
module. The module implements some of the hooks below and imports no solver at its top::

    import dacore.plugins as door

    @door.hookimpl
    def dacore_backends():
        return [door.PluginSpec("skfem", "dacore_skfem.backend:SkfemBackend", requires=("skfem",),
                                install="pip install dacore-skfem", summary="scikit-fem, pure Python")]

The class behind a declaration is imported when a scene first uses it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import pluggy

from dacore.deprecation import warn_deprecated
from dacore.plugins.api import OLDEST

GROUP = "dacore"

hookspec = pluggy.HookspecMarker(GROUP)
hookimpl = pluggy.HookimplMarker(GROUP)


@dataclass(frozen=True)
class PluginSpec:
    """Declaration of one plugin.

    Parameters
    ----------
    name : str
        The word a scene uses for it.
    target : str
        ``"package.module:Class"``, imported at first use.
    requires : tuple of str
        Modules that must be importable.
    install : str
        What to type to install what `requires` names.
    summary : str
        One line for ``dacore plugins``.
    api : str
        Version of the plugin interface that it needs, "major.minor" (docs/versions.md). Without it the plugin
        uses nothing that came after the first of this major version.
    """

    name: str
    target: str
    requires: tuple[str, ...] = ()
    install: str = ""
    summary: str = ""
    api: str | int | tuple[int, int] = OLDEST

    def __post_init__(self) -> None:
        if type(self.api) is int:
            # The caller is behind this method and the generated __init__.
            warn_deprecated(
                f"api = {self.api}, a whole number", since="plugin interface 1.1", removed_in="plugin interface 2.0",
                instead=f'api = "{self.api}.0"', stacklevel=3,
            )  # fmt: skip


class Hooks:
    """The hooks. Each takes no arguments and returns a list of `PluginSpec`."""

    @hookspec
    def dacore_backends(self) -> Sequence[PluginSpec]:
        """Finite element libraries: subclasses of `dacore.core.discretization.Backend`."""
        raise AssertionError

    @hookspec
    def dacore_domains(self) -> Sequence[PluginSpec]:
        """Domains: frozen dataclasses, subclasses of `dacore.core.domain.Domain`."""
        raise AssertionError

    @hookspec
    def dacore_models(self) -> Sequence[PluginSpec]:
        """Physics: frozen dataclasses, subclasses of `dacore.core.model.Physics`."""
        raise AssertionError

    @hookspec
    def dacore_observations(self) -> Sequence[PluginSpec]:
        """Measurements: frozen dataclasses, subclasses of `dacore.core.observation.ObservationOperator`."""
        raise AssertionError

    @hookspec
    def dacore_quantities(self) -> Sequence[PluginSpec]:
        """Numbers of interest: frozen dataclasses, subclasses of `dacore.core.quantity.QuantityOfInterest`."""
        raise AssertionError

    @hookspec
    def dacore_estimators(self) -> Sequence[PluginSpec]:
        """Estimators: frozen dataclasses, subclasses of `dacore.core.estimator.Estimator`."""
        raise AssertionError

    @hookspec
    def dacore_solvers(self) -> Sequence[PluginSpec]:
        """Linear solvers: frozen dataclasses, subclasses of `dacore.core.solver.SolverMethod`."""
        raise AssertionError

    @hookspec
    def dacore_formats(self) -> Sequence[PluginSpec]:
        """Readers of measured data: frozen dataclasses, subclasses of `dacore.core.data.DataFormat`."""
        raise AssertionError

    @hookspec
    def dacore_studies(self) -> Sequence[PluginSpec]:
        """Studies: frozen dataclasses, subclasses of `dacore.workflow.studies.study.Study`."""
        raise AssertionError


HOOKS = (
    "dacore_backends",
    "dacore_domains",
    "dacore_models",
    "dacore_observations",
    "dacore_quantities",
    "dacore_estimators",
    "dacore_solvers",
    "dacore_formats",
    "dacore_studies",
)
