"""The space of compositions against the pipeline of one model, against itself without a window, and in another unit of intensity."""

import numpy as np
import pytest
from scipy.special import softmax

import bayes_toe as bt
from bayes_toe.data.study import Subject
from bayes_toe.inference.space import WINDOW, laplace_evidences, space_evidence
from bayes_toe.inference.subject import Wanted, fitted_result
from bayes_toe.model.ladder import SPACE, model_named
from bayes_toe.model.prior import DEFAULT, Prior


@pytest.fixture(scope="module")
def subject() -> Subject:
    return bt.example_study()["S02"]


@pytest.fixture(scope="module")
def found(subject):
    return space_evidence(subject, DEFAULT, SPACE, 1)


def by_order(values):
    return softmax(values).reshape(3, -1).sum(axis=1)


@pytest.mark.parametrize("prior", [DEFAULT, Prior()])
def test_a_family_has_the_density_of_each_of_its_models_and_its_gradient(subject, prior):
    rng = np.random.default_rng(0)
    for place, (family, i) in laplace_evidences(subject, prior.at(subject), SPACE, np.inf)[
        1
    ].items():
        free, whose = family.free[i], np.full(4, i)
        u = np.where(free, rng.normal(0.0, 0.5, (4, len(free))), 0.0)
        x, volume = family.points(u)
        own = SPACE[place].posterior(subject, prior).log_density(x[:, free]) + volume[:, free].sum(
            axis=1
        )
        np.testing.assert_allclose(family.log_density(u, whose), own, rtol=1e-12)
        slope = family.gradient(u, whose)
        assert not slope[:, ~free].any()
        for k in np.flatnonzero(free):
            step = np.where(np.arange(len(free)) == k, 1e-6, 0.0)
            central = (
                family.log_density(u + step, whose) - family.log_density(u - step, whose)
            ) / 2e-6
            np.testing.assert_allclose(slope[:, k], central, rtol=1e-5, atol=1e-5)


def test_the_straight_coordinates_are_inverted(subject):
    for family in {
        family
        for family, _ in laplace_evidences(subject, DEFAULT.at(subject), SPACE, np.inf)[1].values()
    }:
        u = np.random.default_rng(1).normal(size=(5, len(family.rest)))
        np.testing.assert_allclose(family.straight(family.points(u)[0]), u, rtol=1e-9)


def test_sampled_evidences_are_those_of_the_pipeline_of_one_model(subject, found):
    for place in sorted(found.sampled)[::7]:
        alone = fitted_result(
            SPACE[place].posterior(subject, DEFAULT), 2, Wanted(evidence_draws=20_000)
        )[0].evidence
        error = np.hypot(alone.se, found.sampled[place][1].se)
        assert abs(alone.value - found.log_evidence[place]) < 4.0 * error, SPACE[place].name
        assert error < 0.1


def test_nothing_is_lost_by_the_window(subject, found):
    whole = space_evidence(subject, DEFAULT, SPACE, 1, window=np.inf)
    assert len(whole.sampled) == len(SPACE) > len(found.sampled)
    assert np.abs(by_order(whole.log_evidence) - by_order(found.log_evidence)).max() < 0.01
    assert all(
        found.log_evidence[i] < found.log_evidence.max() - WINDOW + 1.0
        for i in set(range(len(SPACE))) - set(found.sampled)
    )


def test_a_constant_and_a_factor_change_no_probability(subject, found):
    moved = Subject(
        subject.name,
        3.0 * subject.s1 + 2.0,
        3.0 * subject.s2 + 2.0,
        subject.n_yes,
        subject.n_trials,
    )
    assert (
        np.abs(
            by_order(space_evidence(moved, DEFAULT, SPACE, 1).log_evidence)
            - by_order(found.log_evidence)
        ).max()
        < 1e-9
    )


def test_what_lies_far_from_the_maximum_is_found():
    """A narrow width with many lapses: a tenth of the posterior, ten of Laplace's standard deviations away; four pairs leave it open."""
    few = Subject("P", [0.0, 0.0, 0.3, 0.3], [0.0, 0.3, 0.0, 0.3], [45, 20, 15, 46], [50] * 4)
    model = model_named("none + sloped + both ways")
    known = fitted_result(model.posterior(few, DEFAULT), 2, Wanted(evidence_draws=100_000))[
        0
    ].evidence
    values = [space_evidence(few, DEFAULT, [model], seed).log_evidence[0] for seed in range(24)]
    assert known.se < 0.002
    assert abs(np.mean(values) - known.value) < 0.017  # and not 0.03 too low
