"""Laplace's approximation in the paper's coordinates, against a general optimiser and finite differences in those coordinates."""

import json
from pathlib import Path

import numpy as np
import pytest
from reference.hard_cases import hard_cases
from scipy.optimize import minimize

import bayes_toe as bt
from bayes_toe.inference.evidence import laplace_evidence_natural
from bayes_toe.inference.maxima import find_maxima

CASES = {
    **hard_cases(),
    **{subject.name: subject for subject in bt.example_study("same/different")},
}
EVIDENCE = {
    name: case["log_evidence"]
    for name, case in json.loads(
        (Path(__file__).parents[1] / "reference" / "reference.json").read_text()
    )["cases"].items()
}


def natural(name):
    """Value and reason of a case."""
    posterior = bt.model.paper_posterior(CASES[name], bt.Prior())  # the paper's
    return laplace_evidence_natural(posterior, find_maxima(posterior))


def _joint(subject, theta):
    """Log joint density of counts and (mu1, sigma_p^2, sigma_l^2, q0), written from the definitions."""
    mu1, v, small, q0 = theta
    if not (0 < small < v and 0 < q0 < 1):
        return -np.inf
    sp = np.sqrt(v)
    q = bt.model.equal_probability(subject.s1, subject.s2, mu1, sp, np.sqrt(small), q0)
    rest = subject.n_trials - subject.n_yes
    likelihood = (subject.n_yes * np.log(q) + rest * np.log1p(-q)).sum()
    prior = (
        -0.5 * (mu1 / 10) ** 2
        - np.log(10 * np.sqrt(2 * np.pi))
        - 0.5 * v
        + 0.5 * np.log(2 / np.pi)
        - np.log(2 * sp**3)
    )
    return likelihood + prior


def _hessian(function, x, steps):
    def shifted(i, j, a, b):
        y = x.copy()
        y[i] += a * steps[i]
        y[j] += b * steps[j]
        return function(y)

    k = len(x)
    h = np.empty((k, k))
    for i in range(k):
        for j in range(k):
            corners = (
                shifted(i, j, 1, 1)
                - shifted(i, j, 1, -1)
                - shifted(i, j, -1, 1)
                + shifted(i, j, -1, -1)
            )
            h[i, j] = corners / (4 * steps[i] * steps[j])
    return h


@pytest.mark.parametrize("name", ["S07", "funnel", "stimuli spanning 10 log units"])
def test_value_is_that_of_the_definition_in_natural_coordinates(name):
    subject = CASES[name]
    value, why_not = natural(name)
    assert why_not == ""
    simplex = {"maxiter": 20_000, "maxfev": 20_000, "xatol": 1e-10, "fatol": 1e-12}
    best = None
    for mu1 in (-3.0, -0.5, 0.5, 3.0):
        start = (
            np.array([mu1, 0.1, 0.03, 0.8])
            if np.ptp(subject.s1) < 5
            else np.array([mu1, 4.0, 1.0, 0.8])
        )
        for _ in range(4):  # a simplex stalls; it is started again where it stopped
            found = minimize(
                lambda t: -_joint(subject, t), start, method="Nelder-Mead", options=simplex
            )
            start = found.x
        best = found if best is None or found.fun < best.fun else best
    curvature = -_hessian(
        lambda t: _joint(subject, t),
        best.x,
        1e-3 * np.minimum(np.abs(best.x), 1 - 0.9 * (np.abs(best.x) < 1)),
    )
    expected = -best.fun + 2 * np.log(2 * np.pi) - 0.5 * np.linalg.slogdet(curvature)[1]
    assert value == pytest.approx(expected, abs=0.01)


def test_no_value_where_the_maximum_lies_on_an_edge():
    for name, edge in {
        "S02": "gamma = 1",
        "maximum on gamma = 1": "gamma = 1",
        "q0 = 1": "q0 = 1",
        "all equal": "q0 = 1",
        "all different": "sigma_p = 0",
        "perfect observer": "gamma = 0",
    }.items():
        value, why_not = natural(name)
        assert value is None, name
        assert edge in why_not


@pytest.mark.parametrize(
    "name", ["S03", "S07", "S16", "one batch", "very blunt observer", "one order missing"]
)
def test_the_few_starts_lead_as_high_as_a_grid_over_all_that_a_study_can_look_like(name):
    posterior = bt.model.paper_posterior(CASES[name], bt.Prior())  # the paper's
    few, many = (
        laplace_evidence_natural(posterior, find_maxima(posterior), starts)[0]
        for starts in (None, posterior.starts())
    )
    assert few == pytest.approx(many, abs=1e-6)


def test_it_becomes_exact_with_many_trials():
    for name in ("a million trials a pair", "a hundred million trials"):
        value, _ = natural(name)
        assert value == pytest.approx(EVIDENCE[name], abs=0.01)
