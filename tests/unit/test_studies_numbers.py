"""Studies of PBDW's weight and dimension and of cohorts: the numbers of validation where they must be."""

import numpy as np
import pytest

from dacore.core.quantity import QuantityOfInterest
from dacore.studies.errors import JOINT
from dacore.studies.outcomes import PRIOR
from dacore.workflow.canvas import Canvas
from tests.study_scenes import counted, found, opened

STUDIES = """
[study.weights]
kind = "weights"
estimator = "pbdw"
field = "p"
lowest = 1e-15
highest = 1e-5
count = 3
products = ["l2", "h1"]

[study.dimension]
kind = "dimension"
estimator = "pbdw"
largest = 8
"""
COHORT = """
[study.s]
kind = "cohort"
quantity = "cavity_pressure"
groups = [
    { name = "normal", patients = 5, ranges = { p_ventricles = [1e4, 1.02e4] } },
    { name = "raised", patients = 4, ranges = { p_ventricles = [1.08e4, 1.1e4] } },
]
"""
GROUPS = ("normal", "raised")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("numbers")


@pytest.fixture(scope="module")
def session(folder):
    made = opened(folder, STUDIES)
    _ = made.validation
    return made


def numbers(session, estimator, level):
    """Mean errors and root mean squares of an estimator in a validation."""
    outcome = session.validation.outcome(estimator, level)
    errors = [values.mean() for label, values in outcome.space_time.items() if label != JOINT]
    return [*errors, outcome.quantities["cavity_pressure"].rms]


def of_study(findings, *place):
    return [*findings.arrays["errors"][place], *findings.arrays["rms"][place]]


def test_the_scenes_own_weight_reproduces_its_validation(session):
    findings = found(session, "weights")
    assert findings.arrays["weights"][0] == pytest.approx(1e-15)
    for j, level in enumerate((0.0, 0.1)):
        np.testing.assert_allclose(of_study(findings, 0, 0, j), numbers(session, "pbdw", level), rtol=1e-9)
        outcome = session.validation.outcome("pbdw", level).quantities["cavity_pressure"]
        claimed = np.sqrt((outcome.deviation**2).mean())
        np.testing.assert_allclose(findings.arrays["claimed"][0, 0, j], claimed, rtol=1e-9)
        np.testing.assert_array_equal(findings.arrays["n"][0, :, j], 3.0)


@pytest.mark.parametrize("weight", [1e-10, 1e-5])
def test_other_weights_are_those_of_a_scene_of_its_own(folder, session, weight):
    alone = opened(folder, changes=[f"estimator.pbdw.weights.p={weight}"])
    row = int(np.argmin(np.abs(np.log(found(session, "weights").arrays["weights"] / weight))))
    expected = numbers(alone, "pbdw", 0.1)
    np.testing.assert_allclose(of_study(found(session, "weights"), 0, row, 1), expected, rtol=1e-9)
    least = np.nanmin(alone.judged("pbdw").inf_sup)
    np.testing.assert_allclose(found(session, "weights").arrays["inf_sup"][0, row], least, rtol=1e-9)


def test_the_other_product_is_that_of_a_scene_trained_in_it(folder, session):
    alone = opened(folder, changes=["training.product=h1"])
    for j, level in enumerate((0.0, 0.1)):
        np.testing.assert_allclose(
            of_study(found(session, "weights"), 1, 0, j), numbers(alone, "pbdw", level), rtol=1e-6
        )


def test_weights_train_the_other_product_once_and_the_scenes_own_not_again(folder, session, monkeypatch):
    _ = found(session, "weights")
    counts = counted(monkeypatch)
    _ = found(opened(folder, STUDIES.replace("count = 3", "count = 2")), "weights")
    assert counts == {}


def test_the_table_of_weights_names_the_rules_choice(session):
    study, findings = session.builder.studies["weights"], found(session, "weights")
    tables = [part for part in study.show(findings, Canvas(session)).parts if hasattr(part, "rows")]
    assert len(tables) == 4
    claimed = findings.arrays["claimed"][0, :, 1, 0]
    assert tables[1].rows[0][0].text == "guessing the training mean"
    for row, value in zip(tables[1].rows[1:], claimed, strict=True):
        assert row[0].endswith("(rule)") == (value == claimed.min())


def test_the_dimension_in_use_reproduces_the_validation(session):
    findings = found(session, "dimension")
    row = findings.arrays["n"].tolist().index(3.0)
    for k, level in enumerate((0.0, 0.1)):
        np.testing.assert_allclose(of_study(findings, k, row), numbers(session, "pbdw", level), rtol=1e-8)


@pytest.mark.parametrize("rule", ["bound", "noise", "gcv", "discrepancy"])
def test_a_rule_is_an_estimator_of_that_rule(folder, session, rule):
    findings = found(session, "dimension")
    r = findings.facts["rules"].index(rule)
    alone = opened(folder, changes=[f"estimator.pbdw.n={rule}", "estimator.pbdw.max_dimension=8"])
    for k, level in enumerate((0.0, 0.1)):
        arrays = findings.arrays
        given = [*arrays["rule_errors"][k, r], *arrays["rule_rms"][k, r]]
        np.testing.assert_allclose(given, numbers(alone, "pbdw", level), rtol=1e-8)
        data = alone.runner["noisy"]
        chosen = alone.prepared("pbdw").choose(data.given(level), data.sigmas[level])
        assert arrays["rule_n"][k, r] == np.median(chosen)


def test_the_best_n_of_the_table_has_the_least_error_of_the_hidden_field(session):
    findings = found(session, "dimension")
    (table,) = [part for part in session.builder.studies["dimension"].show(findings, Canvas(session)).parts
                if hasattr(part, "rows")]  # fmt: skip
    rules, rows = 1 + len(findings.facts["rules"]), table.rows[1:]
    for k in range(2):
        best = int(np.argmin(findings.arrays["errors"][k, :, 2]))
        assert rows[k * rules][1:3] == ["best n", f"{findings.arrays['n'][best]:.3g}"]
        assert all(float(row[6]) >= 0.99 for row in rows[k * rules : (k + 1) * rules])


@pytest.fixture(scope="module")
def patients(folder):
    return opened(folder, COHORT)


def test_more_patients_change_none(folder, patients):
    some = found(patients).arrays
    more = found(opened(folder, COHORT.replace("patients = 5", "patients = 8"))).arrays
    rows = [0, 1, 2, 3, 4, 8, 9, 10, 11]
    for name in ("truth", "group", "estimate", "deviation", "quantiles", "errors", "guess_errors", "alarm"):
        # Estimated together with others, sums round otherwise.
        np.testing.assert_allclose(more[name][..., rows], some[name], rtol=1e-9)
    np.testing.assert_array_equal(more["samples"][rows], some["samples"])


def test_a_chosen_estimator_and_level_give_the_same_numbers(folder, patients):
    study = COHORT + 'estimators = ["mv"]\nnoise = [0.1]\n'
    fewer, all_of_them = found(opened(folder, study)), found(patients)
    assert (fewer.facts["estimators"], fewer.facts["levels"]) == (["mv"], [0.1])
    for name in ("estimate", "deviation", "errors"):
        np.testing.assert_array_equal(fewer.arrays[name][0, 0], all_of_them.arrays[name][1, 1])


def test_true_numbers_are_those_of_the_full_model_as_near_as_promised(patients):
    arrays, model = found(patients).arrays, patients.model
    quantity: QuantityOfInterest = patients.quantities["cavity_pressure"]
    functionals = quantity.functionals(model.space)
    for sample, value in zip(arrays["samples"][::4], arrays["truth"][::4], strict=True):
        states = model.solve(patients.parameters.as_mapping(sample)).states
        assert float(functionals(states).mean()) == pytest.approx(value, rel=1e-2)
    assert (arrays["truth"][:5] < 1.021e4).all()
    assert (arrays["truth"][5:] > 1.079e4).all()


def test_the_guess_is_that_of_the_training_set(patients):
    mean, deviation = found(patients).arrays["guess"]
    outcome = patients.validation.outcome(PRIOR, 0.0).quantities["cavity_pressure"]
    np.testing.assert_allclose(mean, outcome.estimate[0, 0], rtol=1e-9)
    np.testing.assert_allclose(deviation, outcome.deviation[0, 0], rtol=1e-9)


def test_who_is_told_right_is_counted_at_the_middle_between_the_groups(patients):
    study, findings = patients.builder.studies["s"], found(patients)
    truth, group = findings.arrays["truth"], findings.arrays["group"]
    middle = 0.5 * (truth[group == 0].max() + truth[group == 1].min())
    assert study.limit(findings) == pytest.approx(middle)
    for e in range(2):
        for k in range(2):
            right = ((findings.arrays["estimate"][e, k] > middle) == (group == 1)).sum()
            assert str(study.classification(findings, e, k).fixed.correct).startswith(str(right))
    told = next(part for part in study.show(findings, Canvas(patients)).parts if hasattr(part, "rows"))
    assert told.caption == f"{GROUPS[0]} or {GROUPS[1]} by cavity pressure"


def test_a_threshold_of_ones_own_is_taken(folder):
    session = opened(folder, COHORT + "threshold = 9e3\n")
    study = session.builder.studies["s"]
    assert study.limit(found(session)) == 9e3
    # Minimum variance puts everybody above it.
    assert (found(session).arrays["estimate"][1] > 9e3).all()
    assert str(study.classification(found(session), 1, 0).fixed.correct).startswith("4")
