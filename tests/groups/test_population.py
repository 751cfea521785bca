"""Groups whose truth is known, invariance, the public studies, what is refused."""

import numpy as np
import pandas as pd
import pytest
from populations import made_result, simulated_group, two_conditions

import bayes_toe as bt
from bayes_toe.data.covariates import Covariates
from bayes_toe.errors import InputError
from bayes_toe.groups import population as module
from bayes_toe.groups.predictive_check import CONTRADICTED, predictive_check


@pytest.fixture(scope="module")
def result():
    study = simulated_group(7, n_subjects=10, n_each=60, mean_c=0.6, sd_c=0.2, mean_p=0.25)
    return bt.population(study, seed=1)


def test_a_group_of_known_observers(result):
    assert result.is_reliable
    assert result.problems == ()
    constant_error, contraction = result.effect("constant_error"), result.effect("contraction")
    assert constant_error.mean.low < 0.6 < constant_error.mean.high
    assert contraction.mean.low < 0.25 < contraction.mean.high
    assert constant_error.mean.high - constant_error.mean.low < 0.5
    assert constant_error.sd.low < 0.2 < constant_error.sd.high
    assert constant_error.zero_mean.log_bf < -1.0
    assert contraction.zero_mean.log_bf < -1.0
    # Nobody differs in p.
    assert contraction.sd_at_most is not None
    assert contraction.sd.median < contraction.sd_at_most < contraction.sd.high
    assert constant_error.percent is not None
    shift = 100.0 * np.expm1(0.25 * constant_error.mean.median)
    assert constant_error.percent.median == pytest.approx(shift)


def test_tables_have_what_the_draws_say(result):
    table = result.summary().set_index(["parameter", "quantity"])
    expected = np.quantile(result.draws.mean[..., 1], (0.025, 0.5, 0.975))
    row = table.loc[("contraction", "mean")]
    assert row[["q025", "q50", "q975"]].tolist() == pytest.approx(expected.tolist())
    assert row["ln_bf_zero"] == result.effect("contraction").zero_mean.log_bf
    noise = 0.25 * np.exp(result.draws.mean[..., 2])
    jnd = np.median(100.0 * np.expm1(0.6744897501960817 * noise))
    assert table.loc[("jnd_percent", "mean"), "q50"] == pytest.approx(jnd)
    subjects = result.subject_table.frame()
    assert subjects["subject"].unique().tolist() == list(result.subjects)
    assert set(subjects["parameter"]) == {
        "constant_error",
        "contraction",
        "noise",
        "pse_shift_percent",
        "jnd_percent",
        "lapse_rate",
        "noise_slope",
    }
    new = table.loc[("constant_error", "new_subject")]
    mean = table.loc[("constant_error", "mean")]
    assert new["q975"] - new["q025"] > mean["q975"] - mean["q025"]


def test_a_normal_group_is_not_contradicted(result):
    check = predictive_check(result)
    assert check.warnings == ()
    assert all(CONTRADICTED < row.p_value <= 1.0 for row in check.statistics)
    assert [row.kind for row in check.statistics] == [
        "spread",
        "farthest",
        "spread",
        "skewness",
        "farthest",
    ]


def test_a_subject_of_another_kind_contradicts_a_normal_group():
    study = simulated_group(7, n_subjects=24, n_each=60)
    odd = study.subjects[0]
    odd = bt.Subject(odd.name, odd.s1, odd.s2, odd.n_trials, odd.n_trials, task=odd.task)
    made = made_result(bt.Study([odd, *study.subjects[1:]]))
    same = made_result(study)
    # The made-up sds are those of the ordinary subjects.
    draws = same.draws
    made = module.PopulationResult(made.study, made.settings, made.scales, made.regressors, draws)
    assert any(
        "farthest in its share of 'second'" in line for line in predictive_check(made).warnings
    )


def test_units_of_intensity_do_not_matter():
    study = simulated_group(5, n_subjects=6, n_each=20, mean_c=0.4, mean_p=0.1)
    moved = bt.Study(
        [
            bt.Subject(
                subject.name,
                3 * subject.s1 + 2,
                3 * subject.s2 + 2,
                subject.n_yes,
                subject.n_trials,
                task=subject.task,
            )
            for subject in study
        ]
    )
    here, there = (bt.population(each, seed=3) for each in (study, moved))
    assert there.scales.step == pytest.approx(3.0 * here.scales.step)
    for name in ("constant_error", "contraction"):
        first, second = here.effect(name), there.effect(name)
        width = first.mean.high - first.mean.low
        assert second.mean == pytest.approx(first.mean, abs=0.08 * width)
        error = 4.0 * np.hypot(first.zero_mean.error, second.zero_mean.error)
        assert second.zero_mean.log_bf == pytest.approx(first.zero_mean.log_bf, abs=error)


def test_covariates_move_the_means():
    rng = np.random.default_rng(4)
    low, high = (simulated_group(i, 8, 20, mean_c=c).subjects for i, c in ((1, 0.0), (2, 0.8)))
    renamed = [
        bt.Subject(f"Q{i}", one.s1, one.s2, one.n_yes, one.n_trials, task=one.task)
        for i, one in enumerate(high)
    ]
    study = bt.Study([*low, *renamed])
    groups = dict(zip(study.names, ["a"] * 8 + ["b"] * 7, strict=False))
    ages = dict(zip(study.names, rng.normal(30.0, 5.0, 15).tolist(), strict=False))
    with pytest.warns(bt.ConvergenceWarning, match="subject 'Q7' is left out: no covariates"):
        result = bt.population(study, covariates=Covariates({"group": groups, "age": ages}), seed=1)
    rows = {(row.level, row.parameter): row for row in result.table.select("effect")}
    effect = rows["group b", "constant_error"]
    assert effect.q025 < 0.8 < effect.q975
    assert effect.ln_bf_zero is not None
    assert effect.ln_bf_zero < -1.0
    assert effect.p_direction == pytest.approx(1.0, abs=0.01)
    age = rows["age", "contraction"]
    assert age.q025 < 0.0 < age.q975
    assert (
        result.effect("constant_error").mean.low < 0.0 < result.effect("constant_error").mean.high
    )


def test_conditions_differ_by_what_they_differ():
    result = bt.population(two_conditions(3, n_each=40), seed=1)
    [row] = result.table.select("difference", "constant_error")
    assert row.level == "right - left"
    assert row.q025 < 0.5 < row.q975
    assert row.q975 - row.q025 < 0.6
    [contraction] = result.table.select("difference", "contraction")
    assert contraction.q025 < 0.0 < contraction.q975
    assert row.ln_bf_zero is not None
    assert contraction.ln_bf_zero is not None
    assert row.ln_bf_zero < contraction.ln_bf_zero
    assert (
        result.effect("constant_error").mean.low < 0.2 < result.effect("constant_error").mean.high
    )


def test_delays_are_taken_together():
    [one, two] = simulated_group(2, n_subjects=2, n_each=20)
    half = one.n_trials // 2
    parts = (one.n_yes // 2, one.n_yes - one.n_yes // 2)
    split = bt.Subject(
        one.name,
        np.tile(one.s1, 2),
        np.tile(one.s2, 2),
        np.concatenate(parts),
        np.concatenate([np.maximum(half, parts[0]), one.n_trials - np.maximum(half, parts[0])]),
        isi=np.repeat([0.5, 2.0], len(one.s1)),
        task=one.task,
    )
    other = bt.Subject(
        two.name, two.s1, two.s2, two.n_yes, two.n_trials, isi=0 * two.s1 + 1.0, task=two.task
    )
    pooled = module._without_intervals(bt.Study([split, other]))
    assert pooled.intervals == ()
    assert pooled[one.name].n_yes.tolist() == one.n_yes.tolist()
    assert pooled[one.name].n_trials.tolist() == one.n_trials.tolist()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"draws": 3}, "population: draws=3; allowed is a whole number from 100 to 100000"),
        ({"draws": 2.5}, "draws"),
        ({"hyperprior": "none.toml"}, "none.toml: no such file"),
        ({"hyperprior": 3}, "a Hyperprior, or the path of a TOML file"),
    ],
)
def test_what_is_refused(arguments, words):
    with pytest.raises(InputError, match=words):
        bt.population(simulated_group(1, n_subjects=3), **arguments)


def test_one_subject_is_no_group():
    with pytest.raises(InputError, match=r"'?P000'? is one subject; allowed: 2 and more"):
        bt.population(simulated_group(1, n_subjects=1))


def test_conditions_and_covariates_are_not_analysed_together():
    people = Covariates({"age": {"P000": 20.0, "P001": 30.0}})
    with pytest.raises(InputError, match="a condition and covariates are not analysed together"):
        bt.population(two_conditions(1, n_subjects=2), covariates=people)


#: Public studies: mean, interval and sd of c/D and of p, and ln Bayes factors of a zero mean.
VIBROTACTILE = {
    "constant_error": ((0.000, 0.047, 0.094), (0.035, 0.062, 0.117), 0.9),
    "contraction": ((-0.047, 0.019, 0.076), (0.032, 0.073, 0.141), 1.6),
}
AUDITORY = {
    "constant_error": ((-0.192, -0.111, -0.021), (0.222, 0.281, 0.357), -0.65),
    "contraction": ((0.243, 0.279, 0.316), (0.089, 0.113, 0.145), None),
}
TOLERANCE = {"constant_error": 0.015, "contraction": 0.01}


def require_public(result, expected):
    assert result.is_reliable
    for name, (mean, sd, log_bf) in expected.items():
        found = result.effect(name)
        assert found.mean == pytest.approx(mean, abs=TOLERANCE[name])
        assert found.sd == pytest.approx(sd, abs=TOLERANCE[name])
        if log_bf is None:
            assert found.zero_mean.log_bf < -10.0
        else:
            assert found.zero_mean.log_bf == pytest.approx(log_bf, abs=0.2)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_vibrotactile_study(real_data, seed):
    path = real_data / "vibrotactile_rate" / "trials.csv"
    study = bt.read_study(path, bt.ReadOptions(equal_code="1"))
    study = study.swap("946", (2, 4, 6)).swap("865", (2,))
    require_public(bt.population(study, seed=seed), VIBROTACTILE)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_auditory_study(real_data, seed):
    path = real_data / "auditory_pwm" / "trials.csv"
    study = bt.read_study(path, bt.ReadOptions(ignore=("isi",)))
    require_public(bt.population(study, seed=seed), AUDITORY)


def test_a_frame_has_the_columns_of_the_file(tmp_path, result):
    path = result.table.save(tmp_path / "population.csv")
    table = pd.read_csv(path)
    assert list(table.columns) == list(result.summary().columns)
    assert np.array_equal(table["q50"], result.summary()["q50"])
