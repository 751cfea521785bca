"""Predictive check of the group: whether the distribution of subjects is normal.

`predictive_check` simulates new groups with as many subjects, the same trials and covariates. Each
new group is drawn from the group of one posterior draw, and its responses are simulated. The
estimates of the observed subjects are not used again, because they would hide a misfit.

Five statistics are compared with those of the new groups: the spread and the farthest subject of
the mean asymmetry, the spread of accuracy, and the skewness and the farthest subject of the share
of the counted response.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import chain
from typing import NamedTuple

import numpy as np

from bayes_toe.arrays import FloatArray, Rng, Texts
from bayes_toe.data.study import Subject, pairs_in_both_orders, units_by_subject
from bayes_toe.data.tasks import Task
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


def predictive_check(result: PopulationResult) -> Iterator[Statistic]:
    """Compare the differences between subjects with new groups drawn from the posterior.

    Asymmetries are missing where fewer than two subjects met a pair in both orders.
    """
    rng = generator(result.settings.seed, "population", "predictive check")
    draws = result.draws
    *chains_and_draws, q = draws.mean.shape
    evenly_spaced = np.linspace(0, math.prod(chains_and_draws) - 1, 500).astype(int)
    index = np.unravel_index(evenly_spaced, chains_and_draws)

    # New subjects have new coefficients, (groups, subjects, q). The parameters that the group does
    # not share are those of the observed subjects, because they have no distribution over subjects.
    coefficients = draws.mean[index][:, None] + result.regressors.x @ draws.effects[index]
    coefficients += draws.sd[index][:, None] * rng.standard_normal(coefficients.shape)
    unshared = draws.subjects[..., q:][index]
    points = np.concatenate([coefficients, unshared], axis=-1).swapaxes(0, 1)

    likelihood = subject_rows(result.study)
    task = result.study.task
    units_of_subjects = list(units_by_subject(result.study).values())
    differences_by_block = []
    # At most 32 subjects at a time, because their responses to every pair in every group are many.
    for block in np.array_split(np.arange(len(points)), 1 + len(points) // 32):
        units = list(chain.from_iterable(units_of_subjects[i] for i in block.tolist()))
        differences_by_block.append(
            _differences(task, units, likelihood.part(block), points[block], rng)
        )

    asymmetry, accuracy, share = map(np.concatenate, zip(*differences_by_block, strict=True))
    yield from _statistics("mean asymmetry", asymmetry, ("spread", "farthest"))
    yield from _statistics("accuracy", accuracy, ("spread",))
    yield from _statistics(f"share of {task.yes!r}", share, ("skewness", "farthest"))


def _differences(
    task: Task,
    units: Sequence[Subject],
    likelihood: LinearLikelihood,
    points: FloatArray,
    rng: Rng,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """What subjects differ in: mean asymmetry, accuracy and share of the counted response.

    All have the shape (subjects, groups). The first group is observed. The responses of the other
    groups are simulated at their points, (subjects, groups, coordinates). Subjects without a pair
    in both orders have no asymmetry, and subjects without a right response have no accuracy: they
    are left out there. Each row of the likelihood has the counts of one of the `units`.
    """
    rows = likelihood.rows
    sum_by_subject = likelihood.summed  # over the rows of each subject, which are its conditions
    counts = rows.counts[:, :, 0].astype(np.int64)  # (rows, answers, pairs)
    observed = counts[:, 0]  # the first answer is the counted one
    n_trials = counts.sum(axis=1)
    # The shape is (rows, groups, pairs). Rounding may take a probability above 1.
    log_yes, *_ = rows.log_answers(likelihood.row_points(points))
    p_yes = np.exp(np.minimum(log_yes, 0.0))
    n_yes = np.concatenate([observed[:, None], rng.binomial(n_trials[:, None], p_yes)], axis=1)
    difference = rows.difference  # s2 - s1, (rows, 1, pairs)
    n_wrong = task.wrong(difference, n_yes, n_trials[:, None])

    # 1 for a pair with the stronger stimulus first, -1 for the same pair in the other order, and 0
    # for pairs that were met in one order only.
    signs = np.zeros(n_trials.shape)
    for i, unit in enumerate(units):
        # The indices of each pair in both orders, (pairs, 2); first that with the weaker stimulus
        # first.
        signs[i, pairs_in_both_orders(unit)] = -1.0, 1.0
    n_compared = sum_by_subject((signs > 0.0).sum(axis=1))  # pairs of different stimuli
    is_compared = n_compared > 0
    # Laplace's estimator of the frequency of a wrong response. Its mean difference between the
    # orders is the mean asymmetry.
    wrong_shares = (n_wrong + 1.0) / (n_trials[:, None] + 2.0)  # (rows, groups, pairs)
    total = sum_by_subject((signs[:, None] * wrong_shares).sum(axis=2))  # (subjects, groups)
    asymmetry = total[is_compared] / n_compared[is_compared, None]

    # Equal stimuli have no right response in some tasks, where `right` is 0.
    n_judged = sum_by_subject((n_trials * (task.right(difference[:, 0]) != 0)).sum(axis=1))
    has_right_answer = n_judged > 0
    n_wrong_of_subject = sum_by_subject(n_wrong.sum(axis=2))
    accuracy = 1.0 - n_wrong_of_subject[has_right_answer] / n_judged[has_right_answer, None]

    share = sum_by_subject(n_yes.sum(axis=2)) / sum_by_subject(n_trials.sum(axis=1))[:, None]
    return asymmetry, accuracy, share


def _statistics(quantity: str, values: FloatArray, kinds: Sequence[str]) -> Iterator[Statistic]:
    """Statistics of values, (subjects, groups), in which the first group is the observed group."""
    if len(values) < 2:  # one subject has no spread
        return
    spread = values.std(axis=0, ddof=1)
    deviations = values - values.mean(axis=0)
    # 0 where all subjects have the same value.
    scores = np.divide(deviations, spread, out=np.zeros_like(deviations), where=spread > 0.0)
    measures = {
        "spread": spread,
        "skewness": (scores**3).mean(axis=0),
        "farthest": np.abs(scores).max(axis=0),
    }  # (groups,) each
    for kind in kinds:
        # Two subjects always have the same skewness, and the same distance from their mean in SDs.
        if kind != "spread" and len(values) < 3:
            continue
        observed = float(measures[kind][0])  # the first group is the observed group
        simulated = measures[kind][1:]
        tail = int(min((simulated >= observed).sum(), (simulated <= observed).sum()))
        # Two-sided. The observed group counts as one of the groups, so that p is never 0.
        p_value = min(1.0, 2.0 * (tail + 1) / (len(simulated) + 1))
        q05, median, q95 = np.quantile(simulated, (0.05, 0.5, 0.95)).tolist()
        yield Statistic(kind, quantity, observed, q05, q95, p_value, observed > median)
