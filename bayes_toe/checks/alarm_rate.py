"""Limits of alarms, which give a sound study the same rate of false alarms whatever its size.

`flag_limit` has the limit of p-values that flag a subject, `evidence_limit` that of log
Bayes factors. `simulated_p_value` resolves p-values in studies of up to 500 subjects.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from bayes_toe.arrays import FloatArray

#: Share of sound studies in which a test of every subject flags any subject.
FALSE_ALARM_SHARE = 0.05
#: The same share for an alarm after which a subject is not interpreted.
REFUSAL_SHARE = 0.02


def flag_limit(n_subjects: int) -> float:
    """The p-value below which a test flags a subject in a study of `n_subjects`.

    Any subject of a sound study is flagged with a probability of 5 % (Bonferroni).

    Examples
    --------
    >>> flag_limit(1), flag_limit(200)
    (0.05, 0.00025)
    """
    return FALSE_ALARM_SHARE / n_subjects


def evidence_limit(n_tests: int, share: float) -> float:
    """The log Bayes factor, nats, at which `n_tests` raise an alarm in this share of sound studies.

    Where the other explanation is wrong, its Bayes factor exceeds K with a probability of at most
    1/K (Markov's inequality).

    Examples
    --------
    >>> round(evidence_limit(1, REFUSAL_SHARE), 2), round(evidence_limit(200, REFUSAL_SHARE), 2)
    (3.91, 9.21)
    """
    return math.log(n_tests / share)


def simulated_p_value(observed: float, simulate: Callable[[int], FloatArray]) -> float:
    """Probability of a statistic at least as large, by simulation under the null hypothesis.

    The simulation ends when 20 statistics are as large (Besag and Clifford 1991), or after 20,000.

    Parameters
    ----------
    observed : float
    simulate : callable
        From a number n to n simulated statistics, shape (n,).

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> simulated_p_value(9.0, rng.standard_normal) < 0.0001
    True
    """
    # Statistics that differ by rounding count as equal.
    smallest_equal = observed - 1e-9 * abs(observed)
    n_larger = n_drawn = 0
    while n_drawn < 20_000 and n_larger < 20:
        # A large p-value needs few draws, so that batches are small at first.
        size = min(max(100, n_drawn), 1000, 20_000 - n_drawn)
        n_larger += int(np.count_nonzero(simulate(size) >= smallest_equal))
        n_drawn += size
    # The observed statistic counts as one of the simulated ones, so that the p-value is above 0.
    return (1 + n_larger) / (1 + n_drawn)
