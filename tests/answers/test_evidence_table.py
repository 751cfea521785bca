"""Evidence of both models by routes that share nothing with the estimators."""

import math

import numpy as np
import pytest
from conftest import few_pairs, made_subject
from reference.hard_cases import hard_cases

import bayes_toe as bt
from bayes_toe.answers.evidence_table import (
    EVIDENCE_COLUMNS,
    EvidenceTable,
    frequency_evidence,
    frequency_evidence_laplace,
    subject_evidence,
)
from bayes_toe.errors import NumericalError
from bayes_toe.inference.fitted import importance_evidence
from bayes_toe.inference.mixture import WeightedDraws
from bayes_toe.inference.subject import fit_subject, model_evidence
from bayes_toe.model.paper_model import paper_posterior

CASES = hard_cases()


def test_h0_laplace_is_appendix_c_term_by_term():
    subject = made_subject("0 0 9 10, 0 0.3 4 10, 0.2 0 0 7")
    total = 0.0
    for k, n in zip(subject.n_yes, subject.n_trials, strict=True):
        q = (k + 1) / (n + 2)
        sigma = math.sqrt(q * ((k + 2) / (n + 3) - q))  # Eq. e:2b as printed
        total += k * math.log(q) + (n - k) * math.log(1 - q)
        total += math.log(sigma) + 0.5 * math.log(2 * math.pi)
    assert frequency_evidence_laplace(subject) == pytest.approx(total, rel=1e-12)


def test_laplace_that_does_not_exist_is_empty_and_says_why(monkeypatch, analysis):
    module = "bayes_toe.answers.evidence_table"
    monkeypatch.setattr(f"{module}.laplace", lambda *_: (None, np.array([np.nan])))
    posterior = paper_posterior(CASES["perfect observer"], bt.Prior())
    fitted = fit_subject(posterior, 1)
    row = subject_evidence(fitted, model_evidence(fitted, 1, 20_000), analysis.answers[0])
    assert (row.log_evidence_h1_laplace, row.log_bayes_factor_laplace) == (None, None)
    assert row.log_evidence_h1 is not None
    assert EvidenceTable((row,)).frame(full=True)["log_evidence_h1_laplace"].isna().all()


def test_untrusted_weights_give_no_number():
    probability = (np.arange(20_000) + 0.5) / 20_000
    log_weights = -0.9 * np.log(probability)  # a Pareto distribution of shape 0.9
    draws = WeightedDraws(probability[:, None], 0.0 * log_weights, log_weights, 0.0 * log_weights)
    estimate = importance_evidence(draws)
    assert (estimate.value, estimate.se) == (None, None)
    assert "k-hat 0.89" in estimate.why_not


def test_the_table_has_the_bayes_factor_of_its_evidences(analysis):
    frame = analysis.evidence.frame(full=True)
    assert tuple(frame.columns) == EVIDENCE_COLUMNS
    assert (frame["log_bayes_factor"] == frame["log_evidence_h1"] - frame["log_evidence_h0"]).all()
    assert frame["log_evidence_h1_se"].between(0, 0.01).all()


def paper_evidence(subject, draws, seed, **prior):
    posterior = paper_posterior(subject, **prior)
    return model_evidence(fit_subject(posterior, seed), seed, draws).value


def test_the_draws_asked_for_are_behind_the_evidence_of_h1(small_study):
    subject = small_study["A"]
    row = bt.evidence(bt.Study([subject]), draws=2000, seed=5)["A"]
    assert row.log_evidence_h1 == paper_evidence(subject, 2000, 5)


def test_real_vibrotactile_subjects_go_both_ways(vibrotactile):
    """Log Bayes factors of H1 against H0 under the paper's prior."""
    factors = []
    for subject in vibrotactile:
        h1 = paper_evidence(subject, 10_000, 1, prior=bt.Prior())
        factors.append(h1 - frequency_evidence(subject))
    assert np.count_nonzero(np.greater(factors, 0)) == 6
    assert (min(factors), max(factors)) == pytest.approx((-17, 18.5), abs=0.5)


def test_a_numerical_failure_leaves_the_other_subjects(monkeypatch):
    def checked(evidence):
        if evidence.subject.name == "B":
            raise NumericalError("not a finite number")
        return evidence

    monkeypatch.setattr("bayes_toe.inference.order_evidence.OrderEvidence.checked", checked)
    table = bt.evidence(few_pairs("ABC"), seed=1)
    assert [row.subject for row in table] == ["A", "C"]
    assert table.failed == {"B": "not a finite number"}
    frame = table.frame(full=True)
    assert frame["subject"].tolist() == ["A", "C", "B"]
    assert frame["p_order_effect"].isna().tolist() == [False, False, True]
