"""One observer in several conditions or tasks: likelihood, prior of differences, evidence.

The posterior of one condition is tested against its definition in test_observer.py.
"""

import definitions
import numpy as np
import pytest
from numpy.random import default_rng
from scipy import stats

import bayes_toe as bt
from bayes_toe.answers.contrast import CHOICES, condition_evidences
from bayes_toe.data.conditions import Conditions, StimulusScales
from bayes_toe.data.study import with_shared_scales
from bayes_toe.data.tasks import SAME_DIFFERENT, WHICH_STRONGER
from bayes_toe.inference.engine import Precision
from bayes_toe.inference.order_evidence import evidences_of
from bayes_toe.model.condition_model import ConditionModels
from bayes_toe.model.models import OrderModel
from bayes_toe.model.parameters import CONSTANT_ERROR, CONTRACTION, NOISE

S1 = np.array([0.0, 0.3, 0.3, 0.9, 1.2])
S2 = np.array([0.3, 0.0, 0.7, 0.5, 1.2])
#: Counts of five pairs with 12 trials each, in three conditions.
COUNTS = ((5, 2, 9, 1, 4), (9, 4, 10, 2, 7), (8, 3, 9, 4, 6))


def models_in_conditions(counts, pairs=(S1, S2), n_trials=12, task=WHICH_STRONGER):
    """The models of a subject with these counts in conditions a, b and perhaps c."""
    levels = tuple("abc"[: len(counts)])
    units = []
    for level, n_yes in zip(levels, counts, strict=True):
        all_trials = [n_trials] * len(n_yes)
        unit = bt.Subject(f"S@{level}", *pairs, n_yes, all_trials, task=task, condition=level)
        units.append(unit)
    return ConditionModels(tuple(units), Conditions("c", levels).design())


THREE_CONDITIONS = models_in_conditions(COUNTS)
#: So few trials that draws from the prior suffice for an evidence.
TWO_CONDITIONS = models_in_conditions(((15, 4), (19, 9)), ([0.0, 0.5], [0.5, 0.0]), n_trials=20)


def models_of_two_tasks():
    """The models of a subject with answers to both tasks, between which nothing differs."""
    n_second, (_, *n_equal), _ = COUNTS  # the first pair is not shown in the second task
    units = [
        bt.Subject("S@a", S1, S2, n_second, [12] * 5, task=WHICH_STRONGER, condition="a"),
        bt.Subject("S@b", S1[1:], S2[1:], n_equal, [12] * 4, condition="b"),
    ]
    return ConditionModels(with_shared_scales(units), np.zeros((2, 0)))


MODELS = {
    "conditions, 2AFC": THREE_CONDITIONS,
    "conditions, same/different": models_in_conditions(COUNTS, task=SAME_DIFFERENT),
    "tasks": models_of_two_tasks(),
}
EACH_MODEL = pytest.mark.parametrize("models", MODELS.values(), ids=MODELS)


def sum_of_log_likelihoods(models, points):
    """The log likelihood as a sum over conditions, each with an observer of its own."""
    total = 0.0
    # (points, all coordinates) @ (conditions, all coordinates, coordinates of one condition)
    points_of_conditions = points @ models.loading.swapaxes(1, 2)
    for unit, coordinates in zip(models.units, points_of_conditions, strict=True):
        posterior = OrderModel("both").posterior(unit)
        columns = [models.shared_observer.coordinates.index(name) for name in posterior.coordinates]
        total = total + posterior.log_likelihood(coordinates[:, columns])
    return total


@EACH_MODEL
def test_the_likelihood_is_the_product_over_conditions(models):
    posteriors = models.posteriors([models.differing_parameters])
    points = 0.5 * default_rng(1).standard_normal((1, 4, len(posteriors.names)))
    value, *_ = posteriors.likelihood.scoring(points)  # (1 model, 4 points)
    np.testing.assert_allclose(value[0], sum_of_log_likelihoods(models, points[0]), rtol=1e-11)
    np.testing.assert_allclose(posteriors.likelihood.value(points), value, rtol=1e-12)


@EACH_MODEL
def test_the_gradient_is_the_slope_of_the_likelihood(models):
    # One model in which all that may differ does; four points near the middle of the prior.
    likelihood = models.posteriors([models.differing_parameters]).likelihood
    points = 0.5 * default_rng(1).standard_normal((1, 4, models.loading.shape[-1]))
    _, gradient, _ = likelihood.scoring(points)
    slopes = definitions.slopes(lambda x: likelihood.scoring(x)[0], points)
    np.testing.assert_allclose(gradient, slopes, rtol=1e-5, atol=1e-5)


def test_what_does_not_differ_has_no_prior_and_stays_at_0():
    """There are two models: one in which nothing differs, and one in which the noise differs."""
    models = THREE_CONDITIONS
    posteriors = models.posteriors([(), (NOISE,)])
    probability = default_rng(1).uniform(size=(2, 50, len(posteriors.names)))
    points = posteriors.prior_points(probability)  # (models, points, coordinates)
    is_difference = [name.startswith("noise ") for name in posteriors.names]
    k = len(models.parameters)  # coordinates that all conditions share come first
    alike, differing = points
    assert not alike[:, k:].any()
    assert differing[:, is_difference].all()

    log_prior_of_alike, log_prior_of_differing = posteriors.log_prior(points)
    assert log_prior_of_alike == pytest.approx(models.shared_observer.log_prior(alike[:, :k]))
    shared = models.shared_observer.log_prior(differing[:, :k])
    of_differences = stats.norm.logpdf(differing[:, is_difference]).sum(axis=1)
    assert log_prior_of_differing == pytest.approx(shared + of_differences)


def test_the_prior_sd_of_the_difference_of_any_two_levels_is_half_a_unit():
    models = THREE_CONDITIONS
    posteriors = models.posteriors([(NOISE, CONSTANT_ERROR, CONTRACTION)])
    probability = default_rng(1).uniform(size=(1, 40_000, len(posteriors.names)))
    values = models.quantities(posteriors.prior_points(probability)[0])
    step = StimulusScales.from_pairs(S1, S2, np.full(5, 12)).step
    # A unit is D/2 of the constant error, 1/4 of the contraction, and 1 of the log JND. An SD of
    # 40,000 draws has an error of 0.4 %. Each pair of the three conditions is compared.
    for i, j in ((0, 1), (0, 2), (1, 2)):
        for key, expected in (("constant_error", step / 4.0), ("contraction", 0.125)):
            assert (values[key][i] - values[key][j]).std() == pytest.approx(expected, rel=0.02)
        log_ratio = np.log(values["jnd"][i] / values["jnd"][j])
        assert log_ratio.std() == pytest.approx(0.5, rel=0.02)


def require_means_over_the_prior(evidence, models, posteriors):
    """Each evidence is the mean likelihood of draws from the prior, within 4 standard errors."""
    probability = default_rng(2).uniform(size=(len(posteriors), 40_000, len(posteriors.names)))
    points = posteriors.prior_points(probability)
    for i, draws in enumerate(points):
        log_likelihood = sum_of_log_likelihoods(models, draws)
        highest = log_likelihood.max()  # subtracted, so that exp does not underflow
        weights = np.exp(log_likelihood - highest)
        expected = highest + np.log(weights.mean())
        # The error of the log of a mean is 1 over the root of the number of effective draws.
        error_of_mean = np.sqrt(np.square(weights).sum()) / weights.sum()
        error = np.hypot(error_of_mean, evidence.standard_error[i])
        assert evidence.log_evidence[i] == pytest.approx(expected, abs=4.0 * error)


def test_evidences_of_what_differs_are_means_over_the_prior():
    """CHOICES has what may differ: each subset of constant error, contraction and noise."""
    evidence, _ = condition_evidences(TWO_CONDITIONS, seed=1)
    posteriors = TWO_CONDITIONS.posteriors(CHOICES)
    require_means_over_the_prior(evidence, TWO_CONDITIONS, posteriors)


def test_evidences_of_one_observer_of_two_tasks_are_means_over_the_prior():
    # The evidence is as precise as the mean over 40,000 draws from the prior.
    models = models_of_two_tasks()
    posteriors = models.posteriors_without_differences
    precision = Precision(standard_error=0.01, most_draws=40_000)
    (evidence,) = evidences_of(posteriors, [models.subject], 1, models.prior, precision)
    require_means_over_the_prior(evidence, models, posteriors)
