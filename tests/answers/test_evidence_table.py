"""Evidence of both models by routes that share nothing with the estimators."""

import math

import numpy as np
import pytest
from conftest import made_subject
from reference.hard_cases import hard_cases

import bayes_toe as bt
from bayes_toe.answers.evidence_table import (
    EVIDENCE_COLUMNS,
    EvidenceTable,
    frequency_evidence,
    frequency_evidence_laplace,
    subject_evidence,
)
from bayes_toe.inference.fitted import importance_evidence
from bayes_toe.inference.mixture import WeightedDraws
from bayes_toe.inference.subject import fit_subject, model_evidence
from bayes_toe.model.paper_model import paper_posterior

CASES = hard_cases()


def test_h0_laplace_is_appendix_c_term_by_term():
    subject = made_subject("0 0 9 10, 0 0.3 4 10, 0.2 0 0 7")  # s1, s2, 'equal', trials
    total = 0.0
    for k, n in zip(subject.n_yes, subject.n_trials, strict=True):
        # Mean and SD of a pair's P('equal') after k 'equal' in n trials, from a uniform prior.
        q = (k + 1) / (n + 2)
        sigma = math.sqrt(q * ((k + 2) / (n + 3) - q))  # Eq. e:2b as printed
        # The integral of the likelihood is about its height at q times sigma sqrt(2 pi).
        total += k * math.log(q) + (n - k) * math.log(1 - q)
        total += math.log(sigma) + 0.5 * math.log(2 * math.pi)
    assert frequency_evidence_laplace(subject) == pytest.approx(total, rel=1e-12)


def test_laplace_that_does_not_exist_is_empty_and_says_why(monkeypatch, analysis):
    # `laplace` returns maxima, which are not used, and an evidence for each: here it has none.
    no_evidence = None, np.array([np.nan])
    monkeypatch.setattr("bayes_toe.answers.evidence_table.laplace", lambda *_: no_evidence)
    posterior = paper_posterior(CASES["perfect observer"], bt.Prior())
    fitted = fit_subject(posterior, seed=1)
    estimate = model_evidence(fitted, seed=1, size=20_000)
    row = subject_evidence(fitted, estimate, analysis.answers[0])
    assert (row.log_evidence_h1_laplace, row.log_bayes_factor_laplace) == (None, None)
    assert row.log_evidence_h1 is not None
    assert EvidenceTable((row,)).frame(full=True)["log_evidence_h1_laplace"].isna().all()


def test_untrusted_weights_give_no_number():
    # Quantiles of a Pareto distribution of shape .9. Above .7 a mean of weights is not trusted.
    probability = (np.arange(20_000) + 0.5) / 20_000
    log_weights = -0.9 * np.log(probability)
    zero = np.zeros(20_000)
    draws = WeightedDraws(
        x=probability[:, None], log_prior=zero, log_posterior=log_weights, log_proposal=zero
    )
    estimate = importance_evidence(draws)
    assert (estimate.value, estimate.se) == (None, None)
    assert "k-hat 0.89" in estimate.why_withheld  # the estimated shape


def test_the_table_has_the_bayes_factor_of_its_evidences(analysis):
    frame = analysis.evidence.frame(full=True)
    assert tuple(frame.columns) == EVIDENCE_COLUMNS
    assert (frame["log_bayes_factor"] == frame["log_evidence_h1"] - frame["log_evidence_h0"]).all()
    # In nats, far below the differences between evidences that matter, which are about 1.
    assert frame["log_evidence_h1_se"].between(0, 0.01).all()


def h1_evidence(subject, draws, seed, **prior):
    """The log evidence of the paper's model, by so many draws."""
    posterior = paper_posterior(subject, **prior)
    return model_evidence(fit_subject(posterior, seed), seed, draws).value


def test_the_evidence_of_h1_is_by_as_many_draws_as_asked_for(small_study):
    subject = small_study["A"]
    row = bt.evidence(bt.Study([subject]), draws=2000, seed=5)["A"]
    assert row.log_evidence_h1 == h1_evidence(subject, draws=2000, seed=5)


def test_six_of_eleven_vibrotactile_subjects_favour_h1(vibrotactile):
    """Log Bayes factors of H1 against H0 under the paper's prior: 6 of 11 subjects favour H1.

    Their number and their range are those of an earlier analysis.
    """
    factors = []
    for subject in vibrotactile:
        h1 = h1_evidence(subject, draws=10_000, seed=1, prior=bt.Prior())
        factors.append(h1 - frequency_evidence(subject))
    assert np.count_nonzero(np.greater(factors, 0)) == 6
    assert (min(factors), max(factors)) == pytest.approx((-17, 18.5), abs=0.5)
