"""H0: one free frequency per pair, uniform prior; its evidence is known in closed form."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from scipy.special import betaln

from bayes_toe.data.study import Subject
from bayes_toe.model.prior import Prior


@dataclass(frozen=True)
class FreeFrequencies:
    """The record of H0; its attributes are those of :class:`bayes_toe.model.record.Model`."""

    name: str = "free frequencies"
    about: str = "H0: one frequency per pair, and nothing that connects them"
    knows_intervals: bool = False
    of_intervals: str = "one frequency for each pair at each interval"
    levels: tuple[tuple[str, str], ...] = ()

    def units_at_intervals(self, reference: float) -> Mapping[str, str]:
        """None: a frequency has no unit."""
        return MappingProxyType({})

    def describe(self, prior: Prior) -> str:
        """The prior in words; it has no value to choose."""
        return "every frequency ~ Uniform(0, 1)"


FREE_FREQUENCIES = FreeFrequencies()


def frequency_evidence(subject: Subject) -> float:
    """Exact log evidence of H0, nats: one frequency per pair, uniform prior; sum of ln B(n_Eq + 1, n_Diff + 1)."""
    return float(betaln(subject.n_yes + 1.0, subject.n_trials - subject.n_yes + 1.0).sum())
