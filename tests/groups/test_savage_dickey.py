"""The Savage-Dickey ratio against exact ones: of a normal population, of Student's by quadrature, and where 0 is far out."""

import numpy as np
import pytest
from populations import NAMES, SIZE, made_up
from scipy import stats

import bayes_toe as bt
from bayes_toe.groups.regressors import Regressor, Regressors
from bayes_toe.groups.savage_dickey import ratio, savage_dickey

N = 12
#: The model whose means may be none; one of them is expected elsewhere.
WEIGHTING = {
    "model": "free weighting",
    "hyperprior": bt.Hyperprior().changed({"offset": {"mean": 0.2}}),
}


def people():
    return bt.Study(
        [
            bt.Subject(f"S{i}", [0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [40, 10, 10], [50] * 3)
            for i in range(N)
        ]
    )


def who(x):
    columns = tuple(Regressor(f"c{i}", "", f"c{i}") for i in range(x.shape[1]))
    return Regressors(people().names, x, columns)


def exact_normal(effects, seed, size=(16, 400)):
    """A population, known up to m and beta, whose members are known up to normal errors; and exact log ratios, means first, (1 + r, k)."""
    rng, found = np.random.default_rng(seed), made_up(people(), **WEIGHTING)
    x, tau, error = rng.standard_normal((N, 2)), 0.5, 0.4
    given = found.settings.hyperprior.numbers(found.names)
    a = np.column_stack([np.ones(N), x])
    mean, eta, drawn, logs = (
        np.empty((*size, 4)),
        np.empty((*size, N, 4)),
        np.empty((*size, 2, 4)),
        np.empty((3, 4)),
    )
    for k in range(4):
        prior = np.array([given.mean_sd[k], given.effect_sd[k], given.effect_sd[k]]) ** -2.0
        y = a @ [0.1 * bool(effects[0]), *effects] + rng.standard_normal(N) * np.hypot(tau, error)
        posterior = np.linalg.inv(np.diag(prior) + a.T @ a / (tau**2 + error**2))
        centre = posterior @ (a.T @ y / (tau**2 + error**2) + prior * [given.mean[k], 0.0, 0.0])
        some = rng.multivariate_normal(centre, posterior, size)
        share = error**-2 / (error**-2 + tau**-2)
        expected = some @ a.T
        eta[..., k] = (
            share * y
            + (1 - share) * expected
            + rng.standard_normal((*size, N)) * (error**-2 + tau**-2) ** -0.5
        )
        mean[..., k], drawn[..., k] = some[..., 0], some[..., 1:]
        known = stats.norm.logpdf(0.0, [given.mean[k], 0.0, 0.0], prior**-0.5)
        logs[:, k] = stats.norm.logpdf(0.0, centre, np.sqrt(np.diag(posterior))) - known
    return made_up(
        people(), who(x), **WEIGHTING, mean=mean, effects=drawn, eta=eta, scatter=tau
    ), logs


@pytest.mark.parametrize("effects", [(0.0, 0.0), (0.5, -0.3)])
def test_of_a_normal_population_it_is_the_exact_one(effects):
    """Eleven ratios, each within five of its Monte Carlo errors: a false alarm in 10^5 runs."""
    found, logs = exact_normal(effects, seed=int(10 * effects[0]))
    ratios, own = savage_dickey(found), [found.names.index(name) for name in ("gain", "offset")]
    pairs = list(
        zip(
            (*ratios.means.values(), ratios.joint), (*logs[0, own], logs[0, own].sum()), strict=True
        )
    )
    pairs += [
        (one, logs[1 + i, k]) for i, row in enumerate(ratios.effects) for k, one in enumerate(row)
    ]
    for one, log in pairs:
        assert one.value == pytest.approx(np.exp(log), rel=5 * one.error)
        assert one.error < 0.2


def test_a_model_without_a_mean_that_may_be_none_has_no_ratio_of_one():
    assert savage_dickey(made_up(people())) == ({}, None, ())


def test_far_out_it_is_a_bound_that_holds():
    found, logs = exact_normal((6.0, 6.0), seed=3)
    found_ratios = savage_dickey(found).effects
    bounds = [
        (one, np.exp(logs[1 + i, k]))
        for i, row in enumerate(found_ratios)
        for k, one in enumerate(row)
        if one.value is None
    ]
    assert bounds
    assert all(one.error is None and exact < one.below < 0.05 for one, exact in bounds)


def test_of_students_population():
    """Members that are known: the posterior of m and beta on a grid, with draws of equal weight from it."""
    rng, base = np.random.default_rng(5), made_up(people(), kind="t")
    x, tau = rng.standard_normal((N, 1)), 0.5
    given = base.settings.hyperprior.numbers(NAMES)
    eta = 0.1 + 0.4 * x[:, 0] + tau * rng.standard_t(4, N)
    m, beta = np.meshgrid(np.linspace(-2.5, 2.5, 301), np.linspace(-2.5, 2.5, 301), indexing="ij")
    log = stats.norm.logpdf(m, given.mean[1], given.mean_sd[1]) + stats.norm.logpdf(
        beta, 0.0, given.effect_sd[1]
    )
    log = log + stats.t.logpdf((eta - m[..., None] - beta[..., None] * x[:, 0]) / tau, 4).sum(
        axis=-1
    )
    density = np.exp(log - log.max())
    exact = (
        density[:, 150].sum()
        / density.sum()
        / (5.0 / 300)
        / stats.norm.pdf(0.0, 0.0, given.effect_sd[1])
    )
    size = 16, 1000
    at = rng.choice(density.size, size, p=(density / density.sum()).ravel())
    four = np.ones(4)
    found = made_up(
        people(), who(x), kind="t", mean=m.ravel()[at][..., None] * four, effects=beta.ravel()[at][..., None, None] * four[None],
        scatter=tau, eta=np.broadcast_to(eta[:, None], (*size, N, 4)),
    )  # fmt: skip
    one = savage_dickey(found).effects[0][1]
    assert one.value == pytest.approx(exact, rel=5 * one.error)
    assert one.error < 0.02


def test_where_subjects_are_all_one_it_is_that_of_their_mean():
    """Given a scatter of next to nothing the density of the mean is a spike at the subjects; over draws it is the posterior's, a normal."""
    rng, mean = (
        np.random.default_rng(6),
        0.05 + 0.1 * np.random.default_rng(7).standard_normal((16, 400)),
    )
    four, scatter = np.ones(4), 1e-6
    eta = mean[..., None] + scatter * rng.standard_normal((*mean.shape, N))
    found = made_up(
        people(),
        mean=mean[..., None] * four,
        eta=eta[..., None] * four,
        scatter=scatter,
        **WEIGHTING,
    )
    given = found.settings.hyperprior.numbers(found.names)
    exact = stats.norm.pdf(0.0, 0.05, 0.1) / stats.norm.pdf(
        0.0, 0.0, given.mean_sd[found.names.index("gain")]
    )
    one = savage_dickey(found).means["gain"]
    assert one.value == pytest.approx(exact, rel=5 * one.error)
    assert one.error < 0.1


def test_few_draws_that_carry_all_are_no_estimate():
    logs = np.zeros(SIZE)
    logs[3, 7] = 40.0
    assert ratio(logs, np.full(SIZE, 4.0), 800.0)[:2] == (None, None)
