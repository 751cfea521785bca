"""A mixture that is fitted to the posterior of one subject, for emcee and for an evidence.

`find_maxima` finds the maxima of the posterior, and `fit_posterior` fits the mixture.
`importance_evidence` computes the log evidence from draws that chose no mixture.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import cast

import numpy as np

from bayes_toe.arrays import AnyRng, FloatArray, Rng
from bayes_toe.inference.diagnostics import pareto_k
from bayes_toe.inference.engine import (
    SHARP,
    PriorMixture,
    fitted_draws,
    fresh_draws,
    mixture_of_clouds,
    normal_clouds,
)
from bayes_toe.inference.maxima import POLISH_GAIN, Ascent, ascend_from, polished
from bayes_toe.inference.mixture import WeightedDraws
from bayes_toe.inference.searches import funnel_of_maxima, observer_maxima, paper_maxima
from bayes_toe.model.models import ObserverPosterior
from bayes_toe.model.paper_model import FunnelArray, PaperPosterior
from bayes_toe.model.posterior import SubjectPosterior
from bayes_toe.model.posterior_array import PosteriorArray


@dataclass(frozen=True, eq=False)
class Fitted:
    """A mixture that is fitted to the posterior of one subject.

    Attributes
    ----------
    target : SubjectPosterior
    ends : Ascent
        Distinct ends of searches, the highest first, with all coordinates of the task: maxima, or
        several points along a ridge.
    array : PosteriorArray
        The posterior as an array of one posterior, in the coordinates w of the mixture.
    mixture : PriorMixture
    draws : WeightedDraws
        Draws of the mixture by which it was judged. The mixture would have been refitted if some of
        these draws had had large weights, so that an evidence needs other draws, see :meth:`fresh`.
    """

    target: SubjectPosterior
    ends: Ascent
    array: PosteriorArray
    mixture: PriorMixture
    draws: WeightedDraws

    @cached_property
    def pareto_k(self) -> float:
        """Pareto k of the weights."""
        return pareto_k(self.draws.log_weights)

    @property
    def is_trusted(self) -> bool:
        """Whether the mixture suffices for a mostly global sampler."""
        return is_trusted(self.pareto_k, self.draws.efficiency)

    @cached_property
    def maximum(self) -> FloatArray:
        """The highest maximum of the posterior, (k,)."""
        return _maxima_from(self.target, self.ends).x[0, self.target.is_free]

    def fresh(self, rng: AnyRng, size: int) -> WeightedDraws:
        """`size` further draws of the mixture."""
        (draws,) = fresh_draws(self.array, [self.mixture], [rng], size)
        return draws

    def original(self, w: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Points of the posterior, (points, k), and log |dw/du| there, (points,).

        Both follow from points w, (points, d), in the coordinates of the mixture. u are the d
        coordinates of the task, of which the model has k.
        """
        u, log_volume = self.array.original(w[None])
        return u[0][:, self.target.is_free], log_volume[0]


def is_trusted(k: float, efficiency: float) -> bool:
    """Whether averages by importance weights, and their errors, can be trusted.

    The limit of Pareto k is that of Vehtari et al. 2024. With an efficiency below 2 %, few draws
    have nearly all of the weight.
    """
    return k < 0.7 and efficiency > 0.02


def fit_posterior(
    target: SubjectPosterior, rng: Rng, judging_draws: int = SHARP.most_draws
) -> Fitted:
    """Fit a mixture to a posterior, precise enough for a sampler.

    `judging_draws` is how many draws decide whether the mixture is good enough.

    Examples
    --------
    >>> from bayes_toe.data.study import Subject
    >>> from bayes_toe.model.paper_model import paper_posterior
    >>> subject = Subject("S01", [0.0, 0.0, 0.3], [0.0, 0.3, 0.0], [49, 20, 15], [50, 50, 50])
    >>> fitted = fit_posterior(paper_posterior(subject), np.random.default_rng(1))
    >>> fitted.is_trusted
    True
    """
    ends = _distinct_ends(target)
    clouds = normal_clouds(ends, rng)
    posterior: PosteriorArray = target.array
    if isinstance(target, PaperPosterior):
        # A mixture cannot follow the funnel of this posterior. So `posterior`, an array of one
        # posterior, and the clouds get other coordinates, in which there is no funnel.
        funnel = funnel_of_maxima(target, ends)
        posterior = FunnelArray(
            posterior.likelihood,
            posterior.names,
            further_priors=(),
            is_free=posterior.is_free,
            funnel=funnel,
        )
        clouds = [funnel.forward(cloud[None])[0] for cloud in clouds]

    # `ends` keep the coordinates of the posterior. They only decide the weights of the clouds.
    first_mixture = mixture_of_clouds(clouds, ends, posterior, rng)
    precision = replace(SHARP, most_draws=judging_draws)
    (mixture,), (draws,) = fitted_draws(posterior, [first_mixture], [rng], precision)
    return Fitted(target, ends, posterior, mixture, draws)


def find_maxima(target: SubjectPosterior) -> Ascent:
    """Distinct maxima of a posterior, the highest first, with all coordinates of the task."""
    return _maxima_from(target, _distinct_ends(target))


def _maxima_from(target: SubjectPosterior, ends: Ascent) -> Ascent:
    """The distinct maxima that exact searches reach from the ends of coarse searches."""
    owners = np.zeros(len(ends.x), np.intp)  # all searches are of one posterior
    return polished(target.array, owners, ends.x).distinct()


def _distinct_ends(target: SubjectPosterior) -> Ascent:
    """Distinct points at which short searches end: maxima, or several points along a ridge.

    A mixture needs the points along a ridge. An exact search would move all of them to one maximum.
    """
    if isinstance(target, ObserverPosterior):
        (coarse_ends,) = observer_maxima(target.array)
    else:
        coarse_ends = paper_maxima(cast(PaperPosterior, target))
    starts = coarse_ends.distinct().x
    owners = np.zeros(len(starts), np.intp)  # all searches are of one posterior
    return ascend_from(target.array, owners, starts, least_gain=POLISH_GAIN).distinct()


@dataclass(frozen=True)
class Evidence:
    """Log evidence in nats, without binomial coefficients.

    Value and standard error are None where the evidence is withheld.
    """

    value: float | None
    se: float | None
    pareto_k: float  # of the importance weights
    why_withheld: str = ""  # empty if the evidence is not withheld


def importance_evidence(draws: WeightedDraws) -> Evidence:
    """Log evidence and its standard error from draws that chose no mixture.

    The estimate is the log of the mean weight. Its standard error is the error of the mean weight
    over the mean weight. The estimate is withheld, with a reason, if Pareto k and the efficiency of
    the weights say that neither number can be trusted, see :func:`is_trusted`.
    """
    k = pareto_k(draws.log_weights)
    efficiency = draws.efficiency
    if not is_trusted(k, efficiency):
        reason = (
            "evidence withheld: importance weights are unreliable "
            f"(Pareto k-hat {k:.2f}, efficiency {efficiency:.3f})"
        )
        return Evidence(value=None, se=None, pareto_k=k, why_withheld=reason)
    return Evidence(draws.log_evidence, draws.standard_error, k)
