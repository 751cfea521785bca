"""Laplace's approximation in the paper's coordinates, against independent numerical routes."""

import json
from pathlib import Path

import numpy as np
import pytest
from conftest import text_table
from reference.hard_cases import hard_cases
from scipy import stats
from scipy.optimize import minimize

import bayes_toe as bt
from bayes_toe.inference import evidence
from bayes_toe.inference.evidence import laplace_evidence_natural
from bayes_toe.inference.maxima import find_maxima

CASES = {
    **hard_cases(),
    **{subject.name: subject for subject in bt.example_study("same/different")},
}
STORED = Path(__file__).parents[1] / "reference" / "reference.json"


def natural(name):
    """Value and reason of a case."""
    posterior = bt.model.paper_posterior(CASES[name], bt.Prior())  # the paper's
    return laplace_evidence_natural(posterior, find_maxima(posterior))


def _joint(subject, theta):
    """Log joint density of counts and (mu1, sigma_p^2, sigma_l^2, q0), from the definitions."""
    mu1, v, small, q0 = theta
    if not (0 < small < v and 0 < q0 < 1):
        return -np.inf
    sp = np.sqrt(v)
    q = bt.model.equal_probability(subject.s1, subject.s2, mu1, sp, np.sqrt(small), q0)
    remainder = subject.n_trials - subject.n_yes
    likelihood = (subject.n_yes * np.log(q) + remainder * np.log1p(-q)).sum()
    prior = stats.norm.logpdf(mu1, 0, 10) + stats.halfnorm.logpdf(sp)
    return likelihood + prior - np.log(2 * sp**3)


def _log_determinant_of_curvature(function, x, steps):
    """By central differences."""
    unit = np.diag(steps)
    hessian = np.empty((4, 4))
    for i in range(4):
        for j in range(4):
            ahead, backward = unit[i] + unit[j], unit[i] - unit[j]
            corners = function(x + ahead) - function(x + backward)
            corners += function(x - ahead) - function(x - backward)
            hessian[i, j] = corners / (4 * steps[i] * steps[j])
    return np.linalg.slogdet(-hessian)[1]


@pytest.mark.parametrize("name", ["S07", "funnel", "stimuli spanning 10 log units"])
def test_value_is_that_of_the_definition_in_natural_coordinates(name):
    subject = CASES[name]
    value, why_not = natural(name)
    assert why_not == ""
    simplex = {"maxiter": 20_000, "maxfev": 20_000, "xatol": 1e-10, "fatol": 1e-12}
    variances = [0.1, 0.03] if np.ptp(subject.s1) < 5 else [4.0, 1.0]

    def log_joint(theta):
        return _joint(subject, theta)

    maxima = []
    for mu1 in (-3.0, -0.5, 0.5, 3.0):
        theta = np.array([mu1, *variances, 0.8])
        for _ in range(4):  # a simplex stalls; it is started again where it stopped
            theta = minimize(
                lambda t: -log_joint(t), theta, method="Nelder-Mead", options=simplex
            ).x
        maxima.append(theta)
    best = max(maxima, key=log_joint)
    steps = 1e-3 * np.minimum(np.abs(best), 1 - 0.9 * (np.abs(best) < 1))
    log_determinant = _log_determinant_of_curvature(log_joint, best, steps)
    expected = log_joint(best) + 2 * np.log(2 * np.pi) - 0.5 * log_determinant
    assert value == pytest.approx(expected, abs=0.01)


EDGES = """
    S02 | gamma = 1
    maximum on gamma = 1 | gamma = 1
    q0 = 1 | q0 = 1
    all equal | q0 = 1
    all different | sigma_p = 0
    perfect observer | gamma = 0
"""


@pytest.mark.parametrize("name, edge", text_table(EDGES))
def test_no_value_where_the_maximum_lies_on_an_edge(name, edge):
    value, why_not = natural(name)
    assert value is None
    assert edge in why_not


@pytest.mark.parametrize(
    "name", ["S03", "S07", "S16", "one batch", "very blunt observer", "one order missing"]
)
def test_the_few_starts_lead_as_high_as_a_grid_over_all_that_a_study_can_look_like(
    name, monkeypatch
):
    posterior = bt.model.paper_posterior(CASES[name], bt.Prior())  # the paper's
    maxima = find_maxima(posterior)
    few, _ = laplace_evidence_natural(posterior, maxima)
    monkeypatch.setattr(evidence, "_starts", lambda *_: posterior.starts())
    numerous, _ = laplace_evidence_natural(posterior, maxima)
    assert few == pytest.approx(numerous, abs=1e-6)


@pytest.mark.parametrize("name", ["a million trials a pair", "a hundred million trials"])
def test_it_becomes_exact_with_many_trials(name):
    stored = json.loads(STORED.read_text())["cases"][name]
    assert natural(name)[0] == pytest.approx(stored["log_evidence"], abs=0.01)
