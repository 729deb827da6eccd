"""Laws of cost: they know what a scene says of its size, and grow with it."""

from pathlib import Path

import pytest

from dacore.domains.ball import Ball
from dacore.domains.box import Box
from dacore.domains.file import MeshFile
from dacore.io.scene import read_scene
from dacore.workflow import laws
from dacore_imaging.brain import Brain

ROOT = Path(__file__).resolve().parents[2]
SIZES = {
    "nodes": 5147.0, "n": 20588.0, "m": 444.0, "r": 80.0, "K": 80.0, "cases": 18.0, "t": 40.0, "marched": 40.0,
    "levels": 2.0, "refine": 4.0, "workers": 1.0,
}  # fmt: skip
LAWS = {
    "domain": laws.domain, "model": laws.model, "functionals": laws.functionals, "background": laws.background,
    "prepared": laws.prepared, "measured": laws.measured, "reference": laws.reference, "judged": laws.judged,
    "refinement": laws.refinement, "training": lambda sizes: laws.trajectories(sizes, "K"),
    "truth": lambda sizes: laws.trajectories(sizes, "cases"), "report": lambda sizes: laws.report(sizes, states=True),
}  # fmt: skip


@pytest.mark.parametrize("name", LAWS)
def test_nothing_larger_costs_less(name):
    small = LAWS[name](SIZES)
    assert small.seconds > 0
    assert small.memory > 1e8
    for size in SIZES:
        if size != "workers":
            large = LAWS[name](SIZES | {size: 3 * SIZES[size]})
            assert large.seconds >= small.seconds, size
            assert large.memory >= small.memory, size


def test_processes_share_the_time_and_add_their_memory():
    one, two = (laws.trajectories(SIZES | {"workers": workers}, "K") for workers in (1.0, 2.0))
    assert two.seconds == pytest.approx(one.seconds / 2)
    assert two.memory == pytest.approx(2 * one.memory)
    assert laws.trajectories(SIZES | {"workers": 200.0}, "cases").memory == pytest.approx(18 * one.memory)


def test_a_scene_says_its_size():
    scene = read_scene(ROOT / "examples/brain/demo.toml", ["time.substeps=2", "time.graded=3", "time.spin_up=10"])
    found = laws.sizes_of(scene, Brain(), 3)
    assert (found["K"], found["cases"], found["t"], found["marched"], found["workers"]) == (80, 18, 40, 103, 3)
    assert laws.trajectory(found) is not None
    unknown = laws.sizes_of(scene, None, 1)
    assert "nodes" not in unknown
    assert all(LAWS[name](unknown) is None for name in ("domain", "model", "training", "background", "refinement"))


@pytest.mark.parametrize(("nodes", "known"), [("5k", 5147), ("33k", 33247)])
def test_the_brain_knows_about_how_many_nodes_it_will_have(nodes, known):
    assert abs(Brain(nodes=nodes).expected_nodes() / known - 1) < 0.1


def test_other_domains_know_it_too_or_say_that_they_do_not():
    box = Box(upper=(1.0, 2.0, 3.0), divisions=(2, 3, 4))
    assert box.expected_nodes() == len(box.mesh().points)
    for edge in (1.6, 1.2):
        ball = Ball(edge=edge)
        assert abs(ball.expected_nodes() / len(ball.mesh().points) - 1) < 0.2
    assert MeshFile(ROOT / "README.md", "cm").expected_nodes() is None
