"""One observer in several conditions: gradient, prior of differences, scales, evidence."""

import numpy as np
import pytest
from numpy.random import default_rng
from scipy import stats
from scipy.special import logsumexp, ndtr, xlog1py, xlogy

import bayes_toe as bt
from bayes_toe.answers.contrast import CHOICES, condition_evidences
from bayes_toe.data.conditions import Conditions, StimulusScales
from bayes_toe.data.study import with_shared_scales
from bayes_toe.data.tasks import SAME_DIFFERENT, WHICH_STRONGER
from bayes_toe.inference.engine import Precision
from bayes_toe.inference.order_evidence import evidences_of
from bayes_toe.model.condition_model import DIFFERENCE_SDS, ConditionModels
from bayes_toe.model.parameters import CONSTANT_ERROR, CONTRACTION, NOISE, task_parameters

S1, S2 = np.array([0.0, 0.3, 0.3, 0.9, 1.2]), np.array([0.3, 0.0, 0.7, 0.5, 1.2])
COUNTS = ((5, 2, 9, 1, 4), (9, 4, 10, 2, 7), (8, 3, 9, 4, 6))


def condition_models(task=WHICH_STRONGER, *, n_levels=3, s1=S1, s2=S2, counts=COUNTS, n_trials=12):
    levels = tuple("abc"[:n_levels])
    units = tuple(
        bt.Subject(f"S@{level}", s1, s2, n_yes, [n_trials] * len(s1), task=task, condition=level)
        for level, n_yes in zip(levels, counts, strict=False)
    )
    return ConditionModels(units, Conditions("c", levels).design())


@pytest.mark.parametrize("task", [WHICH_STRONGER, SAME_DIFFERENT])
def test_gradient_and_what_happens_where_nothing_differs(task):
    models = condition_models(task)
    array = models.array([models.differing])
    n, k = len(array.names), len(task_parameters(task))
    assert n == k + 2 * len(set(DIFFERENCE_SDS) & set(task_parameters(task)))
    points = 0.5 * default_rng(1).standard_normal((1, 4, n))

    def density(points):
        return array.likelihood.value(points) + array.log_prior(points)

    value, slope = array.likelihood.gradient(points)
    gradient = slope + array.prior_slopes(points)[0]
    np.testing.assert_allclose(value, array.likelihood.plain_value(points), rtol=1e-12)
    np.testing.assert_allclose(array.likelihood.plain_gradient(points)[1], slope, rtol=1e-9)
    numeric = np.empty_like(gradient)
    for j, step in enumerate(1e-6 * np.eye(n)):
        numeric[..., j] = (density(points + step) - density(points - step)) / 2e-6
    np.testing.assert_allclose(gradient, numeric, rtol=1e-5, atol=1e-5)

    points[..., k:] = 0.0
    u = points[0, :, :k]
    np.testing.assert_allclose(
        array.likelihood.value(points)[0], models.shared.log_likelihood(u), rtol=1e-12
    )
    for in_condition in models.in_conditions(points[0]):
        np.testing.assert_array_equal(in_condition, u)


def test_what_does_not_differ_has_no_prior_and_stays_at_0():
    models = condition_models()
    array = models.array([(), (NOISE,)])
    points = array.prior_points(default_rng(1).uniform(size=(2, 50, len(array.names))))
    differs = [name.startswith("noise ") for name in array.names]
    k = len(models.parameters)
    assert not points[0, :, k:].any()
    assert points[1, :, differs].all()
    log_prior = array.log_prior(points)
    assert log_prior[0] == pytest.approx(models.shared.log_prior(points[0, :, :k]))
    of_differences = stats.norm.logpdf(points[1][:, differs]).sum(axis=1)
    assert log_prior[1] == pytest.approx(models.shared.log_prior(points[1, :, :k]) + of_differences)
    (part,) = array.part(np.array([1])).log_prior(points[1:])
    assert part == pytest.approx(log_prior[1])


def test_any_two_levels_differ_by_half_a_unit_beforehand():
    models = condition_models()
    array = models.array([(NOISE, CONSTANT_ERROR, CONTRACTION)])
    probability = default_rng(1).uniform(size=(1, 40_000, len(array.names)))
    values = models.quantities(array.prior_points(probability)[0])
    step = StimulusScales.from_pairs(S1, S2, np.full(5, 12)).step
    for i, j in ((0, 1), (0, 2), (1, 2)):
        for key, expected in (("constant_error", step / 4.0), ("contraction", 0.125)):
            assert (values[key][i] - values[key][j]).std() == pytest.approx(expected, rel=0.02)
        log_ratio = np.log(values["jnd"][i] / values["jnd"][j])
        assert log_ratio.std() == pytest.approx(0.5, rel=0.02)


def test_the_evidence_is_an_integral_over_a_grid():
    """One pair in both orders at two levels: five parameters matter if only c differs.

    The mean first stimulus is 0, D is 1, and R is 1/2. No slope matters, because the mean of each
    pair is 0.
    """
    s1, s2 = np.array([-0.5, 0.5]), np.array([0.5, -0.5])
    counts, n_trials = ((15, 4), (19, 9)), 20
    models = condition_models(n_levels=2, s1=s1, s2=s2, counts=counts, n_trials=n_trials)
    evidence, _ = condition_evidences(models, seed=1)
    only_c_differs = CHOICES.index((CONSTANT_ERROR,))

    score = np.linspace(-4.5, 4.5, 19)
    # Quantiles of the prior of c: the tails of Student's t are too long for a grid.
    c_quantiles = 0.5 * stats.t(3).ppf((np.arange(40) + 0.5) / 40)
    noise_score, lapse_score, p_score, difference_score, mean_c = np.meshgrid(
        score, score, score, score, c_quantiles, indexing="ij"
    )
    noise, p = np.exp(0.7 * noise_score), 0.25 * p_score
    lapse_rate = 1.0 - ndtr(-lapse_score) ** (1.0 / 9.0)

    log_density = np.where(np.abs(p) < 1.0, 0.0, -np.inf)
    for scores in (noise_score, lapse_score, p_score, difference_score):
        log_density = log_density + stats.norm.logpdf(scores)
    for sign, counts_of_level in zip((-1.0, 1.0), counts, strict=True):
        c = mean_c + sign * 0.125 * difference_score
        for first, second, n_second in zip(s1, s2, counts_of_level, strict=True):
            z = (second - first - c + p * first) / noise
            p_second = 0.5 * lapse_rate + (1.0 - lapse_rate) * ndtr(z)
            log_density += n_second * np.log(p_second)
            log_density += (n_trials - n_second) * np.log1p(-p_second)

    log_cell = 4.0 * np.log(score[1] - score[0]) - np.log(len(c_quantiles))
    expected = logsumexp(log_density) + log_cell
    error = 4.0 * evidence.standard_error[only_c_differs] + 0.01
    assert evidence.log_evidence[only_c_differs] == pytest.approx(expected, abs=error)


# --- Two tasks -----------------------------------------------------------------------------------


def two_tasks(n_trials=12):
    """A subject with answers to both tasks, at other pairs."""
    units = [
        bt.Subject("S@a", S1, S2, COUNTS[0], [n_trials] * 5, task=WHICH_STRONGER, condition="a"),
        bt.Subject("S@b", S1[1:], S2[1:], COUNTS[1][1:], [n_trials] * 4, condition="b"),
    ]
    return ConditionModels(with_shared_scales(units), np.zeros((2, 0)))


def log_likelihood_of_both(values):
    """The log likelihood of :func:`two_tasks` by plain formulas."""
    noise, lapse_rate = values["noise"], values["lapse_rate"]
    slopes = values["noise_slope"], values["criterion_slope"]
    c, p, q0 = values["constant_error"], values["contraction"], values["q0"]
    s1, s2 = np.concatenate([S1, S1[1:]]), np.concatenate([S2, S2[1:]])
    n_yes = np.array([*COUNTS[0], *COUNTS[1][1:]])
    sbar, total = s1.mean(), 0.0
    for i, (first, second) in enumerate(zip(s1, s2, strict=True)):
        middle = 0.5 * (first + second) - sbar
        z = (second - first - c + p * (first - sbar)) / (noise * np.exp(slopes[0] * middle))
        if i < len(S1):
            p_yes = 0.5 * lapse_rate + (1.0 - lapse_rate) * ndtr(z)
        else:
            k = stats.norm.ppf(0.5 + 0.5 * q0) * np.exp(slopes[1] * middle)
            attending = ndtr(k - z) - ndtr(-k - z)
            p_yes = lapse_rate * (2.0 * ndtr(k) - 1.0) + (1.0 - lapse_rate) * attending
        total = total + xlogy(n_yes[i], p_yes) + xlog1py(12 - n_yes[i], -p_yes)
    return total


def test_one_observer_of_two_tasks_has_the_product_of_their_likelihoods():
    models = two_tasks()
    array = models.array([()])
    points = 0.5 * default_rng(1).standard_normal((1, 4, len(array.names)))
    value, slope = array.likelihood.gradient(points)
    by_hand = log_likelihood_of_both(models.shared.quantities(points[0]))
    np.testing.assert_allclose(value[0], by_hand, rtol=1e-11)
    np.testing.assert_allclose(array.likelihood.plain_value(points), value, rtol=1e-12)
    scored = array.likelihood.scoring(points)
    np.testing.assert_allclose(scored[1], slope, rtol=1e-12)
    for j, step in enumerate(1e-6 * np.eye(len(array.names))):
        rise = array.likelihood.value(points + step) - array.likelihood.value(points - step)
        np.testing.assert_allclose(rise / 2e-6, slope[..., j], rtol=1e-5, atol=1e-5)


def test_evidences_of_one_observer_are_means_over_the_prior():
    models = two_tasks()
    array = models.without_differences
    precision = Precision(standard_error=0.01, most_draws=40_000)
    (evidence,) = evidences_of(array, [models.subject], 1, models.prior, precision)
    probability = default_rng(2).uniform(size=(4, 40_000, len(array.names)))
    points = array.prior_points(probability)
    for model, expected in enumerate(evidence.log_evidence):
        by_hand = log_likelihood_of_both(models.shared.quantities(points[model]))
        log_mean = logsumexp(by_hand) - np.log(len(by_hand))
        weights = np.exp(by_hand - by_hand.max())
        error = np.sqrt(np.square(weights).sum()) / weights.sum()
        assert expected == pytest.approx(log_mean, abs=4.0 * error + 0.02)
