"""Correlations of parameters between subjects: what follows from known ones. Their density stands in test_joint."""

import numpy as np
import pytest
from populations import CENTRE, SIZE, made_up
from scipy import stats

from bayes_toe.cli.population import tables
from bayes_toe.groups.regressors import Regressor, Regressors
from bayes_toe.groups.savage_dickey import savage_dickey

#: Strong ones: of mu1 and probit gamma, and of log width and probit q0.
Z = np.arctanh([0.8, 0.0, 0.0, 0.0, 0.0, -0.6])
R = np.array(
    [[1.0, 0.8, 0.0, 0.0], [0.8, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, -0.6], [0.0, 0.0, -0.6, 1.0]]
)


def known(study, **more):
    """A population with these correlations in every draw."""
    return made_up(study, z=np.broadcast_to(Z, (*SIZE, 6)), **more)


def test_a_further_subject_has_them(small_study):
    """800 scores: within five standard errors of each correlation."""
    found = known(small_study, mean=np.broadcast_to(CENTRE, (*SIZE, 4)))
    assert found.chains.correlation == pytest.approx(np.broadcast_to(R, (*SIZE, 4, 4)), abs=1e-12)
    seen = np.corrcoef(found.new_subject().reshape(-1, 4).T)
    assert np.abs(seen - R).max() < 5 / np.sqrt(800)


def test_ratios_of_known_members_are_exact(small_study):
    """With members all but known, and their scatter, means and effects are one normal regression; two means together, too."""
    rng, tau = np.random.default_rng(2), np.array([0.5, 0.3, 0.2, 0.4])
    who = Regressors(
        small_study.names, np.array([[-1.0], [0.0], [1.0]]), (Regressor("c", "", "c"),)
    )
    eta = CENTRE + rng.standard_normal((3, 4)) * tau
    found = known(
        small_study,
        who=who,
        scatter=tau,
        model="free weighting",
        eta=eta + 1e-5 * rng.standard_normal((*SIZE, 3, 4)),
    )
    given = found.settings.hyperprior.numbers(found.names)
    precision = np.linalg.inv(R * np.outer(tau, tau))
    a = np.column_stack([np.ones(3), who.x])
    whole = np.kron(a.T @ a, precision) + np.diag(
        np.concatenate([given.mean_sd, given.effect_sd]) ** -2.0
    )
    covariance = np.linalg.inv(whole)
    centre = covariance @ (a.T @ (eta - given.mean) @ precision).ravel()
    ratios = savage_dickey(found)
    both = [0, 1]  # constant error and gain
    exact = stats.multivariate_normal.logpdf(
        -given.mean[both], centre[both], covariance[np.ix_(both, both)]
    )
    exact -= stats.norm.logpdf(0.0, given.mean[both], given.mean_sd[both]).sum()
    assert np.log(ratios.joint.value) == pytest.approx(exact, rel=1e-4)
    for k, one in enumerate(ratios.effects[0]):
        sd = np.sqrt(covariance[4 + k, 4 + k])
        exact = stats.norm.pdf(0.0, centre[4 + k], sd) / stats.norm.pdf(
            0.0, 0.0, given.effect_sd[k]
        )
        assert one.value == pytest.approx(exact, rel=1e-4)


def test_what_is_said_of_them(small_study):
    found = made_up(small_study, z=Z + 0.1 * np.random.default_rng(3).standard_normal((*SIZE, 6)))
    rows = found.table.some("correlation")
    assert [row.parameter for row in rows][:4] == [
        "mu1, probit gamma",
        "mu1, log width",
        "mu1, probit q0",
        "probit gamma, log width",
    ]
    assert rows[0].q50 == pytest.approx(np.median(found.chains.correlation[..., 0, 1]))
    assert rows[0].p_direction == 1.0
    (shown,) = (rows for title, rows in tables(found) if title.startswith("correlations"))
    assert [row["scales"] for row in shown][:2] == ["mu1, probit gamma", "log width, probit q0"]
    assert not any(title.startswith("correlations") for title, _ in tables(made_up(small_study)))
    assert (
        found.settings.hyperprior.describe(found.names, correlations=True)[-1]
        == "correlations ~ LKJ(2)"
    )
