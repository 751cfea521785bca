"""Hamiltonian Monte Carlo for the joint posterior of a group.

`sample_group` draws from several chains. If the draws are not reliable, it tries once more: with as
many further draws, or with shorter steps if trajectories diverged. `GroupDraws` has the draws.

All chains move together: every leapfrog step is one call of the log density for all of them,
because a gradient in NumPy costs much the same for one point as for a dozen. All trajectories have
the same mean length. The length of each trajectory is random, because a fixed length could bring a
coordinate back to its start every time.
The step size and the covariance of the coordinates are learnt during warm-up from all chains; then
both are fixed. A trajectory on which the energy grows by more than 1000 nats is divergent: it is
rejected and counted.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from bayes_toe.arrays import ArrayPair, BoolArray, FloatArray, Rng
from bayes_toe.groups.group_posterior import GroupPosterior
from bayes_toe.inference.diagnostics import Convergence, convergence_of, shortfall

Density = Callable[[FloatArray], ArrayPair]

#: Gain of energy, nats, and size of a momentum at which a trajectory is given up.
_LARGEST = 1000.0
#: Leapfrog steps of a trajectory.
_MOST_STEPS = 256
#: Draws of the rounds of warm-up.
_ROUNDS = (40, 40, 60, 80)
#: Decimals of positions during warm-up. Small differences grow until the metric is learnt.
_WARM_UP_DECIMALS = 4
#: Draws by which the first guess of a covariance counts.
_GUESS_WEIGHT = 5.0


class Metric:
    """Linear map from standard normal coordinates z to coordinates of a group, learnt from draws.

    Given the shared coordinates the subjects are independent, so that

        shared = S z_shared,    block_i = B_i shared + L_i z_i

    has room for every covariance of a normal posterior.

    Parameters
    ----------
    n_shared : int
        Number of the shared coordinates, which come first.
    n_blocks, block_size : int
        Number and size of the blocks behind the shared coordinates.
    """

    def __init__(self, n_shared: int, n_blocks: int, block_size: int) -> None:
        self._shared: FloatArray = np.eye(n_shared)  # S
        self._blocks = np.tile(np.eye(block_size), (n_blocks, 1, 1))  # L_i
        self._regression = np.zeros((n_shared, n_blocks * block_size))  # B_i', side by side

    def to_position(self, momentum: FloatArray) -> FloatArray:
        """The change of the position by a momentum, by the map; (chains, coordinates) both."""
        n_shared = len(self._shared)
        shared = momentum[:, :n_shared] @ self._shared.T
        # L_i z_i; points are rows, so that factors are transposed.
        blocks = self._multiply_blocks(momentum[:, n_shared:], self._blocks.swapaxes(1, 2))
        return np.concatenate([shared, blocks + shared @ self._regression], axis=1)

    def to_momentum(self, gradient: FloatArray) -> FloatArray:
        """The change of the momentum by a slope, by the transpose of the map.

        Both have the shape (chains, coordinates).
        """
        n_shared = len(self._shared)
        block_gradient = gradient[:, n_shared:]
        # Blocks move with the shared coordinates, and add their slopes to the shared slopes.
        shared = (gradient[:, :n_shared] + block_gradient @ self._regression.T) @ self._shared
        return np.concatenate([shared, self._multiply_blocks(block_gradient, self._blocks)], axis=1)

    def learn(self, draws: FloatArray) -> None:
        """Learn from draws, (draws, coordinates); the former map counts as a few draws more."""
        n_shared = len(self._shared)
        n_blocks, size, _ = self._blocks.shape
        weight = len(draws) / (len(draws) + _GUESS_WEIGHT)  # of the draws, against the former map
        centred = draws - draws.mean(axis=0)
        shared = centred[:, :n_shared]
        blocks = centred[:, n_shared:]
        (self._shared,) = _shrunk_root(shared[None], self._shared[None])  # (1, draws, n_shared)

        # B is the regression of the blocks on the shared coordinates, L the root of the residual
        # covariance. Before the first draws B is 0, toward which the weight shrinks the covariance.
        covariance = weight * shared.T @ blocks / len(draws)
        # S S' is the covariance of the shared coordinates.
        self._regression[:] = np.linalg.solve(self._shared @ self._shared.T, covariance)
        residual = (blocks - shared @ self._regression).reshape(-1, n_blocks, size)
        self._blocks = _shrunk_root(residual.swapaxes(0, 1), self._blocks)  # (blocks, draws, size)

    def _multiply_blocks(self, values: FloatArray, factors: FloatArray) -> FloatArray:
        """Each block of values, (chains, blocks x size), times its factor, (blocks, size, size)."""
        n_blocks, size, _ = factors.shape
        blocks = values.reshape(-1, n_blocks, size).swapaxes(0, 1)  # (blocks, chains, size)
        return (blocks @ factors).swapaxes(0, 1).reshape(values.shape)


def _shrunk_root(draws: FloatArray, root: FloatArray) -> FloatArray:
    """Cholesky factors of the covariances of centred draws, (blocks, draws, size).

    A covariance is shrunk toward that of the former factor, `root`, which counts as a few draws.
    """
    n_draws = draws.shape[1]
    weight = n_draws / (n_draws + _GUESS_WEIGHT)
    covariance = draws.swapaxes(1, 2) @ draws / n_draws
    guess = root @ root.swapaxes(1, 2)
    return np.linalg.cholesky(weight * covariance + (1.0 - weight) * guess)


class Hamiltonian:
    """Chains that sample a density together, by Hamiltonian Monte Carlo.

    Parameters
    ----------
    density : callable
        Points, (chains, coordinates) -> log density, (chains,), and its gradient.
    start : ndarray, shape (chains, coordinates)
    metric : Metric
    rng : Generator

    Attributes
    ----------
    step : float
        Size of a leapfrog step, in units of the metric.
    """

    def __init__(self, density: Density, start: FloatArray, metric: Metric, rng: Rng) -> None:
        self._density = density
        self._metric = metric
        self._rng = rng
        self._x = start.copy()
        self._value, self._gradient = density(start)
        # A good step falls with this power of the dimension; warm-up adapts it.
        self.step = 0.5 * start.shape[1] ** -0.25

    def warm_up(self) -> None:
        """Let the chains settle, then learn step and metric in rounds of :data:`_ROUNDS` draws.

        While chains settle, and in the first round, trajectories have few steps: without a metric
        they would be long. While chains settle, the step follows the worst chain.
        """
        self._adapt_step(n_draws=40, summary=np.min, most_steps=8)
        most_steps = 32  # of the first round
        for n_draws in _ROUNDS:
            draws = self._adapt_step(n_draws, most_steps=most_steps)
            late_draws = draws[n_draws // 4 :]  # while the step was near its value
            self._metric.learn(late_draws.reshape(-1, draws.shape[-1]))  # of all chains
            most_steps = _MOST_STEPS  # there is a metric now
        self._adapt_step(_ROUNDS[0])  # the step for the last metric

    def advance(
        self, n_draws: int, parameters: Callable[[FloatArray], Sequence[FloatArray]]
    ) -> tuple[list[FloatArray], int]:
        """Draws of the parameters, and how often a trajectory diverged.

        One in eight trajectories has steps of a fifth, so that a chain can leave a region in which
        the common step is too long.

        Parameters
        ----------
        n_draws : int
            Draws of each chain.
        parameters : callable
            Points, (chains, coordinates) -> the parameters, (chains, ...) each.

        Returns
        -------
        list of ndarray, shape (chains, draws, ...)
            The draws of each parameter.
        int
        """
        draws = []
        for values in parameters(self._x):
            draws.append(np.empty((len(values), n_draws, *values.shape[1:])))
        is_careful = self._rng.uniform(size=n_draws) < 0.125
        n_divergent = 0
        for t, factor in enumerate(np.where(is_careful, 0.2, 1.0).tolist()):
            _, is_divergent = self._move(factor)
            n_divergent += int(is_divergent.sum())
            for parameter_draws, values in zip(draws, parameters(self._x), strict=True):
                parameter_draws[:, t] = values
        return draws, n_divergent

    def _adapt_step(
        self,
        n_draws: int,
        summary: Callable[[FloatArray], float] = np.mean,
        most_steps: int = _MOST_STEPS,
    ) -> FloatArray:
        """Draws, (n_draws, chains, coordinates), while the step adapts to an acceptance of 0.9.

        The acceptance of a draw is the `summary` of those of the chains. The method is dual
        averaging.

        Source: Hoffman and Gelman 2014, section 3.2, with t_0 = 10, kappa = 0.75 and gamma = 0.1.

            H_t = H_(t-1) + (0.9 - acceptance - H_(t-1)) / (t + t_0)
            log step = mu - H_t t^(1/2) / gamma

        `anchor` is their mu, `error` their H, and `mean_log_step` a mean of the log steps in which
        the latest step has the share t^-kappa. This mean gives the step at the end.
        """
        # The source has 10 steps here, for a first step that is a rough guess.
        anchor = np.log(2.0 * self.step)
        error = 0.0
        mean_log_step = np.log(self.step)
        draws = []
        for t in range(1, n_draws + 1):
            acceptance, _ = self._move(most_steps=most_steps)
            # Rounded, positions are the same where processors differ in last bits.
            self._x = np.round(self._x, _WARM_UP_DECIMALS)
            self._value, self._gradient = self._density(self._x)
            draws.append(self._x)

            missing_acceptance = 0.9 - float(summary(acceptance))
            error += (missing_acceptance - error) / (t + 10.0)
            log_step = np.round(anchor - error * np.sqrt(t) / 0.1, _WARM_UP_DECIMALS)
            mean_log_step += t**-0.75 * (log_step - mean_log_step)
            self.step = float(np.exp(log_step))
        self.step = float(np.exp(np.round(mean_log_step, _WARM_UP_DECIMALS)))
        return np.stack(draws)

    def _move(
        self, factor: float = 1.0, most_steps: int = _MOST_STEPS
    ) -> tuple[FloatArray, BoolArray]:
        """Move every chain by a trajectory; return acceptances and whether it diverged, (chains,).

        The steps of this trajectory are those of the sampler times the factor.
        """
        # A standard normal coordinate is farthest from its start after pi, and back after 2 pi.
        # The length is between 1/4 and 5/4 of pi.
        length = 0.75 * np.pi * self._rng.uniform(1.0 / 3.0, 5.0 / 3.0)
        n_steps = min(most_steps, max(1, round(length / self.step)))
        # With the most steps a trajectory may end early: no step is longer than the common step.
        step = factor * min(length / n_steps, self.step)

        momentum = self._rng.standard_normal(self._x.shape)
        x, value, gradient, energy_gain = self._trajectory(momentum, n_steps, step)
        # Metropolis: a trajectory is accepted with the probability exp(-gain of energy).
        acceptance = np.exp(np.minimum(-energy_gain, 0.0))
        is_accepted = self._rng.uniform(size=len(x)) < acceptance
        self._x = np.where(is_accepted[:, None], x, self._x)
        self._value = np.where(is_accepted, value, self._value)
        self._gradient = np.where(is_accepted[:, None], gradient, self._gradient)
        return acceptance, np.isinf(energy_gain)

    def _trajectory(
        self, momentum: FloatArray, n_steps: int, step: float
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """The end of leapfrog steps from the present points: the chains themselves do not move.

        Returns the points, (chains, coordinates), their log density and gradient, and the gain of
        energy, (chains,), which is infinite if the trajectory diverged.
        """
        metric = self._metric
        x = self._x  # (chains, coordinates), as momentum
        first_energy = _kinetic(momentum) - self._value  # (chains,)
        push = 0.5 * step * metric.to_momentum(self._gradient)  # of half a step
        is_divergent = np.zeros(len(x), bool)
        for _ in range(n_steps):
            # A NaN is not below the limit, and counts as divergent. A chain that diverged waits for
            # the other chains without momentum.
            momentum = momentum + push
            is_divergent |= ~(np.abs(momentum).max(axis=1) < _LARGEST)
            momentum[is_divergent] = 0.0
            x = x + step * metric.to_position(momentum)
            value, gradient = self._density(x)
            push = 0.5 * step * metric.to_momentum(gradient)
            momentum = momentum + push
            energy_gain = _kinetic(momentum) - value - first_energy
            is_divergent |= ~(energy_gain < _LARGEST)
        return x, value, gradient, np.where(is_divergent, np.inf, energy_gain)


def _kinetic(momentum: FloatArray) -> FloatArray:
    """Kinetic energy of momenta, (chains, coordinates): half the sum of squares, (chains,)."""
    # Where the density is 0 its slope may be anything; such a trajectory is divergent.
    with np.errstate(over="ignore"):
        return 0.5 * np.square(momentum).sum(axis=1)


# --- A group -------------------------------------------------------------------------------------

MAX_R_HAT = 1.01
MIN_EFFECTIVE_DRAWS = 300
N_CHAINS = 4


@dataclass(frozen=True, eq=False)
class GroupDraws:
    """Draws of a group; q coefficients, N subjects.

    Attributes
    ----------
    mean, sd : ndarray, shape (chains, draws, q)
    effects : ndarray, shape (chains, draws, covariates, q)
    subjects : ndarray, shape (chains, draws, N, q + unshared)
        Coefficients of the subjects, then the parameters that the group does not share.
    n_divergent : int
        Trajectories that were given up.
    """

    mean: FloatArray
    sd: FloatArray
    effects: FloatArray
    subjects: FloatArray
    n_divergent: int = field(default=0, kw_only=True)

    @cached_property
    def convergence(self) -> Mapping[str, Convergence]:
        """Diagnostics of every mean, standard deviation and effect, by its number: 'quantity 1'."""
        effects = self.effects.reshape(*self.mean.shape[:2], -1)
        columns = np.concatenate([self.mean, self.sd, effects], axis=2)
        return convergence_of(
            {f"quantity {i + 1}": columns[..., i] for i in range(columns.shape[2])}
        )

    @property
    def shortfall(self) -> str:
        """The reasons why the draws are not reliable, in words; empty if they are reliable."""
        # The name of a quantity is a number, because these draws do not know the quantities.
        problems = [shortfall(self.convergence, MIN_EFFECTIVE_DRAWS, MAX_R_HAT)]
        if self.n_divergent:
            n_trajectories = math.prod(self.mean.shape[:2])
            problems.insert(0, f"{self.n_divergent} of {n_trajectories} trajectories diverged")
        return "; ".join(filter(None, problems))


def sample_group(posterior: GroupPosterior, n_draws: int, rng: Rng) -> GroupDraws:
    """Draws of the group from all chains together.

    If the draws are too few to be reliable, as many again are added to them. If trajectories
    diverged, twice as many draws by shorter steps take their place.
    """
    metric = Metric(posterior.n_shared, posterior.rows.n_subjects, posterior.rows.n_coordinates)
    start = posterior.start(N_CHAINS, rng)
    sampler = Hamiltonian(posterior, start, metric, rng)
    sampler.warm_up()

    n_each = math.ceil(n_draws / N_CHAINS)  # of each chain
    # The fields of GroupDraws, each with the shape (chains, draws, ...).
    arrays, n_divergent = sampler.advance(n_each, posterior.points)
    draws = GroupDraws(*arrays, n_divergent=n_divergent)
    if not draws.shortfall:  # a trajectory that diverged is a shortfall, too
        return draws

    if n_divergent:
        sampler.step *= 0.4  # shorter steps follow the density where it bends
        arrays, n_divergent = sampler.advance(2 * n_each, posterior.points)
    else:
        further_arrays, n_divergent = sampler.advance(n_each, posterior.points)
        pairs = zip(arrays, further_arrays, strict=True)
        arrays = [np.concatenate(pair, axis=1) for pair in pairs]  # along the draws
    return GroupDraws(*arrays, n_divergent=n_divergent)
