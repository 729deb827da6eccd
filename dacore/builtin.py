"""dacore's own plugins, declared through the same door as everybody's."""

from dacore.plugins import PluginSpec, hookimpl


@hookimpl
def dacore_domains() -> list[PluginSpec]:
    """Declare the domains that need no other package."""
    return [
        PluginSpec("box", "dacore.domains.box:Box", summary="a rectangle or box of triangles or tetrahedra"),
        PluginSpec("ball", "dacore.domains.ball:Ball", summary="a ball with a cavity, held at the bottom"),
        PluginSpec("file", "dacore.domains.file:MeshFile", summary="your own mesh, read by meshio"),
    ]


@hookimpl
def dacore_estimators() -> list[PluginSpec]:
    """Declare the estimators."""
    return [
        PluginSpec(
            "pbdw",
            "dacore.estimators.pbdw:PBDW",
            summary="parametrised-background data-weak: exact, regularised or weighted by noise",
        ),
        PluginSpec(
            "minimum_variance",
            "dacore.estimators.minimum_variance:MinimumVariance",
            summary="linear minimum variance with the training set's covariance, per step or over the cycle",
        ),
        PluginSpec(
            "posterior",
            "dacore.estimators.posterior:Posterior",
            summary="state and parameters together: Bayesian posterior through the reduced model",
        ),
    ]


@hookimpl
def dacore_formats() -> list[PluginSpec]:
    """Declare what data can be read from."""
    return [
        PluginSpec(
            "csv", "dacore.io.data_csv:CsvSensors", summary="values of sensors, a row a sensor or sensor and time"
        ),
        PluginSpec("npz", "dacore.io.data_arrays:NpzData", summary="named arrays of sensors or of an image"),
        PluginSpec("hdf5", "dacore.io.data_arrays:Hdf5Data", summary="named arrays of sensors or of an image"),
    ]


@hookimpl
def dacore_solvers() -> list[PluginSpec]:
    """Declare the linear solvers."""
    return [
        PluginSpec("auto", "dacore.algebra.solvers:Auto", summary="direct up to 60,000 unknowns, then krylov first"),
        PluginSpec("direct", "dacore.algebra.solvers:Direct", summary="multifrontal, single precision, refined"),
        PluginSpec("krylov", "dacore.algebra.solvers:Krylov", summary="block-preconditioned GMRES"),
    ]


@hookimpl
def dacore_studies() -> list[PluginSpec]:
    """Declare the studies."""
    return [
        PluginSpec(
            "variants",
            "dacore.workflow.studies.variants:Variants",
            summary="the same truths from other data or with other settings",
        ),
        PluginSpec(
            "mismatch",
            "dacore.workflow.studies.mismatch:Mismatch",
            summary="truths of another model than the estimators'",
        ),
        PluginSpec(
            "cohort",
            "dacore.workflow.studies.cohort:CohortStudy",
            summary="synthetic patients: who is told right, and whether claims are honest",
        ),
        PluginSpec(
            "dimension",
            "dacore.workflow.studies.dimension:Dimension",
            summary="errors of PBDW against n, and the n that every rule takes",
        ),
        PluginSpec(
            "limits",
            "dacore.workflow.studies.limits:LimitStudy",
            summary="sampled posterior mean and Fisher information beside every estimator",
        ),
        PluginSpec(
            "placement",
            "dacore.workflow.studies.placement:PlacementStudy",
            summary="slices chosen one by one for a number of interest or for stability",
        ),
        PluginSpec(
            "weights",
            "dacore.workflow.studies.weights:Weights",
            summary="stability and errors of PBDW against the weight between the fields",
        ),
    ]
