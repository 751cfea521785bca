"""emcee's own moves: the default stretch move, and differential evolution mixed with it; independent ensembles, vectorised."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.inference.modes import find_maxima
from bayes_toe.model.posterior import Posterior
from bayes_toe.seeds import stream
from speed.cases import Case
from speed.counting import Counting
from speed.method import Prepared
from speed.natural_target import NaturalTarget
from speed.outcome import CHAINS, Outcome, Verdict, natural_draws

ENSEMBLES, WALKERS, MANY_WALKERS = 4, 64, 256  # the package's own ensembles have 64 to 256
_NEAR = 20.0  # nats below the highest maximum: starting points are not farther out


def default_moves() -> list[tuple[Any, float]] | None:
    """What emcee does unasked: the stretch move."""
    return None


def differential_moves() -> list[tuple[Any, float]]:
    """Differential evolution (0.8) and stretch (0.2)."""
    from emcee.moves import DEMove, StretchMove

    return [(DEMove(), 0.8), (StretchMove(), 0.2)]


def identified(moves: Callable[[], list[tuple[Any, float]] | None]) -> Callable[[Case], Prepared]:
    """The sampler in unconstrained identified coordinates; effort is the number of steps."""

    def prepare(case: Case) -> Prepared:
        def run(effort: int, seed: int) -> Outcome:
            posterior = Counting(case.posterior)
            samplers = _run(posterior.log_density, _start(posterior, WALKERS), effort, seed, moves())
            draws = np.stack([_kept(sampler, effort) for sampler in samplers])
            return _outcome(natural_draws(*posterior.natural(draws)), posterior.evaluations, samplers, effort)

        return Prepared(run)

    return prepare


def natural(moves: Callable[[], list[tuple[Any, float]] | None], walkers: int = WALKERS) -> Callable[[Case], Prepared]:
    """The sampler in natural coordinates from the same starting points; effort is the number of steps."""

    def prepare(case: Case) -> Prepared:
        def run(effort: int, seed: int) -> Outcome:
            target = NaturalTarget(case.posterior)
            start = _start(case.posterior, walkers)

            def natural_start(random: np.random.RandomState) -> FloatArray:
                return np.stack(case.posterior.natural(start(random)), axis=-1)

            samplers = _run(target.log_density, natural_start, effort, seed, moves())
            return _outcome(np.stack([_kept(sampler, effort) for sampler in samplers]), target.evaluations, samplers, effort)

        return Prepared(run)

    return prepare


def _start(posterior: Posterior, walkers: int) -> Callable[[np.random.RandomState], FloatArray]:
    """Draws of the Gaussian at the highest maximum, shape (walkers, 4), none of them far out: a kind start.

    Directions in which the maximum is flat have a standard deviation of 1.
    """
    maxima = find_maxima(posterior)
    values, vectors = np.linalg.eigh(maxima.curvature[0])
    scale = 1.0 / np.sqrt(values if values[0] > 0.01 else np.maximum(values, 1.0))

    def draw(random: np.random.RandomState) -> FloatArray:
        points, shrink = np.empty((0, 4)), 1.0
        while len(points) < walkers:
            cloud = maxima.x[0] + shrink * (random.standard_normal((walkers, 4)) * scale) @ vectors.T
            theta = posterior.natural(cloud)
            usable = (posterior.log_density(cloud) > maxima.value[0] - _NEAR) & (theta.sigma_l < theta.sigma_p) & (theta.q0 < 1.0)
            points, shrink = np.concatenate([points, cloud[usable]]), 0.9 * shrink
        return points[:walkers]

    return draw


def _run(
    log_density: Callable[[FloatArray], FloatArray],
    start: Callable[[np.random.RandomState], FloatArray],
    steps: int,
    seed: int,
    moves: list[tuple[Any, float]] | None,
) -> list[Any]:
    import emcee

    samplers = []
    for index in range(ENSEMBLES):
        random = np.random.RandomState(np.random.MT19937(stream(seed, "ensemble", index)))
        first = start(random)
        sampler = emcee.EnsembleSampler(len(first), 4, log_density, vectorize=True, moves=moves)
        sampler.random_state = random.get_state()  # the only way to seed it
        sampler.run_mcmc(first, steps)
        samplers.append(sampler)
    return samplers


def _kept(sampler: Any, steps: int) -> FloatArray:
    """All but the first quarter, walker-major, shape (draws, 4)."""
    return np.asarray(sampler.get_chain(discard=steps // 4).transpose(1, 0, 2).reshape(-1, 4))


def _outcome(draws: FloatArray, evaluations: int, samplers: list[Any], steps: int) -> Outcome:
    return Outcome(CHAINS, draws, None, evaluations, evaluations, verdict=_verdict(samplers, steps))


def _verdict(samplers: list[Any], steps: int) -> Verdict:
    """emcee's own rule: chains longer than 50 autocorrelation times."""

    def verdict() -> tuple[bool, str]:
        tau = max(float(np.max(sampler.get_autocorr_time(discard=steps // 4, tol=0))) for sampler in samplers)
        return bool(steps - steps // 4 > 50 * tau), f"autocorrelation time {tau:.0f} steps"

    return verdict
