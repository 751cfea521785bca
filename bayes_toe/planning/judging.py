"""How simulated answers are judged: by the words of the verdict, with evidences that take a third of its time.

Of all models Laplace's approximation, and of those within the verdict's window importance sampling of a few draws from its shape, which
are not adapted: processor time 0.5 s a data set of 'same or different' where a verdict takes 1.6 s. In 100 simulated ones (paper's pairs of
260 and 650 trials, wide ones of 650; default observers and those of the prior) 99 words of the effect were those of the verdict, and 99 of
its kind; probabilities differed by 0.009 (median), 0.12 at most.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp, softmax

from bayes_toe.arrays import FloatArray
from bayes_toe.comparison.verdict import Verdict, by_order
from bayes_toe.comparison.words import KINDS, SMALL
from bayes_toe.data.study import Subject
from bayes_toe.inference.prediction import effect_size
from bayes_toe.inference.space import laplace_evidences
from bayes_toe.model.posterior import Posterior
from bayes_toe.model.prior import Prior
from bayes_toe.model.record import Model
from bayes_toe.planning.observers import NONE
from bayes_toe.seeds import generator

#: Draws of each model.
DRAWS = 800
#: Words that say an order effect, and that say none or next to none; only 'undecided' says neither.
FOUND, DENIED = ("has", "probably has"), ("negligible", "probably none", "none")
#: Kinds of observers by the verdict's words for them.
_KINDS = {word: kind for kind, name in KINDS.items() for word in (name, f"probably {name}")}


@dataclass(frozen=True)
class Judgement:
    """What the program says of one subject's answers; all that power and designs know of them.

    Log evidence of no order effect, a constant error, the update, each over its models (nats), None where one is withheld; the
    probability of an effect above a fifth of the JND; and, where they were asked for and can be told, the widths of the
    90 % intervals of gain, mu1 and width under the update.
    """

    log_evidence: tuple[float, ...] | None
    p_larger: float | None = None
    widths: tuple[float, ...] | None = None

    @property
    def probability(self) -> tuple[float, ...] | None:
        """Of each kind, equally probable beforehand."""
        return None if self.log_evidence is None else tuple(softmax(self.log_evidence).tolist())

    @cached_property
    def verdict(self) -> Verdict:
        """Without name, fit, and what is about data and prior."""
        return Verdict("", self.probability, (), None, None, self.p_larger, "", None)

    @property
    def found(self) -> bool:
        """Whether an order effect is said, for sure or probably."""
        return self.verdict.effect in FOUND

    @property
    def named(self) -> str | None:
        """The kind of observers that is said, for sure or probably, a negligible effect being none; None where it is open."""
        return NONE if self.verdict.effect in DENIED else _KINDS.get(self.verdict.kind)


class Weighed(NamedTuple):
    """Log evidences of models, NaN where withheld; of those that count, by their place, also draws x and log weights."""

    models: Sequence[Model]
    values: FloatArray
    draws: Mapping[int, tuple[Posterior, FloatArray, FloatArray]]


def weighed(subject: Subject, seed: int, prior: Prior, models: Sequence[Model]) -> Weighed:
    """By Laplace and a few draws from its shape; streams are keyed by seed, name and model."""
    numbers, draws = prior.at(subject), {}
    values, counting = laplace_evidences(subject, numbers, models)
    for place, (family, i) in counting.items():
        x, weights = family.weighted(
            i, generator(seed, subject.name, models[place].name, "judged"), DRAWS
        )
        values[place] = logsumexp(weights) - np.log(len(weights))
        draws[place] = models[place].posterior(subject, numbers), x, weights
    return Weighed(models, values, draws)


def judged(subject: Subject, seed: int, prior: Prior, models: Sequence[Model]) -> Judgement:
    """The judgement of a subject's answers over these models, without widths."""
    _, values, draws = weighed(subject, seed, prior, models)
    if not np.isfinite(values).all():
        return Judgement(None)
    larger, p = 0.0, softmax(values)
    for place, (posterior, x, weights) in draws.items():
        if dict(models[place].levels)["order"] != NONE:
            larger += p[place] * float(softmax(weights) @ (effect_size(posterior, x) > SMALL))
    return Judgement(tuple(by_order(values, models).tolist()), larger / float(p[list(draws)].sum()))
