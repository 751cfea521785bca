"""Whether a population has an order effect on average, of which kind, and whether its subjects differ: probabilities and words.

Beforehand no mean effect, a mean pull, a mean constant error and both are equally probable; their Bayes factors are those of
:mod:`bayes_toe.groups.savage_dickey`, where no effect on average means that both means are 0, whatever single subjects do.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from bayes_toe.comparison.words import PROBABLY_HAS, PROBABLY_NAMED, SMALL, side
from bayes_toe.groups.population import Population
from bayes_toe.groups.population_table import ORDER_EFFECT, PopulationRow
from bayes_toe.groups.savage_dickey import ORDER_EFFECTS

#: What is said of the mean, by what would be said of one subject.
_WORDS = {
    "has": "one",
    "probably has": "probably one",
    "undecided": "undecided",
    "probably none": "probably none",
    "none": "none",
}
_FAR = 5.0  # posterior sds of a mean from 0


@dataclass(frozen=True)
class OnAverage:
    """What is said of the means that may be none.

    `p_none` is the probability of no effect on average, `shares` have those that a kind, alone or with the other, is on average, if there
    is an effect; `both` is the size of the order effect at both means, with the Bayes factor of none, `means` are each with its own;
    `differ` says whether subjects differ by more than a small effect; `always` is the mean pull where the model always has one, so that
    none of it is no question.
    """

    p_none: float
    shares: Mapping[str, float]
    both: PopulationRow
    means: tuple[PopulationRow, ...]
    differ: bool
    always: PopulationRow | None = None

    @property
    def has(self) -> bool:
        """Whether there is, or probably is, an effect on average."""
        return self.always is not None or self.p_none <= PROBABLY_HAS

    @property
    def named(self) -> tuple[str, ...]:
        """Kinds that are said, for sure or probably."""
        return tuple(
            kind
            for kind, share in self.shares.items()
            if self.p_none <= PROBABLY_HAS and share >= PROBABLY_NAMED
        )

    @property
    def words(self) -> str:
        """One clause: 'one on average: a pull, and subjects differ'."""
        said = f"{_WORDS[side(self.p_none)]} on average"
        if (pull := self.always) is not None:
            size = f"a pull of {pull.q50:.2f} ({pull.q05:.2f} to {pull.q95:.2f}) on average, since this model always has one"
            return f"{size}; {' and '.join(row.parameter for row in self.means)}: {said}"
        said += (
            f": {' and '.join(f'a {kind}' for kind in self.named) or 'which kind is open'}"
            if self.has
            else ""
        )
        differ = (
            ", and subjects differ"
            if self.has
            else ", but subjects differ, with effects of either sign"
        )
        return said + differ * self.differ


def on_average(found: Population) -> OnAverage | None:
    """Of a population; None where its model has no mean that may be none."""
    rows = [row for kind in ORDER_EFFECTS.values() for row in found.table.some("mean", kind)]
    means = [row for row in rows if (row.bf_zero, row.bf_below) != (None, None)]
    if not means:
        return None
    (both,), always = (
        found.table.some("mean", ORDER_EFFECT),
        next((row for row in rows if row not in means), None),
    )
    average = _averages(both, means)
    p, spread = average[()], found.table.some("sd", ORDER_EFFECT)
    shares = {
        row.parameter: sum(one for kinds, one in average.items() if row.parameter in kinds)
        / (1.0 - p)
        for row in means
        if p < 1.0
    }
    return OnAverage(p, shares, both, tuple(means), bool(spread) and spread[0].q05 > SMALL, always)


def _averages(both: PopulationRow, means: Sequence[PopulationRow]) -> dict[tuple[str, ...], float]:
    """Probability of no mean effect, of each kind alone and of all, by their Bayes factors against all."""
    none = {row.parameter: _bounded(row) for row in means}
    joint = math.prod(none.values()) if both.bf_zero is None else both.bf_zero
    factors: dict[tuple[str, ...], float] = {
        (): joint,
        **{(kind,): math.prod(none[one] for one in none if one != kind) for kind in none},
        tuple(none): 1.0,
    }
    return {kinds: factor / math.fsum(factors.values()) for kinds, factor in factors.items()}


def _bounded(row: PopulationRow) -> float:
    """The Bayes factor of none, or about what it can be at most."""
    if row.bf_zero is not None:
        return row.bf_zero
    far = abs(row.mean) > _FAR * row.sd  # no draw is near 0, so that none can carry an estimate
    return 0.0 if far else 1.0 if row.bf_below is None else min(row.bf_below, 1.0)
