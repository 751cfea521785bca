"""What is said of a population: columns, rows of every kind, the answer in words, and the predictive check."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from populations import MEAN, made_population, made_up, ordinary

import bayes_toe as bt
from bayes_toe.classical.asymmetry import asymmetry
from bayes_toe.cli.population import answer
from bayes_toe.comparison.population_answer import on_average
from bayes_toe.data.conditions import mean_first
from bayes_toe.data.covariates import Covariates
from bayes_toe.data.tasks import SAME_DIFFERENT, WHICH_STRONGER
from bayes_toe.groups.predictive_check import CONTRADICTED, predictive_check
from bayes_toe.groups.regressors import regressors


@pytest.fixture(scope="module")
def found(small_study):
    """C has no age."""
    study = bt.Study([*small_study, *(bt.Subject(name, **rows(small_study["A"])) for name in "DE")])
    people = Covariates(
        {
            "age": {"A": 20.0, "B": 30.0, "D": 50.0, "E": 41.0},
            "group": dict(zip("ABCDE", "xyxyx", strict=True)),
        }
    )
    who = regressors(people, study.names)
    return made_up(study.select(who.subjects), who)


def rows(subject):
    return {key: getattr(subject, key) for key in ("s1", "s2", "n_yes", "n_trials")}


def test_columns_and_kinds(found, tmp_path):
    frame = pd.read_csv(
        found.table.save(tmp_path / "population.csv"),
        keep_default_na=False,
        na_values={"bf_below": ""},
    )
    assert ",".join(frame.columns) == (
        "parameter,quantity,level,mean,sd,q05,q25,q50,q75,q95,ess_bulk,ess_tail,r_hat,p_direction,bf_zero,bf_no_difference,bf_error,bf_below"
    )
    assert frame.quantity.drop_duplicates().tolist() == [
        "mean",
        "sd",
        "effect",
        "new_subject",
    ]
    assert not frame.duplicated(["parameter", "quantity", "level"]).any()
    labels = ["mu1", "probit gamma", "log width", "probit q0"]
    assert frame.parameter[frame.quantity == "sd"].tolist() == labels
    assert frame.parameter[frame.quantity == "mean"].tolist() == [
        *labels, "sigma_p", "sigma_l", "gamma", "sigma1", "gain", "width", "offset", "pull", "q0", "jnd", "pse_shift"
    ]  # fmt: skip
    assert frame.level[frame.quantity == "effect"].drop_duplicates().tolist() == ["age", "group y"]
    assert ((frame.p_direction != "") == (frame.quantity == "effect")).all()
    assert ((frame.bf_no_difference != "") == (frame.quantity == "effect")).all()


def test_numbers_are_those_of_the_draws(found):
    own, gamma, of = found.chains, found.chains.mean[..., 1], found.table.some
    (label,), (natural,), effect = (
        of("mean", "probit gamma"),
        of("mean", "gamma"),
        of("effect", "log width")[1],
    )
    assert (label.mean, label.q05) == pytest.approx((gamma.mean(), np.quantile(gamma, 0.05)))
    assert natural.q50 == pytest.approx(np.quantile(found.quantities(own.mean)["gamma"], 0.5))
    assert label.ess_bulk == own.convergence["mean", -1, 1].ess_bulk
    assert (effect.level, effect.p_direction) == (
        "group y",
        max((own.effects[..., 1, 2] > 0).mean(), (own.effects[..., 1, 2] < 0).mean()),
    )
    further = {row.parameter: row for row in of("new_subject")}
    assert further["gain"].q50 == pytest.approx(
        np.median(found.quantities(found.new_subject())["gain"])
    )


def test_subjects_in_the_group_and_alone(found):
    frame = found.subjects()
    assert [*frame.columns] == [
        "subject", "parameter", "mean", "sd", "q05", "q25", "q50", "q75", "q95", "ess_bulk", "ess_tail", "r_hat",
        "mcse_mean", "mcse_q05", "mcse_q50", "mcse_q95", "alone_q05", "alone_q50", "alone_q95",
    ]  # fmt: skip
    reported = [
        "mu1",
        "sigma_p",
        "sigma_l",
        "q0",
        "gamma",
        "sigma1",
        "gain",
        "width",
        "pse_shift",
        "jnd",
    ]
    assert frame[["subject", "parameter"]].to_numpy().tolist() == [
        [name, key] for name in "ABDE" for key in reported
    ]  # C is left out
    one = frame[frame.subject == "B"].set_index("parameter")
    assert one.q95["mu1"] == pytest.approx(np.quantile(found.chains.eta[:, :, 1, 0], 0.95))
    assert one.alone_q05["width"] == pytest.approx(
        np.quantile(np.exp(found.unpooled[:, 1, 2]), 0.05)
    )


# --- in words -----------------------------------------------------------------------------------------------------------------------


#: Constant error, probit(gain/2), log width and probit of q0 or of the lapse rate at the mean, and sds between subjects.
TYPICAL = {
    SAME_DIFFERENT: np.array([0.0, 0.0, -1.2, 1.4]),
    WHICH_STRONGER: np.array([0.0, 0.0, -1.2, -1.8]),
}
SPREAD = np.array([0.01, 0.01, 0.1, 0.2])
#: Eight scores, and those of opposite sign: means known as well as sixteen subjects tell them.
SCORE = np.concatenate(
    [sign * np.random.default_rng(4).standard_normal((8, 4)) for sign in (1, -1)]
)


@pytest.mark.parametrize(
    ("task", "mean", "sd", "said"),
    [
        (SAME_DIFFERENT, 0.0, 0.0, "none on average (P of none "),
        (SAME_DIFFERENT, np.eye(4)[0] * 0.15, 0.0, "one on average: a constant error"),
        (SAME_DIFFERENT, -np.eye(4)[1] * 0.25, 0.0, "one on average: a pull"),
        (
            SAME_DIFFERENT,
            0.0,
            np.eye(4)[0] * 0.25,
            "on average, but subjects differ, with effects of either sign",
        ),
        (WHICH_STRONGER, np.eye(4)[0] * 0.15, 0.0, "one on average: a constant error"),
        (WHICH_STRONGER, -np.eye(4)[1] * 0.25, 0.0, "one on average: a pull"),
    ],
)
def test_the_first_line_says_it(task, mean, sd, said):
    """Of what is added to the means, and to the sds."""
    [line] = answer(
        made_population(
            TYPICAL[task] + mean + (SPREAD + sd) * SCORE, model="free weighting", task=task
        )
    )
    assert said in line
    assert "Bayes factor of none" in line
    assert "16 subjects, the model " in line


@pytest.mark.parametrize("task", TYPICAL, ids=lambda task: task.count)
def test_a_pull_that_cannot_be_none_is_said(task):
    """A contraction has a pull in any case: only its constant error may be none."""
    found = made_population(
        np.array([0.0, -0.4, -1.2, TYPICAL[task][3]]) + SPREAD * SCORE,
        model="contraction",
        task=task,
    )
    [first] = answer(found)
    assert "a pull of 0.3" in first
    assert (
        "on average, since this model always has one; constant error: none on average (P of none "
        in first
    )
    (both,) = found.table.some("mean", "order effect")
    assert both.bf_zero is both.bf_below is None
    assert both.mean > 0.2
    assert on_average(found).named == ()


def test_the_size_of_the_effect_does_not_depend_on_where_whose_stimuli_are():
    """Offsets count from everybody's own mean: the same answers to stimuli elsewhere are the same effect, whoever comes first."""
    near = made_population(
        TYPICAL[SAME_DIFFERENT] - np.eye(4)[1] * 0.25 + SPREAD * SCORE[:4], model="free weighting"
    )
    moved = [
        replace(one, s1=one.s1 + far, s2=one.s2 + far)
        for one, far in zip(near.study, (5.0, 0.0, -2.0, 1.0), strict=True)
    ]
    far = replace(near, study=replace(near.study, subjects=tuple(moved)), centre=mean_first(*moved))
    for kind in ("mean", "sd"):
        (one,), (other,) = (found.table.some(kind, "order effect") for found in (near, far))
        assert other.q50 == pytest.approx(one.q50, rel=1e-9)


def test_one_sd_of_students_scatter_is_its_standard_deviation():
    """Tau of Student's t with 4 degrees of freedom is its scale, the root of a half of its sd."""
    found = made_population(
        TYPICAL[SAME_DIFFERENT] + (SPREAD + 0.3 * np.eye(4)[0]) * SCORE, model="free weighting"
    )
    wide = replace(found, settings=replace(found.settings, scatter="t"))
    (normal,), (student,) = (one.table.some("sd", "order effect") for one in (found, wide))
    assert student.q50 == pytest.approx(np.sqrt(2.0) * normal.q50, rel=0.02)


def test_the_real_vibrotactile_subjects_hardly_pull(real_data):
    """Worked out with other code and a somewhat narrower hyperprior: probit gamma -1.65 (-2.26, -1.21), a pull of about 0.05."""
    study = bt.read_study(
        real_data / "vibrotactile_rate" / "trials.csv", bt.ReadOptions(equal_code="1")
    )
    found = bt.population(study, model="predictive update", seed=1, draws=40, workers=1)
    assert found.converged
    gamma, pull = (found.table.some("mean", name)[0] for name in ("probit gamma", "pull"))
    assert gamma.q50 == pytest.approx(-1.65, abs=0.3)
    assert gamma.q05 < -1.9 < -1.5 < gamma.q95
    assert 0.02 < pull.q50 < 0.07


# --- the predictive check -----------------------------------------------------------------------------------------------------------


def labelled(found, groups):
    return {one.label: one for one in predictive_check(found, groups=groups).statistics}


def test_what_is_observed_is_what_the_answers_say():
    found = made_population(ordinary(8))
    seen, table = labelled(found, 50), asymmetry(found.study)
    means, accuracies = np.array([(row.mean_asymmetry, row.accuracy) for row in table]).T
    shares = np.array([one.fraction_yes for one in found.study])
    scores = (shares - shares.mean()) / shares.std(ddof=1)
    assert seen["sd of mean asymmetry"].observed == pytest.approx(means.std(ddof=1))
    assert seen["sd of accuracy"].observed == pytest.approx(accuracies.std(ddof=1))
    assert seen["skewness of share of 'equal'"].observed == pytest.approx(np.mean(scores**3))
    assert seen["farthest share of 'equal', in sd"].observed == pytest.approx(np.abs(scores).max())


def test_an_ordinary_group_is_left_in_peace():
    checks = [
        predictive_check(made_population(ordinary(20, seed), seed=seed), groups=300)
        for seed in range(4)
    ]
    assert [check.warnings for check in checks] == [()] * 4
    assert predictive_check(made_population(ordinary(20, 0), seed=0), groups=300) == checks[0]


def test_two_kinds_of_subjects_are_no_normal_population():
    eta = MEAN + 0.03 * np.random.default_rng(3).standard_normal((20, 4))
    eta[:, 0] += np.where(np.arange(20) % 2, 1.0, -1.0)
    warned = predictive_check(made_population(eta)).warnings
    (said,) = [
        words
        for words in warned
        if "farthest in its mean asymmetry is nearer than a normal population" in words
    ]
    assert "A covariate may tell them apart" in said
    assert "--population t" not in said


def test_a_subject_far_away_asks_for_t_and_only_where_the_population_is_normal():
    eta = MEAN + 0.1 * np.random.default_rng(3).standard_normal((30, 4))
    eta[0, 3] -= 1.4  # rarely 'equal'
    found = made_population(eta)
    normal, t = (
        predictive_check(replace(found, settings=replace(found.settings, scatter=name)))
        for name in ("normal", "t")
    )
    assert any(
        "farther out than a normal" in words and words.endswith("; try --population t")
        for words in normal.warnings
    )
    assert not any("try" in words for words in t.warnings)
    far, near = (
        next(one.p_value for one in check.statistics if one.label.startswith("farthest share"))
        for check in (normal, t)
    )
    assert far < CONTRADICTED
    assert far < near


def test_of_two_subjects_only_spreads_are_asked_and_without_both_orders_no_asymmetry():
    found = made_population(ordinary(2))
    assert [*labelled(found, 40)] == ["sd of mean asymmetry", "sd of accuracy"]
    one_order = bt.Study(
        [bt.Subject(name, [0.0, 0.1], [0.3, 0.1], [3, 7], [9, 9]) for name in found.study.names]
    )
    assert [*labelled(replace(found, study=one_order), 40)] == ["sd of accuracy"]
