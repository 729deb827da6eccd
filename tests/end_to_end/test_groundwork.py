"""What an estimator makes of a background alone is kept once, read with the same bits, and made again if damaged."""

import logging
from pathlib import Path

import numpy as np
import pytest

from dacore import open_scene
from dacore.core.noise import WhiteNoise
from dacore.estimators import posterior_emulator
from dacore.workflow.run import plan_scene

BALL = Path(__file__).resolve().parents[2] / "examples" / "toy" / "ball.toml"
CHANGES = [
    "domain.edge=2.4", "time.steps=8", "training.samples=40", "validation.cases=3", "validation.refine_time=0",
    "noise.levels=[0.0, 0.1]", 'training.method="reduced"',
    'estimator={sampled={kind="posterior",points=256},fast={kind="posterior",posterior="laplace"},linear={kind="minimum_variance"}}',
]  # fmt: skip


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(scope="module")
def first(cache):
    session = open_scene(BALL, CHANGES, cache)
    return session, session.validation, estimates(session)


@pytest.fixture
def made(monkeypatch):
    """Count emulations."""
    runs = []
    original = posterior_emulator._Maker.run

    def counted(self):
        runs.append(self)
        return original(self)

    monkeypatch.setattr(posterior_emulator._Maker, "run", counted)
    return runs


def estimates(session):
    data = session.runner["noisy"]
    return {
        (name, level): session.prepared(name).estimate(data.data[level], noise_scale=data.sigmas[level])
        for name in ("sampled", "fast")
        for level in session.scene.noise.levels
    }


def kept(cache):
    return sorted(cache.glob("groundwork.*.h5"))


def test_two_estimators_share_one_file(first, cache):
    assert len(kept(cache)) == 1
    rows = {row.name: row for row in plan_scene(BALL, CHANGES, cache.parent, cache)}
    assert [row.status for name, row in rows.items() if name.startswith("groundwork")] in (["cached"], ["skipped"])
    # Another noise asks for the estimators again, not for what they rest on.
    rows = {row.name: row for row in plan_scene(BALL, [*CHANGES, "noise.seed=9"], cache.parent, cache)}
    (row,) = (row for name, row in rows.items() if name.startswith("groundwork"))
    assert row.status == "cached"
    assert rows["prepared.fast"].status == "run"


def test_what_is_read_gives_the_same_bits(first, cache, made):
    again = open_scene(BALL, CHANGES, cache)
    assert again.background is not first[0].background
    found = estimates(again)
    assert not made
    (name,) = (stage.name for stage in again.runner.pipeline.stages if stage.name.startswith("groundwork"))
    assert again.runner.states[name] == "cached"
    for key, estimate in first[2].items():
        np.testing.assert_array_equal(found[key].coefficients, estimate.coefficients)
        np.testing.assert_array_equal(found[key].parameters.covariance, estimate.parameters.covariance)
        for quantity in again.builder.quantities.values():
            np.testing.assert_array_equal(
                found[key].standard_deviation(quantity), estimate.standard_deviation(quantity)
            )


def test_a_scene_with_other_data_reads_it_too_and_other_settings_do_not(first, cache, made):
    other = open_scene(BALL, [*CHANGES, "observation.slice.coverage=0.9"], cache)
    other.prepared("fast")
    assert not made
    finer = open_scene(BALL, [*CHANGES, "estimator.fast.tolerance=1e-2"], cache)
    finer.prepared("fast")
    assert len(made) == 1
    assert len(kept(cache)) == 2


def test_a_damaged_file_is_made_again(first, cache, made, caplog):
    session = open_scene(BALL, CHANGES, cache)
    (name,) = (stage for stage in session.runner.pipeline.stages if stage.name.startswith("groundwork"))
    path = session.runner.path(name)
    whole = path.read_bytes()
    path.write_bytes(whole[:-100] + bytes(100))
    with caplog.at_level(logging.WARNING):
        found = estimates(session)
    assert "computing it again" in caplog.text
    assert len(made) == 1
    for key, estimate in first[2].items():
        np.testing.assert_array_equal(found[key].coefficients, estimate.coefficients)
    assert path.read_bytes() == whole


def test_parts_of_another_background_are_refused(first):
    session = first[0]
    estimator = session.builder.estimators["fast"]
    arrays, facts = estimator.pack(session.background)
    other = open_scene(BALL, [*CHANGES, "training.samples=30"], session.runner.cache).background
    with pytest.raises(ValueError, match="expected"):
        estimator.unpack(arrays, facts, other)
    with pytest.raises(KeyError):
        estimator.unpack({"modes": arrays["modes"]}, facts, other)
    # What is there stays, whatever is offered.
    estimator.unpack(arrays, facts, session.background)
    assert estimator.prepare(session.background, session.functionals, WhiteNoise(1.0)).emulator.left == facts["left"]
