"""The population from subjects' own draws: against integration on a grid, against the joint sampler, and where it has to give up."""

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import norm

import bayes_toe as bt
from bayes_toe.errors import InputError, NumericalError
from bayes_toe.groups.alone import alone
from bayes_toe.groups.reweighting import Reweighted
from bayes_toe.model.ladder import model_named
from bayes_toe.model.posterior import Posterior
from bayes_toe.model.prior import Prior

STUDY = bt.example_study().select(["S01", "S02", "S03"])
MODEL, CENTRE = model_named("symmetric"), 0.1
NUMBERS = bt.Hyperprior().for_study(STUDY).numbers(("width", "q0"))


@pytest.fixture(scope="module")
def members():
    return [alone(one, MODEL, Prior(), CENTRE, 20_000, 1) for one in STUDY]


def on_a_grid(subject, mean, scatter):
    """Log of the integral of likelihood times population density over (log w, probit q0), by the trapezoidal rule."""
    posterior = Posterior(subject, MODEL, Prior(), centre=CENTRE)
    axes = np.linspace(-3.0, 1.0, 500), np.linspace(-1.0, 4.0, 500)
    eta = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    assert posterior.model.group == ("width", "q0")
    x, _ = posterior.from_group(eta)
    values = posterior.log_likelihood(x) + norm.logpdf(eta, mean, scatter).sum(axis=1)
    return logsumexp(values) + sum(np.log(axis[1] - axis[0]) for axis in axes)


@pytest.mark.parametrize(("mean", "scatter"), [((-1.0, 1.4), (0.3, 0.3)), ((-0.8, 1.0), (1.0, 0.5)), ((-1.2, 1.6), (0.1, 0.2))])
def test_likelihood_of_a_population_is_its_integral(members, mean, scatter):
    density = Reweighted(members, np.empty((3, 0)), NUMBERS)
    phi = np.array([[*mean, *np.log(scatter)]])
    prior = norm.logpdf(mean, NUMBERS.mean, NUMBERS.mean_sd) + np.log(2.0) + norm.logpdf(scatter, 0.0, NUMBERS.sd_scale)
    wanted = sum(on_a_grid(one, mean, scatter) for one in STUDY) + prior.sum() + np.log(scatter).sum()
    error = np.sqrt(density.variance(phi).sum())
    assert 0.0 < error < 0.1
    assert abs(density.log_density(phi)[0] - wanted) < 4.0 * error


def test_evidence_of_a_member_is_that_of_the_table(members):
    for one, subject in zip(members, STUDY, strict=True):
        row = bt.compare(STUDY.select([subject.name]), models=["symmetric"], seed=3, workers=1)
        found = row.frame().set_index("model").loc["symmetric"]
        assert abs(one.log_evidence - found["log_evidence"]) < 0.05


def test_variance_grows_where_few_draws_count(members):
    density = Reweighted(members, np.empty((3, 0)), NUMBERS)
    wide, narrow = np.array([[-1.0, 1.4, 0.0, 0.0]]), np.array([[-1.0, 1.4, -8.0, -8.0]])
    assert density.variance(wide).sum() < 0.01 < 1.0 < density.variance(narrow).sum()


@pytest.fixture(autouse=True, scope="module")
def fewer():
    """Fewer draws of each subject are weighted: the same, with a larger variance."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("bayes_toe.groups.population.WEIGHTED", 1000)
        yield


@pytest.fixture(scope="module")
def both():
    numbers = {"width": {"sd_scale": 0.7}, "q0": {"sd_scale": 1.0}}
    given = {"model": "symmetric", "seed": 2, "draws": 300, "workers": 1, "hyperprior": bt.Hyperprior().for_study(STUDY).changed(numbers)}
    return {method: bt.population(STUDY, method=method, **given) for method in ("joint", "reweight")}


def test_both_ways_agree(both):
    for quantity in ("mean", "scatter", "eta"):
        one, other = (getattr(both[method].chains, quantity) for method in ("joint", "reweight"))
        flat = [part.reshape(-1, *part.shape[2:]) for part in (one, other)]
        spread = flat[0].std(axis=0)
        assert (np.abs(flat[0].mean(axis=0) - flat[1].mean(axis=0)) < 0.35 * spread).all()  # 4 errors of the mean of 300 draws
        np.testing.assert_allclose(flat[1].std(axis=0), spread, rtol=0.4)


def test_too_few_of_a_subjects_draws_are_refused():
    # A scatter far below what single subjects' answers tell: nothing but a few draws of each would decide.
    narrow = bt.Hyperprior().for_study(STUDY).changed({"width": {"sd_scale": 1e-4}, "q0": {"sd_scale": 1e-4}})
    with pytest.raises(NumericalError, match=r"method 'reweight': .* variance of .* most of it from 'S0.'.*allowed: method 'joint'"):
        bt.population(STUDY, model="symmetric", method="reweight", hyperprior=narrow, seed=1, draws=100, workers=1)


def test_only_a_normal_population_is_known():
    with pytest.raises(InputError, match="method 'reweight' with scatter 't'"):
        bt.population(STUDY, scatter="t", method="reweight", seed=1, workers=1)
