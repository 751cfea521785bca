"""Moves: known moments stay, weights, and the ratio of densities of the global one."""

from types import SimpleNamespace

import emcee
import numpy as np
from scipy.special import digamma, ndtri, polygamma

from bayes_toe.inference.engine import PriorMixture, fresh_draws
from bayes_toe.inference.fitted import Fitted
from bayes_toe.inference.mixture import StudentMixture
from bayes_toe.inference.sampling import moves
from bayes_toe.seeds import stream


class Target:
    """The log of a product of gammas: a skewed density with known moments."""

    shape = np.array([0.7, 1.5, 3.0, 8.0])

    def log_density(self, x):
        return (self.shape * x - np.exp(x)).sum(axis=1)

    def sample(self, random, size):
        return np.log(random.gamma(self.shape, size=(size, 4)))

    def truth(self):
        return digamma(self.shape), polygamma(1, self.shape)


class Array:
    """The target as an array of one, with a wide normal as its prior."""

    names = ("a", "b", "c", "d")
    is_free = np.ones((1, 4), np.bool_)

    def __init__(self, target):
        self.target = target

    def __len__(self):
        return 1

    def log_prior(self, w):
        return -0.5 * (np.square(w - 0.5) / 9 + np.log(2 * np.pi * 9)).sum(axis=-1)

    def prior_points(self, probability):
        return 0.5 + 3 * ndtri(probability)

    def densities(self, w):
        return self.log_prior(w), self.target.log_density(w[0])[None]


def _fitted_for(target):
    """A mixture deliberately off the target, so that a wrong acceptance rule shows."""
    student = StudentMixture(np.ones(1), np.full((1, 4), 0.4), 1.7 * np.eye(4)[None], 4)
    array = Array(target)
    mixture = PriorMixture(array.is_free[0], student)
    (draws,) = fresh_draws(array, [mixture], [np.random.default_rng(3)], 4000)
    posterior = SimpleNamespace(is_free=array.is_free[0])
    return Fitted(posterior, None, array, mixture, draws)


class Ensemble(emcee.EnsembleSampler):
    """An ensemble whose walkers carry the log density of a mixture."""

    def __init__(self, fitted, move):
        super().__init__(192, 4, self.compute_log_prob, vectorize=True, moves=[(move, 1.0)])
        self.fitted = fitted

    def compute_log_prob(self, coords):
        array = self.fitted.array
        log_proposal = self.fitted.mixture.log_density(coords, array.log_prior(coords))
        return array.target.log_density(coords), log_proposal


def _worst_moment(move, fitted, runs=16):
    """The largest |t| of means and variances over so many ensembles.

    They start from the target itself, which a wrong move leaves.
    """
    target = fitted.array.target
    mean, variance = target.truth()
    means, variances = [], []
    for k in range(runs):
        random = np.random.RandomState(np.random.MT19937(stream(11, "moments", k)))
        sampler = Ensemble(fitted, move)
        sampler.random_state = random.get_state()
        state = sampler.run_mcmc(target.sample(random, 192), 60, store=False)
        sampler.run_mcmc(state, 80)
        x = sampler.get_chain(flat=True)
        means.append(x.mean(axis=0))
        variances.append(np.square(x - mean).mean(axis=0))
    values = np.concatenate([means, variances], axis=1)
    error = values.std(axis=0, ddof=1) / np.sqrt(runs)
    return np.abs((values.mean(axis=0) - np.concatenate([mean, variance])) / error).max()


def test_the_global_move_leaves_known_moments_alone():
    """The other moves are emcee's own."""
    fitted = _fitted_for(Target())
    move, *_ = moves(fitted, fitted.draws)[0]
    # 8 looks at a t distribution with 15 degrees of freedom: |t| < 5 has a false-alarm rate near
    # 0.2 %.
    assert _worst_moment(move, fitted) < 5.0
