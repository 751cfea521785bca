"""Evidences of compositions against tempering, stored in tests/reference (scripts/make_reference.py --compositions made it)."""

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
from reference.hard_cases import hard_cases
from reference.tempering import METHOD, PRIOR

import bayes_toe as bt
from bayes_toe.inference.adaptation import fit_proposal
from bayes_toe.inference.evidence import importance_evidence
from bayes_toe.model.ladder import model_named, posterior_of
from bayes_toe.model.parts import compositions

CASES = json.loads((Path(__file__).with_name("compositions.json")).read_text(encoding="utf-8"))["cases"]
SUBJECTS = {**hard_cases(), **{subject.name: subject for subject in bt.example_study()}}


def test_stored_cases_belong_to_todays_counts_prior_and_method():
    names = {key.split(": ")[0] for key in CASES}
    assert len(names) >= 4
    small = compositions(order=("none", "constant error", "update"), noise=("Weber", "sloped"), lapses=("misses", "both ways"))
    assert {f"{name}: {model.name}" for name in names for model in small} <= set(CASES)
    for key, case in CASES.items():
        name, model = key.split(": ")
        s = SUBJECTS[name]
        columns = np.column_stack((s.s1, s.s2, s.n_yes.astype(float), s.n_trials.astype(float)))
        assert case["counts"] == hashlib.sha256(columns.tobytes()).hexdigest()
        assert case["prior"] == model_named(model).describe(PRIOR)
        assert case["method"] == METHOD


#: Some seconds each: two subjects are enough.
DEAR = ("update + sloped + both ways + exponent + beta-binomial", "update + sloped + both ways + differencing + sloped peak")


@pytest.mark.parametrize("key", [key for key in sorted(CASES) if not (key.endswith(DEAR) and key.startswith(("S01", "one order")))])
def test_evidence_agrees_within_four_standard_errors(key):
    # Errors of the references are from eight runs (7 degrees of freedom): a false alarm in one of three such sets; the seeds are fixed.
    (name, model), case = key.split(": "), CASES[key]
    estimate = importance_evidence(fit_proposal(posterior_of(SUBJECTS[name], PRIOR, model=model), np.random.default_rng(2611)))
    assert estimate.value is not None, estimate.why_not
    assert estimate.value == pytest.approx(case["log_evidence"], abs=4 * np.hypot(estimate.se, case["log_evidence_error"]))
    assert case["log_evidence_error"] < 0.15
