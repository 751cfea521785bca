"""Log posteriors term by term with any number of digits, from the definitions.

Parameters from coordinates, probabilities by subtraction, slopes by differences whose steps are so
small that half of the digits are left. An independent route to values and gradients over the whole
range of floats.
"""

import mpmath
import numpy as np
from mpmath import exp, log, mpf, sqrt
from scipy.special import ndtr, xlogy

from bayes_toe.data.tasks import SAME_DIFFERENT, THREE_ANSWERS
from bayes_toe.inference.maxima import expansion


def expit(a):
    return 1 / (1 + exp(-a))


def normal(value, mean, sd):
    return -(((value - mpf(mean)) / mpf(sd)) ** 2) / 2 - log(mpf(sd) * sqrt(2 * mpmath.pi))


def answers(task, z, share):
    """P of the answer that the task counts, and of the other answer, under the paper's model.

    `share` is q0 of same or different, and the lapse rate of 2AFC.
    """
    if task == SAME_DIFFERENT:
        yes = share * exp(-log(2) * z**2)
        return yes, 1 - yes
    return tuple(share / 2 + (1 - share) * mpmath.ncdf(sign * z) for sign in (1, -1))


def log_power(p, n):
    """Log of p^n, where 0^0 is 1."""
    return n * log(p) if n else 0


def beta(x, a, b):
    """Log density of x = logit(share), where the share has the distribution Beta(a, b)."""
    return a * log(expit(x)) + b * log(1 - expit(x)) - log(mpmath.beta(a, b))


def probit_of_beta(v, a, b):
    """Log density of v = probit(share), where the share has the distribution Beta(a, b)."""
    shares = (a - 1) * log(mpmath.ncdf(v)) + (b - 1) * log(mpmath.ncdf(-v))
    return shares + normal(v, 0, 1) - log(mpmath.beta(a, b))


def terms(target, x):
    """Every term of the log posterior of H1: one for each pair, and the terms of the prior.

    The coordinates x are those of mu1, sigma_p, gamma and q0 (or the lapse rate).
    """
    s, prior = target.subject, target.prior
    score, spread, gamma_probit, share_probit = x
    mu1 = mpf(prior.mu1_mean) + mpf(prior.mu1_sd) * score
    gamma = mpmath.ncdf(gamma_probit)
    power = mpf(1.5) if s.task == SAME_DIFFERENT else mpf(1)  # the width is sigma_p G^power
    ratio = (1 + sqrt(1 + 4 * gamma)) / 2
    p = gamma / ratio**2
    if prior.width_median is None:
        half_normal_score = sqrt(2) * mpmath.erfinv(mpmath.ncdf(spread))
        width = mpf(prior.sigma_p_scale) * half_normal_score * ratio**power
    else:
        width = mpf(prior.width_median) * exp(mpf(prior.width_sd) * spread)
    result = []
    for s1, s2, k, n in zip(s.s1, s.s2, s.n_yes, s.n_trials, strict=True):
        first, second = mpf(float(s1)), mpf(float(s2))
        z = ((second - first) + p * (first - mu1)) / width
        share = mpmath.ncdf(share_probit)
        yes, no = answers(s.task, z, share)
        result.append(log_power(yes, int(k)) + log_power(no, int(n - k)))
    result += [normal(score, 0, 1), normal(spread, 0, 1)]
    result.append(probit_of_beta(gamma_probit, mpf(prior.gamma_a), mpf(prior.gamma_b)))
    a, b = (mpf(getattr(prior, f"{s.task.lapses}_{end}")) for end in "ab")
    result.append(probit_of_beta(share_probit, a, b))
    return result


def computed_gradient(target, x):
    """The log density of a posterior and its gradient, as the package computes them.

    Their shapes are (points,) and (points, coordinates).
    """
    points = target.full_points(x)[0]
    array = target.array.part(np.zeros(len(points), np.intp))
    value, slopes, _ = expansion(array, points)
    return value, slopes[:, target.is_free]


def slopes(function, x, step=1e-5):
    """The derivative of a function by each coordinate of points, from central differences."""
    derivatives = []
    for change in step * np.eye(x.shape[-1]):
        derivatives.append((function(x + change) - function(x - change)) / (2 * step))
    return np.stack(derivatives, axis=-1)


def exact_slopes(function, x, step):
    """The derivative at a point by each coordinate, from central differences of mpmath."""
    derivatives = []
    for i in range(len(x)):
        point_above, point_below = list(map(mpf, x)), list(map(mpf, x))
        point_above[i] += step
        point_below[i] -= step
        derivatives.append((function(point_above) - function(point_below)) / (2 * step))
    return derivatives


def assert_agrees(target, x, digits=120):
    """Value and gradient of H1 are those of the definitions, but for rounding.

    The tolerance is relative to the sum of the sizes of all terms.
    """

    def term_array(point):
        return np.array(terms(target, point))

    value, gradient_at_x = computed_gradient(target, [x])
    with mpmath.workdps(digits):
        assert_sum_of_terms(value[0], terms(target, list(map(mpf, x))), 1e-12)
        expected = exact_slopes(term_array, x, step=mpf(10) ** (25 - digits // 2))
        for slope, slopes_of_terms in zip(gradient_at_x[0], expected, strict=True):
            assert_sum_of_terms(slope, slopes_of_terms, 1e-11)


def assert_sum_of_terms(value, summands, tolerance):
    """A float within so much of the terms' sizes; terms beyond the largest float do not count."""
    size = mpmath.fsum(summands, absolute=True)
    if size < mpf("1e300"):
        rounding = 4e-15  # of a coordinate next to the middle of its prior
        error = abs(mpf(float(value)) - mpmath.fsum(summands))
        assert error <= tolerance * max(size, mpf("1e-80")) + rounding, (value, summands)


def paper_log_likelihood(subject, mu1, sigma_p, gamma, share):
    """Log likelihood of the paper's model; `share` is q0, or the lapse rate of 2AFC."""
    k, n = subject.n_yes, subject.n_trials
    ratio = (1 + np.sqrt(1 + 4 * gamma)) / 2
    z = (subject.s2 - subject.s1 / ratio - (1 - 1 / ratio) * mu1) / sigma_p
    if subject.task == SAME_DIFFERENT:
        yes = share * np.exp2(-((z / ratio**1.5) ** 2))
        no = 1 - yes
    else:
        yes, no = (share / 2 + (1 - share) * ndtr(sign * z / ratio) for sign in (1, -1))
    return (xlogy(k, yes) + xlogy(n - k, no)).sum(axis=-1)


# --- The observer of the four models --------------------------------------------------------------


def observer_scales(s1, s2, n):
    """Sbar, D, R and the sd of the first stimuli, weighted by trials, from exact sums."""
    s1, s2, n = ([mpf(float(value)) for value in column] for column in (s1, s2, n))
    pairs = list(zip(s1, s2, strict=True))

    def mean(values, weights=n):
        return mpmath.fdot(values, weights) / mpmath.fsum(weights)

    sbar = mean(s1)
    middle = (sbar + mean(s2)) / 2
    n_unequal = [w * (a != b) for (a, b), w in zip(pairs, n, strict=True)]
    step = sqrt(mean([(b - a) ** 2 for a, b in pairs], n_unequal))
    spread = sqrt(mean([(a - middle) ** 2 + (b - middle) ** 2 for a, b in pairs]) / 2)
    return sbar, step, spread, sqrt(mean([(a - sbar) ** 2 for a in s1]))


def observer_contraction_sd(scales, prior):
    """Prior standard deviation of the contraction p."""
    _, step, _, first_spread = scales
    sd = mpf(prior.contraction_sd)
    return sd * min(mpf(1), 4 * step / first_spread) if first_spread else sd


def observer_quantities(u, scales, prior):
    """Parameters of the observer, on the scale of the stimuli, from coordinates by name."""
    _, step, spread, _ = scales
    values = {
        "noise": step * mpf(prior.noise_median) * exp(mpf(prior.noise_sd) * u["noise"]),
        "lapse_rate": 1 - ncdf(-u["lapse_rate"]) ** (1 / mpf(prior.lapse_rate_b)),
        "noise_slope": mpf(prior.noise_slope_scale) / spread * u["noise_slope"],
        "constant_error": mpf(prior.constant_error_scale) * step * u.get("constant_error", 0),
        "contraction": observer_contraction_sd(scales, prior) * u.get("contraction", 0),
    }
    if "q0" in u:
        values["q0"] = expit(u["q0"])
        values["criterion_slope"] = mpf(prior.criterion_slope_scale) / spread * u["criterion_slope"]
    return values


def ncdf(x):
    """Phi(x); beyond 1e100 by phi(x)/abs(x), which has 200 digits there and which mpmath lacks."""
    if abs(x) < mpf(10) ** 100:
        return mpmath.ncdf(x)
    tail = exp(-x * x / 2) / (abs(x) * sqrt(2 * mpmath.pi))
    return tail if x < 0 else 1 - tail


def areas(z, k):
    """Areas of the normal about z: between -k and k, and outside."""
    return ncdf(k - z) - ncdf(-k - z), ncdf(z - k) + ncdf(-k - z)


def criterion(peak):
    """The k with 2 Phi(k) - 1 = peak."""
    return sqrt(2) * mpmath.erfinv(peak)


def decision_variable(values, sbar, s1, s2, expectation=0):
    """The difference that an observer perceives, in units of the noise, and the mean intensity.

    The trial before leaves an expectation.
    """
    middle = (s1 + s2) / 2 - sbar
    attraction = values["contraction"] * (s1 - sbar - expectation)
    shifted = s2 - s1 - values["constant_error"] + attraction
    return shifted / (values["noise"] * exp(values["noise_slope"] * middle)), middle


def three_answers(values, bare_k, sbar, s1, s2):
    """P of 'equal', 'second' and 'first': the areas between and beyond the criteria.

    `bare_k` is the criterion at the mean intensity.
    """
    z, middle = decision_variable(values, sbar, s1, s2)
    k, rate = bare_k * exp(values["criterion_slope"] * middle), values["lapse_rate"]
    equal, _ = observer_answers(values, bare_k, sbar, s1, s2)
    unequal = [rate * ncdf(-k) + (1 - rate) * ncdf(sign * z - k) for sign in (1, -1)]
    return equal, *unequal


def observer_answers(values, bare_k, sbar, s1, s2, expectation=0, response=0):
    """P of the counted answer to a pair, and of the other answer.

    `bare_k` is the criterion at the mean intensity. The trial before leaves an expectation, and its
    response times kappa.
    """
    z, middle = decision_variable(values, sbar, s1, s2, expectation)
    rate = values["lapse_rate"]
    if "q0" not in values:
        z += response
        return rate / 2 + (1 - rate) * ncdf(z), rate / 2 + (1 - rate) * ncdf(-z)
    k = bare_k * exp(values["criterion_slope"] * middle + response)
    lapse_areas, attentive_areas = areas(mpf(0), k), areas(z, k)
    pairs = zip(lapse_areas, attentive_areas, strict=True)
    return tuple(rate * lapse + (1 - rate) * attentive for lapse, attentive in pairs)


def student(u):
    """Log density of Student's t with 3 degrees of freedom."""
    norm = mpmath.gamma(2) / (mpmath.gamma(mpf(3) / 2) * sqrt(3 * mpmath.pi))
    return log(norm) - 2 * log(1 + u * u / 3)


def observer_log_prior(u, scales, prior):
    """Log prior density of the coordinates by name, of one of the four models."""
    total = mpf(0)
    for name, x in u.items():
        if name in ("noise", "lapse_rate"):
            total += normal(x, 0, 1)
        elif name == "q0":
            total += beta(x, mpf(prior.q0_a), mpf(prior.q0_b))
        elif name == "contraction":
            limit = 1 / observer_contraction_sd(scales, prior)
            total += normal(x, 0, 1) - log(ncdf(limit) - ncdf(-limit))
        else:
            total += student(x)
    return total


def observer_log_likelihood(u, subject, scales, prior):
    """Log likelihood of a subject without binomial coefficients."""
    values, total = observer_quantities(u, scales, prior), mpf(0)
    bare_k = criterion(values["q0"]) if "q0" in values else None
    if subject.task == THREE_ANSWERS:
        answers, n_of_each = three_answers, (subject.n_yes, subject.n_second, subject.n_first)
    else:
        no = subject.n_trials - subject.n_yes
        answers, n_of_each = observer_answers, (subject.n_yes, no)
    for s1, s2, *counts in zip(subject.s1, subject.s2, *n_of_each, strict=True):
        shares = answers(values, bare_k, scales[0], mpf(float(s1)), mpf(float(s2)))
        total += sum(log_power(p, int(n)) for p, n in zip(shares, counts, strict=True))
    return total


def observer_log_density(posterior, x):
    """Log likelihood, and log prior density, of one of the four models at one point."""
    coordinates = dict(zip(posterior.coordinates, map(mpf, x), strict=True))
    subject, prior = posterior.subject, posterior.prior
    scales = observer_scales(subject.s1, subject.s2, subject.n_trials)
    likelihood = observer_log_likelihood(coordinates, subject, scales, prior)
    return likelihood, observer_log_prior(coordinates, scales, prior)
