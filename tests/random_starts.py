"""The penalised likelihood maximised by general optimisers from random starts.

An independent route for the fits.
"""

import warnings

import numpy as np
from scipy.optimize import minimize
from scipy.special import ndtr

from bayes_toe.data.tasks import WHICH_STRONGER
from bayes_toe.model.prior import Prior


def minus_objective(subject, prior):
    """In natural parameters (mu1, sigma_p, gamma, q0 or lapse rate), without the package."""
    k, d = subject.n_yes.astype(float), (subject.n_trials - subject.n_yes).astype(float)

    def value(theta):
        mu1, sigma_p, gamma, last = theta
        big = (1 + np.sqrt(1 + 4 * gamma)) / 2
        deviation = (subject.s2 - subject.s1 / big - (1 - 1 / big) * mu1) / sigma_p
        with np.errstate(all="ignore"):
            if subject.task == WHICH_STRONGER:
                logs = (
                    np.log(last / 2 + (1 - last) * ndtr(sign * deviation / big)) for sign in (1, -1)
                )
            else:
                log_q = np.log(last) - np.log(2) * (deviation / big**1.5) ** 2
                logs = (log_q, np.log(-np.expm1(log_q)))
            total = sum(
                np.where(n > 0, n * log, 0).sum() for n, log in zip((k, d), logs, strict=True)
            )
        result = total - (mu1 - prior.mu1_mean) ** 2 / (2 * prior.mu1_sd**2)
        return -result if np.isfinite(result) else 1e300

    return value


def best_of_random_starts(subject, starts, seed=0, prior=None):
    """L-BFGS-B, SLSQP and Nelder-Mead by turns, inside the bounds of the model."""
    rng = np.random.default_rng(seed)
    target = minus_objective(subject, Prior() if prior is None else prior)
    scale = max(float(np.ptp(np.concatenate([subject.s1, subject.s2]))), 0.1)
    tight = {
        "L-BFGS-B": {"maxiter": 2000, "ftol": 1e-15, "gtol": 1e-9},
        "SLSQP": {"maxiter": 1000, "ftol": 1e-13},
        "Nelder-Mead": {"maxiter": 4000, "maxfev": 4000, "xatol": 1e-10, "fatol": 1e-11},
    }
    bounds = [(-100, 100), (1e-6, 1e6), (0, 1), (0, 1)]
    best = np.inf
    for i in range(starts):
        mu1, sigma_p = subject.s1.mean() + 3 * scale * rng.normal(), scale * np.exp(rng.normal())
        start = [mu1, sigma_p, rng.uniform(), rng.uniform(0.3, 1)]
        method = list(tight)[i % 3]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # scipy's own remarks on clipping and precision
            result = minimize(target, start, method=method, bounds=bounds, options=tight[method])
        best = min(best, result.fun)
    return -best
