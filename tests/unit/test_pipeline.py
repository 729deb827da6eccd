"""Stages: keys, laziness, cache, plan. Calls are counted, not seconds."""

import json

import pytest

from dacore.errors import DacoreError, StoreError
from dacore.pipeline.costs import Cost, Ledger, Record, memory_text, seconds_text
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


def test_what_is_asked_for_anew_is_made_anew_and_replaces_what_was_kept(tmp_path):
    _ = Runner(Work().pipeline, tmp_path)["errors"]
    again = Work()
    runner = Runner(again.pipeline, tmp_path, fresh=["background"])
    assert [row.status for row in runner.plan(["errors"])] == ["cached", "run", "run", "skipped"]
    _ = runner["errors"]
    assert again.calls == ["background", "errors"]
    every = Work()
    runner = Runner(every.pipeline, tmp_path, fresh=["all"])
    assert {row.status for row in runner.plan(["errors"])} == {"run", "skipped"}
    _ = runner["errors"]
    assert every.calls == ["snapshots", "background", "errors"]
    assert runner.path(every.pipeline["background"]).exists()


def test_a_stage_that_does_not_exist_cannot_be_made_anew(tmp_path):
    with pytest.raises(DacoreError, match="fresh: got 'snapshot', expected all, or any of snapshots, background"):
        Runner(Work().pipeline, tmp_path, fresh=["snapshot"])


class Pieces:
    """A stage that leaves a file for each piece of work, and one after it whose size only this one knows."""

    def __init__(self, stop=8):
        def compute(results, folder):
            folder.mkdir(parents=True, exist_ok=True)
            for index in range(stop):
                (folder / f"piece_{index}.h5").touch()
            return 8

        def law(sizes):
            return Cost(10.0 * sizes["pieces"], 2.0**30)

        def after(sizes):
            return Cost(sizes["n"], 0.0) if "n" in sizes else None

        self.pipeline = Pipeline(
            [
                Stage(
                    "work", (), {}, compute, Codec(".json", TEXT.save, load_json), cost=law,
                    size=lambda result: {"n": 3.0 * result}, pieces=8,
                ),
                Stage("after", ("work",), {}, lambda results, _: results["work"], cost=after),
            ]
        )  # fmt: skip


def costs(runner):
    return {row.name: row.cost and row.cost.seconds for row in runner.plan(["after"])}


def test_costs_are_laws_of_what_is_known(tmp_path):
    assert costs(Runner(Pieces().pipeline, tmp_path)) == {"work": None, "after": None}
    runner = Runner(Pieces().pipeline, tmp_path, sizes={"pieces": 8.0})
    assert costs(runner) == {"work": 80.0, "after": None}
    _ = runner["work"]
    assert runner.plan(["after"])[1].cost == Cost(24.0, 0.0)
    # The next run knows how large the result is from what this one noted.
    assert costs(Runner(Pieces().pipeline, tmp_path, sizes={"pieces": 8.0}))["after"] == 24.0


def test_costs_lean_on_what_the_same_kind_of_stage_took_here(tmp_path):
    ledger = Ledger(tmp_path)
    for key, seconds in (("a", 15.0), ("b", 20.0), ("c", 900.0)):
        ledger.keep(key, Record("work.one", seconds, seconds, 10.0, {}))
    ledger.keep("d", Record("work", 5.0, 5.0, 0.0, {}))
    ledger.keep("e", Record("work", 1e9, 5.0, 1.0, {}, laws=-1))
    (tmp_path / "costs" / "work-f.json").write_text("{")
    assert ledger.factor("work.two") == pytest.approx(2.0)
    assert ledger.factor("worker") is None
    (row, _) = Runner(Pieces().pipeline, tmp_path, sizes={"pieces": 8.0}).plan(["after"])
    assert row.measured
    assert row.cost.seconds == pytest.approx(160.0)


def test_work_that_resumes_costs_what_is_left_and_teaches_nothing(tmp_path):
    runner = Runner(Pieces().pipeline, tmp_path, sizes={"pieces": 8.0})
    folder = runner.folder(runner.pipeline["work"])
    folder.mkdir(parents=True)
    for index in range(6):
        (folder / f"piece_{index}.h5").touch()
    (folder / ".half.h5").touch()
    (row, _) = runner.plan(["after"])
    assert (row.status, row.why, row.cost.seconds) == ("resume", "6 of 8 done", pytest.approx(20.0))
    _ = runner["after"]
    assert runner.ledger.factor("work") is None
    fresh = Runner(Pieces(stop=2).pipeline, tmp_path, sizes={"pieces": 8.0}, fresh=["work"])
    assert fresh.plan(["after"])[0].cost.seconds == pytest.approx(80.0)
    _ = fresh["work"]
    assert len(list(folder.iterdir())) == 2
    assert fresh.ledger.factor("work") is not None


def test_a_kept_result_costs_its_reading(tmp_path):
    runner = Runner(Pieces().pipeline, tmp_path, sizes={"pieces": 8.0})
    _ = runner["work"]
    (row, _) = Runner(Pieces().pipeline, tmp_path).plan(["after"])
    assert row.status == "cached"
    assert row.cost.seconds < 1e-6
    assert runner.states == {"work": "run"}


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.2, "under 1 s"), (1.2, "1 s"), (41.0, "41 s"), (400.0, "6.7 min"), (4500.0, "75 min"), (9000.0, "2.5 h")],
)
def test_times_are_told_in_two_digits(seconds, text):
    assert seconds_text(seconds) == text


def test_memory_is_told_in_two_digits():
    assert [memory_text(size * 2.0**20) for size in (3.0, 184.0, 1000.0, 5210.0)] == [
        "10 MiB", "180 MiB", "0.98 GiB", "5.1 GiB",
    ]  # fmt: skip


def test_a_run_that_knows_no_size_runs_all_the_same(tmp_path):
    runner = Runner(Pieces().pipeline, tmp_path)
    assert runner["after"] == 8
    assert runner.ledger.factor("work") is None
