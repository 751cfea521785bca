"""What a trial leaves to the next, against other routes: loops, filters of other libraries, beliefs, the static model in the limits."""

from dataclasses import replace

import mpmath as mp
import numpy as np
import pytest
from kalman import evolve, settled, update
from scipy.signal import lfilter
from scipy.special import expit, logit

from bayes_toe.data.answers import Answers
from bayes_toe.data.study import Subject
from bayes_toe.data.tasks import SAME_DIFFERENT, WHICH_STRONGER
from bayes_toe.data.trial_sequence import looks_sorted
from bayes_toe.errors import InputError
from bayes_toe.model.closed_form import noise_ratio, pull
from bayes_toe.model.crowd import crowd_posterior
from bayes_toe.model.history import Trials
from bayes_toe.model.ladder import model_named, posterior_of
from bayes_toe.model.parts import composition
from bayes_toe.model.prior import DEFAULT

LEVELS = {
    WHICH_STRONGER: (
        "update + sloped + carry-over",
        "contraction + carry-over by time + previous answer",
        "free weighting + logit + running average",
        "mean-reverting + biased guesses + carry-over",
        "constant error + previous answer",
    ),
    SAME_DIFFERENT: (
        "update + carry-over",
        "update + differencing + both ways + sloped peak + running average",
        "update + carry-over by time",
    ),
}
MODELS = [(task, name) for task, names in LEVELS.items() for name in names]


def session(seed=1, trials=40, isi=False, task=WHICH_STRONGER, missed=5, name="A"):
    """Two sessions of random pairs and answers, some trials without one."""
    rng = np.random.default_rng(seed)
    keys = rng.choice(np.linspace(-0.4, 0.4, 5), (trials, 2))
    keys = np.column_stack([keys, rng.choice([1.0, 2.0, 4.0], trials)]) if isi else keys
    answered = np.ones(trials, int)
    answered[rng.choice(trials, missed, replace=False)] = 0
    yes = rng.integers(0, 2, trials) * answered
    place = np.arange(trials) + (np.arange(trials) >= trials // 3)
    return Subject.from_answers(
        name,
        Answers(keys, yes, answered, None, (), True, place, rng.exponential(4.0, trials)),
        task,
    )


def expectation(target, x):
    """E of every trial in its order, (trials, points)."""
    felt, begins = target.expectation(x), target.subject.answers.begins
    at = np.cumsum(begins) - 1
    return felt[np.arange(len(begins)) - np.flatnonzero(begins)[at], at]


@pytest.mark.parametrize("isi", [False, True])
@pytest.mark.parametrize(("task", "name"), MODELS)
def test_gradients_are_differences_of_values_and_coordinates_come_back(task, name, isi):
    target = posterior_of(session(isi=isi, task=task), DEFAULT, model=name)
    x = target.sample_prior(np.random.default_rng(2), 30)
    x = x[np.abs(x).max(axis=1) < 15.0]
    steps = 1e-5 * np.eye(x.shape[1])
    differences = np.stack(
        [(target.log_density(x + h) - target.log_density(x - h)) / 2e-5 for h in steps], axis=1
    )
    value, gradient = target.gradient(x)
    assert gradient == pytest.approx(differences, rel=1e-5, abs=1e-4)
    assert value == pytest.approx(target.log_density(x), rel=1e-12)
    assert target.pair_log_likelihood(x).sum(axis=1) == pytest.approx(
        target.log_likelihood(x), rel=1e-12
    )
    assert target.points(target.quantities(x)) == pytest.approx(x, rel=1e-9, abs=1e-9)


def test_the_likelihood_is_that_of_a_loop_over_trials_in_many_digits():
    one, (p, rho, c, w, lapses, bias) = session(), (0.3, 0.6, 0.05, 0.2, 0.04, 0.03)
    target = posterior_of(one, DEFAULT, model="contraction + carry-over + previous answer")
    x = np.array([[c, logit(p), np.log(w), logit(lapses), logit(rho), bias]])
    assert target.coordinates == (
        "offset",
        "logit_pull",
        "log_width",
        "logit_lapse_rate",
        "logit_carry_over",
        "answer_bias",
    )
    keys, mu0, total, before = one.answers.keys, one.answers.keys.mean(), mp.mpf(0), 0
    with mp.workdps(40):
        p, rho, c, w, lapses, bias = map(mp.mpf, (p, rho, c, w, lapses, bias))
        for t, (s1, s2) in enumerate(keys):
            if one.answers.begins[t]:
                mean, before = mp.mpf(mu0), 0
            shift = s2 - s1 + p * (s1 - mp.mpf(target.sbar)) - p * (mean - mu0) - c + bias * before
            second = lapses / 2 + (1 - lapses) * mp.ncdf(shift / w)
            if one.answers.n_trials[t]:
                total += mp.log(second if one.answers.n_yes[t] else 1 - second)
            evolved = s1 + p * (mean - s1)
            mean = mu0 + rho * (s2 + p * (evolved - s2) - mu0)
            before = (1 if one.answers.n_yes[t] else -1) if one.answers.n_trials[t] else 0
    assert target.log_likelihood(x)[0] == pytest.approx(float(total), rel=1e-12)


def test_expectations_are_those_of_a_linear_filter():
    one = session()
    target = posterior_of(one, DEFAULT, model="contraction + running average")
    x = target.sample_prior(np.random.default_rng(3), 4)
    found, decay = expectation(target, x), 2.0 ** -np.exp(-x[:, -1])
    mean = one.answers.keys.mean(axis=1) - one.answers.keys.mean()
    for run in np.split(np.arange(len(mean)), np.flatnonzero(one.answers.begins)[1:]):
        for i, d in enumerate(decay):
            assert found[run, i] == pytest.approx(
                lfilter([0.0, 1.0 - d], [1.0, -d], mean[run]), rel=1e-12, abs=1e-15
            )


def test_without_relaxation_it_is_one_kalman_filter_through_all_stimuli():
    one, (sigma_p, sigma_l) = session(missed=0), (0.2, 0.15)
    target = posterior_of(one, DEFAULT, model="update + carry-over")
    a = target.model.free[0].coordinates_from(
        {"mu1": np.array([0.1]), "sigma_p": np.array([sigma_p]), "sigma_l": np.array([sigma_l])},
        target.prior,
        target.sbar,
    )
    found = expectation(target, np.column_stack([a, [[-2.0, 800.0]]]))[:, 0]
    mu0, belief = one.answers.keys.mean(), None
    for t, (s1, s2) in enumerate(one.answers.keys):
        if one.answers.begins[t]:
            belief = settled(mu0, sigma_p, sigma_l)
        assert found[t] == pytest.approx(belief.mean - mu0, rel=1e-12, abs=1e-14)
        for s in (s1, s2):  # the variance that is iterated stays where the prior's is
            belief = evolve(update(belief, s, sigma_l), sigma_p)
    assert pull(noise_ratio(sigma_p, sigma_l)) == pytest.approx(
        target.quantities(np.column_stack([a, [[-2.0, 0.0]]]))["pull"][0]
    )


@pytest.mark.parametrize(
    ("name", "off"),
    [
        ("update + sloped + carry-over", -800.0),
        ("contraction + carry-over by time", -40.0),
        ("free weighting + running average", np.log(1e12)),
        ("constant error + previous answer", 0.0),
    ],
)
def test_with_nothing_left_it_is_the_static_model(name, off):
    one = session(isi=True)
    target, static = (
        posterior_of(one, DEFAULT, model=name),
        posterior_of(one, DEFAULT, model=name.rsplit(" + ", 1)[0]),
    )
    x = target.sample_prior(np.random.default_rng(4), 20)
    x[:, -1] = off
    assert target.log_likelihood(x) == pytest.approx(static.log_likelihood(x[:, :-1]), rel=1e-9)
    for found, known in zip(target.log_answers(x), static.log_answers(x[:, :-1]), strict=True):
        assert found == pytest.approx(known, rel=1e-9)


def test_without_a_pull_no_history_has_an_effect():
    target = posterior_of(session(), DEFAULT, model="contraction + carry-over")
    x = np.repeat(target.sample_prior(np.random.default_rng(5), 1), 2, axis=0)
    x[:, 1], x[:, -1] = -800.0, (-3.0, 3.0)
    assert target.log_likelihood(x)[0] == target.log_likelihood(x)[1]


@pytest.mark.parametrize(
    ("text", "task", "said"),
    [
        ("none + carry-over", WHICH_STRONGER, "without a pull the expectation"),
        ("constant error + running average", WHICH_STRONGER, "without a pull the expectation"),
        (
            "update + carry-over + beta-binomial",
            SAME_DIFFERENT,
            "counts that scatter are of pairs, a history is of trials",
        ),
        ("update + previous answer", SAME_DIFFERENT, "'previous answer' is of the task"),
    ],
)
def test_compositions_without_meaning_are_refused(text, task, said):
    with pytest.raises(InputError, match=said):
        composition(text, task)


@pytest.mark.parametrize("isi", [False, True])
@pytest.mark.parametrize(
    ("name", "a"), [("free weighting + carry-over", 0.0), ("contraction + carry-over", -800.0)]
)
def test_gradients_are_finite_where_the_pull_is_0(name, a, isi):
    target = posterior_of(session(isi=isi), DEFAULT, model=name)
    x = target.sample_prior(np.random.default_rng(6), 3)
    x[:, 1] = a
    assert np.isfinite(target.likelihood_gradient(x)[1]).all()


def changed(one, **columns):
    return Subject.from_answers("A", replace(one.answers, **columns), WHICH_STRONGER)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            lambda one: replace(one, answers=None),
            "subject 'A': a model with a history needs the order of trials, found none",
        ),
        (
            lambda one: changed(one, keys=np.sort(one.answers.keys, axis=0), place=np.arange(40)),
            "trials are sorted by their stimuli",
        ),
        (lambda one: changed(one, iti=None), "needs a column iti"),
    ],
)
def test_without_an_order_it_is_refused(change, said):
    with pytest.raises(InputError, match=said):
        posterior_of(change(session()), DEFAULT, model="update + carry-over by time")


def test_a_pair_that_was_not_presented_is_predicted_from_rest():
    target, static = (
        posterior_of(session(), DEFAULT, model=name) for name in ("update + carry-over", "update")
    )
    x, asked = (
        target.sample_prior(np.random.default_rng(9), 3),
        Subject("A", [0.1], [0.3], [0], [1], task=WHICH_STRONGER),
    )
    assert target.for_subject(asked).log_answers(x)[0] == pytest.approx(
        static.for_subject(asked).log_answers(x[:, :-1])[0]
    )


def test_blocks_of_one_pair_in_both_orders_are_not_sorted():
    low, rng, ones = np.repeat([0.0, 0.3, 0.1, 0.5], 12), np.random.default_rng(1), np.ones(48, int)
    keys = np.where(
        rng.random((48, 1)) < 0.5,
        np.column_stack([low, low + 0.2]),
        np.column_stack([low + 0.2, low]),
    )
    answers = Answers(keys, ones, ones, None, (), True, np.arange(48))
    assert not looks_sorted(answers)
    assert looks_sorted(replace(answers, keys=keys[np.lexsort(keys.T[::-1])]))
    assert looks_sorted(replace(answers, keys=keys[np.lexsort(keys.T[::-1])[::-1]]))
    in_sessions = np.argsort(
        np.r_[np.lexsort(keys[:24].T[::-1]), 24 + np.lexsort(keys[24:].T[::-1])]
    )
    assert looks_sorted(
        replace(answers, keys=keys[np.argsort(in_sessions)], place=np.r_[0:24, 25:49])
    )


def test_trials_know_what_came_before_them():
    keys, yes = np.array([[0.0, 0.2], [0.2, 0.0], [0.0, 0.2], [0.4, 0.4]]), np.array([1, 0, 0, 1])
    answers = Answers(
        keys,
        yes,
        np.array([1, 0, 1, 1]),
        None,
        (),
        True,
        np.array([0, 1, 2, 4]),
        np.array([np.nan, 3.0, 2.0, np.nan]),
    )
    trials = Trials.of(Subject.from_answers("A", answers, WHICH_STRONGER))
    assert (trials.s1.tolist(), trials.starts.tolist()) == ([0.0, 0.0, 0.4], [0, 2])
    assert (trials.before.tolist(), trials.at.tolist()) == ([0.0, 0.0, 0.0], [0, 4, 1])
    np.testing.assert_array_equal(trials.previous, [np.nan, 0.1, np.nan])
    np.testing.assert_array_equal(
        trials.iti[..., 0], [[3.0, np.inf], [2.0, np.inf], [np.inf, np.inf]]
    )
    assert expit(trials.by_pair(np.log([[0.2, 0.4, 0.5]]))) == pytest.approx(
        expit(np.log([[0.3, 0.5]]))
    )


@pytest.mark.parametrize("isi", [False, True])
@pytest.mark.parametrize(("task", "name"), MODELS)
def test_a_crowd_has_each_subjects_likelihood_gradient_and_answers(task, name, isi):
    people = [session(seed, 30 + 7 * seed, isi, task, name=str(seed)) for seed in range(1, 4)]
    model = model_named(name, task)
    crowd = crowd_posterior(
        model, DEFAULT, people, 0.1, 1.5, [-0.1, 0.0, 0.0]
    )  # the first one's own centre is elsewhere
    x = np.random.default_rng(2).normal(0.0, 0.4, (3, len(model.coordinates)))
    value, gradient = crowd.likelihood_gradient(x)
    shares = crowd.log_answers(x)[0]
    for i, one in enumerate(people):
        alone = replace(model.posterior(one), centre=0.0 if i == 0 else 0.1, interval=1.5)
        of_one, slopes = alone.likelihood_gradient(x[i : i + 1])
        np.testing.assert_allclose([value[i], *gradient[i]], [of_one[0], *slopes[0]])
        np.testing.assert_allclose(shares[i, : one.n_pairs], alone.log_answers(x[i : i + 1])[0][0])
