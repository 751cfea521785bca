"""The figure of a group: subjects, means, covariates and conditions.

It shows every subject, the mean of the group with its prior, and the effects of covariates or the
differences between conditions.
"""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import fill

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure

from bayes_toe.answers.group_answer import LABELS
from bayes_toe.arrays import FloatArray
from bayes_toe.data.stimulus_unit import UNKNOWN_UNIT, percent
from bayes_toe.errors import require_kind
from bayes_toe.groups.population import PopulationResult
from bayes_toe.groups.population_table import EFFECTS, PopulationRow
from bayes_toe.model.parameters import CONSTANT_ERROR, CONTRACTION, NOISE, PEAK
from bayes_toe.plots.style import (
    BAD,
    BAND,
    BELIEF,
    LETTERS,
    MARKED_QUANTILES,
    PAGE,
    SMALL,
    Style,
    draw_intervals,
    legend_outside,
    name_rows,
    new_figure,
    plain,
    quantity_ticks,
    style_axes,
    zero_line,
)

#: Number of subjects above which subjects have no names, and are sorted.
MAX_NAMES_IN_GROUP = 40
_MEAN_COLOUR = "#BDB3DD"
#: Labels of axes, in which the unit of differences is filled in.
_LABELS = {
    CONSTANT_ERROR.name: "PSE shift ({unit})",
    CONTRACTION.name: "contraction (%)",
    NOISE.name: "JND ({unit})",
    PEAK.name: "largest P('equal')",
}
#: Labels of effects on the means.
_EFFECT_LABELS = {
    **_LABELS,
    NOISE.name: "JND, relative change ({unit})",
    PEAK.name: "logit of largest P('equal')",
}


def population(result: PopulationResult) -> Figure:
    """Draw the subjects of a group, and the group mean with its prior.

    Above, for every parameter: median and 95 % interval of every subject (blue), of the group's
    mean (purple), and of a new subject (grey). Then the posterior of the mean over its prior.
    Below: what covariates or conditions do to the means.
    """
    require_kind("result", result, PopulationResult, "PopulationResult")
    names = result.names
    conditions = result.study.conditions
    # What is compared: 'hand left − right', or the values of covariates.
    if conditions is None:
        comparisons = [column.meaning for column in result.regressors.columns]
    else:
        comparisons = [
            f"{conditions.name} {level} − {reference}" for level, reference in result.comparisons
        ]
    n_subjects = len(result.subjects)
    is_crowded = n_subjects > MAX_NAMES_IN_GROUP
    # Inches of the sections: forests, priors (1.4), and effects if there are any. A row of a forest
    # takes 0.19, a comparison 0.4, and labels 0.9. The legend or title of a section takes 0.3.
    forest_height = 3.6 if is_crowded else 0.9 + max(0.8, min(0.19 * n_subjects, 4.6))
    heights = [0.3 + forest_height, 1.4]
    if comparisons:
        heights.append(0.3 + 0.85 + 0.4 * len(comparisons))

    figure = new_figure(PAGE, 0.6 + sum(heights))
    colour = "black" if result.is_reliable else BAD
    figure.suptitle(_heading(result), fontsize=LETTERS + 1.0, color=colour)
    sections = figure.subfigures(len(heights), 1, height_ratios=heights, squeeze=False)[:, 0]

    # The first two sections have a panel for each parameter. Forests share the axis of subjects;
    # densities have axes of their own. A third section, with the effects, follows below.
    for section, draw in zip(sections, (forest, prior_panel), strict=False):
        panels = section.subplots(1, len(names), squeeze=False, sharey=draw is forest)[0]
        for name, ax in zip(names, panels, strict=True):
            draw(ax, result, name)
        legend_outside(section, side="upper")
    if is_crowded:
        sections[0].axes[0].set_ylabel(
            f"{n_subjects:,} subjects, sorted in each panel", fontsize=LETTERS
        )

    if comparisons:
        _draw_effects(sections[2], result, comparisons)
    return figure


def _draw_effects(section: SubFigure, result: PopulationResult, comparisons: Sequence[str]) -> None:
    """Draw the effects on the means in a panel for each parameter, a row for each comparison.

    `comparisons` has the labels of the rows.
    """
    if result.comparisons:
        title = "differences of the group means between conditions, 95 % intervals"
        rows = result.table.select("difference")
    else:
        title = "effects of covariates on the group means, 95 % intervals"
        rows = result.table.select("effect")
    section.suptitle(title, fontsize=SMALL)

    names = list(dict.fromkeys(row.parameter for row in rows))  # each once
    panels = section.subplots(1, len(names), squeeze=False, sharey=True)[0]
    labels = [plain(fill(text, 22), limit=70) for text in comparisons]
    for name, ax in zip(names, panels, strict=True):
        parameter_rows = [row for row in rows if row.parameter == name]
        quantiles, axis_label = _effects(result, name, parameter_rows)
        zero_line(ax)
        draw_intervals(ax, range(len(labels)), quantiles)
        name_rows(ax, len(labels), labels)
        # 0 is in the middle, so that the side of an effect is seen; 8 % are a margin.
        reach = 1.08 * float(np.abs(quantiles).max())
        ax.set(xlim=(-reach, reach), xlabel=axis_label)
        ax.spines["left"].set_visible(False)
        quantity_ticks(ax, name)


def _effects(
    result: PopulationResult, name: str, rows: Sequence[PopulationRow]
) -> tuple[FloatArray, str]:
    """Effects on the mean of a parameter, and the label of their axis.

    The effects have the shape (3, rows): low end, median and high end of 95 % intervals.
    """
    quantiles = np.stack([row.interval for row in rows], axis=1)
    label = _EFFECT_LABELS[name]
    if name == CONSTANT_ERROR.name:
        quantiles = result.scales.step * quantiles  # from units of D to natural logs
        unit = result.study.unit
    elif name == NOISE.name:  # an effect on the JND is a ratio, in per cent whatever the unit
        unit = UNKNOWN_UNIT
    else:  # a share, or a logit
        return quantiles, label
    unit = unit.with_logs_if_large(percent(quantiles))
    return unit.to_differences(quantiles), label.format(unit=unit.difference_unit)


def _heading(result: PopulationResult) -> str:
    """The title: a warning if the draws are not reliable, the subjects, effects without a result.

    An effect without a result is one that the responses do not determine.
    """
    synthetic = " (synthetic data)" if result.study.synthetic else ""
    lines = []
    if not result.is_reliable:
        lines.append("NOT RELIABLE, not to be reported as it stands")
    lines.append(f"Group of {len(result.subjects)} subjects{synthetic}")
    for name in EFFECTS:
        if name not in result.identified:
            lines.append(f"{LABELS[name]} cannot be told")
    return "\n".join(lines)


def prior_panel(ax: Axes, result: PopulationResult, name: str) -> None:
    """Draw the posterior of the group's mean of a parameter, and its prior density."""
    j = result.index(name)
    draws = result.draws.mean[..., j].ravel()  # of all chains, (draws,)
    low, high = np.quantile(draws, [0.001, 0.999])  # without draws far out
    if name in EFFECTS:  # the panel shows 0, no effect
        low = min(low, 0.0)
        high = max(high, 0.0)
    pad = 0.1 * (high - low)
    x = np.linspace(low - pad, high + pad, 200)
    # The prior takes x as the mean of every parameter: (x, parameters).
    log_prior, _ = result.numbers.prior_of_mean(x[:, None])
    prior_of_x = np.exp(log_prior[:, j])

    unit = result.shown_unit(name)
    values = result.in_units(name, x, unit)
    prior = prior_of_x / np.gradient(values, x)  # p(value) = p(x) / (d value / d x)
    shown_draws = result.in_units(name, draws, unit)
    ax.hist(
        shown_draws,
        bins=30,
        density=True,
        color=_MEAN_COLOUR,
        label="posterior of the group mean",
    )
    ax.plot(values, prior, color="black", lw=1.0, ls="--", label="its prior")

    axis_label = _LABELS[name].format(unit=unit.difference_unit)
    ax.set(xlim=(values[0], values[-1]), xlabel=axis_label, yticks=[])
    zero_line(ax)
    ax.locator_params(axis="x", nbins=4)
    quantity_ticks(ax, name)
    style_axes(ax).spines["left"].set_visible(False)


def forest(ax: Axes, result: PopulationResult, name: str) -> None:
    """Draw a parameter of every subject, in front of bands of the group's mean and a new subject.

    Bands and lines are 95 % intervals.
    """
    j = result.index(name)
    unit = result.shown_unit(name)
    # Draws of all chains: (chains, draws), and (chains, draws, subjects).
    new_subject = result.in_units(name, result.new_subject[..., j], unit)
    mean = result.in_units(name, result.draws.mean[..., j], unit)
    subjects = result.in_units(name, result.draws.subjects[..., j], unit)

    # With covariates, the group has no single mean: it is shown at the reference of each.
    reference = " at reference" if result.regressors.columns else ""
    bands = (("new subject", new_subject, BAND), ("group mean", mean, _MEAN_COLOUR))
    for label, values, colour in bands:
        low, _, high = np.quantile(values, MARKED_QUANTILES)
        ax.axvspan(low, high, color=colour, lw=0, label=f"{label}{reference}")
    ax.axvline(np.median(mean), color=BELIEF, lw=0.8)
    if name in EFFECTS:
        zero_line(ax)
    quantity_ticks(ax, name)

    quantiles = np.quantile(subjects, MARKED_QUANTILES, axis=(0, 1))  # (3, subjects)
    n_subjects = quantiles.shape[1]
    style: Style = {"label": "subject, median and 95 % interval"}
    if n_subjects > MAX_NAMES_IN_GROUP:
        quantiles = quantiles[:, np.argsort(quantiles[1], kind="stable")]  # by their median
        # The lines of more than 100 subjects would overlap.
        style |= {"ms": 1.6, "line": min(1.6, 160.0 / n_subjects)}
        names = []
    else:
        names = [plain(subject, limit=14) for subject in result.subjects]
    draw_intervals(ax, np.arange(n_subjects), quantiles, **style)
    name_rows(ax, n_subjects, names)
    ax.set_xlabel(_LABELS[name].format(unit=unit.difference_unit))
