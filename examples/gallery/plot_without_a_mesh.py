"""
A state space without a mesh
============================

Estimation knows no finite elements: a state space is fields and inner products. Here it is temperatures of forty tanks
in a row, two thermometers are read, and the rest follow from a training set of random trajectories.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.sparse import csr_array, eye_array

from dacore.algebra.compress import compress
from dacore.core.fields import Field, Layout
from dacore.core.model import Trajectory
from dacore.core.noise import WhiteNoise
from dacore.core.observation import Functionals
from dacore.core.parameters import Parameter, ParameterSpace
from dacore.core.space import StateSpace
from dacore.estimators.minimum_variance import MinimumVariance

N, TIMES = 40, np.arange(1.0, 21.0)


class Tanks(StateSpace):
    layout = Layout([Field("T", 1, unit="K")], {"T": N})

    def scalar_product(self, field, kind="l2"):
        return csr_array(eye_array(N))


def warm(parameters):
    """Two hot spots that spread: their places and heats are the parameters."""
    *places, heat = parameters
    away = (np.arange(N)[:, None, None] - places) / np.sqrt(4.0 + 2.0 * TIMES)[:, None]
    return Trajectory(heat * np.exp(-(away**2)).sum(axis=2), TIMES)


rng = np.random.default_rng(0)
spots = Parameter("first", "1", 5, 15), Parameter("second", "1", 20, 35)
ranges = ParameterSpace((*spots, Parameter("heat", "K", 5, 9)))
samples = ranges.sample(rng, 60)
background = compress(Tanks(), [warm(sample) for sample in samples], ranges, samples)

seen = np.array([8, 28])
rows, nowhere = csr_array(np.eye(N)[seen]), np.zeros((2, 1))
sensors = Functionals(rows, ("T8", "T28"), "K", 1.0 * seen[:, None], nowhere, np.arange(2))
truth = warm(ranges.sample(rng, 1)[0])
data = sensors(truth.states) + 0.1 * rng.standard_normal((2, len(TIMES)))
estimate = MinimumVariance().prepare(background, sensors, WhiteNoise()).estimate(data, noise_scale=0.1)

mean, deviation = estimate.state(0, 4), estimate.deviation(csr_array(np.eye(N)), 4, 0)
figure, ax = plt.subplots(figsize=(5.5, 3.4), layout="constrained")
ax.fill_between(np.arange(N), mean - 2 * deviation, mean + 2 * deviation, alpha=0.25, label="± 2 deviations")
ax.plot(mean, label="estimate")
ax.plot(truth.states[:, 4], "k--", label="truth")
ax.plot(seen, data[:, 4], "o", label="thermometers")
ax.set(xlabel="tank", ylabel="temperature [K]")
ax.legend()
