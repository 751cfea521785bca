"""Evidences of a few subjects, and the comparison of their models by one term for each assignment of models to subjects."""

import itertools

import numpy as np
from scipy.special import gammaln, logsumexp

from bayes_toe.comparison.exceedance import exceedance_probabilities

UNEVEN = np.random.default_rng(3).normal(size=(5, 3)) * 2.5 + [0.0, 1.0, -0.5]


def log_beta(alpha):
    return gammaln(alpha).sum() - gammaln(np.sum(alpha))


def enumerated(log_l, prior):
    """Log evidence, expected frequencies and exceedance by one term per assignment."""
    n, k = log_l.shape
    terms, alphas = [], []
    for assignment in itertools.product(range(k), repeat=n):
        alphas.append(prior + np.bincount(assignment, minlength=k))
        terms.append(log_l[np.arange(n), assignment].sum() + log_beta(alphas[-1]) - log_beta(np.full(k, prior)))
    total = logsumexp(terms)
    weights = np.exp(terms - total)
    means = [alpha / alpha.sum() for alpha in alphas]
    return total, weights @ means, weights @ [exceedance_probabilities(alpha)[0] for alpha in alphas]
