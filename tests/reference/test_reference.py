"""Evidences and quantiles against deterministic integration and tempering.

README.md says what made the stored numbers.
"""

import json
from pathlib import Path

import numpy as np
import pytest
from conftest import hard_and_ordinary_subjects
from make_reference import belongs
from numpy.random import default_rng
from reference.hard_cases import hard_cases
from reference.order_cases import order_cases
from reference.paper_density import PaperScores
from reference.tempering import (
    CONSTANT_ERROR_SCALE,
    CONTRACTION_SD,
    LAPSE_RATE_B,
    METHOD,
    MODELS,
    NOISE_MEDIAN,
    NOISE_SD,
    Q0_A,
    SLOPE_SCALE,
    tempered_evidence,
    tempered_points,
)

import bayes_toe as bt
from bayes_toe.inference.fitted import fit_posterior, importance_evidence
from bayes_toe.inference.order_evidence import MODEL_NAMES, order_evidence
from bayes_toe.inference.sampling import SamplerSettings, sample_chains
from bayes_toe.model.parameters import ObserverPrior

STORED = json.loads((Path(__file__).with_name("reference.json")).read_text(encoding="utf-8"))
SUBJECTS = hard_and_ordinary_subjects()
ORDER = json.loads((Path(__file__).with_name("order_models.json")).read_text(encoding="utf-8"))
ORDER_CASES = order_cases()


def test_stored_cases_belong_to_todays_counts_prior_and_method():
    for name, case in STORED["cases"].items():
        assert belongs(SUBJECTS[name], None).items() <= case.items()
        assert case["log_evidence_error"] <= 1.01e-4  # 1e-4 is what the integration aims at
    assert set(ORDER["cases"]) == {f"{name}: {model}" for name in ORDER_CASES for model in MODELS}
    for key, case in ORDER["cases"].items():
        name, model = key.rsplit(": ", 1)
        assert belongs(ORDER_CASES[name], model).items() <= case.items()
        assert case["method"] == METHOD


@pytest.mark.parametrize("name", hard_cases())
def test_the_likelihood_of_the_paper_in_separate_code(name):
    scores = 4.0 * default_rng(1).standard_normal((500, 4))
    value = PaperScores(SUBJECTS[name])(scores)
    expected = bt.model.paper_posterior(SUBJECTS[name], bt.Prior()).log_likelihood(scores)
    np.testing.assert_allclose(value, expected, rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize("name", ["S02", "one batch", "single pair"])
def test_tempering_confirms_the_integration(name):
    scores = PaperScores(SUBJECTS[name])
    points, log_weights = tempered_points(scores, 4, runs=4, particles=2000, size=4000)
    value, error = tempered_evidence(log_weights)
    case = STORED["cases"][name]
    assert value == pytest.approx(case["log_evidence"], abs=4 * error)
    assert error < 0.03

    theta = scores.natural(points.reshape(-1, 4))
    weights = np.exp(log_weights - log_weights.max()).ravel()
    for i, values in enumerate(theta):
        mean = np.average(values, weights=weights)
        assert mean == pytest.approx(case["means"][i], abs=0.1 * case["sds"][i])


#: Ordinary subjects are alike: every fourth of them.
@pytest.mark.parametrize(
    "name", sorted({*hard_cases(), "S01", "S05", "S09", "S13"} & set(STORED["cases"]))
)
def test_evidence_and_draws_agree(name):
    posterior, case = bt.model.paper_posterior(SUBJECTS[name], bt.Prior()), STORED["cases"][name]
    rng = default_rng(1)
    fitted = fit_posterior(posterior, rng)
    estimate = importance_evidence(fitted.fresh(rng, 20_000))
    if estimate.value is None:  # said, not hidden
        assert "withheld" in estimate.why_not
    else:
        assert estimate.value == pytest.approx(
            case["log_evidence"], abs=4 * estimate.se + case["log_evidence_error"]
        )
    chains = sample_chains(fitted, SamplerSettings(draws=4000), 1)
    quantities = posterior.quantities(chains.x)
    if not chains.converged:
        assert "required" in chains.reason
        return
    # 21 cases, 5 quantities, 3 looks: |z| < 5 for 4,000 effective draws.
    for key, quantiles in zip(STORED["quantities"], case["quantiles"], strict=True):
        for level, quantile in zip(STORED["levels"], quantiles, strict=True):
            below = (quantities[key] < quantile).mean()
            assert below == pytest.approx(
                level, abs=5 * np.sqrt(level * (1 - level) / 4000) + 0.003
            )


# --- The four models of the observer --------------------------------------------------------------


def test_the_references_have_the_default_prior():
    assert tuple(MODELS) == MODEL_NAMES
    assert ObserverPrior() == ObserverPrior(
        noise_median=NOISE_MEDIAN,
        noise_sd=NOISE_SD,
        q0_a=Q0_A,
        q0_b=1.0,
        lapse_rate_b=LAPSE_RATE_B,
        noise_slope_scale=SLOPE_SCALE,
        criterion_slope_scale=SLOPE_SCALE,
        constant_error_scale=CONSTANT_ERROR_SCALE,
        contraction_sd=CONTRACTION_SD,
    )


#: Its evidences scatter twice as far as their standard errors (docs/error_bars_order.md).
PERFECT = "same/different, perfect"


def order_errors(seed, names):
    """Evidences minus references, and combined standard errors, of models near the best ones."""
    errors, sds = [], []
    for name in names:
        (evidence,) = order_evidence([ORDER_CASES[name]], seed)
        cases = [ORDER["cases"][f"{name}: {model}"] for model in MODEL_NAMES]
        reference = np.array([case["log_evidence"] for case in cases])
        reference_error = np.array([case["log_evidence_error"] for case in cases])
        # A model far below the best one gets few draws: its error is stated, and large.
        is_near = reference > reference.max() - 6.0
        errors += (evidence.log_evidence - reference)[is_near].tolist()
        sds += np.hypot(evidence.standard_error, reference_error)[is_near].tolist()
    return np.array(errors), np.array(sds)


@pytest.fixture(scope="module")
def errors_and_sds():
    names = [name for name in ORDER_CASES if name != PERFECT]
    built = [order_errors(seed, names) for seed in (1, 2)]
    return tuple(np.concatenate(parts) for parts in zip(*built, strict=True))


def test_evidences_of_the_four_models_agree_with_tempering(errors_and_sds):
    errors, sds = errors_and_sds
    z = np.abs(errors / sds)
    assert len(errors) >= 80
    # Of 80 one beyond 3 is no surprise; errors of few draws have tails of their own.
    assert (z > 3.0).sum() <= 2
    assert z.max() < 4.5
    assert np.median(sds) < 0.05


def test_evidences_of_the_four_models_have_no_bias(errors_and_sds):
    errors, sds = errors_and_sds
    assert abs(errors.mean()) < 0.015
    assert 0.7 < (errors / sds).std() < 1.4


def test_evidences_of_a_perfect_observer_are_near_the_references():
    errors, _ = order_errors(1, [PERFECT])
    assert np.abs(errors).max() < 0.35
