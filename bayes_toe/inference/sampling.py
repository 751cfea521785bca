"""Posterior draws of one subject by independent ensembles of emcee, with a rule for stopping.

`sample_chains` runs the ensembles until `SamplerSettings` are met.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import emcee
import numpy as np

from bayes_toe.arrays import ArrayPair, FloatArray, NamedArrays
from bayes_toe.errors import NumericalError, require_number
from bayes_toe.inference.diagnostics import Convergence, convergence_of, shortfall, tail_error
from bayes_toe.inference.fitted import Fitted
from bayes_toe.inference.mixture import WeightedDraws
from bayes_toe.seeds import stream

_BATCH = 1024  # draws made at once when the draws of the judging are used up


@dataclass(frozen=True)
class SamplerSettings:
    """Settings of the sampler, and criteria at which it stops.

    Parameters
    ----------
    draws : int
        Bulk and tail effective draws to reach for every judged quantity.
    ensembles : int
        Independent ensembles (chains), at least 4.
    walkers : int
        Walkers of an ensemble, even and at least 8. 0, the default, stands for a walker for every
        forty draws, 64 to 256: many short walks cost less than few long ones, because a step of an
        ensemble costs much the same however many walkers it has.
    max_r_hat : float
        Largest rank-normalised split R-hat.
    max_thin : int
        Limit on the effort: sampling gives up after a pass that keeps only every max_thin-th step.
    max_quantile_error : float
        Largest Monte Carlo standard error of the 5 and 95 % quantiles of natural quantities, in
        units of the range between the two.

    Raises
    ------
    InputError
        If the number of draws is not allowed.
    """

    draws: int = 4000
    ensembles: int = 4
    walkers: int = 0
    max_r_hat: float = 1.01
    max_thin: int = 64
    max_quantile_error: float = 0.05

    def __post_init__(self) -> None:
        require_number("draws", self.draws)
        if self.walkers == 0:  # a walker for every forty draws, even, 64 to 256
            object.__setattr__(self, "walkers", 2 * min(128, max(32, self.draws // 80)))

    @property
    def kept_steps(self) -> int:
        """Steps that are kept of every walker, at least 16.

        All walkers together keep at least twice the effective draws asked for, and at least 10,000
        draws: with fewer, even independent ones leave quantiles in long tails too uncertain.
        """
        n_draws = max(2 * self.draws, 10_000)
        return max(16, math.ceil(n_draws / (self.ensembles * self.walkers)))

    @property
    def required(self) -> int:
        """Effective draws to reach: as many as asked for, but at least four a walker.

        With fewer, walkers that never moved from dispersed starts would pass for a converged
        sample.
        """
        return max(self.draws, 4 * self.ensembles * self.walkers)


@dataclass(frozen=True, eq=False)
class Chains:
    """Draws of one subject.

    Every thin-th step of the final pass is kept. All earlier steps of a walker are burn-in. If the
    chains have converged and a quantile is `imprecise`, more draws make it precise.

    Attributes
    ----------
    x : ndarray, shape (ensembles, draws, k)
        Unconstrained coordinates, walker-major within an ensemble.
    log_posterior : ndarray, shape (ensembles, draws)
    acceptance : ndarray, shape (ensembles,)
        Share of accepted proposals.
    diagnostics : dict of Convergence
        Diagnostics of every judged quantity.
    thin, steps : int
        Steps of a walker for each draw of the final pass, and all its steps with the burn-in.
    reason : str
        The criteria that were not reached; empty if the chains have converged.
    imprecise : str
        The quantile that is not precise enough, and how many draws would do; empty if all quantiles
        are precise enough.
    """

    x: FloatArray
    log_posterior: FloatArray
    acceptance: FloatArray
    diagnostics: dict[str, Convergence]
    thin: int
    steps: int
    reason: str
    imprecise: str

    @property
    def converged(self) -> bool:
        """Whether all criteria are met, except that of quantiles."""
        return not self.reason


def sample_chains(fitted: Fitted, settings: SamplerSettings, seed: int) -> Chains:
    """Run the ensembles until every judged quantity meets the settings, or up to their limit.

    Each pass goes on from where the last one ended and replaces its draws. It keeps the same number
    of draws over twice as many steps. So from the second pass on about half of all steps are
    burn-in, and the number of kept draws does not grow.
    """
    posterior = fitted.target
    ensembles = [_Ensemble(fitted, settings, seed, k) for k in range(settings.ensembles)]
    steps = burn_in(fitted)
    # With a lower efficiency, two draws of successive steps are worth less than one effective draw.
    thin = 2 if fitted.draws.efficiency < 0.8 and settings.max_thin > 1 else 1

    while True:
        passes = [ensemble.advance(thin, settings.kept_steps) for ensemble in ensembles]
        steps += thin * settings.kept_steps
        # Shapes (ensembles, draws, k), (ensembles, draws) and (ensembles,).
        x, log_posterior, acceptance = map(np.stack, zip(*passes, strict=True))

        quantities = posterior.quantities(x)
        diagnostics = diagnose(quantities, posterior.names.same_ranks)
        reason = shortfall(diagnostics, settings.required, settings.max_r_hat)
        if reason:  # the precision of quantiles is known only of converged chains
            imprecise = ""
            is_done = False
        else:
            natural = {name: quantities[name] for name in posterior.names.natural}
            limit = settings.max_quantile_error
            imprecise, is_hopeless = _uncertain_quantile(natural, diagnostics, limit)
            is_done = not imprecise or is_hopeless

        if is_done or thin >= settings.max_thin:
            return Chains(x, log_posterior, acceptance, diagnostics, thin, steps, reason, imprecise)
        thin = min(2 * thin, settings.max_thin)


def diagnose(quantities: NamedArrays, same_ranks: Mapping[str, str]) -> dict[str, Convergence]:
    """Diagnostics of every quantity, from its draws, (chains, draws).

    All diagnostics follow from ranks. So a quantity with the same ranks as another one has its
    diagnostics, which are not computed twice.
    """
    ranked = {name: draws for name, draws in quantities.items() if name not in same_ranks}
    diagnostics = convergence_of(ranked)
    for name, other in same_ranks.items():
        diagnostics[name] = diagnostics[other]
    return diagnostics


def burn_in(fitted: Fitted) -> int:
    """Steps before the first pass: until one walker in a thousand stands where it started.

    At a step, a walker moves with a probability p of about the efficiency of the proposal, and
    (1 - p)^steps = 1/1000. At most 8 steps, and 8 if the mixture cannot be trusted.
    """
    if not fitted.is_trusted:
        return 8
    n_steps = np.log(1e-3) / np.log1p(-fitted.draws.efficiency)
    return min(8, int(np.ceil(n_steps)))


class GlobalMove(emcee.moves.Move):  # type: ignore[misc]  # emcee has no types
    """Independence Metropolis move: all walkers propose from the fitted mixture at once.

    The first proposals are the draws by which the mixture was judged, because their posterior
    densities are known. Later proposals are drawn in large batches. The first draws are selected,
    since draws with very large weights would have led to another mixture. The selection concerns
    some ten-thousandths of the posterior, far less than the Monte Carlo error of as many draws.
    """

    def __init__(self, fitted: Fitted, first_draws: WeightedDraws) -> None:
        self.fitted = fitted
        self._unused_draws = first_draws

    def propose(self, model: Any, state: Any) -> tuple[Any, Any]:
        """One step of all walkers, as emcee asks for it."""
        n_walkers = len(state.coords)
        if len(self._unused_draws.x) < n_walkers:
            self._unused_draws = self.fitted.fresh(model.random, max(n_walkers, _BATCH))
        draws = self._unused_draws.part(slice(n_walkers))
        self._unused_draws = self._unused_draws.part(slice(n_walkers, None))

        # An independence move accepts with the ratio of importance weights, new over old.
        log_proposal = state.blobs  # the density of the mixture at the walkers: compute_log_prob
        log_weights = state.log_prob - log_proposal
        log_ratio = draws.log_weights - log_weights
        is_accepted = np.log(model.random.rand(n_walkers)) < log_ratio
        coordinates = draws.x[:, self.fitted.target.is_free]
        proposed = emcee.State(coordinates, draws.log_posterior, draws.log_proposal)
        return self.update(state, proposed, is_accepted), is_accepted


class _Ensemble(emcee.EnsembleSampler):  # type: ignore[misc]  # emcee has no types
    """One ensemble with a random stream of its own, after its burn-in.

    Walkers have the coordinates of the mixture. The better the mixture, the fewer moves are local;
    most moves are local if the mixture cannot be trusted. emcee's snooker move is never used: in
    release 3.1.6 it is biased.
    """

    def __init__(self, fitted: Fitted, settings: SamplerSettings, seed: int, index: int) -> None:
        self._fitted = fitted
        target = fitted.target
        key = stream(seed, target.subject.name, target.model_name, "ensemble", index)
        random = np.random.RandomState(np.random.MT19937(key))
        # Each ensemble begins with its own part of the draws that judged the mixture.
        n_each = len(fitted.draws.x) // settings.ensembles
        first_draws = fitted.draws.part(slice(index * n_each, (index + 1) * n_each))
        # The share of local moves.
        if fitted.is_trusted:  # 2 to 32 %
            share_local = 0.02 + 0.3 * (1.0 - fitted.draws.efficiency)
        else:
            share_local = 0.8

        super().__init__(
            settings.walkers,
            len(target.coordinates),
            self.compute_log_prob,
            vectorize=True,
            moves=[  # each with its probability
                (GlobalMove(fitted, first_draws), 1.0 - share_local),
                (emcee.moves.DEMove(), 0.8 * share_local),
                (emcee.moves.StretchMove(), 0.2 * share_local),
            ],
        )

        # emcee ignores a seed or a Generator in silence; only the state of a RandomState reaches
        # it.
        self.random_state = random.get_state()
        start = self._dispersed_starts(random)
        self._state = self._run(start, burn_in(fitted), store=False)

    def advance(self, thin: int, n_steps: int) -> tuple[FloatArray, FloatArray, float]:
        """Draws of one pass, (walkers x steps, k), walker-major, log densities and acceptance.

        Draws and densities are in the coordinates of the posterior, not of the mixture.
        """
        self.reset()
        self._state = self._run(self._state, n_steps, thin_by=thin)

        chain = self.get_chain()  # (steps, walkers, k)
        walker_major = chain.transpose(1, 0, 2).reshape(-1, chain.shape[2])
        (w,) = self._fitted.target.full_points(walker_major)  # of the one posterior
        x, log_volume = self._fitted.original(w)
        log_density = self.get_log_prob().T.ravel() + log_volume
        return x, log_density, float(np.mean(self.acceptance_fraction))

    def compute_log_prob(self, coords: FloatArray) -> ArrayPair:
        """Log posterior density, and the log density of the mixture, (points,) each.

        emcee stores the density of the mixture with each walker, as its blob: a global move needs
        this density where the walker stands.
        """
        w = self._fitted.target.full_points(coords)  # (1, points, d), of the one posterior
        (log_prior,), (log_posterior,) = self._fitted.array.densities(w)
        if np.isnan(log_posterior).any():
            name = self._fitted.target.subject.name
            raise NumericalError(f"subject {name!r}: log posterior is NaN")
        return log_posterior, self._fitted.mixture.log_density(w[0], log_prior)

    def _run(self, state: Any, steps: int, **options: Any) -> Any:
        """The state after further steps.

        emcee would refuse walkers that are close to one plane, which local moves cannot leave. A
        posterior may be so thin (100 million trials), and global moves do leave the plane.
        """
        return self.run_mcmc(state, steps, skip_initial_state_check=True, **options)

    def _dispersed_starts(self, random: np.random.RandomState) -> emcee.State:
        """Starting points wider than the posterior: draws, at twice the distance from the mean.

        A point of zero density is replaced: emcee would leave a walker there for good, without a
        word.
        """
        draws = self._fitted.draws
        is_free = self._fitted.target.is_free
        mean = (draws.shares @ draws.x)[is_free]  # (k,)

        starts = np.empty((0, self.ndim))
        while len(starts) < self.nwalkers:
            resampled = draws.resampled(random, self.nwalkers)[:, is_free]
            # Resampled points repeat, and walkers must not: each point goes a tenth of the way away
            # from another point.
            jitter = 0.1 * (resampled - resampled[::-1])
            points = mean + 2.0 * (resampled + jitter - mean)
            log_density, _ = self.compute_log_prob(points)
            starts = np.concatenate([starts, points[np.isfinite(log_density)]])
        return emcee.State(starts[: self.nwalkers])


def _uncertain_quantile(
    natural: NamedArrays, diagnostics: Mapping[str, Convergence], limit: float
) -> tuple[str, bool]:
    """The most uncertain 5 or 95 % quantile in words, and whether a longer run cannot help.

    The text is empty if that quantile is precise enough. A longer run keeps as many draws, and
    cannot help if as many independent draws would not be enough.

    `natural` has the draws of the natural quantities, and `limit` is that of
    :attr:`SamplerSettings.max_quantile_error`.
    """
    errors = {
        name: tail_error(draws, diagnostics[name].ess_tail) for name, draws in natural.items()
    }
    worst = max(errors, key=lambda name: np.nan_to_num(errors[name], nan=np.inf))
    if errors[worst] < limit:
        return "", False

    # The error goes as one over the root of the number of draws. A user asks for half of the draws
    # that are kept, and gets a number with two digits whose error is 85 % of the limit.
    draws = natural[worst]
    n_required = draws.size / 2 * (errors[worst] / (0.85 * limit)) ** 2
    unit = 10 ** (int(np.log10(n_required)) - 1)  # of the second digit: 1000 of 12345
    n_rounded = int(np.ceil(n_required / unit)) * unit
    reason = (
        f"a 5 or 95 % quantile of {worst} is uncertain by {errors[worst]:.3f} of the range between "
        f"them, below {limit:g} wanted: {n_rounded:,} draws would do"
    )
    is_hopeless = not tail_error(draws, draws.size) < limit  # also where the error is NaN
    return reason, is_hopeless
