"""How much the answers narrowed each parameter: the prior's 5 to 95 % range against the posterior's.

contraction = 1 - (posterior width / prior width)^2, widths from the 5 % to the 95 % quantile. For normal densities that is one minus the
ratio of variances; where mu1 has a funnel its variance is ruled by rare far draws, its quantiles are not. 1: all from the data; 0: as wide
as the prior; negative: wider.

Priors of what follows from sigma_p and gamma have no named form: sigma_l, sigma1 and width are sigma_p h(gamma), so their distribution
function is the average over gamma of sigma_p's at x / h(gamma), one smooth integral over the quantiles of gamma; the gain falls with gamma
and takes its quantiles.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.model.closed_form import variance_ratio
from bayes_toe.model.distributions import Distribution
from bayes_toe.model.prior import Prior
from bayes_toe.model.target import Answering

#: The range that is compared.
RANGE = (0.05, 0.95)
#: Contraction below which a parameter is said to be dominated by its prior: a range narrowed by less than three tenths.
DOMINATED = 0.5
_NODES = 200


def prior_quantile(prior: Prior, parameter: str, probability: float) -> float:
    """Prior quantile of mu1, sigma_p, sigma_l, q0, gamma, sigma1, gain or width.

    Examples
    --------
    >>> [round(prior_quantile(Prior(), name, 0.95), 4) for name in ("mu1", "sigma_p", "gamma", "gain")]
    [16.4485, 1.96, 0.95, 0.9545]
    """
    if parameter in prior.distributions:
        return float(prior.distribution(parameter).quantile(probability))
    of_sigma_p, of_gamma = prior.distribution("sigma_p"), prior.distribution("gamma")
    if parameter == "gain":
        return float(1.0 / variance_ratio(of_gamma.quantile(1.0 - probability)))
    return _product_quantile(of_sigma_p, of_gamma, parameter, probability)


def contraction(target: Answering, parameter: str, low: float, high: float) -> float:
    """Contraction of a parameter whose posterior quantiles at 5 and 95 % are `low` and `high`.

    Examples
    --------
    >>> from bayes_toe.data.study import Subject
    >>> from bayes_toe.model.ladder import posterior_of
    >>> round(contraction(posterior_of(Subject("S01", [0.0], [0.3], [20], [50])), "q0", 0.5, 0.59), 2)
    0.99
    """
    before = target.prior_quantile(parameter, RANGE[1]) - target.prior_quantile(parameter, RANGE[0])
    return 1.0 - ((high - low) / before) ** 2


_SHAPES: dict[str, Callable[[FloatArray], FloatArray]] = {
    "sigma_l": np.sqrt,
    "sigma1": lambda gamma: np.sqrt(variance_ratio(gamma)),
    "width": lambda gamma: variance_ratio(gamma) ** 1.5,
}


@cache
def _product_quantile(of_sigma_p: Distribution, of_gamma: Distribution, parameter: str, probability: float) -> float:
    """Quantile of sigma_p h(gamma): between the smallest and the largest h times sigma_p's own, so it is looked for in that unit."""
    from scipy.optimize import brentq  # slow to import

    nodes, weights = np.polynomial.legendre.leggauss(_NODES)
    root = 0.5 * (nodes + 1.0)  # of gamma's distribution function u: sigma_l is smooth in it, du = 2 root d root
    shape = _SHAPES[parameter](of_gamma.quantile(np.square(root)))
    unit = float(of_sigma_p.quantile(probability))

    def excess(x: float) -> float:
        return float(weights @ (root * of_sigma_p.cdf(x * unit / shape))) - probability

    return unit * float(brentq(excess, 0.999 * shape.min(), 1.001 * shape.max(), xtol=1e-12))
