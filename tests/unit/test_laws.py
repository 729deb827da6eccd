"""Laws of cost: they know what a scene says of its size, and grow with it."""

from pathlib import Path

import pytest

from dacore.domains.ball import Ball
from dacore.domains.box import Box
from dacore.domains.file import MeshFile
from dacore.io.scene import read_scene
from dacore.pipeline.stage import Stage
from dacore.workflow import laws
from dacore_imaging.brain import Brain

ROOT = Path(__file__).resolve().parents[2]
SIZES = {
    "nodes": 5147.0, "n": 20588.0, "m": 444.0, "r": 80.0, "K": 80.0, "cases": 18.0, "t": 40.0, "marched": 40.0,
    "levels": 2.0, "refine": 4.0, "workers": 1.0, "full": 12.0,
}  # fmt: skip
LAWS = {
    "domain": laws.domain, "model": laws.model, "functionals": laws.functionals, "background": laws.background,
    "prepared": laws.prepared, "measured": laws.measured, "reference": laws.reference, "judged": laws.judged,
    "refinement": laws.refinement, "reduced training": laws.reduced_training,
    "training": lambda sizes: laws.trajectories(sizes, "K"),
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


def test_reduced_training_of_many_samples_costs_a_fraction_and_uses_what_a_round_has():
    sizes = SIZES | {"n": 131500.0, "nodes": 33000.0, "K": 512.0}
    one, two, many = (laws.reduced_training(sizes | {"workers": workers}) for workers in (1.0, 2.0, 64.0))
    assert 10 * one.seconds < laws.trajectories(sizes, "K").seconds
    assert 0.5 * one.seconds < two.seconds < 0.75 * one.seconds
    assert one.memory < two.memory
    assert many == two


@pytest.mark.parametrize(("tolerance", "full"), [(0.5, 8), (1e-3, 12), (1e-5, 20), (1e-12, 24)])
def test_a_finer_reduction_solves_more_in_full(tolerance, full):
    changes = [f"training.reduction={tolerance}", "training.most=24"]
    scene = read_scene(ROOT / "examples/brain/paper.toml", changes)
    assert laws.sizes_of(scene, Brain(nodes="33k"), 1)["full"] == pytest.approx(full)


def test_the_plan_of_a_reduced_training_is_priced_as_one():
    def priced(method, *changes):
        stages = [Stage(name, (), {}, print) for name in ("motions", "training", "background")]
        scene = read_scene(ROOT / "examples/toy/ball.toml", [f'training.method="{method}"', *changes])
        return {stage.name: stage for stage in laws.priced(stages, scene)}

    reduced, full = priced("reduced"), priced("full")
    assert reduced["training"].cost(SIZES) == laws.reduced_training(SIZES)
    assert full["training"].cost(SIZES) == laws.trajectories(SIZES, "K")
    assert reduced["motions"].cost is reduced["background"].cost is None
    assert (reduced["training"].pieces, full["training"].pieces > 0) == (0, True)


def test_a_scene_says_its_size():
    scene = read_scene(ROOT / "examples/brain/demo.toml", ["time.substeps=2", "time.graded=3", "time.spin_up=10"])
    found = laws.sizes_of(scene, Brain(), 3)
    assert (found["K"], found["cases"], found["t"], found["marched"], found["workers"]) == (512, 18, 40, 103, 3)
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
