"""Conditions within the subjects of a group: how much each parameter differs on average, and how far subjects differ in that.

    eta_sc = eta_s + X_c d_s,    d_s ~ Normal(beta, tau_b^2),    beta ~ Normal(0, h unit),    tau_b ~ HalfNormal(h unit),

with X, h and the units of :mod:`bayes_toe.model.contrasted`. So d are parameters of a subject like any others, with a mean beta and a
scatter tau_b of their own, and the sampler of groups takes them as such; only the likelihood of a subject is a product over conditions.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, cast

import numpy as np

from bayes_toe.arrays import FloatArray, IntArray
from bayes_toe.data.conditions import Conditions
from bayes_toe.data.study import Subject
from bayes_toe.groups.chains import GroupChains
from bayes_toe.groups.hyperprior import HyperpriorNumbers
from bayes_toe.groups.subjects import GroupLikelihood, centre_of
from bayes_toe.model.contrasted import DIFFERENCE, QUANTITIES, Contrasted, contrasted, unit_of
from bayes_toe.model.posterior import Posterior
from bayes_toe.model.prior import Prior
from bayes_toe.model.record import Model

#: What may differ between conditions, in the order of parameters.
DIFFERING = ("constant error", "pull", "width")


class _Aligned(NamedTuple):
    """A subject's answers in one condition at all pairs of the subject, of which some may have none."""

    s1: FloatArray
    s2: FloatArray
    n_yes: IntArray
    n_trials: IntArray
    isi: FloatArray | None
    n_pairs: int
    name: str
    felt: Any = None


@dataclass(frozen=True, eq=False)
class Differences:
    """Which parameters of a model differ between conditions, and how.

    `units` has by subject its answers in each condition that it met. There is an entry for each group parameter that differs and each
    column of the design: `names` and `columns` say of which it is. `chains` are draws of the differences, once there are any: means,
    scatters and those of every subject.
    """

    conditions: Conditions
    units: Mapping[str, tuple[Subject, ...]]
    names: tuple[str, ...]
    columns: tuple[int, ...]
    chains: GroupChains | None = None

    @classmethod
    def of(
        cls, conditions: Conditions, units: Mapping[str, tuple[Subject, ...]], model: Model
    ) -> Differences:
        """Those of a model, before sampling."""
        moved = [name for name in model.group if any(name in QUANTITIES[key] for key in DIFFERING)]
        count = conditions.design().shape[1]
        return cls(
            conditions,
            units,
            tuple(name for name in moved for _ in range(count)),
            tuple(range(count)) * len(moved),
        )

    def numbers(self, given: HyperpriorNumbers, prior: Prior) -> HyperpriorNumbers:
        """The hyperprior of a subject's parameters with that of the differences behind it; `prior` has the scales of the study."""
        spread = np.array([DIFFERENCE * unit_of(name, prior) for name in self.names])
        joined = {
            key: np.concatenate([getattr(given, key), spread])
            for key in ("mean_sd", "sd_scale", "effect_sd")
        }
        return HyperpriorNumbers(
            np.concatenate([given.mean, np.zeros_like(spread)]), **joined, lkj=given.lkj
        )

    def posterior(
        self, person: str, whole: Subject, model: Model, prior: Prior, centre: float
    ) -> Contrasted:
        """A subject's posterior without the group."""
        own, same = (
            self.units[person],
            Posterior(whole, model, prior, centre=centre_of(model, whole, centre)),
        )
        met = [self.conditions.levels.index(one.condition) for one in own]
        return contrasted(same, own, self.conditions.design()[met], DIFFERING)

    @property
    def places(self) -> dict[str, list[int]]:
        """Entries of each parameter that differs."""
        return {
            name: [i for i, one in enumerate(self.names) if one == name]
            for name in dict.fromkeys(self.names)
        }

    def between(self, level: str, reference: str) -> FloatArray:
        """What each entry adds to the difference of two levels, shape (entries,)."""
        names = [*self.places]
        return np.asarray((self.at(level, names) - self.at(reference, names)).sum(axis=1))

    def at(self, level: str, names: Sequence[str]) -> FloatArray:
        """What each entry adds to the parameters at a level, shape (entries, k)."""
        found, x = (
            np.zeros((len(self.names), len(names))),
            self.conditions.design()[self.conditions.levels.index(level)],
        )
        found[np.arange(len(found)), [names.index(name) for name in self.names]] = x[
            list(self.columns)
        ]
        return found

    @property
    def drawn(self) -> GroupChains:
        """The draws, which there are once a group was sampled."""
        assert self.chains is not None
        return self.chains

    def on_average(self) -> dict[str, FloatArray]:
        """Draws of the mean difference in every parameter that differs, (chains, draws, comparisons)."""
        steps = np.stack([self.between(*pair) for pair in self.conditions.comparisons], axis=1)
        return {
            name: self.drawn.mean[..., some] @ steps[some] for name, some in self.places.items()
        }

    def split(self, chains: GroupChains) -> tuple[GroupChains, Differences]:
        """Draws of all parameters as those of a subject at the middle of the conditions, and these differences."""
        k = chains.mean.shape[-1] - len(self.names)
        return _some(chains, slice(0, k)), replace(self, chains=_some(chains, slice(k, None)))


def _some(chains: GroupChains, some: slice) -> GroupChains:
    """The draws of some parameters."""
    places = range(chains.mean.shape[-1])[some]
    judged = {
        (kind, i, place - places[0]): one
        for (kind, i, place), one in chains.convergence.items()
        if place in places
    }
    parts = {key: getattr(chains, key)[..., some] for key in ("mean", "scatter", "effects", "eta")}
    return replace(
        chains, **parts, convergence=judged, subject_convergence=chains.subject_convergence[:, some]
    )


class ConditionLikelihood:
    """The likelihood of every subject over its conditions, as :class:`~bayes_toe.groups.subjects.GroupLikelihood` has that of one.

    Points are subjects' parameters with the differences behind them, (copies, N, k + entries).
    """

    def __init__(
        self,
        model: Model,
        prior: Prior,
        people: Sequence[Subject],
        differences: Differences,
        centre: float,
        copies: int,
    ) -> None:
        self._k, self._parts = len(model.group), list[tuple[FloatArray, GroupLikelihood]]()
        # of a condition alone the mean first stimulus is another one: all stimuli count from that of the subject
        away = [centre_of(model, one, centre) - centre for one in people]
        for level in differences.conditions.levels:
            aligned = [_aligned(one, differences.units[one.name], level) for one in people]
            part = GroupLikelihood(
                model, prior, cast("list[Subject]", aligned), centre, copies, away
            )
            self._parts.append((differences.at(level, model.group), part))

    def __call__(self, eta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Values, (copies, N), and their gradient, (copies, N, k + entries)."""
        value, gradient = np.zeros(eta.shape[:-1]), np.zeros(eta.shape)
        for at, (step, part) in self._at(eta):
            of_part, slope = part(at)
            value += of_part
            gradient[..., : self._k] += slope
            gradient[..., self._k :] += slope @ step.T
        return value, gradient

    def repeated(self, eta: FloatArray, rng: np.random.Generator) -> IntArray:
        """Counted answers of all conditions if everything were done once more, (copies, N, k + entries) -> (copies, N, pairs)."""
        return np.asarray(sum(part.repeated(at, rng) for at, (_, part) in self._at(eta)))

    def _at(
        self, eta: FloatArray
    ) -> Iterator[tuple[FloatArray, tuple[FloatArray, GroupLikelihood]]]:
        for step, part in self._parts:
            yield eta[..., : self._k] + eta[..., self._k :] @ step, (step, part)


def _aligned(whole: Subject, units: Sequence[Subject], level: str) -> _Aligned:
    """The answers at a level, 0 to pairs that were not shown there; the pairs are those of all conditions."""
    keys = [key for key in ("s1", "s2", "isi") if getattr(whole, key) is not None]
    place = {
        pair: i
        for i, pair in enumerate(zip(*(getattr(whole, key).tolist() for key in keys), strict=True))
    }
    counts = np.zeros((2, whole.n_pairs), np.int64)
    for one in units:
        if one.condition == level:
            at = [
                place[pair]
                for pair in zip(*(getattr(one, key).tolist() for key in keys), strict=True)
            ]
            counts[:, at] = one.n_yes, one.n_trials
    return _Aligned(whole.s1, whole.s2, counts[0], counts[1], whole.isi, whole.n_pairs, whole.name)
