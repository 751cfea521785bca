"""The observer of the four models, against definitions with many digits and invariances."""

from dataclasses import replace

import definitions
import mpmath
import numpy as np
import pytest
from conftest import refused
from numpy.random import default_rng
from populations import some_pairs
from scipy import stats
from scipy.integrate import quad
from scipy.special import betaln

import bayes_toe as bt
from bayes_toe.data.tasks import SAME_DIFFERENT, THREE_ANSWERS, WHICH_STRONGER
from bayes_toe.inference.order_evidence import order_evidence
from bayes_toe.model.densities import (
    CutNormal,
    LogitOfBeta,
    ProbitOfBeta,
    StandardNormal,
    StandardStudent,
)
from bayes_toe.model.models import ObserverPosterior, OrderModel
from bayes_toe.model.observer import ObserverRows
from bayes_toe.model.parameters import ORDER_MODELS, ObserverPrior

TASKS = (SAME_DIFFERENT, WHICH_STRONGER, THREE_ANSWERS)
#: Numbers that differ from the default, so that a number in the wrong place changes a density.
PRIOR = ObserverPrior(noise_median=0.8, noise_sd=0.6, q0_a=3.0, q0_b=1.5, lapse_rate_b=7.0)
#: Values of a coordinate far beyond what its prior draws.
FAR_VALUES = (-700.0, -40.0, -6.0, 6.0, 40.0, 700.0)


@pytest.fixture(params=TASKS, ids=[task.name for task in TASKS])
def task(request):
    return request.param


@pytest.fixture
def subject(task):
    """A subject with a different number of trials for each pair, which are the weights of pairs."""
    subject = example_subjects(task)[0]
    return replace(subject, n_trials=subject.n_trials + np.arange(subject.n_pairs))


def example_subjects(task):
    """The first three subjects of an example; for three answers, 'different' is split by chance."""
    if task != THREE_ANSWERS:
        return bt.example_study(task).subjects[:3]
    subjects = []
    for subject in bt.example_study(SAME_DIFFERENT).subjects[:3]:
        p_second = np.where(subject.s2 > subject.s1, 0.8, 0.3)
        n_second = default_rng(1).binomial(subject.n_trials - subject.n_yes, p_second)
        subjects.append(replace(subject, task=task, n_second=n_second))
    return subjects


@pytest.fixture
def posterior(subject):
    return posterior_of(subject)


def posterior_of(subject, model="both"):
    """The posterior of one of the four models under the prior of this file."""
    return ObserverPosterior(subject, OrderModel(model), PRIOR)


def prior_draws(posterior, size, seed=1):
    """Points from the prior, (size, coordinates)."""
    return posterior.sample_prior(default_rng(seed), size)


# --- Against many digits --------------------------------------------------------------------------


@pytest.mark.parametrize("model", ORDER_MODELS)
def test_log_density_and_gradient_are_those_of_the_definition(subject, model):
    """The points are four draws of the prior, and two points far out, where the density is low.

    Slopes by differences of many digits take long: only the last two draws and the two far points
    have them, and the subject has every third pair.
    """
    posterior = posterior_of(some_pairs(subject, slice(None, None, 3)), model)
    # Clipped, because a contraction of 4 prior SDs is 1, where the density ends.
    far_points = np.clip(4.0 * prior_draws(posterior, 2, seed=5), -3.5, 3.5)
    x = np.concatenate([prior_draws(posterior, 4), far_points])
    values, gradient = definitions.computed_gradient(posterior, x)
    assert posterior.log_density(x) == pytest.approx(values, rel=1e-12)

    def log_density(point):
        return sum(definitions.observer_log_density(posterior, point))

    with mpmath.workdps(70):
        assert values == pytest.approx([float(log_density(point)) for point in x], rel=1e-12)
        for point, slopes in zip(x[2:], gradient[2:], strict=True):
            expected = definitions.exact_slopes(log_density, point, step=mpmath.mpf(10) ** -25)
            assert slopes == pytest.approx(np.array(expected, float), rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("value", FAR_VALUES)
def test_far_out_the_log_density_is_the_definition_and_never_nan(subject, value):
    """One coordinate is far out, and all others are near the middle. The subject has few pairs."""
    posterior = posterior_of(some_pairs(subject, slice(None, None, 4)))
    for j, name in enumerate(posterior.coordinates):
        point = np.full(len(posterior.coordinates), 0.3)
        point[j] = value
        log_likelihood = posterior.log_likelihood(point)[0]
        assert not np.isnan(log_likelihood)
        assert not np.isnan(posterior.log_density(point)[0])
        if name == "contraction" and abs(value) * PRIOR.contraction_sd >= 1.0:  # p beyond 1
            assert posterior.log_density(point)[0] == -np.inf
        if name == "lapse_rate" and abs(value) > 38.0:
            continue  # a lapse rate that differs from 0 or 1 by less than e^-240000
        has_304_zeros = name == "q0" and abs(value) == 700.0  # 1 - q0, or q0, is e^-700
        with mpmath.workdps(400 if has_304_zeros else 80):
            expected, _ = definitions.observer_log_density(posterior, point)
        if log_likelihood == -np.inf:  # an answer whose probability is below the smallest float
            assert expected < -700.0, name
        else:
            assert log_likelihood == pytest.approx(float(expected), rel=1e-11), name


@pytest.mark.parametrize("signs", [1.0, -1.0])
def test_all_coordinates_far_out_at_once_give_no_nan(posterior, signs):
    rng = default_rng(3)
    x = signs * rng.choice([700.0, -700.0, 40.0, -40.0, 0.0], (400, len(posterior.coordinates)))
    assert not np.isnan(posterior.log_density(x)).any()
    for answers in posterior.log_answers(x):
        assert (answers <= 1e-15).all()  # the rounding of a sum of two shares


def test_the_gradient_is_that_of_scoring(posterior):
    """The gradient is summed over answers first, and in scoring last."""
    # Most points of the prior are far from the maximum, where slopes are large.
    points = posterior.full_points(prior_draws(posterior, 1000))
    _, gradient = posterior.rows.gradient(points)
    _, slopes_of_scoring, _ = posterior.rows.scoring(points)
    # Slopes cancel: the error is in proportion to the largest slope of a point.
    tolerance = 1e-10 * (1.0 + np.abs(gradient).max(axis=-1, keepdims=True))
    assert (np.abs(gradient - slopes_of_scoring) < tolerance).all()


# --- Rows and pairs -------------------------------------------------------------------------------


def test_rows_of_several_subjects_are_those_of_each_alone(task):
    """The second subject has fewer pairs: its row is filled with pairs without trials."""
    subject_1, subject_2, subject_3 = example_subjects(task)
    subjects = [subject_1, some_pairs(subject_2, slice(-2)), subject_3]
    rows = ObserverRows.from_subjects(subjects, PRIOR)
    u = default_rng(6).normal(size=(3, 50, len(rows.coordinates)))  # (rows, points, coordinates)
    values, slopes, _ = rows.scoring(u)
    for i, subject in enumerate(subjects):
        # The subject alone is a single row.
        expected_values, expected_slopes, _ = posterior_of(subject).rows.scoring(u[[i]])
        assert values[i] == pytest.approx(expected_values[0], rel=1e-14)
        assert slopes[i] == pytest.approx(expected_slopes[0], rel=1e-11, abs=1e-11)


# --- What alters nothing --------------------------------------------------------------------------


@pytest.mark.parametrize(
    "change, tolerance",
    [
        (lambda s: 3.0 * s + 2.0, 1e-9),
        (lambda s: s * 1e-12, 1e-11),
        (lambda s: s * 1e100, 1e-11),
        # Floats about 20.72 lie 3.6e-15 apart, a ten-billionth of such a step.
        (lambda s: 20.72 + 0.00003 * s / np.ptp(s), 1e-6),
    ],
    ids=["3 s + 2", "1e-12", "1e100", "about 20.72"],
)
def test_the_unit_and_the_origin_of_intensity_change_no_density(posterior, change, tolerance):
    subject = posterior.subject
    # s1 and s2 are changed together, because a change may depend on the range of all stimuli.
    s1, s2 = np.split(change(np.concatenate([subject.s1, subject.s2])), 2)
    changed = posterior_of(replace(subject, s1=s1, s2=s2))
    x = prior_draws(posterior, 300)
    assert changed.log_density(x) == pytest.approx(posterior.log_density(x), rel=tolerance)


# --- Prior, quantities ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    "density",
    [
        StandardNormal(),
        StandardStudent(),
        CutNormal(4.0),
        CutNormal(0.7),
        LogitOfBeta(4.0, 1.0),
        LogitOfBeta(0.5, 2.5),
        ProbitOfBeta(4.0, 1.0),
        ProbitOfBeta(0.5, 2.5),
    ],
    ids=repr,
)
def test_priors_integrate_to_1_have_their_slope_and_their_quantiles(density):
    """Quantiles and total are integrals, and slopes are differences of the log density.

    Newton steps use a curvature that is positive everywhere, also where the density is not concave.
    """
    limit = getattr(density, "limit", np.inf)  # where a normal density is cut

    def height(u):
        return float(np.exp(density.log_density(np.array(u))))

    def mass_below(u):
        return quad(height, -limit, u, epsabs=1e-11, limit=400)[0]

    assert mass_below(limit) == pytest.approx(1.0, abs=1e-9)
    for p in (0.003, 0.3, 0.9):
        quantile = density.quantile(np.array([p]))
        assert mass_below(quantile[0]) == pytest.approx(p, abs=1e-8)
        rise = density.log_density(quantile + 1e-5) - density.log_density(quantile - 1e-5)
        assert density.slope(quantile) == pytest.approx(rise / 2e-5, rel=1e-6, abs=1e-8)
        assert density.curvature(quantile) > 0.0


@pytest.mark.parametrize("a, b", [(1.0, 0.05), (0.05, 1.0), (0.001, 0.001)])
def test_quantiles_are_finite_where_a_share_rounds_to_an_edge(a, b):
    """Quantiles are logits of a share with the density Beta(a, b).

    A small share is P^(1/a) (a B(a, b))^(1/a), so that its logarithm is linear in that of P.
    """
    p = np.array([1e-6, 1e-3, 0.2, 0.6, 1 - 1e-3, 1 - 1e-6])
    logits = LogitOfBeta(a, b).quantile(p)
    assert np.isfinite(logits).all()
    assert (np.diff(logits) > 0.0).all()
    log_norm = np.log(a) + betaln(a, b)
    assert logits[0] == pytest.approx((np.log(p[0]) + log_norm) / a, rel=1e-4)


def test_draws_from_the_prior_follow_its_quantiles(posterior):
    """Kolmogorov's test of at most nine quantities at 1e-4: a false alarm in a thousand."""
    values = posterior.quantities(prior_draws(posterior, 4000, seed=7))
    probabilities = np.linspace(0.02, 0.98, 49)
    for name in posterior.names.reported:
        quantiles = np.array([posterior.prior_quantile(name, p) for p in probabilities])
        shares_below = (values[name][:, None] <= quantiles).mean(axis=0)  # of the draws
        error = np.abs(shares_below - probabilities).max()
        assert error < stats.kstwobign.isf(1e-4) / np.sqrt(4000), name


def test_a_quantity_that_the_model_lacks_is_refused(posterior):
    with refused("unknown quantity 'width'; there are: noise"):
        posterior.prior_quantile("width", 0.5)


def test_quantities_are_those_of_the_definition_and_points_their_inverse(posterior):
    x = prior_draws(posterior, 40)
    values = posterior.quantities(x)
    subject = posterior.subject
    assert posterior.points(values) == pytest.approx(x, rel=1e-9, abs=1e-9)
    with mpmath.workdps(50):
        scales = definitions.observer_scales(subject.s1, subject.s2, subject.n_trials)
        for i in range(5):
            coordinates = dict(zip(posterior.coordinates, map(mpmath.mpf, x[i]), strict=True))
            expected = definitions.observer_quantities(coordinates, scales, PRIOR)
            # The 75 % quantile of the noise is where 'second' is given in 75 % of trials.
            expected["jnd"] = mpmath.erfinv(0.5) * mpmath.sqrt(2) * expected["noise"]
            if "q0" in expected:
                expected["zone"] = definitions.criterion(expected["q0"]) * expected["noise"]
            observed = {name: value[i] for name, value in values.items()}
            expected = {name: float(value) for name, value in expected.items()}
            assert observed == pytest.approx(expected, rel=1e-12)


# --- Two samplers ---------------------------------------------------------------------------------


def test_emcee_and_importance_sampling_agree():
    """The subject gives three answers: the other tasks have references of their own."""
    subject = example_subjects(THREE_ANSWERS)[0]
    draws = bt.sample(bt.Study([subject]), model="both", draws=2000, seed=3, workers=1)
    assert not draws.not_converged

    weighted = order_evidence([subject], seed=3)[0].draws[-1]  # of the model 'both'
    weights = np.exp(weighted.log_weights - weighted.log_weights.max())
    weights /= weights.sum()
    n_effective = 1.0 / np.square(weights).sum()
    assert n_effective > 250  # as many draws as evidences ask for

    posterior = draws.posterior(subject.name)
    values = posterior.quantities(weighted.x)
    for name in posterior.names.natural:
        for p in (0.05, 0.5, 0.95):
            # The share of weight below emcee's quantile, at 4.5 standard errors: some 20
            # comparisons, a false alarm in 7,000 such tests.
            quantile = np.quantile(draws.values(subject.name, name), p)
            share = weights[values[name] <= quantile].sum()
            error = np.sqrt(p * (1.0 - p) * (1.0 / n_effective + 1.0 / 2000.0))
            assert abs(share - p) < 4.5 * error, (name, p)
