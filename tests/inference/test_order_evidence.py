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


def make_subject(n_yes, n=20):
    """A 2AFC subject with these counts of 'second' in n trials of each of the eight pairs."""
    return Subject("S", S1, S2, n_yes, np.full(8, n), task=WHICH_STRONGER)


#: A subject who overestimates the first stimulus.
SHIFTED = make_subject([1, 3, 11, 17, 15, 10, 2, 0])


@pytest.fixture(scope="module")
def evidence():
    """The evidences of the four models for a subject with a clear constant error."""
    return order_evidence([SHIFTED], seed=3)[0]


def test_laplaces_evidences_are_near_those_by_sampling(evidence):
    # A posterior of 160 trials is not quite normal; .5 nat is half of what changes a word.
    assert np.abs(evidence.laplace - evidence.log_evidence).max() < 0.5


@pytest.mark.parametrize("task", ["2afc", "same/different"])
def test_other_subjects_and_their_order_change_no_bit_of_an_evidence(task):
    """Thirteen subjects make two batches; two subjects have fewer pairs, which a batch fills up."""
    study = list(bt.example_study(task))[:11]
    # The two subjects with fewer pairs are the fifth and the last subject.
    fifth_subject, last_subject = (some_pairs(subject, slice(1, None)) for subject in study[:2])
    subjects = [*study[:4], fifth_subject, *study[4:], last_subject]
    for subject, evidence in zip(subjects, order_evidence(subjects, seed=3), strict=True):
        (expected,) = order_evidence([subject], seed=3)  # of the subject alone
        assert evidence.subject is subject
        for name in ("log_evidence", "standard_error", "laplace", "modes"):
            assert np.array_equal(getattr(evidence, name), getattr(expected, name))
        for draws, expected_draws in zip(evidence.draws, expected.draws, strict=True):
            assert np.array_equal(draws.x, expected_draws.x)


def test_one_trial_leaves_the_prior_probabilities_as_they_are():
    """Probabilities stay those of the prior: 1/2 for no effect, 1/6 for each other model."""
    subject = made_subject("0 0.3 1 1", task=WHICH_STRONGER)
    (evidence,) = order_evidence([subject], seed=1)
    none, error, contraction, joint = evidence.probabilities
    effects = [error + joint, contraction + joint]
    assert [none, *effects] == pytest.approx([1 / 2, 1 / 3, 1 / 3], abs=0.02)


@pytest.mark.parametrize(
    # Counts of 'second', and trials of each pair: always one answer, never an error, always half
    # and half, and a billion trials.
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
    subject = Subject("S", S1, S2, [3, 9, 9, 3, 3, 9, 9, 3], np.full(8, 10))
    batch = ObserverRows.from_subjects([subject])
    rng = np.random.default_rng(1)
    u = rng.normal(size=(1, 20_000, 7))  # (subjects, points, coordinates)
    logit_of_q0 = batch.coordinates.index("q0")
    u[..., logit_of_q0] = rng.uniform(-60.0, -25.0, 20_000)
    assert not np.isnan(batch.log_likelihood(u)).any()
    _, gradient = batch.gradient(u)
    _, slopes_of_scoring, _ = batch.scoring(u)
    assert np.allclose(gradient, slopes_of_scoring, rtol=1e-5, atol=1e-6)


def test_draws_by_which_a_mixture_is_changed_do_not_count(evidence, monkeypatch):
    """Every mixture is replaced eight times, after 500 draws each."""
    monkeypatch.setattr("bayes_toe.inference.engine._FEWEST_ASSESSED", 500)
    precision = Precision(largest_share=0.0)  # no draw may have any share of the weight
    (other_evidence,) = order_evidence([SHIFTED], seed=3, precision=precision)
    difference = np.abs(other_evidence.log_evidence - evidence.log_evidence)
    error = np.hypot(evidence.standard_error, other_evidence.standard_error)
    assert ((difference > 0.0) & (difference < 4.0 * error)).all()

    # Only the draws of the last mixture count, which fits well.
    for draws in other_evidence.draws:
        assert len(draws.x) <= 1500
        assert draws.efficiency > 0.6
