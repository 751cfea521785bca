"""Conditions within the subjects of a group: the likelihood over conditions, and what is said of differences on average."""

import re
import warnings

import numpy as np
import pandas as pd
import pytest

import bayes_toe as bt
from bayes_toe.cli.population import answer, tables
from bayes_toe.data.conditions import by_person
from bayes_toe.groups.differences import ConditionLikelihood, Differences
from bayes_toe.groups.subjects import centre_of
from bayes_toe.inference.maxima import find_maxima
from bayes_toe.model.parts import composition
from bayes_toe.model.posterior import Posterior
from bayes_toe.model.prior import DEFAULT

PAIRS = np.array([(a, a + step) for a in (0.0, 0.3, 0.6) for step in (-0.3, 0.3)])


def study(people=6, levels=("left", "right"), away=0.1, trials=40, seed=1):
    """The constant error differs by `away` from level to level, the width does not; subject P0 never met the last level."""
    rng, rows = np.random.default_rng(seed), []
    for i in range(people):
        offset = 0.05 * rng.standard_normal()
        for j, level in enumerate(levels[: len(levels) - (i == 0)]):
            shown = PAIRS[
                : len(PAIRS) - j
            ]  # so that conditions have other pairs, and another mean first stimulus
            p = 1.0 / (1.0 + np.exp(-(shown[:, 1] - shown[:, 0] - offset - away * j) / 0.12))
            told = {
                "subject": f"P{i}",
                "condition": level,
                "s1": shown[:, 0],
                "s2": shown[:, 1],
                "n_trials": trials,
            }
            rows.append(pd.DataFrame({**told, "n_second": rng.binomial(trials, p)}))
    return bt.read_study(pd.concat(rows))


def test_a_search_warns_of_nothing_on_its_way():
    """Far from a maximum curvatures are not positive definite, of which an elimination overflows."""
    read, _ = bt.simulate(
        1, batches=20, seed=1, conditions=("a", "b", "c"), differ={"pull": (0.5, 0.0)}
    )
    whole, record = read.without_conditions(), composition("free weighting", read.task)
    apart = Differences.of(read.conditions, by_person(read), record)
    assert find_maxima(
        apart.posterior("S01", whole["S01"], record, DEFAULT.at(*whole), 0.2)
    ).arrived


@pytest.mark.parametrize("model", ["free weighting + sloped", "update", "contraction"])
def test_the_likelihood_is_that_of_every_condition(model):
    read, record = (
        study(people=3, levels=("a", "b", "c")),
        composition(model, bt.read_study(study().frame()).task),
    )
    whole, units = read.without_conditions(), by_person(read)
    apart, centre = Differences.of(read.conditions, units, record), 0.2
    prior = DEFAULT.at(*whole)
    likelihood = ConditionLikelihood(record, prior, whole.subjects, apart, centre, 2)
    rng, k = np.random.default_rng(2), len(record.group)
    base = np.array(
        [-1.0 if name in ("pull", "gamma", "lapse_rate", "width") else 0.1 for name in record.group]
    )
    eta = np.concatenate(
        [np.broadcast_to(base, (2, 3, k)), np.zeros((2, 3, len(apart.names)))], axis=-1
    )
    eta = eta + 0.2 * rng.standard_normal(eta.shape)
    value, gradient = likelihood(eta)
    for i, one in enumerate(whole):
        same = Posterior(one, record, prior, centre=centre_of(record, one, centre))
        expected = 0.0
        for unit in units[one.name]:
            at = eta[:, i, :k] + eta[:, i, k:] @ apart.at(unit.condition, record.group)
            own = Posterior(unit, record, prior, centre=same.sbar)
            expected = expected + own.log_likelihood(own.from_group(at)[0])
        np.testing.assert_allclose(value[:, i], expected, rtol=1e-10)
    for j in range(eta.shape[-1]):
        step = 1e-6 * (np.arange(eta.shape[-1]) == j)
        np.testing.assert_allclose(
            gradient[..., j],
            (likelihood(eta + step)[0] - likelihood(eta - step)[0]) / 2e-6,
            rtol=1e-5,
            atol=1e-4,
        )
    answers = likelihood.repeated(eta, rng)
    assert (answers <= np.stack([one.n_trials for one in whole])).all()


def test_differences_on_average_are_found_kept_and_read_back(tmp_path):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", bt.ConvergenceWarning)
        found = bt.population(
            study(), model="constant error + no lapses", draws=200, seed=1, workers=1
        )
    assert (found.names, found.study.names) == (
        ("offset", "width"),
        tuple(f"P{i}" for i in range(6)),
    )
    rows = {
        (row.parameter, row.quantity): row
        for row in found.table
        if row.quantity.startswith("condition")
    }
    error, width = rows["constant error", "condition_effect"], rows["log width", "condition_effect"]
    assert error.level == "right - left"
    assert error.q05 < 0.1 < error.q95
    assert (error.bf_no_difference or error.bf_below) < 1 / 20
    assert width.bf_no_difference > 1.5
    assert rows["order effect", "condition_effect"].bf_no_difference == pytest.approx(
        error.bf_no_difference, rel=0.3
    )
    assert {"log width", "constant error"} == {
        name for name, kind in rows if kind == "condition_sd"
    }
    shown = {
        row["on"]: row["word"]
        for row in dict(tables(found))[
            "differences between conditions on average, mean (5 %, 95 %)"
        ]
    }
    assert (
        shown["constant error"] == "differs"
    )  # from a Bayes factor of 20 on, in sentences and in the table
    for label, name in (("constant error", "constant error"), ("log width", "width")):
        assert re.search(rf"{name} [^;]*, {shown[label]} \(Bayes factor", " ".join(answer(found)))
    assert bt.plots.population_figure(found).subfigs[2].get_axes()
    again = bt.load(found.save(tmp_path / "population.nc"))
    pd.testing.assert_frame_equal(again.summary(), found.summary())
    assert again.differences.conditions == found.differences.conditions


def test_what_does_not_go_with_conditions_is_refused():
    with pytest.raises(
        bt.InputError, match="allowed without covariates, posterior and correlations"
    ):
        bt.population(study(), correlations=True)
