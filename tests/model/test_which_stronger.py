"""The paper's observer who says which stimulus was stronger, against other routes."""

import numpy as np
import pytest
from numpy.random import default_rng
from scipy.stats import norm

from bayes_toe.data.study import Subject
from bayes_toe.data.tasks import SAME_DIFFERENT, WHICH_STRONGER
from bayes_toe.model.paper_equations import pull, variance_ratio
from bayes_toe.model.paper_model import paper_posterior
from bayes_toe.model.prior import Prior

S1 = np.array([0.0, 0.2, 0.4, 0.6, 0.2, 0.4, 0.6, 0.8])
S2 = np.array([0.2, 0.4, 0.6, 0.8, 0.0, 0.2, 0.4, 0.6])


def subject(k=(40, 38, 35, 33, 20, 15, 12, 8), s1=S1, s2=S2):
    return Subject("A", s1, s2, k, np.full(len(k), 50), task=WHICH_STRONGER)


# --- The answers ----------------------------------------------------------------------------------


def test_answers_are_those_of_a_simulated_belief():
    """'Second' where a draw of the second percept exceeds one of what memory expects.

    These are N(s2, sigma_l^2) and N(mu_2, sigma_2^2).
    """
    mu1, sigma_p, sigma_l, n = -0.3, 0.2, 0.15, 400_000
    gamma = (sigma_l / sigma_p) ** 2
    ratio = variance_ratio(gamma)
    target = paper_posterior(subject(), Prior())
    theta = {"mu1": mu1, "sigma_p": sigma_p, "sigma_l": sigma_l, "lapse_rate": 1e-12}
    x = target.points({name: np.array([value]) for name, value in theta.items()})
    p = np.exp(target.log_answers(x)[0][0])
    rng, s1, s2 = default_rng(1), target.subject.s1, target.subject.s2
    memory = s1 + pull(gamma) * (mu1 - s1) + sigma_p * np.sqrt(ratio) * rng.standard_normal((n, 1))
    simulated = (s2 + sigma_l * rng.standard_normal((n, 1)) > memory).mean(axis=0)
    assert np.abs(p - simulated).max() < 4.5 * np.sqrt(0.25 / n)


def test_both_tasks_have_one_observer():
    """The width of 'equal' is that of 'second' times the root of G, and the pull is the same."""
    theta = {"mu1": 0.3, "sigma_p": 0.2, "sigma_l": 0.15, "q0": 0.9, "lapse_rate": 0.1}
    theta = {name: np.array([value]) for name, value in theta.items()}
    quantities = []
    for task in (SAME_DIFFERENT, WHICH_STRONGER):
        target = paper_posterior(Subject("A", S1, S2, [5] * 8, [9] * 8, task=task), Prior())
        quantities.append(target.quantities(target.points(theta)))
    equal, second = quantities
    ratio = variance_ratio((0.15 / 0.2) ** 2)
    assert equal["width"] == pytest.approx(second["width"] * np.sqrt(ratio), rel=1e-12)
    assert equal["pull"] == pytest.approx(second["pull"])
    assert equal["offset"] == second["pse_shift"] == pytest.approx(second["offset"])
    assert second["jnd"] == pytest.approx(norm.ppf(0.75) * second["width"])
