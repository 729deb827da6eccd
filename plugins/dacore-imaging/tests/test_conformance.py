"""What is measured, and the brain, keep every promise of their kinds."""

from functools import partial

from dacore.testing import domain_suite, observation_suite, quantity_suite
from dacore.testing.spaces import box_space
from dacore_imaging.brain import Brain
from dacore_imaging.points import PointSensors
from dacore_imaging.quantities import BoundaryMean, VolumeMean
from dacore_imaging.voxels import Slice, Voxels

POSITIONS = ((1.1, 1.7, 0.8), (0.4, 2.2, 1.3), (2.9, 0.1, 2.95))
TURNED = ((0.6, 0.8, 0.0), (-0.8, 0.6, 0.0), (0.0, 0.0, 1.0))
SQUARE = partial(box_space, 2, order=2)

test_voxels = observation_suite(Voxels(size=1.0), reproduces="linear").as_test()
test_voxels_of_a_square = observation_suite(Voxels(size=1.0, directions=((0.6, 0.8),)), SQUARE, "linear").as_test()
test_turned_voxels = observation_suite(
    Voxels(field="p", size=0.6, axes=TURNED, coverage=1.0), reproduces="linear"
).as_test()
test_cut_voxels = observation_suite(Voxels(field="c", size=0.9, coverage=0.2)).as_test()
test_slices = observation_suite(
    Voxels(size=1.0, slices=(Slice("z", 1.5), Slice("x", 0.5)), components=("y",)), reproduces="linear"
).as_test()
test_plain_integrals = observation_suite(Voxels(size=1.0, average=False), reproduces="nothing").as_test()
test_sampled_voxels = observation_suite(Voxels(size=1.0, quadrature=4)).as_test()

test_points = observation_suite(PointSensors(POSITIONS), reproduces="linear").as_test()
test_derivatives = observation_suite(
    PointSensors(POSITIONS, derivative="y"), reproduces="linear", derivative=1
).as_test()
test_smeared_points = observation_suite(PointSensors(POSITIONS, components=(0,), width=0.1)).as_test()

test_boundary_mean = quantity_suite(BoundaryMean("hole"), partial(box_space, hole=True), reproduces="linear").as_test()
test_mean_of_a_component = quantity_suite(BoundaryMean("left", "u", 2, "each"), reproduces="linear").as_test()
test_volume_mean = quantity_suite(VolumeMean(), SQUARE, reproduces="linear").as_test()

test_brain = domain_suite(Brain(edge=1.15)).as_test()
