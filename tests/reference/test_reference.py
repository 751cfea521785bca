"""Evidences and quantiles against deterministic integration and tempering.

README.md says what made the stored numbers.
"""

import json
from itertools import product
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

#: References for the paper's model, and for the four models.
STORED = json.loads((Path(__file__).with_name("reference.json")).read_text(encoding="utf-8"))
SUBJECTS = hard_and_ordinary_subjects()
ORDER = json.loads((Path(__file__).with_name("order_models.json")).read_text(encoding="utf-8"))
ORDER_CASES = order_cases()


def test_stored_cases_belong_to_todays_counts_prior_and_method():
    """A case has a hash of the counts and a description of the prior, which `belongs` computes."""
    for name, case in STORED["cases"].items():
        assert belongs(SUBJECTS[name], model=None).items() <= case.items()  # the paper's model
        assert case["log_evidence_error"] <= 1.01e-4  # 1e-4 is what the integration aims at
    assert set(ORDER["cases"]) == {f"{name}: {model}" for name in ORDER_CASES for model in MODELS}
    for key, case in ORDER["cases"].items():
        name, model = key.rsplit(": ", 1)
        assert belongs(ORDER_CASES[name], model).items() <= case.items()
        assert case["method"] == METHOD


@pytest.mark.parametrize("name", hard_cases())
def test_the_likelihood_of_the_paper_in_separate_code(name):
    # Coordinates are standard normal under the prior: up to a dozen SDs from its centre.
    scores = 4.0 * default_rng(1).standard_normal((500, 4))
    value = PaperScores(SUBJECTS[name])(scores)
    expected = bt.model.paper_posterior(SUBJECTS[name], bt.Prior()).log_likelihood(scores)
    np.testing.assert_allclose(value, expected, rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize("name", ["S02", "one batch", "single pair"])
def test_tempering_confirms_the_integration(name):
    scores = PaperScores(SUBJECTS[name])
    points, log_weights = tempered_points(scores, k=4, runs=4, particles=2000, size=4000)
    value, error = tempered_evidence(log_weights)
    case = STORED["cases"][name]
    assert value == pytest.approx(case["log_evidence"], abs=4 * error)
    assert error < 0.03  # so that the comparison says something

    theta = scores.natural(points.reshape(-1, 4))  # an array for each parameter
    weights = np.exp(log_weights - log_weights.max()).ravel()
    # The stored means go on with that of the gain.
    for values, expected, sd in zip(theta, case["means"], case["sds"], strict=False):
        mean = np.average(values, weights=weights)
        assert mean == pytest.approx(expected, abs=0.1 * sd)


@pytest.fixture(
    scope="module",
    # Hard cases that have a reference, and every fourth ordinary subject, because these are alike.
    params=sorted({*hard_cases(), "S01", "S05", "S09", "S13"} & set(STORED["cases"])),
)
def fit(request):
    """A stored case, the mixture that is fitted to its posterior, and fresh draws of it."""
    posterior = bt.model.paper_posterior(SUBJECTS[request.param], bt.Prior())
    rng = default_rng(1)
    fitted = fit_posterior(posterior, rng)
    return STORED["cases"][request.param], fitted, fitted.fresh(rng, 20_000)


def test_the_evidence_is_the_stored_one_or_is_withheld_with_a_reason(fit):
    case, _, draws = fit
    estimate = importance_evidence(draws)
    if estimate.value is None:
        assert "withheld" in estimate.why_withheld
    else:
        tolerance = 4 * estimate.se + case["log_evidence_error"]
        assert estimate.value == pytest.approx(case["log_evidence"], abs=tolerance)


def test_quantiles_are_the_stored_ones_or_the_draws_are_said_not_to_have_converged(fit):
    case, fitted, _ = fit
    chains = sample_chains(fitted, SamplerSettings(draws=4000), seed=1)
    if not chains.converged:
        assert "required" in chains.reason
        return
    # The share of draws below each stored quantile, at 5 standard errors of 4,000 effective draws:
    # 21 cases, 5 quantities and 3 levels make 300 comparisons. 0.003 is for the stored quantiles.
    quantities = fitted.target.quantities(chains.x)
    for key, quantiles in zip(STORED["quantities"], case["quantiles"], strict=True):
        for level, quantile in zip(STORED["levels"], quantiles, strict=True):
            below = (quantities[key] < quantile).mean()
            tolerance = 5 * np.sqrt(level * (1 - level) / 4000) + 0.003
            assert below == pytest.approx(level, abs=tolerance)


# --- The four models of the observer --------------------------------------------------------------


def test_the_references_have_the_default_prior():
    # The references come from code with numbers of its own.
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


def order_errors(names, seeds):
    """Evidences minus references, and combined standard errors, of models near the best ones."""
    errors, sds = [], []
    for name, seed in product(names, seeds):
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
    """Of all cases but one, with two seeds."""
    names = [name for name in ORDER_CASES if name != PERFECT]
    return order_errors(names, seeds=(1, 2))


def test_evidences_of_the_four_models_agree_with_tempering(errors_and_sds):
    errors, sds = errors_and_sds
    z = np.abs(errors / sds)
    assert len(errors) >= 80
    # Of 80 one beyond 3 is no surprise; errors of few draws have tails of their own.
    assert (z > 3.0).sum() <= 2
    assert z.max() < 4.5
    assert np.median(sds) < 0.05  # nats; the evidences aim at .03


def test_evidences_of_the_four_models_have_no_bias(errors_and_sds):
    errors, sds = errors_and_sds
    # Three standard errors of the mean of 80 errors with an SD of .045.
    assert abs(errors.mean()) < 0.015
    assert 0.7 < (errors / sds).std() < 1.4


def test_evidences_of_a_perfect_observer_are_near_the_references():
    errors, _ = order_errors([PERFECT], seeds=[1])
    assert np.abs(errors).max() < 0.35  # nats, which change no word
