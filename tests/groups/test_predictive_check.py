"""The predictive check of a population: statistics by hand, kinds and outliers found, ordinary groups left in peace."""

from dataclasses import replace

import numpy as np
import pytest
from populations import MEAN, made_population, ordinary

import bayes_toe as bt
from bayes_toe.classical.asymmetry import asymmetry
from bayes_toe.groups.predictive_check import CONTRADICTED, predictive_check


def by_label(check):
    return {one.label: one for one in check.statistics}


def test_what_is_observed_is_what_the_answers_say():
    found = made_population(ordinary(8))
    seen, table = by_label(predictive_check(found, groups=50)), asymmetry(found.study)
    means, accuracies = np.array([(row.mean_asymmetry, row.accuracy) for row in table]).T
    shares = np.array([one.fraction_yes for one in found.study])
    scores = (shares - shares.mean()) / shares.std(ddof=1)
    assert seen["sd of mean asymmetry"].observed == pytest.approx(means.std(ddof=1))
    assert seen["sd of accuracy"].observed == pytest.approx(accuracies.std(ddof=1))
    assert seen["skewness of share of 'equal'"].observed == pytest.approx(np.mean(scores**3))
    assert seen["farthest share of 'equal', in sd"].observed == pytest.approx(np.abs(scores).max())


def test_an_ordinary_group_is_left_in_peace():
    checks = [predictive_check(made_population(ordinary(20, seed), seed=seed), groups=300) for seed in range(4)]
    assert [check.warnings for check in checks] == [()] * 4
    assert predictive_check(made_population(ordinary(6)), groups=100) == predictive_check(made_population(ordinary(6)), groups=100)


def test_two_kinds_of_subjects_are_no_normal_population():
    eta = MEAN + 0.03 * np.random.default_rng(3).standard_normal((20, 4))
    eta[:, 0] += np.where(np.arange(20) % 2, 1.0, -1.0)
    check = predictive_check(made_population(eta))
    said = [words for words in check.warnings if "farthest in its mean asymmetry is nearer than a normal population" in words]
    assert len(said) == 1
    assert "A covariate may tell them apart" in said[0]
    assert "--population t" not in said[0]


def test_a_subject_far_away_asks_for_t_and_only_where_the_population_is_normal():
    eta = MEAN + 0.1 * np.random.default_rng(3).standard_normal((30, 4))
    eta[0, 3] -= 1.4  # rarely 'equal'
    found = made_population(eta)
    check = predictive_check(found)
    assert any("farther out than a normal" in words and words.endswith("; try --population t") for words in check.warnings)
    assert all(one.p_value < CONTRADICTED for one in check.statistics if one.label.startswith("farthest share"))
    t = predictive_check(replace(found, settings=replace(found.settings, scatter="t")))
    assert not any("try" in words for words in t.warnings)
    assert by_label(t)["farthest share of 'equal', in sd"].p_value > by_label(check)["farthest share of 'equal', in sd"].p_value


def test_of_two_subjects_only_spreads_are_asked_and_without_both_orders_no_asymmetry():
    found = made_population(ordinary(2))
    assert list(by_label(predictive_check(found, groups=40))) == ["sd of mean asymmetry", "sd of accuracy"]
    one_order = bt.Study([bt.Subject(name, [0.0, 0.1], [0.3, 0.1], [3, 7], [9, 9]) for name in found.study.names])
    assert list(by_label(predictive_check(replace(found, study=one_order), groups=40))) == ["sd of accuracy"]
