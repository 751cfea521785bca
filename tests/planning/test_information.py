"""Information in closed form against the sum over answers, and designs' changes against designs made anew."""

import numpy as np
import pytest

from bayes_toe.errors import InputError
from bayes_toe.model.prior import Prior
from bayes_toe.planning.information import UTILITIES, information
from bayes_toe.planning.observers import observers_from, of_kind
from bayes_toe.planning.study_design import StudyDesign, each_once

PAIRS = each_once([-0.5, 0.0, 0.7, 1.1, 0.2], [-0.2, 0.0, 0.5, 0.6, 1.9])


@pytest.fixture(scope="module")
def observers():
    return observers_from(None, 3, seed=2)


def test_information_is_the_expected_product_of_slopes(observers):
    from bayes_toe.model.ladder import model_named
    from bayes_toe.model.posterior import Posterior

    found = information(PAIRS, observers, "gain", Prior())
    one = of_kind(observers, "update")[1]
    design = StudyDesign(PAIRS.s1, PAIRS.s2, np.ones(5, int))
    target = Posterior(design.unanswered, model_named("update + sloped + both ways"), Prior(), one.centre, one.interval)
    x = target.points({name: np.array([{"lapse_rate": 0.02, "noise_slope": 0.0, **one.quantities}[name]]) for name in target.names.natural})
    step, k = 1e-5, x.shape[1]
    slopes = np.stack([(target.log_answers(x + e)[0] - target.log_answers(x - e)[0])[0] / (2 * step) for e in step * np.eye(k)])
    rest = np.stack([(target.log_answers(x + e)[1] - target.log_answers(x - e)[1])[0] / (2 * step) for e in step * np.eye(k)])
    q = np.exp(target.log_answers(x)[0][0])
    pull = target.quantities(x)["pull"][0]
    scale = np.ones(k)
    scale[1] = pull * (1 - pull / 0.3819660112501051)  # the pull itself in the place of its logit
    for j, place in enumerate(np.lexsort((PAIRS.s2, PAIRS.s1))):
        expected = q[j] * np.outer(slopes[:, j], slopes[:, j]) + (1 - q[j]) * np.outer(rest[:, j], rest[:, j])
        rows = found.rows[1, place]
        assert np.outer(rows, rows) == pytest.approx(expected / np.outer(scale, scale), rel=1e-5, abs=1e-9)


@pytest.mark.parametrize("aim", UTILITIES)
def test_a_change_is_worth_what_the_changed_design_is(observers, aim):
    found = information(PAIRS, observers, aim, Prior())
    n = np.array([30.0, 40.0, 20.0, 10.0, 5.0])
    more = found.scores(found.total(n), 7.0)
    anew = [found.score(found.total(n + 7.0 * np.eye(5)[j])) for j in range(5)]
    assert more == pytest.approx(anew, rel=1e-9)


def test_the_expected_sd_is_that_of_maximum_likelihood_over_simulated_data(observers):
    """The mean square of Newton's first steps from the truth: scores whitened by the information, a brute-force variance."""
    one = of_kind(observers, "update")[0]
    pairs = each_once(np.repeat([-0.75, 0.25, 1.25], 4), [-0.7, -0.4, -0.2, 0.1, 0.0, 0.2, 0.4, 0.7, 0.6, 0.8, 1.0, 1.3])
    found = information(pairs, [one], "gain", Prior())
    n = np.full(12, 60)
    total = found.total(n.astype(float))
    q, rng = one.p_yes(StudyDesign(pairs.s1, pairs.s2, n)), np.random.default_rng(0)
    q = q * (1 - 0.02) + 0.02 * one.quantities["q0"]  # lapses both ways, as the information has them
    counts = rng.binomial(n, q, (20_000, 12))
    scores = (counts - n * q) / np.sqrt(q * (1 - q)) @ found.rows[0]
    data = total[0] - found.prior[0]
    assert scores.T @ scores / 20_000 == pytest.approx(data, rel=0.05, abs=0.05 * np.abs(data).max())
    steps = scores @ np.linalg.inv(data) @ found.direction[0]
    alone = found.direction[0] @ np.linalg.inv(data) @ found.direction[0]
    assert steps.var() == pytest.approx(alone, rel=0.05)
    assert found.variance(total)[0] <= alone


def test_who_does_not_update_counts_for_naming_alone(observers):
    assert information(PAIRS, observers, "gain", Prior()).updates.tolist() == [True] * 3
    assert information(PAIRS, observers, "update", Prior()).updates.sum() == 3
    assert len(information(PAIRS, observers, "update", Prior()).updates) == 9


def test_refusals(observers):
    with pytest.raises(InputError, match="found nobody with a predictive update"):
        information(PAIRS, of_kind(observers, "none"), "update", Prior())
