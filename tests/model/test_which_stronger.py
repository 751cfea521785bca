"""The paper's observer who says which stimulus was stronger, against other routes."""

from dataclasses import replace

import mpmath as mp
import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.stats import norm

from bayes_toe.data.study import Subject
from bayes_toe.data.tasks import SAME_DIFFERENT, WHICH_STRONGER
from bayes_toe.errors import InputError
from bayes_toe.model.closed_form import pull
from bayes_toe.model.ladder import model_named, models_of, posterior_of
from bayes_toe.model.links import PROBIT, Lapsing
from bayes_toe.model.prior import Prior

S1 = np.array([0.0, 0.2, 0.4, 0.6, 0.2, 0.4, 0.6, 0.8])
S2 = np.array([0.2, 0.4, 0.6, 0.8, 0.0, 0.2, 0.4, 0.6])
MODELS = [*models_of(WHICH_STRONGER).named[1:], *models_of(WHICH_STRONGER).space]
RICH = [
    model_named(name, WHICH_STRONGER)
    for name in ("contraction + sloped", "update + biased guesses + logit + beta-binomial")
]


def subject(k=(40, 38, 35, 33, 20, 15, 12, 8), isi=None, s1=S1, s2=S2):
    return Subject("A", s1, s2, k, np.full(len(k), 50), isi, task=WHICH_STRONGER)


def observer(model, x, seed=1, s1=S1, s2=S2, trials=65):
    """A subject who answers by a model at coordinates."""
    asked = Subject(
        "A", s1, s2, np.zeros(len(s1), int), np.full(len(s1), trials), task=WHICH_STRONGER
    )
    p = np.exp(model.posterior(asked, Prior()).log_answers(np.atleast_2d(x))[0][0])
    return replace(asked, n_yes=np.random.default_rng(seed).binomial(trials, p))


# --- The answers ----------------------------------------------------------------------------------


def test_answers_are_those_of_a_simulated_belief():
    """'Second' where a draw of the second percept exceeds one of what memory expects: N(s2, sigma_l^2) against N(mu_2, sigma_2^2)."""
    mu1, sigma_p, sigma_l, n = -0.3, 0.2, 0.15, 400_000
    gamma = (sigma_l / sigma_p) ** 2
    ratio = 0.5 * (1.0 + np.sqrt(1.0 + 4.0 * gamma))
    target = posterior_of(subject(), Prior(), model="update + no lapses")
    x = target.points(
        {"mu1": np.array([mu1]), "sigma_p": np.array([sigma_p]), "sigma_l": np.array([sigma_l])}
    )
    p = np.exp(target.log_answers(x)[0][0])
    rng, s1, s2 = np.random.default_rng(1), target.subject.s1, target.subject.s2
    memory = s1 + pull(gamma) * (mu1 - s1) + sigma_p * np.sqrt(ratio) * rng.standard_normal((n, 1))
    simulated = (s2 + sigma_l * rng.standard_normal((n, 1)) > memory).mean(axis=0)
    assert np.abs(p - simulated).max() < 4.5 * np.sqrt(0.25 / n)


@pytest.mark.parametrize("z", [-40.0, -6.0, 0.0, 3.0, 9.0])
@pytest.mark.parametrize("rate", [None, -300.0, -3.0, 2.0])
def test_probabilities_keep_their_digits(z, rate):
    with mp.workdps(200):
        lapse = mp.mpf(0) if rate is None else 1 / (1 + mp.exp(-mp.mpf(rate)))
        exact = [mp.log(lapse / 2 + (1 - lapse) * mp.ncdf(sign * mp.mpf(z))) for sign in (1, -1)]
    link, own = (PROBIT, ()) if rate is None else (Lapsing(PROBIT), (np.array([[rate]]),))
    found = link.log_answers(np.array([[z]]), *own)
    assert [float(part[0, 0]) for part in found] == pytest.approx(
        [float(one) for one in exact], rel=1e-12, abs=1e-300
    )


@pytest.mark.parametrize("model", [*MODELS, *RICH], ids=lambda model: model.name)
def test_gradients_are_differences_of_values_and_coordinates_come_back(model):
    target, rng = (
        model.posterior(subject(isi=[1, 2, 4, 1, 2, 4, 1, 2]), Prior()),
        np.random.default_rng(2),
    )
    x = target.sample_prior(rng, 30)
    x = x[np.abs(x).max(axis=1) < 20.0]
    steps = 1e-5 * np.eye(x.shape[1])
    differences = np.stack(
        [(target.log_density(x + h) - target.log_density(x - h)) / 2e-5 for h in steps], axis=1
    )
    assert target.gradient(x)[1] == pytest.approx(differences, rel=1e-5, abs=1e-4)
    assert target.points(target.quantities(x)) == pytest.approx(x, rel=1e-9, abs=1e-9)


def test_both_tasks_have_one_observer():
    """The width of 'equal' is that of 'second' times the root of G, and the pull is the same."""
    theta = {"mu1": np.array([0.3]), "sigma_p": np.array([0.2]), "sigma_l": np.array([0.15])}
    ratio = 0.5 * (1.0 + np.sqrt(1.0 + 4.0 * (0.15 / 0.2) ** 2))
    found = []
    for task in (SAME_DIFFERENT, WHICH_STRONGER):
        target = posterior_of(
            Subject("A", S1, S2, [5] * 8, [9] * 8, task=task), Prior(), model="update + no lapses"
        )
        found.append(target.quantities(target.points(theta)))
    equal, second = found
    assert equal["width"] == pytest.approx(second["width"] * np.sqrt(ratio), rel=1e-12)
    assert (equal["pull"], equal["offset"]) == (
        pytest.approx(second["pull"]),
        pytest.approx(second["offset"]),
    )
    assert second["jnd"] == pytest.approx(norm.ppf(0.75) * second["width"])
    assert second["pse_shift"] == pytest.approx(second["offset"])


# --- Estimates -----------------------------------------------------------------------------------


def test_without_lapses_it_is_a_probit_regression():
    """Maximum likelihood of intercept, s1 and s2 by another search: K = -b1/b2, sigma_d = 1/b2, c = -(b0 + b1 sbar + b2 sbar)/b2."""
    one = subject()

    def loss(beta):
        z = beta[0] + beta[1] * one.s1 + beta[2] * one.s2
        return -(one.n_yes * norm.logcdf(z) + (one.n_trials - one.n_yes) * norm.logcdf(-z)).sum()

    fit = minimize(
        loss,
        [0.0, -1.0, 1.0],
        method="Nelder-Mead",
        options={"xatol": 1e-10, "fatol": 1e-12, "maxiter": 5000},
    )
    target = posterior_of(one, Prior(), model="free weighting + no lapses")
    b0, b1, b2 = fit.x
    given = {
        "gain": np.array([-b1 / b2]),
        "width": np.array([1.0 / b2]),
        "offset": np.array([-(b0 + (b1 + b2) * target.sbar) / b2]),
    }
    x = target.points(given)
    assert target.log_likelihood(x)[0] == pytest.approx(-fit.fun, rel=1e-12)
    assert np.abs(target.likelihood_gradient(x)[1]).max() < 1e-3


# --- What is concluded ----------------------------------------------------------------------------


def test_models_of_another_task_are_refused():
    with pytest.raises(
        InputError,
        match="'both ways' is of the task 'same/different', and asked was 'which is stronger'",
    ):
        posterior_of(subject(), model="update + both ways")
    with pytest.raises(InputError, match="'predictive update' is of the task 'same/different'"):
        model_named("update").posterior(subject())
