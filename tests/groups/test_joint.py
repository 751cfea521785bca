"""The joint density of a group against its definition in many digits, and the map to its coordinates against differences."""

import itertools

import mpmath
import numpy as np
import pytest

from bayes_toe.groups.hyperprior import HyperpriorNumbers
from bayes_toe.groups.joint import Joint, scatter_named
from bayes_toe.groups.subjects import Funnel, NormalApproximation
from bayes_toe.model.ladder import PREDICTIVE_UPDATE

N, K, CENTRE = 3, 4, 0.3
HYPERPRIOR = HyperpriorNumbers(
    *np.array(
        [[0.2, 0.0, -1.0, 1.0], [2.0, 1.0, 1.1, 0.9], [2.0, 1.0, 0.7, 0.8], [0.4, 0.5, 0.6, 0.7]]
    ),
    1.7,
)
PULL = PREDICTIVE_UPDATE.free[0].group_pull
#: Funnel or not, kind of scatter, regressors, what is told.
CASES = {
    "nothing told": (False, "normal", 0, "nothing"),
    "two regressors": (False, "normal", 2, "some"),
    "funnel, t, two regressors": (True, "t", 2, "some"),
    "funnel, nothing told": (True, "normal", 1, "nothing"),
    "funnel, very much told": (True, "t", 1, "much"),
}
CORRELATED = {
    "correlated, funnel, regressor": (True, "normal", 1, "some"),
    "correlated, t": (True, "t", 0, "nothing"),
}


def bumps(eta):
    """A likelihood that needs no digits: of each member, and its gradient."""
    weight = np.array([0.3, 1.1, 0.7, 2.0])
    return -(weight * (eta**2 / 4.0 + np.cos(eta))).sum(axis=-1), -weight * (
        eta / 2.0 - np.sin(eta)
    )


def bump(eta):
    return -sum(
        w * (e**2 / 4 + mpmath.cos(e))
        for w, e in zip(map(mpmath.mpf, (0.3, 1.1, 0.7, 2.0)), eta, strict=True)
    )


def made(funnel, scatter, regressors, told, likelihood=bumps, correlated=False):
    rng = np.random.default_rng(11)
    log_precision = {
        "nothing": np.full((N, K), -np.inf),
        "some": rng.normal(1.0, 2.0, (N, K)),
        "much": rng.uniform(8.0, 20.0, (N, K)),
    }[told]
    if told == "some":
        log_precision[1, 2] = -np.inf
    place = rng.normal(0.0, 1.0, (N, K))
    x = rng.standard_normal((N, regressors))
    known = NormalApproximation(
        log_precision, place, Funnel(0, 1, CENTRE, PULL) if funnel else None
    )
    return Joint(likelihood, HYPERPRIOR, x, known, scatter_named(scatter), correlated)


def points(joint, far):
    rng = np.random.default_rng(13)
    theta = rng.standard_normal((2, joint.dimension))
    if far:  # scatters of e^-20 to e^3, and a pull that is next to nothing
        theta[:, K : 2 * K] = rng.uniform(-20.0, 3.0, (2, K))
        theta[0, 1] = -9.0
    return theta


def coefficients_by_definition(joint, theta, tau):
    """Means and effects, (1 + r) rows of k, and the sum of the logs of their units."""
    told, given, r = joint.without_funnel, joint.hyperprior, joint.x.shape[1]
    scores, rows, log_unit = (
        [theta[:K], *(theta[(2 + a) * K : (3 + a) * K] for a in range(r))],
        [],
        mpmath.mpf(0),
    )
    for a, score in enumerate(scores):
        row = []
        for j in range(K):
            s = mpmath.mpf(float((given.effect_sd if a else given.mean_sd)[j]))
            h = [mpmath.exp(mpmath.mpf(float(v))) for v in told.log_precision[:, j]]
            weights = [
                v / (1 + v * tau[j] ** 2) * (mpmath.mpf(float(joint.x[i, a - 1])) ** 2 if a else 1)
                for i, v in enumerate(h)
            ]
            precision = 1 / s**2 + sum(weights)
            places = sum(
                w * mpmath.mpf(float(e)) for w, e in zip(weights, told.location[:, j], strict=True)
            )
            centre = 0 if a else (mpmath.mpf(float(given.mean[j])) / s**2 + places) / precision
            row.append(centre + score[j] / mpmath.sqrt(precision))
            log_unit -= mpmath.log(precision) / 2
        rows.append(row)
    return rows, log_unit


def eta_by_definition(joint, theta):
    """Members and their means, scatters and units, from what the module says of them."""
    told, r = joint.approximation, joint.x.shape[1]
    tau, xi, found = [mpmath.exp(v) for v in theta[K : 2 * K]], theta[joint.size :], []
    (mean, *effects), log_unit = coefficients_by_definition(joint, theta, tau)
    for i in range(N):
        eta, expected = (
            [None] * K,
            [
                mean[j] + sum(mpmath.mpf(float(joint.x[i, a])) * effects[a][j] for a in range(r))
                for j in range(K)
            ],
        )
        unit = [None] * K
        for j in (1, 2, 3, 0):
            h = mpmath.exp(mpmath.mpf(float(told.log_precision[i, j])))
            e = mpmath.mpf(float(told.location[i, j]))
            if told.funnel is not None and j == 0:
                ratio = (1 + mpmath.sqrt(1 + 4 * mpmath.ncdf(eta[1]))) / 2
                p = (ratio - 1) / ratio
                h, e = h * p**2, mpmath.mpf(CENTRE) + e / p
            s = 1 / (1 + h * tau[j] ** 2)
            unit[j] = tau[j] * mpmath.sqrt(s)
            eta[j] = (1 - s) * e + s * expected[j] + unit[j] * xi[i * K + j]
        found.append((eta, expected, unit))
    return found, mean, tau, effects, log_unit


def log_normal(value, mean, sd):
    mean, sd = mpmath.mpf(float(mean)), mpmath.mpf(float(sd))
    return -(((value - mean) / sd) ** 2) / 2 - mpmath.log(sd * mpmath.sqrt(2 * mpmath.pi))


def correlations_by_definition(z):
    """From partial correlations, each given all parameters before both: by the recursion that takes one of these away after the other."""
    partial = dict(zip(itertools.combinations(range(K), 2), map(mpmath.tanh, z), strict=True))
    whole = mpmath.eye(K)
    for (j, i), found in partial.items():
        for step in reversed(range(j)):
            a, b = partial[step, j], partial[step, i]
            found = a * b + found * mpmath.sqrt((1 - a**2) * (1 - b**2))
        whole[i, j] = whole[j, i] = found
    return whole


def lkj_by_definition(z, shape):
    """Log of det(R)^(shape - 1) over its integral (Lewandowski et al. 2009, eq. 16), and of what the coordinates do to volumes."""
    h, pairs = mpmath.mpf(10) ** -40, list(itertools.combinations(range(K), 2))
    jacobian = mpmath.zeros(len(pairs))
    for column in range(len(pairs)):
        up, down = (
            correlations_by_definition([v + sign * h * (i == column) for i, v in enumerate(z)])
            for sign in (1, -1)
        )
        for row, (j, i) in enumerate(pairs):
            jacobian[row, column] = (up[i, j] - down[i, j]) / (2 * h)
    integral = mpmath.mpf(0)
    for k in range(1, K):
        integral += (2 * (shape - 1) + K - k) * (K - k) * mpmath.log(2)
        b = shape + mpmath.mpf(K - k - 1) / 2
        integral += (K - k) * mpmath.log(mpmath.beta(b, b))
    determinant = mpmath.det(correlations_by_definition(z))
    return (shape - 1) * mpmath.log(determinant) - integral + mpmath.log(abs(mpmath.det(jacobian)))


def by_definition(joint, theta):
    subjects, mean, tau, effects, total = eta_by_definition(joint, theta)
    given, root = joint.hyperprior, mpmath.eye(K)
    if joint.correlated:
        z = theta[joint.size - K * (K - 1) // 2 : joint.size]
        root = mpmath.cholesky(correlations_by_definition(z))
        total += lkj_by_definition(z, mpmath.mpf(given.lkj)) - N * sum(
            mpmath.log(root[j, j]) for j in range(K)
        )
    for eta, expected, unit in subjects:
        total += bump(eta)
        scores = mpmath.inverse(root) * mpmath.matrix(
            [(eta[j] - expected[j]) / tau[j] for j in range(K)]
        )
        for j, u in enumerate(scores):
            of_score = (
                mpmath.log(mpmath.mpf(3) / 8 * (1 + u**2 / 4) ** mpmath.mpf(-2.5))
                if joint.scatter.name == "t"
                else log_normal(u, 0, 1)
            )
            total += of_score - mpmath.log(tau[j]) + mpmath.log(unit[j])
    for j in range(K):
        total += log_normal(mean[j], given.mean[j], given.mean_sd[j])
        total += mpmath.log(2) + log_normal(tau[j], 0, given.sd_scale[j]) + mpmath.log(tau[j])
        total += sum(
            log_normal(effect, 0, given.effect_sd[j]) for effect in (row[j] for row in effects)
        )
    return total


def require_right(joint, far):
    """Values at both points, to twelve digits, and the gradient at the first, to twelve of its largest term."""
    theta, h = points(joint, far), mpmath.mpf(10) ** -30
    values, gradients = joint(theta)
    with mpmath.workdps(90):
        first, other = ([mpmath.mpf(float(v)) for v in point] for point in theta)
        assert values == pytest.approx(
            [float(by_definition(joint, at)) for at in (first, other)], rel=1e-12
        )
        for i, found in enumerate(gradients[0]):
            up, down = (
                by_definition(joint, [v + sign * h * (j == i) for j, v in enumerate(first)])
                for sign in (1, -1)
            )
            assert found == pytest.approx(
                float((up - down) / (2 * h)), rel=1e-11, abs=1e-11 * np.abs(gradients[0]).max()
            )


@pytest.mark.parametrize(
    ("case", "far"), [("funnel, t, two regressors", False), *((case, True) for case in CASES)]
)
def test_value_and_gradient_are_those_of_the_definition(case, far):
    require_right(made(*CASES[case]), far)


@pytest.mark.parametrize(
    ("case", "far"), [("correlated, t", False), ("correlated, funnel, regressor", True)]
)
def test_correlated_parameters(case, far):
    require_right(made(*CORRELATED[case], correlated=True), far)
