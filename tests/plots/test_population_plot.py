"""The figure of a group, by what is drawn in it."""

import numpy as np
import pytest
from legible import marks_of, require_legible, words_of
from populations import made_result, simulated_group, two_conditions, with_ages
from scipy import stats

import bayes_toe as bt
from bayes_toe.plots.population import MAX_NAMES_IN_GROUP, forest
from bayes_toe.plots.style import new_figure


@pytest.fixture(scope="module")
def group_of_four():
    """The result for a simulated group of four subjects, made without a sampler."""
    return made_result(simulated_group(1, n_subjects=4))


def forests_of(figure):
    """The three forests of the figure by their labels. Panels of the means follow the forests."""
    return {ax.get_xlabel(): ax for ax in figure.axes[:3]}


def test_a_forest_has_every_subject_before_the_mean_and_a_new_subject(group_of_four):
    forests = forests_of(bt.plots.population(group_of_four))
    ax = forests["contraction (%)"]
    lines = {line.get_label(): line.get_xdata() for line in ax.lines}
    medians = np.median(group_of_four.draws.subjects, axis=(0, 1))  # (subjects, quantities)
    constant_error, contraction = map(group_of_four.index, ("constant_error", "contraction"))
    assert lines["subject, median and 95 % interval"] == pytest.approx(medians[:, contraction])

    bands = {band.get_label(): band.get_bbox().intervalx for band in ax.patches}
    for label, draws in (
        ("group mean", group_of_four.draws.mean),
        ("new subject", group_of_four.new_subject),
    ):
        expected = np.quantile(draws[..., contraction], [0.025, 0.975])
        assert bands[label] == pytest.approx(expected)

    ax = forests["PSE shift (%)"]
    [points] = marks_of(ax, "o")
    shifts = group_of_four.in_units("constant_error", medians[:, constant_error])
    assert points.get_xdata() == pytest.approx(shifts, rel=1e-3)
    assert words_of(ax.get_yticklabels()) == list(group_of_four.subjects)


def test_the_title_says_if_the_draws_are_not_reliable(group_of_four):
    title = bt.plots.population(group_of_four).get_suptitle()
    assert title == "Group of 4 subjects (synthetic data)"
    # With three divergent trajectories, the result is not reliable.
    result = made_result(group_of_four.study, n_divergent=3)
    assert bt.plots.population(result).get_suptitle().startswith("NOT RELIABLE")


def test_the_mean_of_the_group_is_shown_with_its_prior(group_of_four):
    contraction_panel = 4  # after three forests, and the mean constant error
    ax = bt.plots.population(group_of_four).axes[contraction_panel]
    [prior_line] = [line for line in ax.lines if line.get_label() == "its prior"]
    x, density = prior_line.get_data()
    hyperprior = group_of_four.settings.hyperprior.contraction
    expected = stats.norm(hyperprior.mean, hyperprior.mean_scale).pdf(x)
    assert density == pytest.approx(expected, rel=1e-6)
    # The mean's draws are a histogram whose area is 1.
    areas = [bar.get_height() * bar.get_width() for bar in ax.patches]
    assert sum(areas) == pytest.approx(1.0)


@pytest.mark.parametrize("n_subjects", [4, 40])
def test_the_figure_is_legible_and_fits_a_page(n_subjects):
    figure = bt.plots.population(made_result(simulated_group(3, n_subjects, n_each=6)))
    require_legible(figure)
    # In millimetres; a page of A4 has 297 with its margins.
    assert 25.4 * figure.get_figheight() < 270.0


def test_many_subjects_are_sorted_and_have_no_names():
    # The group has one subject more than can have names in a forest.
    result = made_result(simulated_group(2, n_subjects=MAX_NAMES_IN_GROUP + 1, n_each=4))
    ax = new_figure(3.0, 3.0).subplots()
    forest(ax, result, "constant_error")
    [points] = marks_of(ax, "o")
    assert (np.diff(points.get_xdata()) >= 0.0).all()
    assert not ax.get_yticklabels()


def require_effect(result, label, median):
    """The third forest of the PSE shift has one effect, with this label and this median.

    The median is in the unit of the constant error.
    """
    axes = bt.plots.population(result).axes
    _, _, ax = (ax for ax in axes if ax.get_xlabel() == "PSE shift (%)")
    assert [text.replace("\n", " ") for text in words_of(ax.get_yticklabels())] == [label]
    [point] = marks_of(ax, "o")
    assert point.get_xdata() == pytest.approx(
        [float(result.in_units("constant_error", median))], rel=1e-3
    )


def test_the_figure_shows_the_effect_of_a_covariate():
    # The ages of six subjects have the mean 29.5 and the SD 7.176.
    result = made_result(*with_ages())
    effects = result.draws.effects  # (chains, draws, covariates, coefficients)
    median = np.median(effects[..., 0, result.index("constant_error")])
    require_effect(result, "age, per sd of 7.176 about 29.5", median)


def test_the_figure_shows_the_effect_of_a_condition():
    # The constant errors of the conditions left and right of the hand differ.
    result = made_result(two_conditions(1, n_subjects=3))
    draws, *_ = result.difference("constant_error", ("right", "left"))
    require_effect(result, "hand right − left", np.median(draws))
