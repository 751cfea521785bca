"""The figure of a group: subjects, means, predictive check, covariates and conditions.

It shows every subject, the mean of the group with its prior, the predictive check of a normal
group, and the effects of covariates or the differences between conditions.
"""

from __future__ import annotations

from textwrap import fill

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bayes_toe.answers.group_answer import EFFECTS, LABELS, group_estimate, log_factor_of_mean
from bayes_toe.answers.order_effect import format_bayes_factor
from bayes_toe.arrays import FloatArray
from bayes_toe.data.stimulus_unit import UNKNOWN_UNIT, percent
from bayes_toe.groups.population import PopulationResult
from bayes_toe.groups.predictive_check import CONTRADICTED, PredictiveCheck, predictive_check
from bayes_toe.model.parameters import CONSTANT_ERROR, CONTRACTION, NOISE, PEAK
from bayes_toe.plots.style import (
    BAD,
    BAND,
    BELIEF,
    EQUAL,
    LETTERS,
    MARKED,
    PAGE,
    SMALL,
    Style,
    draw_intervals,
    even_columns,
    grid_panels,
    legend_above,
    legend_below,
    n_rows,
    name_rows,
    new_figure,
    plain,
    quantity_ticks,
    rounded,
    style_axes,
    zero_line,
)

#: Subjects beyond which they have no names, and are sorted.
MAX_NAMES_IN_GROUP = 40
_MEAN_COLOUR = "#BDB3DD"
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
_BEYOND = {-1: "<", 0: "D", 1: ">"}  # markers of a group beyond the panel of the check


def population(result: PopulationResult, check: PredictiveCheck | None = None) -> Figure:
    """Draw the subjects of a group, the group mean with its prior, and the predictive check.

    Above, for every parameter: median and 95 % interval of every subject (blue), of the group's
    mean (purple), and of a new subject (grey). Then the posterior of the mean over its prior.
    Below: how subjects differ beside new groups, and what covariates or conditions do to the means.

    Parameters
    ----------
    result : PopulationResult
    check : PredictiveCheck, optional
        Computed here where it is not given.
    """
    names, effects = result.names, _effects(result)
    labels = [column.meaning for column in result.regressors.columns]
    if result.study.conditions is not None:
        condition = result.study.conditions.name
        labels = [f"{condition} {level} − {reference}" for level, reference in result.comparisons]
    n_subjects = len(result.subjects)
    is_crowded = n_subjects > MAX_NAMES_IN_GROUP
    forest_height = 3.6 if is_crowded else 0.9 + max(0.8, min(0.19 * n_subjects, 4.6))
    heights = [0.3 + forest_height, 1.4, 2.4]
    n_columns = 1

    if effects:
        n_columns = even_columns(len(effects), largest=4)
        heights.append(0.3 + n_rows(len(effects), n_columns) * (0.85 + 0.4 * len(labels)))

    figure = new_figure(PAGE, 0.6 + sum(heights))
    colour = "black" if result.is_reliable else BAD
    figure.suptitle(_heading(result), fontsize=LETTERS + 1.0, color=colour)
    parts = figure.subfigures(len(heights), 1, height_ratios=heights, squeeze=False)[:, 0]

    for part, draw in zip(parts, (forest, prior_panel), strict=False):
        panels = part.subplots(1, len(names), squeeze=False, sharey=draw is forest)[0]
        for name, ax in zip(names, panels, strict=True):
            draw(ax, result, name)
        legend_below(part, side="upper")
    if is_crowded:
        label = f"{n_subjects:,} subjects, sorted in each panel"
        parts[0].axes[0].set_ylabel(label, fontsize=LETTERS)
    check_panel(parts[2].subplots(), predictive_check(result) if check is None else check)
    if effects:
        title = "effects of covariates on the group means, 95 % intervals"
        if result.comparisons:
            title = "differences of the group means between conditions, 95 % intervals"
        parts[3].suptitle(title, fontsize=SMALL)
        panels = grid_panels(parts[3], len(effects), n_columns, sharey=True)
        names_of_rows = [plain(fill(text, 22), 70) for text in labels]
        for (name, (quantiles, label)), ax in zip(effects.items(), panels, strict=True):
            ax.axvline(0.0, color="black", lw=0.8)
            draw_intervals(ax, range(len(labels)), quantiles)
            name_rows(ax, len(labels), names_of_rows)
            reach = 1.08 * float(np.abs(quantiles).max())
            ax.set(xlim=(-reach, reach), xlabel=label)
            ax.spines["left"].set_visible(False)
            quantity_ticks(ax, name)
    return figure


def _heading(result: PopulationResult) -> str:
    """The number of subjects, both effects, and whether the draws are reliable."""
    synthetic = " (synthetic data)" if result.study.synthetic else ""
    lines = []
    if not result.is_reliable:
        lines.append("NOT RELIABLE, not to be reported as it stands")
    lines.append(f"Group of {len(result.subjects)} subjects{synthetic}")
    for name in EFFECTS:
        if name not in result.identified:
            lines.append(f"{LABELS[name]} cannot be told")
            continue
        mean = f"mean {LABELS[name]} {group_estimate(result, name)}"
        factor = format_bayes_factor(log_factor_of_mean(result, name))
        lines.append(f"{mean}, BF of a mean that is not 0: {factor}")
    return "\n".join(lines).replace("-", "−")


def prior_panel(ax: Axes, result: PopulationResult, name: str) -> None:
    """The posterior of a group's mean before its prior density."""
    j = result.index(name)
    draws = result.draws.mean[..., j].ravel()
    low, high = np.quantile(draws, [0.001, 0.999])
    if name in EFFECTS:
        low, high = min(low, 0.0), max(high, 0.0)
    pad = 0.1 * (high - low)
    x = np.linspace(low - pad, high + pad, 200)

    unit = result.shown_unit(name)
    values = result.in_units(name, x, unit)
    # A density in the unit of the panel follows from the slope of the unit.
    log_prior, _ = result.numbers.prior_of_mean(x[:, None])
    prior = np.exp(log_prior[:, j]) / np.gradient(values, x)

    draws = result.in_units(name, draws, unit)
    label = "posterior of the group mean"
    ax.hist(draws, 30, density=True, color=_MEAN_COLOUR, label=label)
    ax.plot(values, prior, color="black", lw=1.0, ls="--", label="its prior")
    label = _LABELS[name].format(unit=unit.of_differences)
    ax.set(xlim=(values[0], values[-1]), xlabel=label, yticks=[])
    zero_line(ax)
    ax.locator_params(axis="x", nbins=4)
    quantity_ticks(ax, name)
    style_axes(ax).spines["left"].set_visible(False)


def forest(ax: Axes, result: PopulationResult, name: str) -> None:
    """One parameter of every subject before the group's mean and a new subject."""
    j = result.index(name)
    reference = " at reference" if result.regressors.columns else ""
    unit = result.shown_unit(name)
    new_subject = result.in_units(name, result.new_subject[..., j], unit)
    mean = result.in_units(name, result.draws.mean[..., j], unit)
    subjects = result.in_units(name, result.draws.subjects[..., j], unit)

    spans = {"new subject": (new_subject, BAND), "group mean": (mean, _MEAN_COLOUR)}
    for label, (values, colour) in spans.items():
        low, _, high = np.quantile(values, MARKED)
        ax.axvspan(low, high, color=colour, lw=0, label=f"{label}{reference}")
    ax.axvline(np.median(mean), color=BELIEF, lw=0.8)
    if name in EFFECTS:
        zero_line(ax)
    quantity_ticks(ax, name)

    quantiles = np.quantile(subjects, MARKED, axis=(0, 1))
    n_subjects = quantiles.shape[1]
    names = [plain(subject, 14) for subject in result.subjects]
    style: Style = {"label": "subject, median and 95 % interval"}
    if n_subjects > MAX_NAMES_IN_GROUP:
        quantiles = quantiles[:, np.argsort(quantiles[1], kind="stable")]
        style |= {"ms": 1.6, "line": min(1.6, 160.0 / n_subjects)}
        names = []
    draw_intervals(ax, np.arange(n_subjects), quantiles, **style)
    name_rows(ax, n_subjects, names)
    ax.set_xlabel(_LABELS[name].format(unit=unit.of_differences))


def check_panel(ax: Axes, check: PredictiveCheck) -> None:
    """Differences between subjects (points) beside new groups, whose 5 to 95 % are a bar each.

    Every row has a scale of its own: the median of new groups is in the middle, and their central
    90 % are as wide as in any other row.
    """
    for i, row in enumerate(check.statistics):
        colour = BAD if row.p_value < CONTRADICTED else "black"
        side = row.q95 - row.q50 if row.is_above else row.q50 - row.q05
        distance = row.observed - row.q50
        side_of_median = int(np.sign(distance))
        position, marker = 2.0 * side_of_median, _BEYOND[side_of_median]
        if abs(distance) < 2.0 * side:
            position, marker = distance / side, "D"
        ax.barh(i, 2.0, 0.36, -1.0, color=BAND, label="new groups, 5 to 95 %")
        ax.plot([0.0, 0.0], [i - 0.18, i + 0.18], color=EQUAL, lw=0.8)
        ax.plot(position, i, marker, ms=4.0, color=colour, label="observed", ls="")
        low, high, observed = rounded(row.q05, row.q95, row.q05, row.q95, row.observed)
        text = f"{observed}, expected {low} to {high}, test p = {row.p_value:.2g}"
        ax.text(0.0, i - 0.24, text, ha="center", va="bottom", fontsize=SMALL, color=colour)

    n_rows = len(check.statistics)
    ax.set_yticks(range(n_rows), [fill(row.label, 30) for row in check.statistics])
    ax.set(ylim=(n_rows - 0.5, -0.6), xlim=(-2.2, 2.2), xticks=[])
    legend_above(ax, columns=2, title="does a normal group fit?")
    style_axes(ax).tick_params(axis="y", length=0)
    ax.spines[:].set_visible(False)


def _effects(result: PopulationResult) -> dict[str, tuple[FloatArray, str]]:
    """Effects on the means by parameter: medians and 95 % intervals, (3, effects), and a label."""
    # The unit of differences, and that of a ratio of JNDs.
    units = {CONSTANT_ERROR.name: result.study.unit, NOISE.name: UNKNOWN_UNIT}
    effects = {}
    for name in result.names:
        # Conditions and covariates are not analysed together.
        rows = (*result.table.select("effect", name), *result.table.select("difference", name))
        if not rows:
            continue
        quantiles = np.stack([row.interval for row in rows], axis=1)
        label = _EFFECT_LABELS[name]
        if name == CONSTANT_ERROR.name:
            quantiles = result.scales.step * quantiles
        if name in units:
            unit = units[name].for_percent(percent(quantiles))
            quantiles, label = unit.differences(quantiles), label.format(unit=unit.of_differences)
        effects[name] = quantiles, label
    return effects
