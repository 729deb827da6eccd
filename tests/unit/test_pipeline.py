"""Stages: keys, laziness, cache, plan. Calls are counted, not seconds."""

import json

import pytest

from dacore.errors import DacoreError, StoreError
from dacore.pipeline.runner import Runner
from dacore.pipeline.stage import Codec, Pipeline, Stage


def load_json(path, _results):
    try:
        return json.loads(path.read_text())
    except ValueError as error:
        raise StoreError(f"{path}: damaged") from error


TEXT = Codec(".json", lambda value, path: path.write_text(json.dumps(value)) and None, load_json)


class Work:
    """A chain a -> b -> c with a side branch, counting computations."""

    def __init__(self, noise=0.1, samples=3):
        self.calls = []

        def stage(name, needs, settings, value, codec=None):
            def compute(results, folder):
                self.calls.append(name)
                return value + sum(results[need] for need in needs)

            return Stage(name, needs, settings, compute, codec)

        self.pipeline = Pipeline(
            [
                stage("snapshots", (), {"samples": samples}, samples, TEXT),
                stage("background", ("snapshots",), {}, 10, TEXT),
                stage("errors", ("background",), {"noise": noise}, noise),
                stage("pictures", ("errors",), {}, 0),
            ]
        )


def test_only_what_is_asked_for_runs(tmp_path):
    work = Work()
    assert Runner(work.pipeline, tmp_path)["background"] == 13
    assert work.calls == ["snapshots", "background"]


def test_changing_the_noise_recomputes_no_snapshot(tmp_path):
    _ = Runner(Work().pipeline, tmp_path)["errors"]
    again = Work(noise=0.2)
    assert Runner(again.pipeline, tmp_path)["errors"] == pytest.approx(13.2)
    assert again.calls == ["errors"]


def test_changing_the_samples_recomputes_what_depends_on_them(tmp_path):
    _ = Runner(Work().pipeline, tmp_path)["errors"]
    again = Work(samples=4)
    assert Runner(again.pipeline, tmp_path)["errors"] == pytest.approx(14.1)
    assert again.calls == ["snapshots", "background", "errors"]


def test_plan_says_what_a_run_then_does(tmp_path):
    work = Work()
    runner = Runner(work.pipeline, tmp_path)
    status = {row.name: row.status for row in runner.plan(["errors"])}
    assert status == {"snapshots": "run", "background": "run", "errors": "run", "pictures": "skipped"}
    assert work.calls == []
    _ = runner["errors"]
    status = {row.name: row.status for row in Runner(Work().pipeline, tmp_path).plan(["errors"])}
    assert status == {"snapshots": "skipped", "background": "cached", "errors": "run", "pictures": "skipped"}


def test_a_damaged_result_is_computed_again_and_said(tmp_path, caplog):
    work = Work()
    runner = Runner(work.pipeline, tmp_path)
    _ = runner["background"]
    runner.path(work.pipeline["background"]).write_text("{")
    again = Work()
    assert Runner(again.pipeline, tmp_path)["background"] == 13
    assert "damaged" in caplog.text
    assert again.calls == ["background"]


def test_timings_do_not_count_what_a_stage_waits_for(tmp_path):
    runner = Runner(Work().pipeline, tmp_path)
    _ = runner["errors"]
    assert set(runner.timings) == {"snapshots", "background", "errors"}
    assert all(value >= 0 for value in runner.timings.values())


def test_keys_depend_on_settings_and_needs_only():
    one, other = Work(noise=0.1).pipeline, Work(noise=0.2).pipeline
    assert one.key("background") == other.key("background")
    assert one.key("errors") != other.key("errors")
    assert one.key("pictures") != other.key("pictures")


def test_an_order_that_cannot_work_is_refused():
    stage = Stage("a", ("b",), {}, lambda results, folder: None)
    with pytest.raises(DacoreError, match="a needs b"):
        Pipeline([stage])
