"""Subjects of a group: value and gradient of each are those of its own posterior, for every composition; unpooled posteriors."""

import numpy as np
import pytest
from reference.hard_cases import hard_cases

from bayes_toe.data.study import Subject
from bayes_toe.groups.subjects import GroupLikelihood, unpooled
from bayes_toe.inference.adaptation import fit_proposal
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
        made.append(
            Subject(
                f"S{i}", s1, s2, k, n, isi=rng.choice([0.4, 0.9, 2.0], pairs) if intervals else None
            )
        )
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
                    assert gradient[i] == pytest.approx(
                        steep, rel=1e-9, abs=1e-10 * (1.0 + np.abs(steep).max())
                    )


@pytest.mark.parametrize(
    "model", MODELS[:: len(OTHERS)] + MODELS[1 :: len(OTHERS)], ids=lambda model: model.name
)
def test_many_copies_change_nothing(model):
    people, rng = subjects(True), np.random.default_rng(8)
    eta = rng.normal(
        0.0, 0.6, (400, len(people), len(model.group))
    )  # 2,400 rows: more than one block
    for one, other in zip(
        GroupLikelihood(model, PRIOR, people, CENTRE, 2)(eta[[0, -1]]),
        GroupLikelihood(model, PRIOR, people, CENTRE, 400)(eta),
        strict=True,
    ):
        assert one == pytest.approx(other[[0, -1]], rel=1e-13, abs=1e-12)


def test_new_answers_are_as_parameters_say():
    """False alarms: 5 standard errors of a mean over 4,000 sets of answers."""
    one = Subject("a", [0.0, 0.0, 0.4], [0.0, 0.4, 0.0], [0, 0, 0], [9, 30, 4])
    other = Subject("b", [0.1], [0.3], [0], [20])
    likelihood, eta = (
        GroupLikelihood(PREDICTIVE_UPDATE, Prior(), [one, other], 0.2, 4000),
        np.array([[0.1, -0.5, -1.3, 1.3]] * 2),
    )
    counts = likelihood.repeated(np.broadcast_to(eta, (4000, 2, 4)), np.random.default_rng(1))
    assert (counts.shape, counts[:, 1, 1:].max()) == ((4000, 2, 3), 0)
    for i, subject in enumerate((one, other)):
        posterior = Posterior(subject, PREDICTIVE_UPDATE, Prior(), centre=0.2)
        p = np.exp(posterior.log_answers(posterior.from_group(eta[i : i + 1])[0])[0])[0]
        error = np.sqrt(p * (1 - p) / subject.n_trials / 4000)
        assert np.all(
            np.abs(counts[:, i, : subject.n_pairs].mean(axis=0) / subject.n_trials - p) < 5 * error
        )


@pytest.mark.parametrize("name", ["reversed answers", "one batch"])
def test_without_the_group_they_are_their_own_posteriors(name):
    """20 shares below quantiles of weighted draws from another seed, within 4.5 errors of 2,000 and at least 6,000 independent ones."""
    one, probabilities = hard_cases()[name], np.array([0.05, 0.25, 0.5, 0.75, 0.95])
    found, posterior = (
        unpooled(one, PREDICTIVE_UPDATE, Prior(), 0.25, 5000, 6),
        Posterior(one, PREDICTIVE_UPDATE, Prior(), centre=0.25),
    )
    draws = fit_proposal(posterior, np.random.default_rng(7), draws=20_000).draws
    eta, weights = posterior.to_group(draws.x), np.exp(draws.log_weights - draws.log_weights.max())
    assert found.trusted
    for drawn, values in zip(found.eta.T, eta.T, strict=True):
        order = np.argsort(values)
        cumulated = np.cumsum(weights[order]) / weights.sum()
        quantiles = np.interp(probabilities, cumulated, values[order])
        below = (drawn[:, None] <= quantiles).mean(axis=0)
        assert (
            np.abs(below - probabilities)
            < 4.5 * np.sqrt(probabilities * (1.0 - probabilities) / 1500)
        ).all()
    if name == "reversed answers":  # of a log width the prior hardly says anything
        mean = np.average(eta[:, 2], weights=weights)
        sd = np.sqrt(np.average(np.square(eta[:, 2] - mean), weights=weights))
        assert (found.location[2], np.exp(-0.5 * found.log_precision[2])) == pytest.approx(
            (mean, sd), abs=0.1 * sd
        )
