"""The observer of the four models against definitions with many digits, and under changes that alter nothing."""

from dataclasses import replace

import definitions
import mpmath
import numpy as np
import pytest
from scipy import stats
from scipy.integrate import quad

import bayes_toe as bt
from bayes_toe.data.tasks import SAME_DIFFERENT, WHICH_STRONGER
from bayes_toe.inference.maxima import find_maxima
from bayes_toe.inference.order_evidence import order_evidence
from bayes_toe.model.answer_curves import criterion, equal_answers, second_answers
from bayes_toe.model.observer import ObserverBatch, ObserverPosterior, OrderModel, StimulusScales
from bayes_toe.model.parameters import (
    ORDER_MODELS,
    CutNormal,
    LogitOfBeta,
    ObserverPrior,
    StandardNormal,
    StandardStudent,
)

TASKS = (SAME_DIFFERENT, WHICH_STRONGER)
PRIOR = ObserverPrior(noise_median=0.8, noise_sd=0.6, q0_a=3.0, q0_b=1.5, lapse_rate_b=7.0)
#: Coordinates far out.
FAR = (-700.0, -40.0, -6.0, 6.0, 40.0, 700.0)


@pytest.fixture(params=TASKS, ids=[task.name for task in TASKS])
def task(request):
    return request.param


@pytest.fixture
def subject(task):
    return bt.example_study(task).subjects[0]


@pytest.fixture
def posterior(subject):
    return ObserverPosterior(subject, OrderModel("both"), PRIOR)


def prior_draws(posterior, size=200, seed=1):
    return posterior.sample_prior(np.random.default_rng(seed), size)


def near_the_best(posterior, nats):
    """Points about the maximum that are at most so many nats below it."""
    best = find_maxima(posterior).x[0]
    rng = np.random.default_rng(2)
    scales = rng.choice([0.01, 0.1, 0.5, 1.0, 2.0], size=(3000, 1))
    points = np.concatenate([best + scales * rng.normal(size=(3000, len(best))), [best]])
    values = posterior.log_likelihood(points)
    return points[values > values.max() - nats]


# --- Against many digits --------------------------------------------------------------------------


DISTANCES = (0.0, 1e-8, 0.1, 0.7, 1.0, 2.5, 6.0, 12.0, 25.0, 38.0)
LOGITS = (-300.0, -40.0, -12.0, -3.0, -0.5, 0.0, 0.5, 3.0, 12.0, 40.0, 300.0)


def close_logs(found, expected):
    """Logs of probabilities within 1e-12 of their size; below the smallest float, within 1e-300."""
    assert found == pytest.approx(float(mpmath.log(expected)), rel=1e-12, abs=1e-300)


@pytest.mark.parametrize("logit", LOGITS)
def test_log_answers_of_same_or_different_keep_twelve_digits(logit):
    with mpmath.workdps(400):
        k = definitions.criterion(definitions.expit(mpmath.mpf(logit)))
        own = float(criterion(logit))
        assert own == pytest.approx(float(k), rel=1e-13)
        for z in DISTANCES:
            # At the criterion that the floats have: its own rounding is no error of the answers.
            inside, outside = definitions.areas(mpmath.mpf(z), mpmath.mpf(own))
            answers = equal_answers(np.array([z, -z]), np.array([own]))
            for i in range(2):
                close_logs(answers.yes[i], inside)
                close_logs(answers.no[i], outside)


def test_log_answers_of_which_is_stronger_keep_twelve_digits():
    with mpmath.workdps(400):
        for z in (*DISTANCES, *(-z for z in DISTANCES)):
            answers = second_answers(np.array([z]))
            close_logs(answers.yes[0], mpmath.ncdf(mpmath.mpf(z)))
            close_logs(answers.no[0], mpmath.ncdf(-mpmath.mpf(z)))


@pytest.mark.parametrize("model", ORDER_MODELS)
def test_the_log_density_is_the_definition(subject, model):
    posterior = ObserverPosterior(subject, OrderModel(model), PRIOR)
    x = prior_draws(posterior, 6)
    with mpmath.workdps(60):
        expected = [float(definitions.observer_log_density(posterior, point)) for point in x]
    assert posterior.log_density(x) == pytest.approx(expected, rel=1e-12)


def test_far_out_the_log_density_is_the_definition_and_never_nan(posterior):
    k = len(posterior.coordinates)
    lapse = posterior.coordinates.index("lapse_rate")
    contraction = posterior.coordinates.index("contraction")
    for place in range(k):
        for value in FAR:
            point = np.full(k, 0.3)
            point[place] = value
            found = posterior.log_likelihood(point)[0]
            assert not np.isnan(found)
            assert not np.isnan(posterior.log_density(point)[0])
            if place == lapse and abs(value) > 38.0:
                continue  # a lapse rate that differs from 0 or 1 by less than e^-240000
            digits = 400 if posterior.coordinates[place] == "q0" else 80  # 1 - q0 is e^-700
            with mpmath.workdps(digits):
                subject = posterior.subject
                scales = definitions.observer_scales(subject.s1, subject.s2, subject.n_trials)
                at = dict(zip(posterior.coordinates, map(mpmath.mpf, point.tolist()), strict=True))
                expected = definitions.observer_log_likelihood(at, subject, scales, PRIOR)
            assert found == pytest.approx(float(expected), rel=1e-11), (place, value)
            if place == contraction and abs(value) * PRIOR.contraction_sd >= 1.0:
                assert posterior.log_density(point)[0] == -np.inf


@pytest.mark.parametrize("signs", [1.0, -1.0])
def test_all_coordinates_far_out_at_once_give_no_nan(posterior, signs):
    rng = np.random.default_rng(3)
    x = signs * rng.choice([700.0, -700.0, 40.0, -40.0, 0.0], (400, len(posterior.coordinates)))
    assert not np.isnan(posterior.log_likelihood(x)).any()
    assert not np.isnan(posterior.log_density(x)).any()
    for answers in posterior.log_answers(x):
        assert (answers <= 1e-15).all()  # the rounding of a sum of two shares


@pytest.mark.parametrize("model", ORDER_MODELS)
def test_the_gradient_is_that_of_the_definition(subject, model):
    posterior = ObserverPosterior(subject, OrderModel(model), PRIOR)
    x = prior_draws(posterior, 2, seed=4)
    _, gradient = posterior.gradient(x)
    step = mpmath.mpf(10) ** -25
    with mpmath.workdps(70):
        for row, slopes in zip(x, gradient, strict=True):
            middle = [mpmath.mpf(value) for value in row.tolist()]
            for j, slope in enumerate(slopes):
                ahead, behind = list(middle), list(middle)
                ahead[j] += step
                behind[j] -= step
                ends = [definition_at(posterior, point) for point in (ahead, behind)]
                expected = float((ends[0] - ends[1]) / (2 * step))
                assert slope == pytest.approx(expected, rel=1e-9, abs=1e-9)


def definition_at(posterior, point):
    """The log density at numbers of many digits."""
    at = dict(zip(posterior.coordinates, point, strict=True))
    subject = posterior.subject
    scales = definitions.observer_scales(subject.s1, subject.s2, subject.n_trials)
    return definitions.observer_log_likelihood(
        at, subject, scales, posterior.prior
    ) + definitions.observer_log_prior(at, scales, posterior.prior)


def test_the_gradient_is_that_of_differences_where_the_density_is_low(posterior):
    x = 4.0 * prior_draws(posterior, 60, seed=5)
    contraction = posterior.coordinates.index("contraction")
    x[:, contraction] = np.clip(x[:, contraction], -3.5, 3.5)
    _, gradient = posterior.gradient(x)
    for j in range(x.shape[1]):
        step = 1e-5 * np.maximum(1.0, np.abs(x[:, j]))
        ahead, behind = x.copy(), x.copy()
        ahead[:, j] += step
        behind[:, j] -= step
        value = np.abs(posterior.log_density(x))
        expected = (posterior.log_density(ahead) - posterior.log_density(behind)) / (2.0 * step)
        error = np.abs(gradient[:, j] - expected)
        assert (error < 1e-5 * np.abs(expected) + 1e-9 * value + 1e-6).all()


def test_the_plain_form_is_the_log_form_within_200_nats(posterior):
    points = near_the_best(posterior, 200.0)
    assert len(points) > 1000
    full = posterior.full_points(points)
    plain = posterior.batch.plain_log_likelihood(full)[0]
    assert plain == pytest.approx(posterior.log_likelihood(points), rel=1e-12)
    value, slope = posterior.batch.gradient(full)
    plain_value, plain_slope = posterior.batch.plain_gradient(full)
    assert plain_value == pytest.approx(value, rel=1e-12)
    scale = 1.0 + np.abs(slope).max(axis=-1, keepdims=True)
    assert np.abs((plain_slope - slope) / scale).max() < 1e-10


# --- Rows and pairs -------------------------------------------------------------------------------


def test_rows_are_single_posteriors_and_pairs_without_trials_change_nothing(task):
    study = bt.example_study(task)
    fewer = study.subjects[1]
    fewer = replace(
        fewer, **{key: getattr(fewer, key)[:-2] for key in ("s1", "s2", "n_yes", "n_trials")}
    )
    subjects = [study.subjects[0], fewer, study.subjects[2]]
    batch = ObserverBatch.from_subjects(subjects, PRIOR)
    u = np.random.default_rng(6).normal(size=(3, 50, batch.n_coordinates))
    values, slopes = batch.gradient(u)
    for row, one in enumerate(subjects):
        alone = ObserverPosterior(one, OrderModel("both"), PRIOR)
        assert batch.log_likelihood(u)[row] == pytest.approx(
            alone.log_likelihood(u[row]), rel=1e-14
        )
        density, gradient = alone.gradient(u[row])
        assert values[row] + batch.log_prior(u)[row] == pytest.approx(density, rel=1e-14)
        assert slopes[row] + batch.prior_slopes(u)[0][row] == pytest.approx(
            gradient, rel=1e-11, abs=1e-11
        )
        assert batch.log_likelihood(u)[row] == pytest.approx(
            batch.rows(np.array([row])).log_likelihood(u[[row]])[0], rel=1e-15
        )


def test_a_model_is_both_with_its_effect_at_0(subject):
    both = ObserverPosterior(subject, OrderModel("both"), PRIOR)
    for name in ORDER_MODELS:
        one = ObserverPosterior(subject, OrderModel(name), PRIOR)
        x = prior_draws(one, 20)
        full = np.zeros((20, len(both.coordinates)))
        full[:, [both.coordinates.index(free) for free in one.coordinates]] = x
        assert one.log_likelihood(x) == pytest.approx(both.log_likelihood(full), rel=1e-15)


# --- What alters nothing --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "tolerance"),
    [
        (lambda s: 3.0 * s + 2.0, 1e-9),
        (lambda s: s * 2.0**-40, 1e-12),
        (lambda s: s * 1e-12, 1e-11),
        (lambda s: s * 1e8, 1e-11),
        (lambda s: s * 1e100, 1e-11),
        # Floats about 20.72 lie 3.6e-15 apart, a ten-billionth of such a step.
        (lambda s: 20.72 + 0.00003 * s / np.ptp(s), 1e-6),
    ],
    ids=["3 s + 2", "2^-40", "1e-12", "1e8", "1e100", "about 20.72"],
)
def test_the_unit_and_the_origin_of_intensity_change_no_density(posterior, change, tolerance):
    both = np.concatenate([posterior.subject.s1, posterior.subject.s2])
    changed = change(both)
    n_pairs = posterior.subject.n_pairs
    other = replace(posterior.subject, s1=changed[:n_pairs], s2=changed[n_pairs:])
    moved = ObserverPosterior(other, OrderModel("both"), PRIOR)
    x = prior_draws(posterior, 300)
    assert moved.log_density(x) == pytest.approx(posterior.log_density(x), rel=tolerance)
    for name in ("contraction", "lapse_rate"):
        assert moved.quantities(x)[name] == pytest.approx(posterior.quantities(x)[name], rel=1e-9)


def test_exchanged_answers_to_stimuli_of_the_other_sign_turn_both_shift_and_slope():
    subject = bt.example_study(WHICH_STRONGER).subjects[0]
    turned = replace(
        subject, s1=-subject.s1, s2=-subject.s2, n_yes=subject.n_trials - subject.n_yes
    )
    posterior, other = (
        ObserverPosterior(one, OrderModel("both"), PRIOR) for one in (subject, turned)
    )
    x = prior_draws(posterior, 200)
    y = x.copy()
    for name in ("constant_error", "noise_slope"):
        y[:, posterior.coordinates.index(name)] *= -1.0
    assert other.log_density(y) == pytest.approx(posterior.log_density(x), rel=1e-12)


def test_a_thousand_million_trials_a_pair(posterior):
    many = replace(
        posterior.subject,
        n_yes=posterior.subject.n_yes * 10**7,
        n_trials=posterior.subject.n_trials * 10**7,
    )
    assert many.n_trials.min() >= 10**8
    large = ObserverPosterior(many, OrderModel("both"), PRIOR)
    x = prior_draws(posterior, 100)
    assert large.log_likelihood(x) == pytest.approx(1e7 * posterior.log_likelihood(x), rel=1e-12)
    maxima = find_maxima(large)
    assert maxima.arrived
    assert np.linalg.eigvalsh(maxima.curvature[0])[0] > 0.0


def test_scales_by_hand():
    s1, s2, n = np.array([0.0, 1.0, 1.0]), np.array([3.0, 0.0, 1.0]), np.array([5.0, 15.0, 20.0])
    found = StimulusScales.from_counts(s1, s2, n)
    sbar, mean = 35.0 / 40.0, (35.0 + 35.0) / 80.0
    squares = (s1 - mean) ** 2 + (s2 - mean) ** 2
    assert found.sbar == pytest.approx(sbar)
    assert found.step == pytest.approx(np.sqrt((5 * 9 + 15 * 1) / 20))
    assert found.spread == pytest.approx(np.sqrt(squares @ n / 80))
    assert found.first_spread == pytest.approx(np.sqrt((s1 - sbar) ** 2 @ n / 40))
    assert found.contraction_sd(ObserverPrior()) == 0.25
    roved = StimulusScales(0.0, 1.0, 5.0, 10.0)
    assert roved.contraction_sd(ObserverPrior()) == pytest.approx(0.1)
    with pytest.raises(bt.InputError, match="no pair has two different stimuli"):
        StimulusScales.from_counts(s1, s1, n)


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
    ],
    ids=repr,
)
def test_priors_integrate_to_1_have_their_slope_and_their_quantiles(density):
    limit = getattr(density, "limit", np.inf)

    def height(u):
        return float(np.exp(density.log_density(np.array(u))))

    mass, _ = quad(height, -limit, limit, epsabs=1e-11, limit=400)
    assert mass == pytest.approx(1.0, abs=1e-9)
    for p in (0.003, 0.3, 0.9):
        quantile = float(density.quantile(np.array(p)))
        assert quad(height, -limit, quantile, epsabs=1e-11, limit=400)[0] == pytest.approx(
            p, abs=1e-8
        )
        at = quantile + 1e-5 * np.array([-1.0, 1.0])
        expected = np.diff(density.log_density(at)) / 2e-5
        assert density.slope(np.array([quantile])) == pytest.approx(expected, rel=1e-6, abs=1e-8)
        assert density.curvature(np.array([quantile])) > 0.0


def test_draws_from_the_prior_follow_its_quantiles(posterior):
    """Kolmogorov's test of at most nine quantities at 1e-4.

    A false alarm in a thousand such tests.
    """
    x = prior_draws(posterior, 4000, seed=7)
    found = posterior.quantities(x)
    p = np.linspace(0.02, 0.98, 49)
    for name in posterior.names.reported:
        quantiles = np.array([posterior.prior_quantile(name, one) for one in p])
        shares = (found[name][:, None] <= quantiles).mean(axis=0)
        assert np.abs(shares - p).max() < stats.kstwobign.isf(1e-4) / np.sqrt(4000), name
    with pytest.raises(bt.InputError, match="unknown quantity 'width'; there are: noise"):
        posterior.prior_quantile("width", 0.5)


def test_quantities_are_those_of_the_definition_and_points_their_inverse(posterior):
    x = prior_draws(posterior, 40)
    found, subject = posterior.quantities(x), posterior.subject
    assert posterior.points(found) == pytest.approx(x, rel=1e-9, abs=1e-9)
    with mpmath.workdps(50):
        scales = definitions.observer_scales(subject.s1, subject.s2, subject.n_trials)
        for i in range(5):
            at = dict(zip(posterior.coordinates, map(mpmath.mpf, x[i].tolist()), strict=True))
            expected = definitions.observer_quantities(at, scales, PRIOR)
            expected["jnd"] = mpmath.erfinv(0.5) * mpmath.sqrt(2) * expected["noise"]
            if "q0" in expected:
                expected["zone"] = definitions.criterion(expected["q0"]) * expected["noise"]
            assert found.keys() == expected.keys()
            for name, value in expected.items():
                assert found[name][i] == pytest.approx(float(value), rel=1e-12), name


def test_other_pairs_keep_the_scales_and_the_curve_is_that_of_its_distances(posterior):
    x = prior_draws(posterior, 30)
    subject = posterior.subject
    part = replace(
        subject, **{key: getattr(subject, key)[:3] for key in ("s1", "s2", "n_yes", "n_trials")}
    )
    some = posterior.for_subject(part)
    assert some.log_answers(x).yes == pytest.approx(posterior.log_answers(x).yes[:, :3], rel=1e-13)
    # At the mean intensity the answers depend on the distance alone.
    sbar = posterior.sbar
    pairs = np.array([[sbar - d, sbar + d] for d in (-0.1, 0.05, 0.2)])
    asked = bt.Subject("asked", pairs[:, 0], pairs[:, 1], [1, 1, 1], [2, 2, 2], task=subject.task)
    central = posterior.for_subject(asked)
    z = central.distance(x)
    curve = np.stack([central.yes_at_distance(x, one)[i] for i, one in enumerate(z)])
    assert curve == pytest.approx(np.exp(central.log_answers(x).yes), rel=1e-9)


# --- Two samplers ---------------------------------------------------------------------------------


def test_emcee_and_importance_sampling_agree(subject):
    draws = bt.sample(bt.Study([subject]), model="both", draws=2000, seed=3, workers=1)
    assert not draws.not_converged
    weighted = order_evidence([subject], 3)[0].draws[-1]
    weights = np.exp(weighted.log_weights - weighted.log_weights.max())
    weights /= weights.sum()
    effective = 1.0 / np.square(weights).sum()
    posterior = draws.posterior(subject.name)
    assert isinstance(posterior, ObserverPosterior)
    found = posterior.quantities(weighted.points)
    assert effective > 250
    for name in posterior.names.natural:
        values = draws.values(subject.name, name).ravel()
        for p in (0.05, 0.5, 0.95):
            # The share of weight below emcee's quantile, at 4.5 standard errors.
            share = weights[found[name] <= np.quantile(values, p)].sum()
            error = np.sqrt(p * (1.0 - p) * (1.0 / effective + 1.0 / 2000.0))
            assert abs(share - p) < 4.5 * error, (name, p)


def test_a_subject_in_one_condition_has_the_scales_of_all_conditions(tmp_path):
    rows = "subject,condition,s1,s2,n_second,n_trials\n"
    for condition, start in (("left", 0.0), ("right", 0.5)):
        for first, second in ((0.0, 0.3), (0.3, 0.0), (0.0, 0.6)):
            rows += f"S,{condition},{start + first},{start + second},6,10\n"
    (tmp_path / "s.csv").write_text(rows)
    study = bt.read_study(tmp_path / "s.csv", bt.ReadOptions(condition="condition"))
    scales = [StimulusScales.from_subject(unit) for unit in study]
    assert len(scales) == 2
    assert scales[0].sbar == scales[1].sbar == pytest.approx(0.25 + 0.1)
    assert scales[0].step == scales[1].step
    assert scales[0].spread == scales[1].spread
    alone = replace(study.subjects[0], felt=None)
    assert StimulusScales.from_subject(alone).sbar == pytest.approx(0.1)
