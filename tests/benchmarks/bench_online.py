"""What is left to do when data arrive: a quantity, a state, a series, at the paper's size. Run as a script.

    OPENBLAS_NUM_THREADS=1 python tests/benchmarks/bench_online.py [NODES]

462 functionals at 40 steps; training sets of 80 and of 512 samples with 60 modes of u and 20 of p; states of 5,147 and
33,000 nodes (or NODES) without a mesh: what is measured depends on the sizes alone. Times are the best of many, and
bytes are those that must move: the basis once, the state once.
"""

import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.sparse import csr_array, eye_array

from dacore.core.background import Background
from dacore.core.fields import Field, Layout
from dacore.core.noise import WhiteNoise
from dacore.core.observation import Functionals
from dacore.core.parameters import Parameter, ParameterSpace
from dacore.core.reduced import ReducedSpace
from dacore.core.space import StateSpace
from dacore.estimators.minimum_variance import MinimumVariance
from dacore.estimators.pbdw import PBDW
from dacore.testing.backgrounds import Weighted

M, STEPS, MODES = 462, 40, {"u": 60, "p": 20}


class Nodes(StateSpace):
    """u and p on nodes whose inner product is Euclidean."""

    def __init__(self, nodes):
        self._layout = Layout([Field("u", 3, unit="cm"), Field("p", 1, unit="dyn/cm^2")], {"u": nodes, "p": nodes})

    layout = property(lambda self: self._layout)

    def scalar_product(self, field, kind="l2"):
        return csr_array(eye_array(self.layout.nodes[field]))


def background_of(space: Nodes, samples: int) -> Background:
    rng = np.random.default_rng(0)
    bases = {}
    for field in space.fields:
        block = space.layout.block(field.name)
        n, r = block.stop - block.start, MODES[field.name]
        basis, _ = np.linalg.qr(rng.standard_normal((n, r)))
        bases[field.name] = ReducedSpace(basis, np.ones(r), csr_array(eye_array(n)))
    r = sum(MODES.values())
    decay = 0.9 ** np.arange(r)[:, None, None]
    coefficients = decay * rng.standard_normal((r, STEPS, samples)) + rng.standard_normal((r, STEPS, 1))
    times = np.arange(1.0, STEPS + 1)
    parameters = ParameterSpace((Parameter("a", "1", 0.0, 1.0),))
    return Background(
        space, bases, coefficients, times, parameters, rng.random((samples, 1)), "l2", dict.fromkeys(bases, 0.0)
    )


def functionals_of(space: Nodes) -> Functionals:
    """Averages of components of u over some nodes each."""
    rng = np.random.default_rng(1)
    columns = rng.permutation(space.layout.block("u").stop)[: 8 * M]
    rows = np.repeat(np.arange(M), 8)
    matrix = csr_array((np.full(8 * M, 1 / 8), (rows, columns)), shape=(M, space.n_dofs))
    return Functionals(matrix, tuple(map(str, range(M))), "cm", np.zeros((M, 3)), np.zeros((M, 3)), np.arange(M))


def best(work: Callable[[], Any], least: float = 0.4) -> tuple[float, float]:
    """Least wall and processor time [s] of one call."""
    work()
    wall, cpu, end = [], [], time.perf_counter() + least
    while time.perf_counter() < end or len(wall) < 5:
        began, used = time.perf_counter(), time.process_time()
        work()
        wall.append(time.perf_counter() - began)
        cpu.append(time.process_time() - used)
    return min(wall), min(cpu)


def show(what: str, measured: tuple[float, float], size: float | None = None, copied: float | None = None) -> None:
    wall, cpu = measured
    rate = "" if size is None else f"{size / wall / 1e9:8.1f} GB/s"
    if size is not None and copied is not None:
        rate += f", {size / wall / copied:5.2f} of a copy"
    print(f"  {what:<58}{1e3 * wall:10.3f} ms{1e3 * cpu:10.3f} ms cpu{rate}")


def main(nodes: list[int]) -> None:
    for count in nodes:
        space = Nodes(count)
        functionals = functionals_of(space)
        state = np.zeros(space.n_dofs * STEPS)
        target = np.empty_like(state)
        copy = best(lambda source=state, to=target: np.copyto(to, source))
        moved = 2 * state.nbytes
        copied = moved / copy[0]
        print(f"{count:,} nodes, {space.n_dofs:,} dofs")
        show("copying a series of states", copy, moved)
        weights = np.zeros((1, space.n_dofs))
        weights[0, space.layout.block("p").start :: 97] = 1.0
        quantity = Weighted(weights)
        for samples in (80, 512):
            background = background_of(space, samples)
            for name, estimator in (
                ("minimum variance", MinimumVariance()),
                ("PBDW", PBDW(n=30, weights="balanced")),
            ):
                began, used = time.perf_counter(), time.process_time()
                prepared = estimator.prepare(background, functionals, WhiteNoise(1.0))
                offline = time.perf_counter() - began, time.process_time() - used
                data = functionals(background.lift(background.coefficients[:, :, :1]))
                began, used = time.perf_counter(), time.process_time()
                ready = prepared.readout(quantity, 0.1)
                making = time.perf_counter() - began, time.process_time() - used
                wanted = prepared.estimate(data, 0.1).quantity(quantity)
                assert np.allclose(ready(data), wanted, rtol=1e-9)
                print(f" {name}, {samples} samples")
                show("prepare, once", offline)
                show("making a readout with its deviation, once", making)
                show("readout of a mean over 40 steps: one number", best(lambda r=ready, d=data: r(d)))
                show(
                    "estimate(data).quantity(q), for comparison",
                    best(lambda p=prepared, d=data, q=quantity: p.estimate(d, 0.1).quantity(q)),
                )
                estimate = prepared.estimate(data, 0.1)
                if estimate.correction is None:
                    basis = 8 * sum(b.basis.size for b in background.bases.values())
                    one, series = 8 * space.n_dofs, 8 * space.n_dofs * STEPS
                    show("lifting one state", best(lambda e=estimate: e.state(0, 5)), basis + one, copied)
                    show("lifting a series of 40", best(lambda e=estimate: e.state(0)), basis + series, copied)


if __name__ == "__main__":
    main([int(each) for each in sys.argv[1:]] or [5147, 33000])
