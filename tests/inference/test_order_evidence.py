"""Evidences of the four models: against integration over a grid, against seeds, on hard cases."""

import numpy as np
import pytest
from scipy import stats
from scipy.special import logsumexp

from bayes_toe.answers.model_average import PRIOR_PROBABILITIES
from bayes_toe.data.study import Subject
from bayes_toe.data.tasks import WHICH_STRONGER
from bayes_toe.inference.order_evidence import MODEL_NAMES, order_evidence
from bayes_toe.model.observer import ObserverBatch

STEPS = np.array([-0.5, -0.25, 0.25, 0.5])
S1 = np.concatenate([np.zeros(4), STEPS])
S2 = np.concatenate([STEPS, np.zeros(4)])


def make_subject(n_yes, n=20, name="S"):
    return Subject(name, S1, S2, n_yes, np.full(8, n), task=WHICH_STRONGER)


#: Somebody to whom the first stimulus seems stronger.
SHIFTED = make_subject([1, 3, 11, 17, 15, 10, 2, 0])


@pytest.fixture(scope="module")
def evidence():
    return order_evidence([SHIFTED], seed=3)[0]


def grid_evidence(subject, has_error):
    """Log evidence by a sum over a grid, from the formulas of the observer as on paper."""
    difference = subject.s2 - subject.s1
    step = np.sqrt(np.mean(np.square(difference)))
    middle = 0.5 * (subject.s1 + subject.s2) - subject.s1.mean()
    spread = np.concatenate([subject.s1, subject.s2]).std()
    t = np.linspace(-5.0, 5.0, 41)
    log_normal = stats.norm.logpdf(t)
    sigmas = step * np.exp(0.7 * t)
    lapses = stats.beta.ppf(stats.norm.cdf(t), 1, 9)
    # Student's t has long tails: its axis is sinh(t), with the derivative as a weight.
    tails = np.sinh(t)
    log_student = stats.t.logpdf(tails, 3) + np.log(np.cosh(t))
    slope = 0.15 / spread * tails[:, None, None]
    errors, log_error = (tails, log_student) if has_error else np.zeros((2, 1))
    shifted = difference - 0.5 * step * errors[:, None]
    log_sums = []
    for i, j in np.ndindex(41, 41):
        z = shifted / (sigmas[i] * np.exp(slope * middle))
        p = 0.5 * lapses[j] + (1.0 - lapses[j]) * stats.norm.cdf(z)
        terms = stats.binom.logpmf(subject.n_yes, subject.n_trials, p).sum(axis=-1)
        terms += log_student[:, None] + log_error
        log_sums.append(logsumexp(terms) + log_normal[i] + log_normal[j])
    dimensions = 4 if has_error else 3
    log_half = stats.binom.logpmf(subject.n_yes, subject.n_trials, 0.5).sum()
    log_choices = log_half + subject.total_trials * np.log(2.0)
    return logsumexp(log_sums) + dimensions * np.log(t[1] - t[0]) - log_choices


def test_laplace_is_near(evidence):
    assert np.abs(evidence.laplace - evidence.log_evidence).max() < 0.5


@pytest.mark.parametrize("model", ["none", "constant error"])
def test_evidence_is_that_of_a_grid(evidence, model):
    i = MODEL_NAMES.index(model)
    exact = grid_evidence(SHIFTED, model == "constant error")
    assert abs(evidence.log_evidence[i] - exact) < 4.0 * evidence.standard_error[i]
    assert abs(evidence.laplace[i] - exact) < 0.5


def test_mean_evidence_over_seeds_is_unbiased():
    exact = grid_evidence(SHIFTED, False)
    ratios = []
    for seed in range(30):
        log_evidence = order_evidence([SHIFTED], seed)[0].log_evidence[0]
        ratios.append(np.exp(log_evidence - exact))
    assert abs(np.mean(ratios) - 1.0) < 4.0 * np.std(ratios) / np.sqrt(30)


def test_a_seed_gives_the_same_bits_and_companions_change_nothing(evidence):
    repeated = order_evidence([SHIFTED], seed=3)[0]
    assert np.array_equal(repeated.log_evidence, evidence.log_evidence)
    other = make_subject([0, 1, 19, 20, 20, 18, 1, 0], name="T")
    together = order_evidence([other, SHIFTED], seed=3)[1]
    assert np.abs(together.log_evidence - evidence.log_evidence).max() < 0.1


def test_one_trial_says_next_to_nothing():
    subject = Subject("S", [0.0], [0.3], [1], [1], task=WHICH_STRONGER)
    p = order_evidence([subject], seed=1)[0].probabilities(PRIOR_PROBABILITIES)
    assert [p[0], p[1] + p[3], p[2] + p[3]] == pytest.approx([1 / 2, 1 / 3, 1 / 3], abs=0.02)


@pytest.mark.parametrize(
    ("n_yes", "n"),
    [
        ([0] * 8, 50),
        ([50] * 8, 50),
        ([0, 0, 50, 50, 50, 50, 0, 0], 50),
        ([25] * 8, 50),
        ([10**8, 3 * 10**8, 8 * 10**8, 95 * 10**7] * 2, 10**9),
    ],
)
def test_hard_counts_have_finite_evidences(n_yes, n):
    evidence = order_evidence([make_subject(n_yes, n)], seed=1)[0]
    assert np.isfinite(evidence.log_evidence).all()
    assert np.isfinite(evidence.standard_error).all()


def test_a_criterion_near_zero_is_no_numerical_failure():
    """Long runs draw logits of q0 far below 0 from the prior, where a plain difference rounds."""
    counts = Subject("S", S1, S2, [3, 9, 9, 3, 3, 9, 9, 3], np.full(8, 10))
    batch = ObserverBatch.from_subjects([counts])
    rng = np.random.default_rng(1)
    u = rng.normal(size=(1, 20_000, 7))
    u[..., 1] = rng.uniform(-60.0, -25.0, 20_000)
    plain = batch.plain_log_likelihood(u)
    assert not np.isnan(plain).any()
    assert np.allclose(plain, batch.log_likelihood(u), rtol=1e-9)
    slope = batch.gradient(u)[1]
    assert np.allclose(batch.plain_gradient(u)[1], slope, rtol=1e-5, atol=1e-6)


def test_draws_by_which_a_mixture_is_changed_do_not_count(evidence, monkeypatch):
    module = "bayes_toe.inference.order_evidence"
    monkeypatch.setattr(f"{module}._FEWEST_ASSESSED", 500)
    monkeypatch.setattr(f"{module}._HEAVY", 0.0)  # eight times a new mixture
    changed = order_evidence([SHIFTED], seed=3)[0]
    difference = np.abs(changed.log_evidence - evidence.log_evidence)
    error = np.hypot(evidence.standard_error, changed.standard_error)
    assert ((difference > 0.0) & (difference < 4.0 * error)).all()
    n_draws = np.array([len(draws.points) for draws in changed.draws])
    assert np.all(n_draws <= 1500)
    assert np.all(changed.effective_draws > 0.6 * n_draws)
