"""One verdict a subject: whether there is an order effect, of which kind and size, and whether the models describe the answers.

It averages over the space of the task (:func:`bayes_toe.model.ladder.models_of`): order {none, constant error, update} x noise x lapses x
what else the task's curve has, all equally probable beforehand. The size of an effect is the root mean square, over the first stimuli
shown, of the shift c - p (s1 - sbar) that the order makes, in just noticeable differences (half-widths of the curve of 'equal'); 0 where
there is none. The words and their limits were measured on simulated observers: docs/order_effect.md says how often each is right.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp, softmax

from bayes_toe.arrays import FloatArray
from bayes_toe.checks.answer_checks import answer_flags
from bayes_toe.comparison.words import (
    EFFECTS,
    HAS,
    KINDS,
    NAMED,
    NONE,
    PROBABLY_HAS,
    PROBABLY_NAMED,
    SMALL,
    SURELY,
    compared,
    side,
)
from bayes_toe.data.study import Study, Subject
from bayes_toe.inference.evidence import weighed
from bayes_toe.inference.prediction import effect_size
from bayes_toe.inference.predictive_checks import MISFIT, FitSummary
from bayes_toe.inference.proposal import FittedProposal
from bayes_toe.inference.space import SpaceEvidence, space_evidence
from bayes_toe.inference.subject import weighted_fit
from bayes_toe.model.ladder import ORDERS, models_of
from bayes_toe.model.parts import compose
from bayes_toe.model.posterior import Posterior
from bayes_toe.model.prior import Prior
from bayes_toe.model.record import Model

#: Which scales of the prior belong to the order, and by what they are multiplied for `robust`.
ORDER_SCALES, FACTORS = ("mu1_sd", "offset_sd"), (0.5, 2.0)
#: Columns with which evidence.csv begins.
VERDICT_COLUMNS = (
    *(
        "subject",
        "effect",
        "kind",
        "fit",
        "data",
        "robust",
        "p_none",
        "p_constant_error",
        "p_update",
        "log_bayes_factor_effect",
    ),
    *("size_q50", "best_model", "predictive_p", "deviance_p", "history_p"),
)


class Doubt(NamedTuple):
    """What a subject's data have against them, in a few words, and the option that acts on it; empty where none does."""

    kind: str
    option: str = ""

    def __str__(self) -> str:
        return f"{self.kind} ({self.option})" if self.option else self.kind


def data_doubts(study: Study) -> list[tuple[Doubt, ...]]:
    """The flags of every subject."""
    return [
        tuple(Doubt(flag.words, flag.option) for flag in flags) for flags in answer_flags(study)
    ]


@dataclass(frozen=True)
class Verdict:
    """What is concluded of one subject.

    Attributes
    ----------
    subject : str
    p_orders : tuple of 3 floats, or None
        Posterior probabilities that the order has no effect, makes a constant error, pulls; None where an evidence that counts is missing.
    varied : tuple of such
        The same with the scales of mu1 and of the constant error halved, and doubled.
    log_bayes_factor_effect : float or None
        Natural log of the evidence of an effect, both kinds equally probable, over that of none; it does not depend on P(none) beforehand.
    size_q50, p_larger : float or None
        Posterior median of the size of the effect in just noticeable differences, and the probability that it is above 0.2.
    best_model : str
        The composition with the highest evidence.
    best_fit : FitSummary or None
        Its goodness of fit.
    p_none_scattered : float or None
        Where it does not fit: P(none) with beta-binomial scatter of the counts as one more part.
    data : tuple of Doubt
        What the data have against them; see :mod:`bayes_toe.checks.answer_checks`.
    notes : tuple of str
        What is withheld, and why.
    p_first_stronger : float or None
        Under a constant error, the probability that it makes the first stimulus seem stronger.
    history_p : float or None
        p-value of the answers by the trial before; None where it is not known.
    """

    subject: str
    p_orders: tuple[float, ...] | None
    varied: tuple[tuple[float, ...], ...]
    log_bayes_factor_effect: float | None
    size_q50: float | None
    p_larger: float | None
    best_model: str
    best_fit: FitSummary | None
    p_none_scattered: float | None = None
    data: tuple[Doubt, ...] = ()
    notes: tuple[str, ...] = ()
    p_first_stronger: float | None = None
    history_p: float | None = None

    @property
    def p_none(self) -> float | None:
        """Posterior probability that the order has no effect."""
        return None if self.p_orders is None else self.p_orders[0]

    @property
    def p_constant_error(self) -> float | None:
        """Posterior probability of a constant error."""
        return None if self.p_orders is None else self.p_orders[1]

    @property
    def p_update(self) -> float | None:
        """Posterior probability of a pull toward a prior: the predictive update."""
        return None if self.p_orders is None else self.p_orders[2]

    @property
    def effect(self) -> str:
        """A key of :data:`EFFECTS`; empty where there is no probability."""
        if self.p_orders is None:
            return ""
        said = side(self.p_orders[0])
        return "negligible" if said == "undecided" and self.at_most_small else said

    @property
    def at_most_small(self) -> bool:
        """Whether no effect above a fifth of a just noticeable difference is left."""
        return self.p_larger is not None and self.p_larger <= SURELY

    @property
    def kind(self) -> str:
        """Constant error or pull, either perhaps with 'probably' before it; 'open'; empty where no effect is said."""
        return "" if self.p_orders is None else _kind(self.p_orders)

    @property
    def first_seems(self) -> str:
        """What a constant error that is named makes of the first stimulus, 'stronger' or 'weaker'; empty where that is not known."""
        if not self.kind.endswith("constant error") or self.p_first_stronger is None:
            return ""
        return (
            "stronger"
            if self.p_first_stronger >= NONE
            else "weaker"
            if self.p_first_stronger <= HAS
            else ""
        )

    @property
    def p_none_range(self) -> tuple[float, float]:
        """Smallest and largest P(none) as the prior's scales of the order are halved and doubled; NaN where there is none."""
        cases = [p[0] for p in self._cases] or [float("nan")]
        return min(cases), max(cases)

    @property
    def fit(self) -> str:
        """Whether the best model describes the answers: 'described', 'not described', 'cannot be told'."""
        describes = None if self.best_fit is None else self.best_fit.describes
        return (
            "cannot be told" if describes is None else "described" if describes else "not described"
        )

    @property
    def robust(self) -> str:
        """Yes, where halving and doubling the prior's scales of the order changes neither the side of the verdict nor the kind named."""
        if self.p_orders is None:
            return ""
        kinds = {_kind(p).removeprefix("probably ") for p in self._cases} - {"open", ""}
        return "yes" if len(self._sides) == 1 and len(kinds) <= 1 else "no"

    @property
    def _cases(self) -> tuple[tuple[float, ...], ...]:
        """Probabilities under the prior, and with its scales of the order halved and doubled."""
        return tuple(p for p in (self.p_orders, *self.varied) if p)

    @property
    def _sides(self) -> set[str]:
        return {side(p[0]).removeprefix("probably ") for p in self._cases}

    @property
    def predictive_p(self) -> float | None:
        """Posterior predictive p-value of the best model's deviance."""
        return None if self.best_fit is None else self.best_fit.p_overall

    @property
    def deviance_p(self) -> float | None:
        """P-value of the best model's deviance."""
        return None if self.best_fit is None else self.best_fit.p_deviance

    def cell(self, column: str) -> object:
        """The entry of one of :data:`VERDICT_COLUMNS`."""
        return "; ".join(map(str, self.data)) if column == "data" else getattr(self, column)

    def describe(self) -> str:
        """The verdict in words, without the subject's name.

        Examples
        --------
        >>> one = Verdict("S", (0.02, 0.03, 0.95), ((0.02, 0.03, 0.95),) * 2, 3.2, 0.6, 0.99, "predictive update", None)
        >>> one.said_effect()
        'has an order effect: a pull (P of an effect = 0.98, that it is a pull = 0.97)'
        """
        return "; ".join([self.said_effect(), *self.doubts()])

    def said_effect(self) -> str:
        """Effect, kind and their probabilities in words."""
        if self.p_orders is None:
            return EFFECTS[""]
        none = self.p_orders[0]
        words = EFFECTS[self.effect]
        if none <= PROBABLY_HAS:
            of = {
                kind: p / (1.0 - none)
                for kind, p in zip(KINDS.values(), self.p_orders[1:], strict=True)
            }
            likely = max(of, key=lambda kind: of[kind])
            words = words.replace("an order", "a small order") if self.at_most_small else words
            if self.kind == "open":
                return f"{words}, which kind is open (P of an effect {compared(1.0 - none)})"
            named = self.kind.replace(likely, f"a {likely}") + (
                f", the first stimulus seems {self.first_seems}" if self.first_seems else ""
            )
            return f"{words}: {named} (P of an effect {compared(1.0 - none)}, that it is a {likely} {compared(of[likely])})"
        if self.at_most_small and self.effect != "negligible":
            words += ", and at most a negligible one"
        return f"{words} (P of none {compared(none)})"

    @property
    def follows(self) -> bool:
        """Whether answers look as if they depended on the trial before, which no model of the space describes."""
        return self.history_p is not None and self.history_p < MISFIT

    def doubts(self) -> list[str]:
        """What stands against the verdict, each in a few words; nothing where nothing does."""
        said = []
        if self.fit == "not described":
            scattered = (
                ""
                if self.p_none_scattered is None
                else f" (with more scatter P of none {compared(self.p_none_scattered)})"
            )
            said.append(f"but no model describes the answers{scattered}")
        elif self.fit == "cannot be told":
            said.append("whether the models describe the answers cannot be told")
        if self.follows:
            said.append(
                f"answers seem to depend on the trial before (p {compared(self.history_p or 0.0)}; bayes-toe history)"
            )
        said += (
            [f"but its data are in doubt: {', '.join(map(str, self.data))}"] if self.data else []
        )
        if self.robust == "no":
            low, high = self.p_none_range
            moved = f"P of none {low:.2f} to {high:.2f}" if len(self._sides) > 1 else "another kind"
            said.append(f"the prior has a say: {moved} as its scales are halved and doubled")
        return said


def _kind(p: tuple[float, ...]) -> str:
    if p[0] > PROBABLY_HAS:
        return ""
    share, name = max(zip((one / (1.0 - p[0]) for one in p[1:]), KINDS.values(), strict=True))
    return name if share >= NAMED else f"probably {name}" if share >= PROBABLY_NAMED else "open"


def verdict(
    subject: Subject, prior: Prior, seed: int, *, data: Sequence[Doubt] = ()
) -> tuple[Verdict, SpaceEvidence]:
    """The verdict of one subject, of whose data `data` says what they have against them, and the evidences behind it.

    Random streams are keyed by the seed, the subject's name and the model's.
    """
    space = models_of(subject.task).space
    found = space_evidence(subject, prior, space, seed)
    values = weighed(
        [None if np.isnan(one) else one for one in found.log_evidence.tolist()],
        found.bounds.tolist(),
    )
    if np.isnan(values).any() or not found.sampled:
        missing = (
            ", ".join(space[i].name for i in np.flatnonzero(np.isnan(values)))
            or "any model that can be trusted"
        )
        return Verdict(
            subject.name,
            None,
            (),
            None,
            None,
            None,
            "",
            None,
            None,
            tuple(data),
            (f"no evidence of {missing}",),
        ), found
    of_orders = by_order(values, space)
    best = max(found.sampled, key=lambda i: float(values[i]))
    fitted = found.sampled[best].fitted
    fit = weighted_fit(fitted, seed)
    sizes, weights = _sizes(found, values)
    order = np.argsort(sizes)
    middle = int(np.searchsorted(np.cumsum(weights[order]), 0.5))
    made = Verdict(
        subject.name,
        _probabilities(of_orders),
        tuple(_probabilities(by_order(_under(found, values, factor), space)) for factor in FACTORS),
        float(np.logaddexp(*of_orders[1:]) - np.log(2.0) - of_orders[0]),
        float(sizes[order][min(middle, len(sizes) - 1)]),
        float(weights[sizes > SMALL].sum()),
        space[best].name,
        fit,
        data=tuple(data),
        notes=found.notes,
        p_first_stronger=_first_stronger(found, values),
    )
    if made.fit == "not described":
        scattering = [
            compose(subject.task, **{**dict(model.levels), "spread": "beta-binomial"})
            for model in space
        ]
        more = by_order(space_evidence(subject, prior, scattering, seed).log_evidence, scattering)
        made = replace(made, p_none_scattered=_probabilities(np.logaddexp(of_orders, more))[0])
    return made, found


def by_order(log_evidence: FloatArray, models: Sequence[Model]) -> FloatArray:
    """Log evidence of each order level, (models,) -> (3,): the mean over the models that have it, which are equally many."""
    of_level = [log_evidence[places] for places in places_by_order(models)]
    return np.array([logsumexp(some) - np.log(len(some)) for some in of_level])


def places_by_order(models: Sequence[Model]) -> list[list[int]]:
    """Of each level of the order, the places of the models that have it."""
    levels = [dict(model.levels)["order"] for model in models]
    return [[i for i, level in enumerate(levels) if level == order] for order in ORDERS]


def _probabilities(log_evidence: FloatArray) -> tuple[float, ...]:
    return tuple(softmax(log_evidence).tolist())


def _under(found: SpaceEvidence, values: FloatArray, factor: float) -> FloatArray:
    """The log evidences with the order's scales multiplied: sampled ones by their draws, others as those of their order on average."""
    other = replace(
        found.prior, **{name: factor * getattr(found.prior, name) for name in ORDER_SCALES}
    )
    moved, known = values.copy(), np.zeros(len(values), bool)
    for i, one in found.sampled.items():
        moved[i] += logsumexp(log_weights_under(one.fitted, other)) - logsumexp(
            one.fitted.draws.log_weights
        )
        known[i] = True
    for places in places_by_order(found.models):
        same = np.isin(np.arange(len(values)), places)
        if (same & known).any():
            moved[same & ~known] += (moved - values)[same & known].mean()
    return moved


def log_weights_under(fitted: FittedProposal, prior: Prior) -> FloatArray:
    """Log importance weights of its draws, (draws,), for the same model's posterior under another prior; without sampling again."""
    posterior, draws, log_weights = (
        fitted.proposal.posterior,
        fitted.draws,
        fitted.draws.log_weights.copy(),
    )
    assert isinstance(posterior, Posterior)
    if prior != posterior.prior:
        some = np.isfinite(
            log_weights
        )  # elsewhere the likelihood or the prior is 0, under any prior
        log_weights[some] += posterior.log_prior_under(draws.x[some], prior) - draws.log_prior[some]
    return log_weights


def _sizes(found: SpaceEvidence, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Draws of the effect's size over all models, and their weights, which sum to 1; a model that was not sampled as those of its order."""
    sizes, weights = [np.zeros(1)], [np.zeros(1)]
    p, (without, *others) = softmax(values), places_by_order(found.models)
    weights[0][0] = p[without].sum()
    for places in others:
        known = [i for i in places if i in found.sampled]
        for i in known:
            fitted = found.sampled[i].fitted
            posterior = fitted.proposal.posterior
            assert isinstance(posterior, Posterior)
            sizes.append(effect_size(posterior, fitted.draws.x))
            weights.append(fitted.draws.shares * p[i] * p[places].sum() / p[known].sum())
    joined = np.concatenate(weights)
    return np.concatenate(sizes), joined / joined.sum()


def _first_stronger(found: SpaceEvidence, values: FloatArray) -> float | None:
    """Posterior probability of a positive constant error, which makes the first stimulus seem stronger; None where none was sampled."""
    places = [i for i in places_by_order(found.models)[1] if i in found.sampled]
    if not places:
        return None
    drawn = [found.sampled[i].fitted.draws for i in places]  # the offset is the first coordinate
    return float(
        softmax(values[places]) @ [draws.shares @ (draws.x[:, 0] > 0.0) for draws in drawn]
    )
