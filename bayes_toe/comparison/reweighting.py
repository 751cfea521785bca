"""The draws of one proposal as draws under another prior, and whether the two prior presets conclude alike.

Draws x of a fitted proposal g carry log likelihood and log g; under another prior pi' their importance weights are L(x) pi'(x) / g(x),
exactly, so nothing is sampled again. The largest weights are smoothed (PSIS, Vehtari et al. 2024). Where k-hat exceeds 0.7 or too few draws
count, a proposal is fitted under that prior and fresh draws are made.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp

from bayes_toe.arrays import FloatArray
from bayes_toe.comparison.words import order_effect, order_effect_and_probability
from bayes_toe.inference.adaptation import fit_proposal
from bayes_toe.inference.diagnostics import smoothed_unnormalised
from bayes_toe.inference.proposal import TRUSTED_EFFICIENCY, TRUSTED_K, FittedProposal, efficiency
from bayes_toe.inference.subject import Fitted
from bayes_toe.model.posterior import Posterior
from bayes_toe.model.prior import Prior
from bayes_toe.seeds import generator

REWEIGHTED, RESAMPLED = "reweighted", "resampled"
#: Effective draws below which re-weighted draws give way to fresh ones.
ENOUGH = 1000


class Weighted(NamedTuple):
    """Draws x, their log weights, k-hat and efficiency under some prior, and how they were made."""

    x: FloatArray
    log_weights: FloatArray
    pareto_k: float
    efficiency: float
    method: str

    @property
    def trusted(self) -> bool:
        """Whether averages over the weights can be trusted."""
        return self.pareto_k <= TRUSTED_K and self.efficiency > TRUSTED_EFFICIENCY

    @property
    def log_evidence(self) -> float:
        """Natural log."""
        return float(logsumexp(self.log_weights) - np.log(len(self.x)))


def under(fitted: FittedProposal, posterior: Posterior, wanted: Posterior, seed: int) -> Weighted:
    """The draws of a proposal for one posterior under the prior of another one of the same model; fresh ones where those do not do."""
    old = reweighted(fitted, posterior, wanted)
    if old.trusted and old.efficiency * len(old.x) >= ENOUGH:
        return old
    rng = generator(seed, wanted.subject.name, wanted.model.name, "sensitivity", wanted.model.describe(wanted.prior))
    return reweighted(fit_proposal(wanted, rng), wanted, wanted)._replace(method=RESAMPLED)


def reweighted(fitted: FittedProposal, posterior: Posterior, wanted: Posterior) -> Weighted:
    """The draws of a proposal that was fitted to one posterior as draws of the same model's under another prior."""
    draws = fitted.draws
    log_weights = draws.log_weights.copy()
    if wanted.prior != posterior.prior:
        some = np.isfinite(log_weights)  # elsewhere the likelihood or the prior is 0, under any prior
        log_weights[some] += posterior.log_prior_under(draws.x[some], wanted.prior) - draws.log_prior[some]
    made, k = smoothed_unnormalised(log_weights)
    return Weighted(draws.x, made, k, efficiency(made), REWEIGHTED)


# --- presets ------------------------------------------------------------------------------------------------------------------------

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
