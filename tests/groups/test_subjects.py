"""Subjects of a group: value and gradient of each are those of its own posterior, for every composition; unpooled posteriors."""

import numpy as np
import pytest
from conftest import observer_counts

import bayes_toe as bt
from bayes_toe.data.study import Subject
from bayes_toe.groups.chains import Hamiltonian
from bayes_toe.groups.subjects import GroupLikelihood, unpooled
from bayes_toe.inference.diagnostics import convergence, errors
from bayes_toe.model.ladder import PREDICTIVE_UPDATE
from bayes_toe.model.parts import compose
from bayes_toe.model.posterior import Posterior
from bayes_toe.model.prior import Prior

ORDERS = ("none", "constant error", "update", "free weighting", "mean-reverting")
#: Every level of every part with every order.
OTHERS = (
    {},
    {"noise": "sloped", "lapses": "both ways", "spread": "beta-binomial"},
    {"lapses": "no lapses"},
    {"curve": "differencing", "spread": "beta-binomial"},
    {"curve": "exponent", "lapses": "no lapses", "noise": "sloped"},
    {"curve": "exponent", "lapses": "both ways"},
    {"curve": "differencing", "lapses": "both ways"},
)
MODELS = [compose(order=order, **levels) for order in ORDERS for levels in OTHERS]
CENTRE, PRIOR = 0.2, Prior(reference_interval=0.7)


def subjects(intervals):
    """Six: other pairs, other numbers of them, one pair only, all 'equal', none 'equal', one trial."""
    rng, made = np.random.default_rng(5), []
    for i, pairs in enumerate((9, 4, 1, 6, 5, 1)):
        s1, s2 = rng.normal(0.3, 0.3, (2, pairs))
        s2 = np.where(rng.uniform(size=pairs) < 0.3, s1, s2)
        n = rng.integers(1, 40, pairs) if i != 5 else np.array([1])
        k = n if i == 3 else 0 * n if i == 4 else rng.binomial(n, 0.6)
        made.append(Subject(f"S{i}", s1, s2, k, n, isi=rng.choice([0.4, 0.9, 2.0], pairs) if intervals else None))
    return made


@pytest.mark.parametrize("intervals", [False, True], ids=["", "intervals"])
@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.name)
def test_of_each_what_its_own_posterior_has(model, intervals):
    people, rng = subjects(intervals), np.random.default_rng(7)
    likelihood = GroupLikelihood(model, PRIOR, people, CENTRE, 1)
    for spread in (0.7, 4.0):
        eta = rng.normal(0.0, spread, (1, len(people), len(model.group)))
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            (value,), (gradient,) = likelihood(eta)
            for i, one in enumerate(people):
                own = Posterior(one, model, PRIOR, centre=CENTRE if "mu1" in model.group else None)
                x, jacobian = own.from_group(eta[:, i])
                wanted = own.log_likelihood(x)[0]
                assert value[i] == pytest.approx(wanted, rel=1e-12, abs=1e-12)
                if np.isfinite(wanted):
                    steep = own.likelihood_gradient(x)[1][0] @ jacobian[0]
                    assert gradient[i] == pytest.approx(steep, rel=1e-9, abs=1e-10 * (1.0 + np.abs(steep).max()))


@pytest.mark.parametrize("model", MODELS[:: len(OTHERS)] + MODELS[1 :: len(OTHERS)], ids=lambda model: model.name)
def test_many_copies_change_nothing(model):
    people, rng = subjects(True), np.random.default_rng(8)
    eta = rng.normal(0.0, 0.6, (400, len(people), len(model.group)))  # 2,400 rows: more than one block
    for one, other in zip(
        GroupLikelihood(model, PRIOR, people, CENTRE, 2)(eta[[0, -1]]), GroupLikelihood(model, PRIOR, people, CENTRE, 400)(eta), strict=True
    ):
        assert one == pytest.approx(other[[0, -1]], rel=1e-13, abs=1e-12)


def test_new_answers_are_as_parameters_say():
    """False alarms: 5 standard errors of a mean over 4,000 sets of answers."""
    one = Subject("a", [0.0, 0.0, 0.4], [0.0, 0.4, 0.0], [0, 0, 0], [9, 30, 4])
    other = Subject("b", [0.1], [0.3], [0], [20])
    likelihood, eta = GroupLikelihood(PREDICTIVE_UPDATE, Prior(), [one, other], 0.2, 4000), np.array([[0.1, -0.5, -1.3, 1.3]] * 2)
    counts = likelihood.repeated(np.broadcast_to(eta, (4000, 2, 4)), np.random.default_rng(1))
    assert (counts.shape, counts[:, 1, 1:].max()) == ((4000, 2, 3), 0)
    for i, subject in enumerate((one, other)):
        posterior = Posterior(subject, PREDICTIVE_UPDATE, Prior(), centre=0.2)
        p = np.exp(posterior.log_answers(posterior.from_group(eta[i : i + 1])[0])[0])[0]
        error = np.sqrt(p * (1 - p) / subject.n_trials / 4000)
        assert np.all(np.abs(counts[:, i, : subject.n_pairs].mean(axis=0) / subject.n_trials - p) < 5 * error)


# --- Without pooling ------------------------------------------------------------------------------

#: Narrower than the default, so that a sampler without its own coordinates for a funnel gets around.
NARROW = Prior(mu1_mean=0.2, mu1_sd=0.7, sigma_p_scale=0.5)
PROBABILITIES = (0.05, 0.25, 0.5, 0.75, 0.95)


def own_prior(eta):
    """Its log density with respect to (mu1, probit gamma, log w, probit q0), and the gradient: sigma_p = w K^(3/2), K = 1 - p."""
    pulled = PREDICTIVE_UPDATE.free[0].group_pull(eta[..., 1])
    log_sd = eta[..., 2] + 1.5 * np.log1p(-pulled.pull) - np.log(NARROW.sigma_p_scale)
    score, square = (eta[..., 0] - NARROW.mu1_mean) / NARROW.mu1_sd, np.exp(2.0 * log_sd)
    constant = 0.5 * np.log(2.0 / np.pi) - 1.5 * np.log(2.0 * np.pi) - np.log(NARROW.mu1_sd)
    value = constant - 0.5 * (score**2 + square + eta[..., 1] ** 2 + eta[..., 3] ** 2) + log_sd
    by_pull = -1.5 * pulled.rise / (1.0 - pulled.pull) * (1.0 - square)
    return value, np.stack([-score / NARROW.mu1_sd, by_pull - eta[..., 1], 1.0 - square, -eta[..., 3]], axis=-1)


@pytest.fixture(scope="module")
def study():
    kinds = {"A": (-0.7, 0.25, 0.17, 0.92), "B": (1.2, 0.25, 0.18, 0.9), "C": (0.25, 0.22, 0.02, 0.6)}
    return bt.Study([bt.Subject(name, *observer_counts(*kind, n=20)) for name, kind in kinds.items()])


def test_the_own_prior_is_that_of_the_posterior(study):
    eta = np.random.default_rng(1).normal(0.0, 1.5, (40, 4))
    posterior = Posterior(study["A"], PREDICTIVE_UPDATE, NARROW, centre=0.25)
    x, jacobian = posterior.from_group(eta)
    value, gradient = own_prior(eta)
    assert value == pytest.approx(posterior.log_prior(x) + np.linalg.slogdet(jacobian)[1], rel=1e-12)
    for j in range(4):
        h = 1e-4 * np.eye(4)[j]
        assert gradient[:, j] == pytest.approx((own_prior(eta + h)[0] - own_prior(eta - h)[0]) / 2e-4, rel=1e-6, abs=1e-6)


def test_the_population_replaced_by_their_own_prior_gives_their_own_posteriors(study):
    """60 quantiles, z scores with both Monte Carlo errors, at most 4.5 and together as large as chance: false alarms once in 1000 runs."""
    likelihood, chains = GroupLikelihood(PREDICTIVE_UPDATE, NARROW, study.subjects, 0.25, 16), np.random.default_rng(5)

    def density(x):
        eta = x.reshape(len(x), -1, 4)
        value, gradient = likelihood(eta)
        prior, steep = own_prior(eta)
        return (value + prior).sum(axis=1), (gradient + steep).reshape(x.shape)

    alone = [unpooled(one, PREDICTIVE_UPDATE, NARROW, 0.25, 2000, 6) for one in study]
    assert all(one.trusted for one in alone)
    sampler = Hamiltonian(density, np.concatenate([one.eta[:16] for one in alone], axis=1), 0.4 * np.ones(12), 12, chains)
    sampler.warm_up((100, 150))
    drawn = sampler.advance(500).x.transpose(1, 0, 2).reshape(16, -1, 3, 4)
    draws = bt.sample(study, seed=8, draws=2000, workers=1, prior=NARROW)
    scores = []
    for i, name in enumerate(study.names):
        known = draws.posterior(name).to_group(draws.points(name).reshape(-1, 4))
        for j in range(4):
            assert convergence(drawn[:, :, i, j]).r_hat < 1.05
            for probability, at in zip(PROBABILITIES, np.quantile(known[:, j], PROBABILITIES), strict=True):
                below = drawn[:, :, i, j] <= at
                error = np.hypot(errors(below).mean, np.sqrt(probability * (1.0 - probability) / 2000.0))
                scores.append((below.mean() - probability) / error)
    assert np.abs(scores).max() < 4.5
    assert np.sqrt(np.mean(np.square(scores))) < 1.6
