"""The figure of a population, by what is drawn in it."""

import re
from dataclasses import replace

import numpy as np
import pytest
from populations import made_population, ordinary

import bayes_toe as bt
from bayes_toe.classical.frequencies import laplace_estimate
from bayes_toe.data.tasks import WHICH_STRONGER
from bayes_toe.groups.predictive_check import PredictiveCheck, Statistic
from bayes_toe.groups.regressors import Regressor
from bayes_toe.plots.population import MOST_NAMED_IN_GROUP, forest, marked
from bayes_toe.plots.style import ORDERS, new_figure, said_interval

COLUMNS = (
    Regressor("group", "patient", "group patient against control", reference="control"),
    Regressor("age", "", "age, per sd of 11 about 35", 35.0, 11.0),
)


@pytest.fixture(scope="module")
def few():
    return made_population(ordinary(3))


@pytest.fixture(scope="module")
def drawn(few):
    """Panels of its figure by what they are about: the label below, or the words above."""
    axes = bt.plots.population_figure(few).axes
    return {ax.get_xlabel(): ax for ax in axes[:4]} | {"new subject": axes[4], "check": axes[5]}


def alone_in(found, quantity):
    """The panel of one quantity on its own."""
    ax = new_figure(3.0, 3.0).subplots()
    forest(ax, found, quantity, marked(found)[quantity])
    return ax


def test_a_forest_has_everybody_alone_and_in_the_group_before_the_population(few, drawn):
    ax = drawn["width $w$"]
    width = [
        np.exp(eta.reshape(-1, *eta.shape[2:])[..., 2]) for eta in (few.chains.mean, few.chains.eta)
    ]
    lines = {line.get_label(): np.asarray(line.get_xdata()) for line in ax.lines}
    assert lines["in the group"] == pytest.approx(np.median(width[1], axis=0))
    assert lines["subject alone (5-50-95 %)"] == pytest.approx(
        np.median(np.exp(few.unpooled[..., 2]), axis=0)
    )
    low, high = np.quantile(width[0], (0.05, 0.95))
    bands = {
        band.get_label(): (band.get_x(), band.get_x() + band.get_width()) for band in ax.patches
    }
    assert bands["typical subject (mean)"] == pytest.approx((low, high))
    new = np.quantile(np.exp(few.new_subject()[..., 2]), (0.05, 0.95))
    assert bands["new subject"] == pytest.approx(tuple(new))
    assert ax.get_title() == said_interval(np.quantile(width[0], (0.05, 0.5, 0.95)))
    assert [label.get_text() for label in next(iter(drawn.values())).get_yticklabels()] == list(
        few.study.names
    )


def test_a_subject_alone_who_says_nothing_does_not_squeeze_the_others(few):
    alone = few.unpooled.copy()
    alone[:, 1, 0] *= 1e4
    one = replace(few, unpooled=alone)
    limits = [np.ptp(alone_in(found, "mu1").get_xlim()) for found in (few, one)]
    assert limits[1] < 1.6 * limits[0]
    beyond = [
        line.get_ydata() for line in alone_in(one, "mu1").lines if line.get_marker() in ("<", ">")
    ]
    assert 1 in np.rint(np.concatenate(beyond))


def test_many_subjects_are_sorted_without_names():
    ax = bt.plots.population_figure(
        made_population(ordinary(MOST_NAMED_IN_GROUP + 1), draws=30)
    ).axes[0]
    assert not len(ax.get_yticks())
    middle = next(
        np.asarray(line.get_xdata()) for line in ax.lines if "in the group" in str(line.get_label())
    )
    assert (len(middle), np.diff(middle).min() >= 0.0) == (MOST_NAMED_IN_GROUP + 1, True)
    assert ax.get_ylabel() == "41 subjects, sorted in each panel"


def test_curves_are_of_a_new_subject_and_points_of_all_answers(few, drawn):
    ax, study = drawn["new subject"], few.study
    k, n = (np.sum([getattr(one, key) for one in study], axis=0) for key in ("n_yes", "n_trials"))
    at = study.subjects[0].s1 < study.subjects[0].s2
    points = next(bars[0] for bars in ax.containers if bars.get_label() == ORDERS[-1].label)
    assert np.asarray(points.get_ydata()) == pytest.approx(laplace_estimate(k, n)[at])
    posterior, eta = few.posterior("P000"), few.new_subject().reshape(-1, 4)
    pair = bt.Subject("pair", [0.0], [float(study.subjects[0].s2.max())], [0], [1])
    expected = np.exp(
        posterior.for_subject(pair).log_answers(posterior.from_group(eta)[0])[0]
    ).mean()
    mean = next(
        line
        for line in ax.lines
        if line.get_color() == ORDERS[-1].colour
        and len(line.get_xdata()) == 60
        and line.get_ls() == "-"
    )
    assert np.asarray(mean.get_ydata())[-1] == pytest.approx(expected)


@pytest.mark.parametrize(
    ("model", "k", "isi"),
    [("predictive update", 4, 2.0), ("constant error + both ways + sloped", 5, None)],
)
def test_other_models_and_studies_with_intervals(model, k, isi):
    eta = np.zeros((3, k)) + 0.1 * np.arange(3)[:, None]
    found = made_population(eta, model=model, isi=isi)
    figure = bt.plots.population_figure(found)
    shown = [ax.get_xlabel() for ax in figure.axes[: len(found.names)]]
    assert len(set(shown)) == len(found.names)
    assert ("at 2 s" in figure.axes[len(shown)].get_legend().get_title().get_text()) == (
        isi is not None
    )


def test_psychometric_curves_of_many_first_stimuli_have_no_dotted_ends():
    eta = np.array([0.0, -0.2, -1.2, -1.8]) + 0.1 * np.arange(3)[:, None]
    found = made_population(eta, model="free weighting", task=WHICH_STRONGER)
    ax = bt.plots.population_figure(found).axes[4]
    curves = [line.get_ls() for line in ax.lines if len(line.get_xdata()) == 60]
    assert (set(curves), len(curves)) == ({"-"}, 5)
    assert "mean, 50 %; points" in ax.get_legend().get_title().get_text()
    assert ax.get_ylabel() == "P('second')"


def test_effects_say_their_direction():
    x = np.column_stack([np.arange(6) % 2, np.linspace(-1.0, 1.0, 6)])
    found = made_population(ordinary(6), columns=COLUMNS, x=x)
    found.chains.effects[:, :, 0, 3] = -0.7
    figure = bt.plots.population_figure(found)
    assert len(figure.axes) == 4 + 2 + 4
    of_q0 = figure.axes[-1]
    above = np.mean(found.chains.effects[:, :, 1, 3] > 0)
    assert [text.get_text() for text in of_q0.texts] == ["P(< 0) > 0.99", f"P(> 0) = {above:.2f}"]
    assert [label.get_text().replace("\n", " ") for label in figure.axes[6].get_yticklabels()] == [
        column.about for column in COLUMNS
    ]
    assert "with covariates of the study" in figure.axes[4].get_legend().get_title().get_text()


def test_the_predictive_check_shows_what_is_wrong_and_where_it_lies(few):
    rows = (
        Statistic("spread", "accuracy", 0.2, 0.1, 0.15, 0.2, 0.1, True),
        Statistic("farthest", "accuracy", 9.0, 1.0, 2.0, 3.0, 0.004, True),
    )
    ax = bt.plots.population_figure(few, PredictiveCheck(rows, "normal", 500)).axes[5]
    marks = [
        (float(line.get_xdata()[0]), line.get_marker(), line.get_color())
        for line in ax.lines
        if line.get_marker() != "None"
    ]
    assert marks == [(1.0, "D", "black"), (2.0, ">", "#C00000")]
    assert [text.get_text() for text in ax.texts] == [
        "0.20, expected 0.10 to 0.20, p = 0.1",
        "9.0, expected 1.0 to 3.0, p = 0.004",
    ]


def test_the_title_says_who_and_whether_to_believe_it(drawn):
    title = drawn["check"].get_figure(root=True).get_suptitle()
    assert title.startswith("Population of 3 subjects: predictive update\n")
    assert "pull 0." in title
    weighted = made_population(
        np.array([0.0, 0.0, -1.2, 1.4]) + 0.01 * np.arange(3)[:, None], model="free weighting"
    )
    _, answer, factors = bt.plots.population_figure(weighted).get_suptitle().split("\n")
    assert re.fullmatch(r"order effect: .* on average.* \(P of none = 0\.\d\d\)", answer)
    of = {row.parameter: row.of_none for row in weighted.table.some("mean")}
    assert (
        factors
        == f"Bayes factors of a mean of 0: pull {of['pull']}, constant error {of['constant error']}"
    )
    unfinished = bt.plots.population_figure(made_population(ordinary(3), reason="few draws"))
    assert unfinished.get_suptitle().startswith("NOT CONVERGED")
