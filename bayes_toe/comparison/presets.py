"""Whether the two prior presets conclude alike on the order effect: the draws of the analysis itself, re-weighted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from bayes_toe.comparison.reweighting import under
from bayes_toe.comparison.words import order_effect, order_effect_and_probability
from bayes_toe.inference.subject import Fitted
from bayes_toe.model.posterior import Posterior
from bayes_toe.model.prior import Prior

#: Log evidences without order effect, with a constant error and with the update; None where one cannot be trusted.
Orders = tuple[float, ...] | None


@dataclass(frozen=True)
class UnderPresets:
    """The order effect of one subject under each preset.

    Attributes
    ----------
    subject : str
    orders : mapping of preset to log evidences
    """

    subject: str
    orders: Mapping[str, Orders]

    @property
    def differ(self) -> bool:
        """Whether the words for it are not the same."""
        return len({order_effect(found) for found in self.orders.values()}) > 1

    def describe(self) -> str:
        """One line.

        Examples
        --------
        >>> UnderPresets("S1", {"paper": (0.0, -3.0, -3.0), "stimuli": (0.0, 0.2, 4.0)}).describe()
        'S1: no order effect (P = 0.91) under --prior paper, update (P = 0.96) under --prior stimuli'
        """
        said = (f"{order_effect_and_probability(found)} under --prior {preset}" for preset, found in self.orders.items())
        return f"{self.subject}: {', '.join(said)}"


def under_presets(fitted: Sequence[Fitted], presets: Mapping[str, Prior], seed: int) -> UnderPresets:
    """The order effect under each preset, from what was fitted to the models without one, with a constant error and with the update."""
    orders = {preset: _orders(fitted, prior, seed) for preset, prior in presets.items()}
    return UnderPresets(_posterior(fitted[0]).subject.name, orders)


def _orders(fitted: Sequence[Fitted], prior: Prior, seed: int) -> Orders:
    found = [under(one.proposal, _posterior(one), replace(_posterior(one), prior=prior), seed) for one in fitted]
    return tuple(one.log_evidence for one in found) if all(one.trusted for one in found) else None


def _posterior(fitted: Fitted) -> Posterior:
    posterior = fitted.proposal.proposal.posterior
    assert isinstance(posterior, Posterior)  # of a composition, not of free frequencies
    return posterior


def say_presets(found: Sequence[UnderPresets]) -> tuple[str, ...]:
    """One line for each subject about whom the presets differ; one in all where they differ about none."""
    lines = tuple(one.describe() for one in found if one.differ)
    return lines if lines or not found else ("the presets --prior paper and --prior stimuli say the same of everybody's order effect",)
