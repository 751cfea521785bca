"""Predictive check of the group: whether the distribution of subjects is normal.

`predictive_check` simulates new groups with as many subjects, the same trials and covariates. Each
new group is drawn from the group of one posterior draw, and its responses are simulated. The
estimates of the observed subjects are not used again, because they would hide a misfit.

Subjects differ in their mean asymmetry and in their share of the counted response. The spread, the
skewness and the farthest subject of each are compared with those of the new groups.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from bayes_toe.arrays import FloatArray, IntArray, Texts
from bayes_toe.data.study import pairs_in_both_orders, units_by_subject
from bayes_toe.groups.population import PopulationResult, subject_rows
from bayes_toe.model.posterior_array import LinearLikelihood
from bayes_toe.seeds import generator

#: Below this two-sided tail probability a normal group is contradicted.
CONTRADICTED = 0.01


class Statistic(NamedTuple):
    """A statistic of the differences between subjects, beside quantiles of new groups.

    Attributes
    ----------
    kind : {"spread", "skewness", "farthest"}
        Standard deviation between subjects, third standardised moment, or the largest distance
        from the mean, in standard deviations.
    quantity : str
        What subjects differ in.
    observed, q05, q95 : float
    p_value : float
        Two-sided share of new groups that are as far out.
    is_above : bool
        Whether the observed value is above the median of new groups.
    """

    kind: str
    quantity: str
    observed: float
    q05: float
    q95: float
    p_value: float
    is_above: bool

    @property
    def warning(self) -> str:
        """The contradiction to a normal group, in words."""
        if self.kind == "spread":
            size = "larger" if self.is_above else "smaller"
            text = f"the spread of the {self.quantity} between subjects is {size} than"
        elif self.kind == "skewness":
            text = f"the {self.quantity} of the subjects is more skewed than"
        else:
            position = "farther out" if self.is_above else "nearer"
            text = f"the subject farthest in its {self.quantity} is {position} than"
        return (
            f"{text} in a normal group ({self.observed:.2g}, {self.q05:.2g} to {self.q95:.2g} "
            f"expected, p = {self.p_value:.2g})"
        )


def contradictions(result: PopulationResult) -> Texts:
    """The statistics that contradict a normal group, a line each."""
    return tuple(
        statistic.warning
        for statistic in predictive_check(result)
        if statistic.p_value < CONTRADICTED
    )


def predictive_check(result: PopulationResult) -> list[Statistic]:
    """Compare the differences between subjects with new groups drawn from the posterior.

    Statistics are missing for fewer than three subjects. A mean asymmetry is the mean difference in
    wrong responses between both orders of a pair. Only subjects who met a pair in both orders have
    one.
    """
    task = result.study.task
    likelihood = subject_rows(result.study)  # a row for each unit of subject and condition
    rows = likelihood.rows
    counts = rows.counts[:, :, 0].astype(np.int64)  # (rows, answers, pairs)
    observed = counts[:, 0]  # the first answer is the counted one
    n_trials = counts.sum(axis=1)
    difference = rows.difference[:, 0]  # s2 - s1, (rows, pairs)

    # 1 for a pair with the stronger stimulus first, -1 for the same pair in the other order, and 0
    # for pairs that were met in one order only.
    signs = np.zeros(n_trials.shape)
    units = chain.from_iterable(units_by_subject(result.study).values())
    for i, unit in enumerate(units):
        # The indices of each pair in both orders, (pairs, 2), first with the weaker stimulus first.
        signs[i, pairs_in_both_orders(unit)] = -1.0, 1.0

    def per_subject(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Sums over the units and pairs of each subject, (rows, pairs) -> (subjects,)."""
        return likelihood.summed(values.sum(axis=1))

    n_compared = per_subject(signs > 0.0)  # pairs of different stimuli, met in both orders
    is_compared = n_compared > 0

    asymmetries = []  # of the observed group, and then of new groups
    shares = []
    for n_yes in chain([observed], _simulated_counts(result, likelihood, n_trials)):
        # Laplace's estimator of the frequency of a wrong response, (rows, pairs).
        wrong_share = (task.wrong(difference, n_yes, n_trials) + 1.0) / (n_trials + 2.0)
        differences = per_subject(signs * wrong_share)
        asymmetries.append(differences[is_compared] / n_compared[is_compared])
        # The share of the counted response.
        shares.append(per_subject(n_yes) / per_subject(n_trials))
    return [
        *_statistics("mean asymmetry", np.array(asymmetries)),
        *_statistics(f"share of {task.yes!r}", np.array(shares)),
    ]


def _simulated_counts(
    result: PopulationResult, likelihood: LinearLikelihood, n_trials: IntArray
) -> Iterator[IntArray]:
    """Counts of the counted response, (rows, pairs), in 500 new groups drawn from the posterior."""
    rng = generator(result.settings.seed, "population", "predictive check")
    draws = result.draws
    n_chains, n_draws, q = draws.mean.shape
    for index in np.linspace(0, n_chains * n_draws - 1, 500).astype(int).tolist():
        draw = divmod(index, n_draws)  # a chain, and a draw of this chain
        # New subjects have new coefficients, (subjects, q). The parameters that the group does not
        # share are those of observed subjects, because they have no distribution over subjects.
        centre = draws.mean[draw] + result.regressors.x @ draws.effects[draw]
        coefficients = centre + draws.sd[draw] * rng.standard_normal(centre.shape)
        points = np.hstack([coefficients, draws.subjects[draw][:, q:]])
        row_points = likelihood.row_points(points[:, None])  # with an axis for a single point
        log_yes, *_ = likelihood.rows.log_answers(row_points)  # (rows, 1, pairs)
        # Rounding may take a probability above 1.
        yield rng.binomial(n_trials, np.exp(np.minimum(log_yes[:, 0], 0.0)))


def _statistics(quantity: str, values: FloatArray) -> list[Statistic]:
    """Statistics of values, (groups, subjects), of which the first group is the observed group."""
    if values.shape[1] < 3:  # two subjects have always the same skewness and farthest subject
        return []
    spread = values.std(axis=1, ddof=1)
    deviations = values - values.mean(axis=1, keepdims=True)
    # 0 where all subjects have the same value.
    scores = deviations / np.where(spread > 0.0, spread, 1.0)[:, None]
    measures = {
        "spread": spread,
        "skewness": (scores**3).mean(axis=1),
        "farthest": np.abs(scores).max(axis=1),
    }
    statistics = []
    for kind, (observed, *simulated) in measures.items():
        n_tail = min(
            np.greater_equal(simulated, observed).sum(), np.less_equal(simulated, observed).sum()
        )
        # Two-sided. The observed group counts as one of the groups, so that p is never 0.
        p_value = min(1.0, 2.0 * (n_tail + 1) / (len(simulated) + 1))
        q05, median, q95 = np.quantile(simulated, (0.05, 0.5, 0.95)).tolist()
        statistics.append(
            Statistic(
                kind, quantity, float(observed), q05, q95, float(p_value), bool(observed > median)
            )
        )
    return statistics
