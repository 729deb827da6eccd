"""Contracts of an estimator."""

from dacore.core.estimator import Estimator
from dacore.testing import settings
from dacore.testing.estimators import conduct, results
from dacore.testing.estimators.stand import Bench
from dacore.testing.suite import Suite, bind, expect_kind


def estimator_suite(
    estimator: Estimator, affine: bool = True, deviations: bool = False, forward: bool = False
) -> Suite:
    """Make every check of an estimator, with one choice of its settings.

    It is prepared on a training set of twenty random trajectories of two fields, of which one is measured.

    Parameters
    ----------
    estimator : Estimator
    affine : bool
        Whether estimates are claimed to be affine in the data.
    deviations : bool
        Whether standard deviations are claimed to hold on unseen cases drawn as the training set was.
    forward : bool
        Whether the estimator needs the map from parameters to trajectories: the training set then has one, and its
        trajectories follow from four parameters.

    Returns
    -------
    Suite

    Raises
    ------
    PluginError
        If it is no estimator.
    """
    expect_kind("estimator_suite", estimator, Estimator)
    bench = Bench(estimator, affine, deviations, forward)
    return Suite((*bind(settings.CHECKS, estimator), *bind((*results.CHECKS, *conduct.CHECKS), bench)))
