"""Moves: known moments stay, weights, and the ratio of densities of the global one."""

from dataclasses import replace

import numpy as np
import pytest
from reference.hard_cases import hard_cases

from bayes_toe.inference.adaptation import fit_proposal
from bayes_toe.inference.sampling import GlobalMove, moves
from bayes_toe.model.paper_model import paper_posterior
from bayes_toe.seeds import generator, stream


class Target:
    """A known density in the place of a posterior: normal, or the log of a product of gammas (skewed, with known mean)."""

    def __init__(self, skewed):
        self.skewed = skewed
        self.shape = np.array([0.7, 1.5, 3.0, 8.0])

    def log_density(self, x):
        return (
            (self.shape * x - np.exp(x)).sum(axis=1)
            if self.skewed
            else -0.5 * np.square(x).sum(axis=1)
        )

    def sample(self, random, size):
        return (
            np.log(random.gamma(self.shape, size=(size, 4)))
            if self.skewed
            else random.standard_normal((size, 4))
        )

    def truth(self):
        from scipy.special import digamma, polygamma

        if not self.skewed:
            return np.zeros(4), np.ones(4)
        return digamma(self.shape), polygamma(1, self.shape)


def _fitted_for(target):
    """A proposal deliberately off the target, so that a wrong acceptance rule shows."""
    from bayes_toe.inference import proposal as module
    from bayes_toe.inference.proposal import StudentMixture

    class Known:
        log_density = staticmethod(target.log_density)

        def log_prior(self, x):
            return -0.5 * (np.square(x - 0.5) / 9 + np.log(2 * np.pi * 9)).sum(axis=1)

        def log_likelihood(self, x):
            return target.log_density(x) - self.log_prior(x)

        def sample_prior(self, rng, size):
            return 0.5 + 3 * rng.standard_normal((size, 4))

    class Same:
        forward = staticmethod(lambda x: (x, np.zeros(len(x))))
        inverse = staticmethod(lambda y: (y.copy(), np.zeros(len(y))))

    one = StudentMixture(np.ones(1), np.full((1, 4), 0.4), 1.7 * np.eye(4)[None], 4)
    made = module.Proposal(Known(), Same(), one, one, 0.05)
    return module.FittedProposal(
        made, module.importance_draws(made, np.random.default_rng(3), 4000), 0.5, 0.1
    )


def _worst_moment(move, target, index, runs=16):
    """The largest |t| of means and variances over so many ensembles.

    They start from the target itself, which a wrong move leaves.
    """
    import emcee

    mean, variance = target.truth()
    means, variances = [], []
    for k in range(runs):
        random = np.random.RandomState(np.random.MT19937(stream(11, "moments", index, k)))
        sampler = emcee.EnsembleSampler(
            192, 4, target.log_density, vectorize=True, moves=[(move, 1.0)]
        )
        sampler.random_state = random.get_state()
        state = sampler.run_mcmc(target.sample(random, 192), 60, store=False)
        sampler.run_mcmc(state, 80)
        x = sampler.get_chain(flat=True)
        means.append(x.mean(axis=0))
        variances.append(np.square(x - mean).mean(axis=0))
    sides = ((np.array(means), mean), (np.array(variances), variance))
    return max(
        np.abs(
            (found.mean(axis=0) - truth) / (found.std(axis=0, ddof=1) / np.sqrt(len(found)))
        ).max()
        for found, truth in sides
    )


@pytest.mark.parametrize("skewed", [False, True])
@pytest.mark.parametrize("index", [0, 1, 2], ids=["global", "differential evolution", "stretch"])
def test_every_move_that_is_used_leaves_known_moments_alone(index, skewed):
    target = Target(skewed)
    fitted = _fitted_for(target)
    move = moves(fitted, fitted.draws)[index][0]
    assert type(move).__name__ != "DESnookerMove"
    # 8 looks at a t distribution with 15 degrees of freedom, 6 parametrisations: |t| < 5 has a
    # false-alarm rate near 0.8 %.
    assert _worst_moment(move, target, index) < 5.0


def density(fitted, x):
    return fitted.proposal.log_density(x, fitted.proposal.posterior.log_prior(x))


def global_move(fitted):
    return GlobalMove(fitted.proposal, fitted.draws)


@pytest.fixture(scope="module")
def fitted():
    return fit_proposal(paper_posterior(hard_cases()["funnel"]), generator(1, "move", "proposal"))


def test_the_moves_are_weighted_to_one_and_local_where_the_proposal_is_poor(fitted):
    assert sum(weight for _, weight in moves(fitted, fitted.draws)) == pytest.approx(1.0)
    poor = replace(fitted, pareto_k=1.2)
    assert moves(poor, fitted.draws)[0][1] < 0.5 < moves(fitted, fitted.draws)[0][1]


def test_the_global_move_deals_the_judging_draws_and_then_new_ones_with_their_densities(fitted):
    first, random = fitted.draws.part(slice(1000)), np.random.RandomState(1)
    dealt = list(map(GlobalMove(fitted.proposal, first).take, [300] * 5, [random] * 5))
    assert np.array_equal(np.concatenate([one.x for one in dealt[:3]]), first.x[:900])
    for one in dealt:
        assert one.log_posterior == pytest.approx(
            fitted.proposal.posterior.log_density(one.x), rel=1e-12, abs=1e-12
        )
        assert one.log_proposal == pytest.approx(density(fitted, one.x), rel=1e-9, abs=1e-9)
    assert not np.isin(dealt[3].x, first.x).any()
