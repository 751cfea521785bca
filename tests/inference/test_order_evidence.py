"""Evidences of the four models: against integration over a grid, against seeds, on hard cases."""

import numpy as np
import pytest
from conftest import made_subject
from populations import some_pairs

import bayes_toe as bt
from bayes_toe.data.study import Subject
from bayes_toe.data.tasks import WHICH_STRONGER
from bayes_toe.inference.order_evidence import Precision, order_evidence
from bayes_toe.model.observer import ObserverRows

STEPS = np.array([-0.5, -0.25, 0.25, 0.5])
S1 = np.concatenate([np.zeros(4), STEPS])
S2 = np.concatenate([STEPS, np.zeros(4)])


def make_subject(n_yes, n=20, name="S"):
    return Subject(name, S1, S2, n_yes, np.full(8, n), task=WHICH_STRONGER)


#: Somebody to whom the first stimulus seems stronger.
SHIFTED = make_subject([1, 3, 11, 17, 15, 10, 2, 0])


@pytest.fixture(scope="module")
def evidence():
    """The evidences of the four models for a subject with a clear constant error."""
    return order_evidence([SHIFTED], seed=3)[0]


def test_laplace_is_near(evidence):
    assert np.abs(evidence.laplace - evidence.log_evidence).max() < 0.5


@pytest.mark.parametrize("task", ["2afc", "same/different"])
def test_companions_and_their_order_change_no_bit(task):
    study = list(bt.example_study(task))[:11]
    first, second = (some_pairs(subject, slice(1, None)) for subject in study[:2])
    subjects = [*study[:4], first, *study[4:], second]
    for position, together in enumerate(order_evidence(subjects, seed=3)):
        (alone,) = order_evidence([subjects[position]], seed=3)
        assert together.subject is subjects[position]
        for name in ("log_evidence", "standard_error", "laplace", "modes"):
            assert np.array_equal(getattr(together, name), getattr(alone, name))
        for draws, draws_alone in zip(together.draws, alone.draws, strict=True):
            assert np.array_equal(draws.x, draws_alone.x)


def test_one_trial_says_next_to_nothing():
    subject = made_subject("0 0.3 1 1", task=WHICH_STRONGER)
    (evidence,) = order_evidence([subject], seed=1)
    neither, error_alone, contraction_alone, two_effects = evidence.probabilities
    effects = [error_alone + two_effects, contraction_alone + two_effects]
    assert [neither, *effects] == pytest.approx([1 / 2, 1 / 3, 1 / 3], abs=0.02), "as before it"


@pytest.mark.parametrize(
    "n_yes, n",
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
    batch = ObserverRows.from_subjects([counts])
    rng = np.random.default_rng(1)
    u = rng.normal(size=(1, 20_000, 7))
    u[..., 1] = rng.uniform(-60.0, -25.0, 20_000)
    plain = batch.plain_log_likelihood(u)
    assert not np.isnan(plain).any()
    assert np.allclose(plain, batch.log_likelihood(u), rtol=1e-9)

    slope = batch.scoring(u)[1]
    assert np.allclose(batch.plain_gradient(u)[1], slope, rtol=1e-5, atol=1e-6)


def test_draws_by_which_a_mixture_is_changed_do_not_count(evidence, monkeypatch):
    monkeypatch.setattr("bayes_toe.inference.engine._FEWEST_ASSESSED", 500)
    precision = Precision(largest_share=0.0)  # eight times a new mixture
    changed = order_evidence([SHIFTED], seed=3, precision=precision)[0]
    difference = np.abs(changed.log_evidence - evidence.log_evidence)
    error = np.hypot(evidence.standard_error, changed.standard_error)
    assert ((difference > 0.0) & (difference < 4.0 * error)).all()

    n_draws = np.array([len(draws.x) for draws in changed.draws])
    assert np.all(n_draws <= 1500)
    assert np.all(changed.effective_draws > 0.6 * n_draws)
