"""The paper's observer who says which stimulus was stronger, against other routes."""

import numpy as np
import pytest
from numpy.random import default_rng
from populations import S1, S2

from bayes_toe.data.study import Subject
from bayes_toe.data.tasks import WHICH_STRONGER
from bayes_toe.design.simulate import PaperObserver
from bayes_toe.model.paper_equations import Natural, pull, variance_ratio
from bayes_toe.model.paper_model import paper_posterior
from bayes_toe.model.prior import Prior

PAIRS = Subject("A", S1, S2, [0] * 10, [50] * 10, task=WHICH_STRONGER)


def test_answers_are_those_of_a_simulated_belief():
    """The answer is 'second' if a draw of the second percept exceeds a draw of the memory.

    The percept is N(s2, sigma_l^2), and the memory is N(mu_2, sigma_2^2), where
    mu_2 = s1 + pull (mu1 - s1) and sigma_2^2 = sigma_p^2 G.
    """
    mu1, sigma_p, sigma_l, n = -0.3, 0.2, 0.15, 400_000
    gamma = (sigma_l / sigma_p) ** 2
    ratio = variance_ratio(gamma)
    target = paper_posterior(PAIRS, Prior())
    no_lapses = 1e-12
    theta = {"mu1": mu1, "sigma_p": sigma_p, "sigma_l": sigma_l, "lapse_rate": no_lapses}
    x = target.points({name: np.array([value]) for name, value in theta.items()})
    p = np.exp(target.log_answers(x)[0, 0])  # P(second) of each pair, at the only point
    rng = default_rng(1)
    s1 = target.subject.s1
    s2 = target.subject.s2
    observer = PaperObserver("A", Natural(*theta.values()), WHICH_STRONGER)
    assert observer.p_trials(s1, s2, carry_over=0.0)[0] == pytest.approx(p, rel=1e-9)

    # n draws for each of the ten pairs.
    memory_noise = sigma_p * np.sqrt(ratio) * rng.standard_normal((n, 1))
    memory = s1 + pull(gamma) * (mu1 - s1) + memory_noise
    simulated = (s2 + sigma_l * rng.standard_normal((n, 1)) > memory).mean(axis=0)
    largest_standard_error = np.sqrt(0.25 / n)  # the error of a share of a half
    # 4.5 standard errors: a false alarm in 10,000 runs of ten pairs.
    assert np.abs(p - simulated).max() < 4.5 * largest_standard_error
