"""The figure of a group, by what is drawn in it."""

import re

import numpy as np
import pytest
from legible import marks_of, require_legible, words_of
from populations import made_result, simulated_group, two_conditions, with_ages
from scipy import stats

import bayes_toe as bt
from bayes_toe.plots.population import MAX_NAMES_IN_GROUP, forest
from bayes_toe.plots.style import new_figure


@pytest.fixture(scope="module")
def few():
    return made_result(simulated_group(1, n_subjects=4))


def panels(figure):
    """The forests; below them are the means with their priors."""
    return {ax.get_xlabel(): ax for ax in figure.axes[:3]}


def test_a_forest_has_every_subject_before_the_mean_and_a_new_subject(few):
    forests = panels(bt.plots.population(few))
    ax = forests["contraction (%)"]
    lines = {line.get_label(): line.get_xdata() for line in ax.lines}
    medians = np.median(few.draws.subjects, axis=(0, 1))
    assert lines["subject, median and 95 % interval"] == pytest.approx(medians[:, 1])

    bands = {band.get_label(): band.get_bbox().intervalx for band in ax.patches}
    for label, draws in (("group mean", few.draws.mean), ("new subject", few.new_subject)):
        expected = np.quantile(draws[..., 1], [0.025, 0.975])
        assert bands[label] == pytest.approx(expected)

    ax = forests["PSE shift (%)"]
    [points] = marks_of(ax, "o")
    shifts = few.in_units("constant_error", medians[:, 0])
    assert points.get_xdata() == pytest.approx(shifts, rel=1e-3)
    assert words_of(ax.get_yticklabels()) == list(few.subjects)


def test_the_title_has_both_effects_and_warns(few):
    title = bt.plots.population(few).get_suptitle()
    assert re.match(
        r"Group of 4 subjects \(synthetic data\)\nmean PSE shift .*\nmean contraction .*", title
    )
    wrong = made_result(few.study, n_divergent=3)
    assert bt.plots.population(wrong).get_suptitle().startswith("NOT RELIABLE")


def test_the_mean_stands_before_its_prior(few):
    contraction_panel = 4  # after three forests, and the mean constant error
    ax = bt.plots.population(few).axes[contraction_panel]
    [prior] = [line for line in ax.lines if line.get_label() == "its prior"]
    x, density = prior.get_data()
    hyperprior = few.settings.hyperprior.contraction
    expected = stats.norm(hyperprior.mean, hyperprior.mean_scale).pdf(x)
    assert density == pytest.approx(expected, rel=1e-6)
    areas = [bar.get_height() * bar.get_width() for bar in ax.patches]
    assert sum(areas) == pytest.approx(1.0)


@pytest.mark.parametrize("n_subjects", [4, 40])
def test_the_figure_is_legible_and_fits_a_page(n_subjects):
    figure = bt.plots.population(made_result(simulated_group(3, n_subjects, n_each=6)))
    require_legible(figure)
    assert 25.4 * figure.get_figheight() < 270.0


def test_many_subjects_are_sorted_and_have_no_names():
    built = made_result(simulated_group(2, n_subjects=MAX_NAMES_IN_GROUP + 1, n_each=4))
    ax = new_figure(3.0, 3.0).subplots()
    forest(ax, built, "constant_error")
    [points] = marks_of(ax, "o")
    assert (np.diff(points.get_xdata()) >= 0.0).all()
    assert not ax.get_yticklabels()


def require_effect(result, label, middle):
    """A forest with one effect on the PSE shift."""
    axes = bt.plots.population(result).axes
    ax = [ax for ax in axes if ax.get_xlabel() == "PSE shift (%)"][2]
    assert [text.replace("\n", " ") for text in words_of(ax.get_yticklabels())] == [label]
    [point] = marks_of(ax, "o")
    assert point.get_xdata() == pytest.approx(
        [float(result.in_units("constant_error", middle))], rel=1e-3
    )


def test_the_figure_shows_the_effect_of_a_covariate():
    result = made_result(*with_ages())
    middle = np.median(result.draws.effects[..., 0, 0])
    require_effect(result, "age, per sd of 7.176 about 29.5", middle)


def test_the_figure_shows_the_effect_of_a_condition():
    result = made_result(two_conditions(1, n_subjects=3))
    draws, *_ = result.difference("constant_error", ("right", "left"))
    require_effect(result, "hand right − left", np.median(draws))
