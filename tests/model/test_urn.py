"""Polya's urn against high precision, and of a crowd against one point at a time."""

import mpmath
import numpy as np
import pytest

from bayes_toe.model.spread import log_drawn, rising

SIDES = [-1e-300, -1e-20, -1e-9, -0.011, -0.3, -2.0, -26.0, -300.0, -900.0]  # log P, with Q = 1 - P


def exact(log_p, v, n, before):
    """Log probability and sums of slopes in exact terms, and log Q."""
    with mpmath.workdps(500):
        p, q, eps = mpmath.exp(log_p), -mpmath.expm1(log_p), mpmath.exp(v)
        drawn = mpmath.fsum(mpmath.log((p + j * eps) / (1 + (before + j) * eps)) for j in range(n))
        share = [p / (p + j * eps) for j in range(n)]
        sums = [mpmath.fsum(share), mpmath.fsum(1 - t for t in share)]
        return float(mpmath.log(q)), float(drawn), [float(one) for one in sums]


@pytest.mark.parametrize("v", [-600.0, -60.0, -11.0, -2.0, 0.0, 3.0, 40.0, 600.0])
@pytest.mark.parametrize("swapped", [False, True], ids=["first", "other"])
def test_every_digit_of_likely_and_unlikely_answers(v, swapped):
    for log_p in SIDES:
        for n, before in ((0, 3), (1, 0), (2, 0), (17, 40), (50, 7)):
            log_q, drawn, sums = exact(log_p, v, n, before)
            if swapped:
                with mpmath.workdps(500):
                    p, eps = -mpmath.expm1(log_p), mpmath.exp(v)
                    drawn = float(mpmath.fsum(mpmath.log((p + j * eps) / (1 + (before + j) * eps)) for j in range(n)))
            sides = [np.array([[one]]) for one in ((log_q, log_p) if swapped else (log_p, log_q))]
            found = log_drawn(tuple(sides), np.array([[v]]), np.array([n]), np.array([before]))
            assert found[0, 0] == pytest.approx(drawn, rel=1e-13, abs=0.0)
            if not swapped:
                assert [one[0, 0] for one in rising(sides[0], np.array([[v]]), np.array([n]))] == pytest.approx(sums, rel=1e-12, abs=1e-290)


def test_many_answers_do_not_underflow():
    n, v = np.array([5000]), np.array([[-18.0], [1.0]])
    log_p = np.full((2, 1), -40.0)
    found = log_drawn((log_p, np.log1p(-np.exp(log_p))), v, n, np.array([100]))
    for value, one in zip(found[:, 0], v[:, 0], strict=True):
        assert value == pytest.approx(exact(-40.0, one, 5000, 100)[1], rel=1e-12)


def test_a_crowd_has_the_sums_of_its_points():
    rng = np.random.default_rng(3)
    n, before, log_p = rng.integers(0, 9, (4, 3)), rng.integers(0, 9, (4, 3)), np.log(rng.uniform(size=(4, 3)))
    answers, v = (log_p, np.log(-np.expm1(log_p))), rng.normal(size=(4, 1))
    crowd, slopes = log_drawn(answers, v, n, before), rising(log_p, v, n)
    for i in range(4):
        at = slice(i, i + 1)
        alone = log_drawn((answers[0][at], answers[1][at]), v[at], n[i], before[i])
        np.testing.assert_array_equal(crowd[at], alone)
        for one, other in zip(slopes, rising(log_p[at], v[at], n[i]), strict=True):
            np.testing.assert_array_equal(one[at], other)
