"""A scene trained by a reduced model: the same estimates as from full training, few full solves, resumed and kept."""

import json
from pathlib import Path

import numpy as np
import pytest

from dacore import open_scene
from dacore.dynamics.march import MarchedModel
from dacore.errors import SceneError
from dacore.workflow.run import plan_scene, run_scene

BALL = Path(__file__).resolve().parents[2] / "examples" / "toy" / "ball.toml"
SMALL = [
    "domain.edge=2.4", "time.steps=10", "training.samples=40", "training.seed=4", "validation.cases=4",
    "validation.refine_time=0", "noise.levels=[0.0, 0.1]",
]  # fmt: skip
REDUCED = ['training.method="reduced"', "training.reduction=1e-5", "training.tolerance=1e-8"]


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(scope="module")
def full(cache):
    return open_scene(BALL, SMALL, cache)


@pytest.fixture(scope="module")
def reduced(cache):
    return open_scene(BALL, [*SMALL, *REDUCED], cache)


def count_solves(monkeypatch):
    """Count what is marched in full from now on."""
    solved = []
    for name in ("solve", "motions"):
        original = getattr(MarchedModel, name)

        def counted(self, parameters, *rest, original=original):
            solved.append(dict(parameters))
            return original(self, parameters, *rest)

        monkeypatch.setattr(MarchedModel, name, counted)
    return solved


def test_full_and_reduced_training_give_the_same_estimates(full, reduced):
    assert np.array_equal(full.background.samples, reduced.background.samples)
    names = [name for name in full.scene.estimator if name != "pbdw_one_space"]  # β small: amplifies anything
    data = full.runner["noisy"]
    for name in names:
        for level in full.scene.noise.levels:
            pair = [
                each.prepared(name).estimate(data.data[level], noise_scale=data.sigmas[level])
                for each in (full, reduced)
            ]
            truth, found = (each.state(series=0) for each in pair)
            for field in full.model.space.fields:
                block, product = full.model.space.layout.block(field.name), full.model.space.field_product(field.name)
                error = truth[block] - found[block]
                size = np.einsum("ij,ij->", truth[block], product @ truth[block])
                assert np.sqrt(np.einsum("ij,ij->", error, product @ error) / size) < 1e-3


def test_a_fraction_is_solved_in_full_and_the_rest_is_as_accurate_as_it_says(reduced):
    training, unseen = reduced.reduced, reduced.unseen_errors
    assert len(training.solved) < 30
    assert training.estimates.shape == (2, 40)
    assert training.estimates.max() <= 1e-5
    for name in ("u", "p"):
        assert unseen.true[name].max() < 1e-5
        assert 0.5 < unseen.effectivity[name].min() <= unseen.effectivity[name].max() < 100
    assert unseen.true["p − p_csf"].min() > unseen.true["p"].max()


def test_another_tolerance_solves_only_what_it_still_needs(reduced, cache, monkeypatch):
    done = set(reduced.reduced.solved.tolist())
    solved = count_solves(monkeypatch)
    looser = open_scene(BALL, [*SMALL, REDUCED[0], "training.reduction=1e-2"], cache)
    again = set(looser.reduced.solved.tolist())
    assert len(solved) == len(again - done)
    assert len(again) <= len(done)


def test_a_finished_training_is_read_not_repeated(reduced, cache, monkeypatch):
    expected = reduced.reduced
    solved = count_solves(monkeypatch)
    again = open_scene(BALL, [*SMALL, *REDUCED], cache)
    assert np.array_equal(again.background.coefficients, expected.background.coefficients)
    assert not solved
    rows = {row.name: row.status for row in plan_scene(BALL, [*SMALL, *REDUCED], cache.parent, cache)}
    assert rows["training"] == "cached"
    assert rows["motions"] == "skipped"


def test_a_lost_motion_is_solved_again(reduced, cache, monkeypatch):
    runner = reduced.runner
    folder = runner.folder(runner.pipeline["motions"])
    files = sorted(folder.glob("*.h5"))
    assert len(files) == len(reduced.reduced.solved)
    files[0].write_bytes(files[0].read_bytes()[:-100])
    runner.path(runner.pipeline["training"]).unlink()
    solved = count_solves(monkeypatch)
    again = open_scene(BALL, [*SMALL, *REDUCED], cache)
    assert np.array_equal(again.reduced.solved, reduced.reduced.solved)
    assert len(solved) == 1


def test_results_say_how_it_was_trained(cache, tmp_path):
    run_scene(BALL, [*SMALL, *REDUCED], tmp_path, cache)
    told = json.loads((tmp_path / "results.json").read_text())["reduced_training"]
    assert told["solved_in_full"] < 40
    assert told["motions_each"] == 2
    assert len(told["unseen_cases"]["error"]["p"]) == 4
    assert "Reduced training" in (tmp_path / "report.html").read_text()


def test_keys_of_reduced_training_alone_are_refused():
    with pytest.raises(SceneError, match="reduction: of method = 'reduced', but the method is 'full'"):
        open_scene(BALL, ["training.reduction=1e-3"])


def test_too_few_trajectories_name_the_key(cache):
    with pytest.raises(
        SceneError, match=r"ball.toml: training: reduced training: 8 trajectories leave .* training.most"
    ):
        _ = open_scene(BALL, [*SMALL, REDUCED[0], "training.reduction=1e-13", "training.most=8"], cache).reduced


def test_a_full_training_has_no_reduced_model(full):
    with pytest.raises(SceneError, match=r"training\.method: got 'full', expected 'reduced'"):
        _ = full.reduced
