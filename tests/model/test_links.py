"""Links against 50-digit arithmetic, and their shape."""

import mpmath as mp
import numpy as np
import pytest

from bayes_toe.model.links import (
    BELL,
    DIFFERENCING,
    EXPONENT,
    Lapsing,
    bell_answers,
    criterion,
    differencing_answers,
)

DISTANCES = [0.0, 1e-200, 1e-8, 0.01, 0.3, 1.0, 2.5, 6.0, 9.0, 30.0, 200.0, 1e4]
LOGITS = [-600.0, -40.0, -12.0, -3.0, -0.5, 0.0, 1e-9, 0.4, 2.0, 10.0, 38.0, 90.0]


def _exact(z, logit):
    """Log P(equal), log P(different) and k, with enough digits for the smaller one."""
    with mp.workdps(60 + int(abs(logit))):
        a, z = mp.mpf(logit), mp.mpf(z)
        tail = 1 / (1 + mp.exp(a)) / 2  # 1 - Phi(k)
        k = mp.mpf(float(criterion(logit)))
        for _ in range(
            8
        ):  # Newton on log Phi(-k), from the float; the density ratio keeps it stable in the tail
            upper = mp.erfc(k / mp.sqrt(2)) / 2
            k += (upper - tail) / mp.npdf(k)
        low, high = (mp.erfc((z + s * k) / mp.sqrt(2)) / 2 for s in (1, -1))
        inside, outside = high - low, low + mp.erfc((k - z) / mp.sqrt(2)) / 2
        half = (
            mp.mpf(1) / 2
        )  # the larger one from the smaller: its own difference from 1 may be beyond the digits kept
        return (
            mp.log(inside) if outside > half else mp.log1p(-outside),
            mp.log(outside) if inside > half else mp.log1p(-inside),
            k,
        )


@pytest.mark.parametrize("logit", LOGITS)
def test_differencing_against_fifty_digits(logit):
    found = differencing_answers(np.array(DISTANCES), np.array(logit))
    k = None
    for i, z in enumerate(DISTANCES):
        *logs, k = _exact(z, logit)
        for log_answer, exact in zip(found, logs, strict=True):
            # Relative in the log; a criterion of finite accuracy moves a far tail by z k eps.
            assert float(log_answer[i]) == pytest.approx(float(exact), rel=2e-12, abs=1e-300)
    assert float(criterion(logit)) == pytest.approx(float(k), rel=1e-13)


def test_differencing_far_away_and_at_the_ends():
    equal, different = differencing_answers(
        np.array([1e200, 0.0, 3.0]), np.array([0.0, np.inf, np.inf])
    )
    assert equal.tolist() == [-np.inf, 0.0, 0.0]
    assert different.tolist() == [0.0, -np.inf, -np.inf]
    z = np.linspace(-4, 4, 33)
    assert differencing_answers(z, np.array(0.7))[0] == pytest.approx(
        differencing_answers(-z, np.array(0.7))[0], rel=1e-15
    )


def test_without_lapses_identical_stimuli_are_never_called_different():
    equal, different = bell_answers(np.array([0.0, 1.0, 3.0]), np.array(np.inf))
    assert equal == pytest.approx(-np.log(2) * np.array([0, 1, 9]))
    assert different == pytest.approx([-np.inf, np.log(0.5), np.log1p(-(2.0**-9))])


def _of_curve(z, logit, exponent, logit_rate):
    """Log P(equal) and log P(different) of a curve q0 2^(-z^nu), with lapses both ways if there is a rate."""
    with mp.workdps(50 + int(max(abs(logit), abs(logit_rate or 0.0)) / 2.2)):
        q0, miss = (1 / (1 + mp.exp(sign * mp.mpf(logit))) for sign in (-1, 1))
        t = mp.log(2) * mp.mpf(z) ** exponent if z else mp.mpf(0)
        if t > 5000:  # no part of any sum
            q, rest = mp.mpf(0), mp.mpf(1)
        else:
            q, rest = (
                q0 * mp.exp(-t),
                miss + q0 * (-mp.expm1(-t) if t > mp.mpf(10) ** -3 else _lost(t)),
            )
        if logit_rate is None:
            return mp.log(q0) - t, mp.log1p(-q) if 2 * q < 1 else mp.log(rest)
        lapse, attend = (1 / (1 + mp.exp(sign * mp.mpf(logit_rate))) for sign in (-1, 1))
        equal, different = lapse * q0 + attend * q, lapse * miss + attend * rest
        return [
            mp.log(one) if 2 * one < 1 else mp.log1p(-other)
            for one, other in ((equal, different), (different, equal))
        ]


def _lost(t):
    """1 - e^-t of a small t by its series, which keeps its digits however small t is."""
    return t * mp.fsum((-t) ** k / mp.factorial(k + 1) for k in range(25))


#: Floors f = lambda q0 from 1e-300 to within 1e-261 of q0, q0 from 1e-304 to within 1e-300 of 1.
RATES, PEAKS = [None, -690.0, -40.0, -2.0, 37.0, 600.0], [-700.0, -3.0, 10.0, 690.0]
AWAY = [0.0, 1e-200, 1e-8, 0.3, 1.0, 1.01, 9.0, 1e4, 1e200]


@pytest.mark.parametrize("exponent", [None, 0.2, 1.0, 1.7, 20.0])
def test_curves_with_and_without_a_floor_at_their_ends(exponent):
    curve = BELL if exponent is None else EXPONENT
    shape = [] if exponent is None else [np.array([[np.log(exponent)]])]
    exact = 2 if exponent is None else mp.exp(mp.mpf(float(np.log(exponent))))
    for rate in RATES:
        link, floor = (
            (curve, []) if rate is None else (Lapsing(curve, "logit_q0"), [np.array([[rate]])])
        )
        for peak in PEAKS:
            found = link.log_answers(np.array([AWAY]), np.array([[peak]]), *shape, *floor)
            for i, z in enumerate(AWAY):
                for log_answer, truth in zip(found, _of_curve(z, peak, exact, rate), strict=True):
                    assert float(log_answer[0, i]) == pytest.approx(
                        float(truth), rel=1e-13, abs=1e-300
                    ), (exponent, rate, peak, z)


@pytest.mark.parametrize(
    "curve", [BELL, EXPONENT, DIFFERENCING], ids=["bell", "exponent", "differencing"]
)
def test_slopes_are_finite_where_only_the_floor_is_left(curve):
    # There the curve has the log -inf with infinite slopes, and the observer answers by lapses alone.
    z, own = np.array([[1e20, 1e100, 1e180, -1e180]]), [np.array([[2.0]])]
    own += [*([np.array([[2.9]])] if curve is EXPONENT else []), np.array([[-2.0]])]
    link = Lapsing(curve, "logit_q0")
    with np.errstate(all="raise", under="ignore"):
        for slopes in link.slopes(z, link.log_answers(z, *own), *own):
            assert all((np.asarray(row) == 0.0).all() for row in (slopes.z, *slopes.own[1:-1]))
            assert all(np.isfinite(part).all() for part in slopes.own)


def test_slopes_exist_where_a_steep_curve_has_fallen_beyond_the_largest_float():
    """An optimiser gets there: z = 40 to the power of 230. 'Equal' then comes from lapses alone, 'different' is certain without them."""
    z, own, link = (
        np.array([[40.0]]),
        (np.array([[1.3]]), np.log([[230.0]])),
        Lapsing(EXPONENT, "logit_q0"),
    )
    rate = np.array([[-0.2]])
    equal, different = link.slopes(z, link.log_answers(z, *own, rate), *own, rate)
    for one in (equal, different, EXPONENT.slopes(z, EXPONENT.log_answers(z, *own), *own)[1]):
        assert [float(part[0, 0]) for part in (one.z, one.own[1])] == [0.0, 0.0]
        assert np.isfinite([part[0, 0] for part in one.own]).all()
