"""Every rung and compositions with every part: value, gradient and Hessian against forward differentiation with hundreds of digits.

The reference (`jets.py`) is written from the definitions, with no stable form: parameters from coordinates, probabilities by subtraction,
scales of an interval from the filter's own quantities.
"""

import mpmath
import numpy as np
import pytest
from hypothesis import Phase, assume, given, settings
from hypothesis import strategies as st
from jets import Jet

from bayes_toe.data.study import Subject
from bayes_toe.model.closed_form import MAX_PULL
from bayes_toe.model.ladder import MODELS, posterior_of
from bayes_toe.model.posterior import Model
from bayes_toe.model.prior import Prior

RUNGS = [model.name for model in MODELS if isinstance(model, Model)]
COMPOSED = [
    "none + sloped + both ways",
    "constant error + sloped + both ways + exponent",
    "constant error + both ways + differencing",
    "update + sloped + both ways",
    "update + no lapses + exponent + beta-binomial",
    "free weighting + both ways + beta-binomial",
    "mean-reverting + sloped + exponent + beta-binomial",
]
PRIOR = Prior(mu1_mean=0.4, mu1_sd=2.0, sigma_p_scale=0.7, offset_sd=1.0, reference_interval=1.0)
DIGITS = 120
#: With lapses, terms cancel where the curvature in the logit of the peak changes its sign, and the curve's own keeps some 14 digits.
TOLERANCE = {"constant error + both ways + differencing": 1e-11}


def variance_ratio(gamma):
    return (1 + (1 + 4 * gamma) ** mpmath.mpf("0.5")) / 2


def scales(name, at, t):
    """Pull and width at t seconds over those at one second."""
    if name == "update":
        p = mpmath.mpf(MAX_PULL) * at["logit_pull"].expit()
        gamma = p / (1 - p) ** 2
        ratio = variance_ratio(gamma / t) / variance_ratio(gamma)
        return 1 / (ratio**2 * t), mpmath.sqrt(t) * ratio ** mpmath.mpf("1.5")
    if name == "mean-reverting":
        kept, split = 1 - at["logit_pull"].expit(), at["logit_split"].expit()
        rho, gain = (split * kept.log()).exp(), ((1 - split) * kept.log()).exp()

        def width(seconds):
            weight = rho**seconds * gain
            return (1 - weight * weight) / (1 - weight * rho**seconds) ** mpmath.mpf("0.5")

        return (1 - rho**t * gain) / (1 - kept), width(t) / width(mpmath.mpf(1))
    return 1, 1


def pull_of(name, at):
    if "logit_pull" in at:
        return (mpmath.mpf(MAX_PULL) if "split" not in "".join(at) else 1) * at["logit_pull"].expit()
    return 1 - 2 * at["logit_gain"].expit() if "logit_gain" in at else None


def answers(levels, z, at):
    """P(equal) and P(different)."""
    peak = at["logit_q0"].expit() if "logit_q0" in at else 1
    if levels["curve"] == "differencing":
        k, z = peak.criterion(), -z if z.value < 0 else z
        equal = (k - z).ndtr() - (-k - z).ndtr()
    elif levels["curve"] == "exponent":
        size = -z if z.value < 0 else z
        equal = peak * (-mpmath.log(2) * (at["log_exponent"].exp() * size.log()).exp()).exp() if size.value else peak * (1 + 0 * z)
    else:
        equal = peak * (-mpmath.log(2) * z * z).exp()
    if "logit_lapse_rate" in at:
        rate = at["logit_lapse_rate"].expit()
        equal = rate * peak + (1 - rate) * equal
    return equal, 1 - equal


def log_likelihood(levels, z, at, k, n):
    """Terms of one pair."""
    equal, different = answers(levels, z, at)
    if levels["spread"] == "binomial":
        yield from ([k * equal.log()] if k else []) + ([(n - k) * different.log()] if n > k else [])
    else:
        eps = at["logit_icc"].exp()
        yield from ((equal + j * eps).log() for j in range(k))
        yield from ((different + j * eps).log() for j in range(n - k))
        yield from (-(1 + j * eps).log() for j in range(n))


def half_normal(value, scale):
    return mpmath.mpf(-0.5) * (value / scale) ** 2 + mpmath.log(mpmath.sqrt(2 / mpmath.pi) / scale)


def normal(value, mean, sd):
    return mpmath.mpf(-0.5) * ((value - mean) / sd) ** 2 - mpmath.log(sd * mpmath.sqrt(2 * mpmath.pi))


def prior_terms(name, at, sbar):
    prior = PRIOR
    if name == "update":
        most = mpmath.mpf(MAX_PULL)
        p = most * at["logit_pull"].expit()
        gain, width = 1 - p, at["log_width"].exp()
        yield normal(at["offset"] / p + sbar, prior.mu1_mean, prior.mu1_sd)
        yield half_normal(width * gain ** mpmath.mpf("1.5"), prior.sigma_p_scale)
        yield ((1 + p) / gain ** mpmath.mpf("1.5") * (1 - p / most) * width).log()
    elif name == "mean-reverting":
        p, split = at["logit_pull"].expit(), at["logit_split"].expit()
        lost = -(1 - p).log()
        rho, gain = (-split * lost).exp(), ((split - 1) * lost).exp()
        weight = rho * gain
        sigma1 = at["log_width"].exp() * gain * (1 - weight * rho) ** mpmath.mpf("0.5") / (1 - weight * weight)
        yield normal(at["offset"] / p + sbar, prior.mu1_mean, prior.mu1_sd)
        yield half_normal(sigma1, prior.sigma_p_scale)
        # d(mu1, sigma1, rho, K)/dx: 1/p, sigma1, and rho K l p split (1 - split).
        yield (sigma1 * weight * lost * split * (1 - split)).log()
    else:
        yield half_normal(at["log_width"].exp(), prior.sigma_p_scale) + at["log_width"]
        if "offset_score" in at:
            yield normal(at["offset_score"], 0, 1)
        if "logit_gain" in at:
            yield (at["logit_gain"].expit() * (1 - at["logit_gain"].expit())).log()
    yield from prior_terms_of_other_parts(at)


def prior_terms_of_other_parts(at):
    for key in ("logit_q0", "logit_lapse_rate"):
        if key in at:
            yield (at[key].expit() * (1 - at[key].expit())).log()
    if "noise_slope" in at:
        yield normal(at["noise_slope"], 0, PRIOR.noise_slope_sd)
    if "log_exponent" in at:
        yield normal(at["log_exponent"], mpmath.log(PRIOR.exponent_median), PRIOR.exponent_sd)
    if "logit_icc" in at:  # Beta(1, 9)
        icc = at["logit_icc"].expit()
        yield (9 * icc * (1 - icc) ** 9).log()


def terms(target, x):
    """Every term of the log posterior as a jet."""
    levels, s, sbar = dict(target.model.levels), target.subject, mpmath.mpf(target.sbar)
    at = dict(zip(target.coordinates, Jet.coordinates([mpmath.mpf(float(v)) for v in x]), strict=True))
    pull, offset = pull_of(levels["order"], at), at.get("offset", at.get("offset_score"))
    seconds = np.ones(s.n_pairs) if s.isi is None else s.isi
    for s1, s2, k, n, t in zip(s.s1, s.s2, s.n_equal, s.n_trials, seconds, strict=True):
        first, second = mpmath.mpf(float(s1)), mpmath.mpf(float(s2))
        r, v = scales(levels["order"], at, mpmath.mpf(float(t)))
        shift = (second - first) - (0 if offset is None else r * offset)
        log_width = at["log_width"] + (at["noise_slope"] * ((first + second) / 2 - sbar) if "noise_slope" in at else 0)
        z = (shift + (0 if pull is None else r * pull * (first - sbar))) * (-log_width).exp() / v
        yield from log_likelihood(levels, z, at, int(k), int(n))
    yield from prior_terms(levels["order"], at, sbar)


def assert_agrees(target, x, tolerance, digits=DIGITS):
    gradient, hessian = target.derivatives([x])
    found = [target.log_density([x]), gradient[0], hessian[0].ravel()]
    with mpmath.workdps(digits):
        parts = list(terms(target, x))
        for value, get in zip(found, (lambda j: [j.value], lambda j: list(j.slope), lambda j: list(j.bend)), strict=True):
            columns = list(zip(*map(get, parts), strict=True))
            truth = np.array([float(mpmath.fsum(column)) for column in columns])
            size = np.array([float(mpmath.fsum(map(abs, column))) for column in columns])
            assert (np.abs(value - truth) <= tolerance * np.maximum(size, 1e-80)).all(), (target.model.name, value, truth, size)


def subject(isi, scale=1.0):
    s1, s2 = [0.0, 0.0, 0.5, 0.25, 0.125], [0.0, 0.5, 0.0, 0.375, 0.75]
    counts = np.array([45, 20, 15, 30, 2]), np.array([50, 50, 50, 40, 50])
    return Subject("S", s1, s2, *((scale * part).astype(int) for part in counts), isi)


def scale(name, most=1.0):
    """Beta-binomial answers go one by one: there of a fifth as many, for time's sake."""
    return 0.2 if "beta-binomial" in name else most


@pytest.mark.parametrize("isi", [None, [0.25, 1.0, 2.0, 0.5, 8.0]], ids=["one interval", "intervals"])
@pytest.mark.parametrize("name", RUNGS + COMPOSED)
@settings(max_examples=15, deadline=None, phases=[Phase.explicit, Phase.generate])
@given(data=st.data())
def test_derivatives_of_every_rung(name, isi, data):
    target = posterior_of(subject(isi, scale=scale(name)), PRIOR, model=name)
    ranges = {"offset": (-0.6, 0.6), "offset_score": (-0.6, 0.6), "log_width": (-2.0, 1.5), "log_exponent": (-1.6, 3.0)}
    ranges |= {"logit_pull": (-6, 6), "logit_split": (-6, 6), "logit_q0": (-6, 12), "logit_lapse_rate": (-12, 6), "logit_icc": (-20, 6)}
    # Subnormal ones left out: a displacement that underflows lies beyond the kink that an exponent of 1 has at z = 0.
    x = [data.draw(st.floats(*ranges.get(key, (-4.0, 4.0)), allow_subnormal=False), label=key) for key in target.coordinates]
    z = target.distance(np.array([x]))[0]
    # Rounding a displacement costs what its cancellation costs: only pairs off the axis are held to 1e-12.
    assume(((z == 0.0) | (np.abs(z) > 1e-2)).all())
    assert_agrees(target, x, TOLERANCE.get(name, 1e-12))


FAR = {"logit_pull": [-80.0, -20.0, 25.0], "logit_split": [-30.0, 30.0], "logit_q0": [-25.0, 60.0, 100.0], "logit_gain": [-30.0, 30.0]}
FAR |= {"noise_slope": [-40.0, 40.0], "logit_lapse_rate": [-60.0, 30.0], "log_exponent": [-1.6, 3.0], "logit_icc": [-60.0, 30.0]}


@pytest.mark.parametrize("isi", [None, [0.25, 1.0, 2.0, 0.5, 8.0]], ids=["one interval", "intervals"])
@pytest.mark.parametrize("name", RUNGS + COMPOSED)
def test_derivatives_far_out(name, isi):
    target = posterior_of(subject(isi, scale=scale(name, 1000.0)), Prior(0.4, 1e30, 0.7, offset_sd=1.0, reference_interval=1.0), model=name)
    middle = {"offset": 0.31, "offset_score": 0.31, "log_width": -0.4, "logit_q0": 2.0, "logit_pull": 0.3, "logit_split": -0.2}
    middle |= {"logit_gain": 0.4, "noise_slope": -0.3, "logit_lapse_rate": -1.7, "log_exponent": 0.4, "logit_icc": -3.0}
    for key, values in {**FAR, "log_width": [-5.0, 3.0]}.items():
        for value in values if key in target.coordinates else ():
            x = [value if other == key else middle[other] for other in target.coordinates]
            if key == "logit_pull" and value < -30:
                x[0] = 1e-20  # mu1 within reach
            assert_agrees_with(target, x, name)


def assert_agrees_with(target, x, name):
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(globals(), "PRIOR", target.prior)
        assert_agrees(target, x, TOLERANCE.get(name, 1e-12), digits=300)
