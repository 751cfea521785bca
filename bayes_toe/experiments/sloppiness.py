"""Which combinations of the parameters the answers fix, and which they leave open: Fisher information and covariance spectra.

Coordinates (mu_1, ln sigma_p, ln sigma_l, logit q0). mu_1 is a location and taken as it is: it is the logarithm of the amplitude that the
observer expects, so that a unit of mu_1, of ln sigma_p and of ln sigma_l is a factor e of the quantity behind each.

Spectra depend on the coordinates; comparisons with the prior do not, under linear changes of them. Two are given:

effective dimension   MacKay's number of well-determined parameters at one point, the sum of lambda/(lambda + 1) over the eigenvalues lambda
                      of the Fisher information where the prior is white (MacKay 1992, Neural Computation 4, 415-447). 0..4.
well determined       the number of directions in which the posterior draws have less than half the variance of the prior.

Where gamma may vanish, the posterior of ln sigma_l has a longer tail than its prior, and the ratio of variances exceeds 1 in that
direction: nothing was learnt there, and no sum of such ratios is a dimension.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.linalg import eigh
from scipy.special import log_expit, logit, softmax

from bayes_toe.arrays import FloatArray
from bayes_toe.data.study import Subject, refuse_intervals
from bayes_toe.errors import NumericalError
from bayes_toe.model.closed_form import LN2, log_different, log_equal, normalised_distance, pull, require_natural, variance_ratio, width
from bayes_toe.model.coordinates import Natural
from bayes_toe.model.distributions import log_density_of_logit
from bayes_toe.model.prior import Prior

#: The coordinates of every matrix here.
LOG_PARAMETERS = ("mu1", "log_sigma_p", "log_sigma_l", "logit_q0")
_STEP = 1.0 / 32.0  # of logarithms and logits: two thirds of the sd of the narrowest logit that a prior file allows


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Eigenvalues, largest first, with eigenvectors as columns, over :data:`LOG_PARAMETERS`.

    Attributes
    ----------
    values : array, shape (4,)
        Information per squared unit of the coordinates, or variance.
    vectors : array, shape (4, 4)
        Column j belongs to values[j].
    """

    values: FloatArray
    vectors: FloatArray

    @property
    def participation_ratio(self) -> float:
        """(sum of eigenvalues)^2 / sum of squares, 1..4: how many directions carry it. Depends on the units of the coordinates."""
        shares = self.values / self.values.max()
        return float(shares.sum() ** 2 / np.square(shares).sum())


@dataclass(frozen=True, eq=False)
class Contraction:
    """Posterior covariance against the prior's.

    Attributes
    ----------
    ratios : array, shape (4,)
        Generalised eigenvalues r: posterior variance over prior variance along the directions, smallest (best determined) first. Above 1
        where the posterior is wider than its prior.
    directions : array, shape (4, 4)
        Column j is the combination of :data:`LOG_PARAMETERS` that ratio j belongs to, with unit prior variance.
    """

    ratios: FloatArray
    directions: FloatArray

    @property
    def well_determined(self) -> int:
        """Number of directions in which the posterior variance is below half the prior variance."""
        return int(np.count_nonzero(self.ratios < 0.5))


@dataclass(frozen=True, eq=False)
class Sloppiness:
    """Which directions one subject's answers fix.

    Attributes
    ----------
    information : Spectrum
        Fisher information of the design at the point.
    covariance : Spectrum
        Covariance of the posterior draws.
    contraction : Contraction
        The draws' covariance against the prior's.
    effective_dimension : float
        See :func:`effective_dimension`; 0..4.
    """

    information: Spectrum
    covariance: Spectrum
    contraction: Contraction
    effective_dimension: float


def sloppiness(subject: Subject, draws: Natural, *, at: Natural | None = None, prior: Prior | None = None) -> Sloppiness:
    """Spectra and dimensions of one subject.

    Parameters
    ----------
    subject : Subject
        Its design: pairs and trials.
    draws : Natural
        Posterior draws, arrays of one shape.
    at : Natural, optional
        The point of the Fisher information, scalars; by default the medians of the draws.
    prior : Prior, optional
        What the draws' posterior started from.

    Raises
    ------
    NumericalError
        If a parameter is outside its range or at its edge, where its logarithm is infinite.
    """
    point = Natural(*(np.asarray(np.median(column)) for column in draws)) if at is None else at
    before, after = prior_covariance(Prior() if prior is None else prior), log_covariance(draws)
    return Sloppiness(
        fisher_spectrum(subject, point), _spectrum(after), contraction(after, before), effective_dimension(subject, point, before)
    )


def effective_dimension(subject: Subject, theta: Natural, prior_covariance: npt.ArrayLike) -> float:
    """Number of parameters that the design determines at theta, the sum of lambda/(lambda + 1), 0..4. Source: MacKay 1992.

    lambda are the eigenvalues of the Fisher information in coordinates where the prior has unit covariance.
    """
    whitened = root_information(subject, theta) @ np.linalg.cholesky(np.asarray(prior_covariance, np.float64))
    values = np.square(np.linalg.svd(whitened, compute_uv=False))
    return float((values / (1.0 + values)).sum())


def fisher_information(subject: Subject, theta: Natural) -> FloatArray:
    """Expected information, F_ij = sum over pairs of n q_i q_j / (q (1 - q)), of :data:`LOG_PARAMETERS`, shape (4, 4).

    q_i is the derivative of P(equal) by parameter i. In a form that stays finite for q near 0 and near 1.

    Examples
    --------
    >>> theta = Natural(*map(np.asarray, (0.2, 0.3, 0.15, 0.9)))
    >>> fisher_information(Subject("S01", [0.0], [0.3], [20], [50]), theta).shape
    (4, 4)
    """
    root = root_information(subject, theta)
    return np.asarray(root.T @ root)


def fisher_spectrum(subject: Subject, theta: Natural) -> Spectrum:
    """Eigenvalues and eigenvectors of the Fisher information, from the singular values of its root: small ones keep their digits."""
    root = root_information(subject, theta)
    padded = np.vstack([root, np.zeros((max(0, 4 - len(root)), 4))])
    _, values, rows = np.linalg.svd(padded, full_matrices=False)
    return Spectrum(np.square(values), rows.T)


def root_information(subject: Subject, theta: Natural) -> FloatArray:
    """Rows sqrt(n q/(1 - q)) d(log q) of every pair, shape (pairs, 4): the Fisher information is root' root.

    With z the normalised distance, d(log q) = -2 ln2 z dz for the first three parameters and 1 - q0 for logit q0.
    """
    _require_interior(theta)
    refuse_intervals([subject], "Fisher information")
    z = normalised_distance(subject.s1, subject.s2, theta.mu1, theta.sigma_p, theta.sigma_l)
    top = logit(float(theta.q0))
    log_odds = log_equal(z, log_expit(top)) - log_different(z, top)
    scores = np.column_stack([-2.0 * LN2 * z[:, None] * _distance_slopes(subject, theta, z), np.full(len(z), np.exp(log_expit(-top)))])
    root = np.sqrt(subject.n_trials)[:, None] * np.exp(0.5 * log_odds)[:, None] * scores
    if not np.isfinite(root).all():
        raise NumericalError("the Fisher information is not finite here")
    return np.asarray(root)


def _distance_slopes(subject: Subject, theta: Natural, z: FloatArray) -> FloatArray:
    """Derivatives of z by mu_1, ln sigma_p and ln sigma_l, shape (pairs, 3).

    d(ln p)/d(ln gamma) = 1/(2G - 1) and d(ln w)/d(ln gamma) = 1.5 (G - 1)/(2G - 1), with G - 1 = gamma/G.
    """
    gamma = theta.gamma
    ratio, p, w = variance_ratio(gamma), pull(gamma), width(theta.sigma_p, gamma)
    rise = 2.0 * ratio - 1.0
    of_gamma = -p / rise * (theta.mu1 - subject.s1) / w - z * (1.5 * gamma / (ratio * rise))
    return np.column_stack([np.full(len(z), -p / w), -z - 2.0 * of_gamma, 2.0 * of_gamma])


def log_covariance(draws: Natural) -> FloatArray:
    """Covariance of posterior draws in :data:`LOG_PARAMETERS`, shape (4, 4)."""
    _require_interior(draws)
    columns = (draws.mu1, np.log(draws.sigma_p), np.log(draws.sigma_l), logit(draws.q0))
    return np.asarray(np.cov([np.ravel(column) for column in columns]))


def prior_covariance(prior: Prior) -> FloatArray:
    """Covariance of the prior in :data:`LOG_PARAMETERS`, shape (4, 4), whatever its families are.

    With ln sigma_l = ln sigma_p + ln(gamma)/2. Variances of logarithms and logits are sums over their densities on a fine grid, which
    converge exponentially.

    Examples
    --------
    >>> found = prior_covariance(Prior())
    >>> bool(np.allclose([found[1, 1], found[2, 2] - found[1, 1], found[3, 3]], [np.pi**2 / 8, 0.25, np.pi**2 / 3], rtol=1e-12))
    True
    """
    sigma_p, gamma, q0 = (prior.distribution(name) for name in ("sigma_p", "gamma", "q0"))
    logs, logits = np.arange(-300.0, 300.0, _STEP), np.arange(-1000.0, 1000.0, _STEP)
    of_sigma = _variance(logs, sigma_p.log_density(sigma_p.quantile(0.5) * np.exp(logs)) + logs)
    of_gamma = _variance(log_expit(logits), log_density_of_logit(gamma, logits))
    of_q0 = _variance(logits, log_density_of_logit(q0, logits))
    result = np.diag([prior.distribution("mu1").spread ** 2, of_sigma, of_sigma + 0.25 * of_gamma, of_q0])
    result[1, 2] = result[2, 1] = of_sigma
    return result


def _variance(values: FloatArray, log_weights: FloatArray) -> float:
    weights = softmax(log_weights)
    return float(weights @ np.square(values - weights @ values))


def contraction(posterior_covariance: npt.ArrayLike, prior_covariance: npt.ArrayLike) -> Contraction:
    """Directions and ratios of two covariances of shape (4, 4), from posterior v = r prior v.

    Examples
    --------
    >>> found = contraction(np.diag([0.1, 0.2, 0.3, 1.0]), np.eye(4))
    >>> found.ratios.round(12).tolist(), found.well_determined
    ([0.1, 0.2, 0.3, 1.0], 3)
    """
    ratios, directions = eigh(np.asarray(posterior_covariance, np.float64), np.asarray(prior_covariance, np.float64))
    return Contraction(np.asarray(ratios), np.asarray(directions))


def _spectrum(matrix: FloatArray) -> Spectrum:
    values, vectors = np.linalg.eigh(matrix)
    return Spectrum(values[::-1], vectors[:, ::-1])


def _require_interior(theta: Natural) -> None:
    require_natural(*theta)
    if np.any(np.asarray(theta.sigma_l) <= 0) or np.any(np.asarray(theta.q0) <= 0) or np.any(np.asarray(theta.q0) >= 1):
        raise NumericalError("log parameters need sigma_l > 0 and 0 < q0 < 1")
