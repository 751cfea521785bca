"""Members alone: with each subject's own prior in the place of the population, the group's sampler returns their own posteriors."""

import numpy as np
import pytest
from conftest import observer_counts

import bayes_toe as bt
from bayes_toe.groups.alone import alone
from bayes_toe.groups.hamiltonian import Hamiltonian
from bayes_toe.groups.members import MembersLikelihood
from bayes_toe.inference.diagnostics import convergence, errors
from bayes_toe.model.ladder import PREDICTIVE_UPDATE
from bayes_toe.model.posterior import Posterior
from bayes_toe.model.prior import Prior

#: Narrower than the default, so that a sampler without its own coordinates for a funnel gets around.
PRIOR = Prior(mu1_mean=0.2, mu1_sd=0.7, sigma_p_scale=0.5)
CENTRE = 0.25
PROBABILITIES = (0.05, 0.25, 0.5, 0.75, 0.95)


@pytest.fixture(scope="module")
def study():
    kinds = {"A": (-0.7, 0.25, 0.17, 0.92), "B": (1.2, 0.25, 0.18, 0.9), "C": (0.25, 0.22, 0.02, 0.6)}
    return bt.Study([bt.Subject(name, *observer_counts(*kind, n=20)) for name, kind in kinds.items()])


def own_prior(eta):
    """Its log density with respect to (mu1, probit gamma, log w, probit q0), and the gradient: sigma_p = w K^(3/2), K = 1 - p."""
    pulled = PREDICTIVE_UPDATE.free[0].group_pull(eta[..., 1])
    log_sd = eta[..., 2] + 1.5 * np.log1p(-pulled.pull) - np.log(PRIOR.sigma_p_scale)
    score, square = (eta[..., 0] - PRIOR.mu1_mean) / PRIOR.mu1_sd, np.exp(2.0 * log_sd)
    constant = 0.5 * np.log(2.0 / np.pi) - 1.5 * np.log(2.0 * np.pi) - np.log(PRIOR.mu1_sd)
    value = constant - 0.5 * (score**2 + square + eta[..., 1] ** 2 + eta[..., 3] ** 2) + log_sd
    by_pull = -1.5 * pulled.rise / (1.0 - pulled.pull) * (1.0 - square)
    return value, np.stack([-score / PRIOR.mu1_sd, by_pull - eta[..., 1], 1.0 - square, -eta[..., 3]], axis=-1)


def test_the_own_prior_is_that_of_the_posterior(study):
    eta = np.random.default_rng(1).normal(0.0, 1.5, (40, 4))
    posterior = Posterior(study["A"], PREDICTIVE_UPDATE, PRIOR, centre=CENTRE)
    x, jacobian = posterior.from_group(eta)
    value, gradient = own_prior(eta)
    assert value == pytest.approx(posterior.log_prior(x) + np.linalg.slogdet(jacobian)[1], rel=1e-12)
    for j in range(4):
        h = 1e-4 * np.eye(4)[j]
        assert gradient[:, j] == pytest.approx((own_prior(eta + h)[0] - own_prior(eta - h)[0]) / 2e-4, rel=1e-6, abs=1e-6)


def test_weights_and_prior_of_a_member_alone(study):
    member = alone(study["B"], PREDICTIVE_UPDATE, PRIOR, CENTRE, 2000, 3)
    assert member.trusted
    assert member.log_prior == pytest.approx(own_prior(member.eta)[0], rel=1e-11)
    row = bt.evidence(bt.Study([study["B"]]), seed=4, prior=PRIOR).rows[0]
    assert member.log_evidence == pytest.approx(row.log_evidence_h1, abs=0.15)


def test_the_population_replaced_by_their_own_prior_gives_their_own_posteriors(study):
    """60 quantiles, z scores with both Monte Carlo errors, at most 4.5 and together as large as chance: false alarms once in 1000 runs."""
    likelihood, chains = MembersLikelihood(PREDICTIVE_UPDATE, PRIOR, study.subjects, CENTRE, 16), np.random.default_rng(5)

    def density(x):
        eta = x.reshape(len(x), -1, 4)
        value, gradient = likelihood(eta)
        prior, steep = own_prior(eta)
        return (value + prior).sum(axis=1), (gradient + steep).reshape(x.shape)

    members = [alone(one, PREDICTIVE_UPDATE, PRIOR, CENTRE, 2000, 6) for one in study]
    start = np.concatenate([one.equal[:16] for one in members], axis=1)
    sampler = Hamiltonian(density, start, 0.4 * np.ones(12), 12, chains)
    sampler.warm_up((40, 60))
    drawn = sampler.advance(250).x.transpose(1, 0, 2).reshape(16, -1, 3, 4)
    draws = bt.sample(study, seed=8, draws=2000, workers=1, prior=PRIOR)
    scores = []
    for i, name in enumerate(study.names):
        known = draws.posterior(name).to_group(draws.points(name).reshape(-1, 4))
        for j in range(4):
            quantiles = zip(PROBABILITIES, np.quantile(known[:, j], PROBABILITIES), strict=True)
            scores += [_score(drawn[:, :, i, j], probability, at) for probability, at in quantiles]
            assert convergence(drawn[:, :, i, j]).r_hat < 1.05
    assert np.abs(scores).max() < 4.5
    assert np.sqrt(np.mean(np.square(scores))) < 1.6


def _score(draws, probability, at):
    """Share of draws below the other program's quantile, as a z score; that one's error is that of 2000 effective draws."""
    below = draws <= at
    return (below.mean() - probability) / np.sqrt(errors(below).mean ** 2 + probability * (1.0 - probability) / 2000.0)
