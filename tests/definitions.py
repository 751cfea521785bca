"""The log posterior of any model, term by term with as many digits as asked for, from the definitions and with no stable form.

Parameters from coordinates, probabilities by subtraction, scales of an interval from the filter's own quantities, slopes by differences
whose steps are so small that half of the digits are left. An independent route to values and gradients over the whole range of floats.
"""

import mpmath
import numpy as np
from mpmath import exp, log, mpf, sqrt

from bayes_toe.model.closed_form import MAX_PULL


def expit(a):
    return 1 / (1 + exp(-a))


def normal(value, mean, sd):
    return -(((value - mpf(mean)) / mpf(sd)) ** 2) / 2 - log(mpf(sd) * sqrt(2 * mpmath.pi))


def half_normal(value, scale):
    return -((value / mpf(scale)) ** 2) / 2 + log(sqrt(2 / mpmath.pi) / mpf(scale))


def variance_ratio(gamma):
    return (1 + sqrt(1 + 4 * gamma)) / 2


def scales(order, at, t):
    """Pull and width at t over those at the reference."""
    if order == "update":
        p = mpf(MAX_PULL) * expit(at["logit_pull"])
        gamma = p / (1 - p) ** 2
        ratio = variance_ratio(gamma / t) / variance_ratio(gamma)
        return 1 / (ratio**2 * t), sqrt(t) * ratio ** mpf(1.5)
    if order == "mean-reverting":
        kept, split = 1 - expit(at["logit_pull"]), expit(at["logit_split"])
        rho, gain = kept**split, kept ** (1 - split)

        def width(seconds):
            weight = rho**seconds * gain
            return (1 - weight * weight) / sqrt(1 - weight * rho**seconds)

        return (1 - rho**t * gain) / (1 - kept), width(t) / width(mpf(1))
    return mpf(1), mpf(1)


def pull_of(at):
    if "logit_pull" in at:
        return (1 if "logit_split" in at else mpf(MAX_PULL)) * expit(at["logit_pull"])
    return 1 - 2 * expit(at["logit_gain"]) if "logit_gain" in at else mpf(0)


def answers(curve, z, peak, criterion, at):
    """P(equal) and P(different)."""
    if curve == "differencing":
        equal = mpmath.ncdf(criterion - abs(z)) - mpmath.ncdf(-criterion - abs(z))
    else:
        exponent = exp(at["log_exponent"]) if curve == "exponent" else 2
        equal = peak * exp(-log(2) * abs(z) ** exponent)
    if "logit_lapse_rate" in at:
        rate = expit(at["logit_lapse_rate"])
        equal = rate * peak + (1 - rate) * equal
    return equal, 1 - equal


def log_likelihood(spread, equal, different, k, n, at):
    if spread == "binomial":
        return (k * log(equal) if k else 0) + ((n - k) * log(different) if n > k else 0)
    eps = exp(at["logit_icc"])
    drawn = [log(equal + j * eps) for j in range(k)] + [log(different + j * eps) for j in range(n - k)]
    return mpmath.fsum(drawn) - mpmath.fsum(log(1 + j * eps) for j in range(n))


def prior_terms(order, at, prior, sbar):
    if order == "update":
        p = mpf(MAX_PULL) * expit(at["logit_pull"])
        gain, width = 1 - p, exp(at["log_width"])
        yield normal(at["offset"] / p + sbar, prior.mu1_mean, prior.mu1_sd)
        yield half_normal(width * gain ** mpf(1.5), prior.sigma_p_scale)
        yield log((1 + p) / gain ** mpf(1.5) * (1 - p / mpf(MAX_PULL)) * width)
    elif order == "mean-reverting":
        p, split = expit(at["logit_pull"]), expit(at["logit_split"])
        lost = -log(1 - p)
        rho, gain = exp(-split * lost), exp((split - 1) * lost)
        weight = rho * gain
        sigma1 = exp(at["log_width"]) * gain * sqrt(1 - weight * rho) / (1 - weight * weight)
        yield normal(at["offset"] / p + sbar, prior.mu1_mean, prior.mu1_sd)
        yield half_normal(sigma1, prior.sigma_p_scale)
        yield log(sigma1 * weight * lost * split * (1 - split))  # d(mu1, sigma1, rho, K)/dx: 1/p, sigma1, and rho K l p split (1 - split)
    else:
        yield half_normal(exp(at["log_width"]), prior.sigma_p_scale) + at["log_width"]
        if "offset_score" in at:
            yield normal(at["offset_score"], 0, 1)
    yield from (log(expit(at[key]) * (1 - expit(at[key]))) for key in ("logit_q0", "logit_lapse_rate", "logit_gain") if key in at)
    if "noise_slope" in at:
        yield normal(at["noise_slope"], 0, prior.noise_slope_sd)
    if "log_exponent" in at:
        yield normal(at["log_exponent"], log(mpf(prior.exponent_median)), prior.exponent_sd)
    if "logit_icc" in at:  # Beta(1, 9)
        yield log(9 * expit(at["logit_icc"]) * (1 - expit(at["logit_icc"])) ** 9)


def terms(target, x):
    """Every term of the log posterior, of which the constant error is a normal's: one for each pair, and those of the prior."""
    levels, s, sbar = dict(target.model.levels), target.subject, mpf(target.sbar)
    at = dict(zip(target.coordinates, x, strict=True))
    offset = at.get("offset", at["offset_score"] * target.prior.offset_sd if "offset_score" in at else mpf(0))
    peak = expit(at["logit_q0"]) if "logit_q0" in at else mpf(1)
    criterion = sqrt(2) * mpmath.erfinv(peak) if levels["curve"] == "differencing" else None
    seconds = np.full(s.n_pairs, target.reference) if s.isi is None else s.isi
    found = []
    for s1, s2, k, n, t in zip(s.s1, s.s2, s.n_equal, s.n_trials, seconds, strict=True):
        first, second = mpf(float(s1)), mpf(float(s2))
        r, v = scales(levels["order"], at, mpf(float(t)) / mpf(target.reference))
        log_width = at["log_width"] + at.get("noise_slope", 0) * ((first + second) / 2 - sbar)
        z = ((second - first) + r * (pull_of(at) * (first - sbar) - offset)) * exp(-log_width) / v
        found.append(log_likelihood(levels["spread"], *answers(levels["curve"], z, peak, criterion, at), int(k), int(n), at))
    return [*found, *prior_terms(levels["order"], at, target.prior, sbar)]


def value_and_gradient(target, x, digits):
    """Truth and sum of absolute contributions, to which rounding is in proportion: of the value, (1,), and of the gradient, (k,)."""
    with mpmath.workdps(digits):
        point, step = [mpf(float(v)) for v in x], mpf(10) ** (25 - digits // 2)

        def moved(i, sign):
            return terms(target, [v + sign * step * (i == j) for j, v in enumerate(point)])

        slopes = [[(a - b) / (2 * step) for a, b in zip(moved(i, 1), moved(i, -1), strict=True)] for i in range(len(point))]
        return [
            tuple(np.array([as_float(mpmath.fsum(part, absolute=absolute)) for part in parts]) for absolute in (False, True))
            for parts in ([terms(target, point)], slopes)
        ]


def as_float(value):
    """A float, infinite where the value is beyond the largest one."""
    return float(value) if abs(value) < mpf("1.79e308") else float(np.sign(float(mpmath.sign(value))) * np.inf)


def assert_agrees(target, x, tolerance=1e-12, digits=120, slope_tolerance=1e-11):
    """Value and gradient within so much of the contributions."""
    value, gradient = target.gradient([x])
    expected = value_and_gradient(target, x, digits)
    for found, (truth, size), allowed in zip((value, gradient[0]), expected, (tolerance, slope_tolerance), strict=True):
        some = size < 1e300  # a term beyond the largest float is nothing to compare
        assert (np.abs(found - truth)[some] <= allowed * np.maximum(size, 1e-80)[some]).all(), (target.model.name, x, found, truth, size)
