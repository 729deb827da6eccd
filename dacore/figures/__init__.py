"""One figure a file: data in, Figure out.

Every function takes plain arrays and small frozen values, draws with matplotlib's object interface
(no pyplot, no global state) and returns a `matplotlib.figure.Figure`; `dacore.figures.style` turns
one into PNG or SVG bytes.

========================  ==========================================================
`spectrum.spectrum`       singular values and tails ε̂_n
`inf_sup.inf_sup`         stability constants β_n
`bound.bound`             the a-priori bound ε̂_n/β_n, the chosen n, measured errors
`cycle.cycle_errors`      errors over the cycle, one line a case
`modes.modes`             first modes on a slice
`voxels.measured_slice`   the measured voxels of one slice
`comparison.comparison`   truth, reconstruction, difference, standard deviation
`quantity.quantity`       estimated against true quantity of interest
`summary.summary`         error of each estimator for each noise level
`hero.hero`               from measured voxels to a hidden field, one wide strip
`work_precision.work_precision`  error against cost with the efficient frontier
`work_precision.growth`   how costs grow with a size
`costs.costs`             what several variants cost, a panel of bars for each cost
`costs.differences`       how far several variants agree, item by item
`stability.stability`     where a family of time schemes is stable, and what schemes damp
`convergence.convergence` errors against the size of the cells
`formula.against_formula` curves known by formula, and the points computed
`classify.classification` two groups told apart by a number, and operating curves
`calibration.calibration` coverage of claimed intervals, and transforms of truths
`dimension.dimension`     errors against n, and the n that each rule chooses
`weights.weights`         errors, stability and n against the weight ζ
`data_amount.data_amount` errors against how much is measured
`mismatch.mismatch`       errors and alarms against what is wrong with the model
`placement.placement`     what placed measurements are worth
`learned.learned`         how much data said of each parameter
`parameters.parameters`   estimated against true parameters
========================  ==========================================================
"""

from importlib.util import find_spec

from dacore.errors import MissingDependencyError

if find_spec("matplotlib") is None:
    raise MissingDependencyError("figures need matplotlib, which is not installed; pip install 'dacore[figures]'")
