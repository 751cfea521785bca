"""Does the population have the right form? How subjects differ in what they did, beside how those of new groups would.

A new group has as many subjects, with the same trials and covariates, each drawn from the population of one posterior draw; its answers are
simulated. The subjects themselves are not used again, so that their own parameters cannot hide that no such population has them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from bayes_toe.arrays import FloatArray, IntArray
from bayes_toe.data.study import Subject
from bayes_toe.groups.differences import ConditionLikelihood
from bayes_toe.groups.joint import scatter_named
from bayes_toe.groups.population import Population
from bayes_toe.groups.subjects import GroupLikelihood
from bayes_toe.model.crowd import Crowd
from bayes_toe.seeds import generator

#: Below this two-sided tail probability a population of this form is said to be contradicted.
CONTRADICTED = 0.01
_GROUPS, _TOGETHER = 500, 20  # new groups, and how many of them are simulated at once
_FEWEST = 3  # subjects of which a skewness or a farthest one says anything: of two, both are always the same


class Statistic(NamedTuple):
    """How subjects differ in something that they did, beside quantiles of new groups.

    The kind is the "spread", standard deviation between subjects, the "skewness", third standardised moment, or how far the "farthest" is
    from the mean, in standard deviations.
    """

    kind: str
    of: str
    observed: float
    q05: float
    q50: float
    q95: float
    p_value: float  # two-sided share of new groups that are as far out
    above: bool  # the median of new groups

    @property
    def label(self) -> str:
        """What it is, in words."""
        return {
            "spread": "sd of {}",
            "skewness": "skewness of {}",
            "farthest": "farthest {}, in sd",
        }[self.kind].format(self.of)


@dataclass(frozen=True)
class PredictiveCheck:
    """What :func:`predictive_check` found; asymmetries are missing where fewer than two subjects met a pair in both orders."""

    statistics: tuple[Statistic, ...]
    scatter: str
    groups: int

    @property
    def warnings(self) -> tuple[str, ...]:
        """What contradicts the population, in words."""
        return tuple(self._said(one) for one in self.statistics if one.p_value < CONTRADICTED)

    def _said(self, one: Statistic) -> str:
        above, outlying = one.above, one.above or one.kind == "skewness"
        what = {
            "spread": f"the spread of the {one.of} between subjects is {'larger' if above else 'smaller'} than",
            "skewness": f"the {one.of} of the subjects is skewed otherwise than",
            "farthest": f"the subject farthest in its {one.of} is {'farther out' if above else 'nearer'} than",
        }[one.kind]
        numbers = (
            f"{one.observed:.2g}, {one.q05:.2g} to {one.q95:.2g} expected, p = {one.p_value:.2g}"
        )
        further = "; try --population t" if outlying and self.scatter == "normal" else ""
        clumps = (
            "; do the subjects fall into kinds? A covariate may tell them apart"
            if not outlying and one.kind == "farthest"
            else ""
        )
        return f"{what} a {self.scatter} population has it ({numbers}){further}{clumps}"


def predictive_check(found: Population, *, groups: int = _GROUPS) -> PredictiveCheck:
    """Hold how subjects differ against so many new groups drawn from the posterior.

    Examples
    --------
    >>> from bayes_toe.data.read_study import example_study
    >>> from bayes_toe.groups.population import population
    >>> made = population(example_study().select(["S01", "S02", "S03"]), draws=200, seed=1, workers=1)
    >>> [one.label for one in predictive_check(made, groups=100).statistics[:2]]
    ['sd of mean asymmetry', 'farthest mean asymmetry, in sd']
    """
    rng, chains = generator(found.settings.seed, "population", "predictive check"), found.chains
    k, draws, parts = len(found.names), chains.mean[..., 0].size, -(-groups // _TOGETHER)
    some = np.linspace(0, draws - 1, parts * _TOGETHER).astype(int)
    mean, tau, effects, root = (
        values.reshape(draws, -1, k)[some]
        for values in (chains.mean, chains.scatter, chains.effects, chains.root)
    )
    expected = mean + found.regressors.x @ effects
    eta = expected + tau * (
        scatter_named(found.settings.scatter).sample(rng, expected.shape) @ root.swapaxes(1, 2)
    )
    own = (found.model, found.settings.prior, found.study.subjects)
    likelihood: GroupLikelihood | ConditionLikelihood = GroupLikelihood(
        *own, found.centre, _TOGETHER
    )
    if found.differences is not None:
        apart = found.differences.drawn
        mean, tau = (values.reshape(draws, 1, -1)[some] for values in (apart.mean, apart.scatter))
        score = scatter_named(found.settings.scatter).sample(rng, (*eta.shape[:2], mean.shape[-1]))
        eta = np.concatenate([eta, mean + tau * score], axis=-1)
        likelihood = ConditionLikelihood(*own, found.differences, found.centre, _TOGETHER)
    crowd = Crowd.of(found.study.subjects, 0.0, 1.0)
    everyone = np.concatenate(
        [crowd.n_yes[None], *(likelihood.repeated(part, rng) for part in np.split(eta, parts))]
    )[: groups + 1]
    statistics = [
        one for deed in _deeds(found.study.subjects, crowd, everyone) for one in _statistics(*deed)
    ]
    return PredictiveCheck(tuple(statistics), found.settings.scatter, groups)


def _deeds(
    subjects: Sequence[Subject], crowd: Crowd, n_yes: IntArray
) -> Iterator[tuple[str, FloatArray, tuple[str, ...]]]:
    """What each subject of each group did, shape (groups, N), from counts, shape (groups, N, pairs), and what is asked of it."""
    task, difference, n = subjects[0].task, crowd.s2 - crowd.s1, crowd.n_trials
    wrong, weights = (
        task.wrong(difference, n_yes, n),
        np.zeros(crowd.s1.shape),
    )  # of pairs in a subject's mean of q(c, r) - q(r, c)
    for row, one in zip(weights, subjects, strict=True):
        seconds = np.zeros(one.n_pairs) if one.isi is None else one.isi
        at = {
            key: i
            for i, key in enumerate(
                zip(one.s1.tolist(), one.s2.tolist(), seconds.tolist(), strict=True)
            )
        }
        both = [(i, at[b, a, isi]) for (a, b, isi), i in at.items() if a > b and (b, a, isi) in at]
        for strong_first, weak_first in both:
            row[strong_first], row[weak_first] = 1.0 / len(both), -1.0 / len(both)
    met = weights.any(axis=1)
    if met.sum() > 1:
        shares = (wrong[:, met] + 1.0) / (n[met] + 2.0)  # Laplace's estimator, Eq. e:2b
        yield "mean asymmetry", (weights[met] * shares).sum(axis=2), ("spread", "farthest")
    judged = np.where(task.right(difference) == 0, 0, n)
    some = judged.any(axis=1)
    if some.sum() > 1:
        yield "accuracy", 1.0 - wrong[:, some].sum(axis=2) / judged[some].sum(axis=1), ("spread",)
    yield f"share of {task.yes!r}", n_yes.sum(axis=2) / n.sum(axis=1), ("skewness", "farthest")


def _statistics(of: str, values: FloatArray, kinds: Sequence[str]) -> Iterator[Statistic]:
    """Of the group in the first row beside those in the others: its spread, and, where that says something, its form."""
    spread = values.std(axis=1, ddof=1, keepdims=True)
    from_mean = values - values.mean(axis=1, keepdims=True)
    scores = np.divide(from_mean, spread, out=np.zeros_like(from_mean), where=spread > 0.0)
    measures = {
        "spread": spread[:, 0],
        "skewness": (scores**3).mean(axis=1),
        "farthest": np.abs(scores).max(axis=1),
    }
    for kind in kinds:
        if kind != "spread" and values.shape[1] < _FEWEST:
            continue
        observed, *others = measures[kind].tolist()
        tail = min(sum(one >= observed for one in others), sum(one <= observed for one in others))
        q05, q50, q95 = np.quantile(others, (0.05, 0.5, 0.95)).tolist()
        yield Statistic(
            kind,
            of,
            observed,
            q05,
            q50,
            q95,
            min(1.0, 2.0 * (tail + 1) / (len(others) + 1)),
            observed > q50,
        )
