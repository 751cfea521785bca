"""Figures of a population: its subjects alone and in the group, a new subject's curves, what covariates do, whether its form fits."""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import fill
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bayes_toe.arrays import FloatArray
from bayes_toe.comparison.population_answer import on_average
from bayes_toe.comparison.words import compared
from bayes_toe.data.study import Study, pooled
from bayes_toe.groups.hyperprior import GROUP_PARAMETERS
from bayes_toe.groups.population import Population
from bayes_toe.groups.predictive_check import CONTRADICTED, PredictiveCheck, predictive_check
from bayes_toe.inference.prediction import Predictor
from bayes_toe.plots.curves import (
    CURVE_DRAWS,
    Curve,
    lines_along,
    main_weaker,
    order_panel,
    which_weaker,
)
from bayes_toe.plots.style import (
    BAD,
    BAND,
    BELIEF,
    EQUAL,
    HIGH,
    LABELS,
    LETTERS,
    MARKED,
    ORDERS,
    PAGE,
    POSTERIOR,
    SMALL,
    chance,
    draw_band,
    dress,
    even_columns,
    first_panels,
    legend_above,
    legend_below,
    new_figure,
    plain,
    rounded,
    said_interval,
)
from bayes_toe.seeds import generator

#: Subjects beyond which they have no names, and no interval of their own beside that in the group.
MOST_NAMED_IN_GROUP = 40
_DRAWS = 1000  # of each subject, for quantiles
_ALONE, _MEAN = "#8C8C8C", "#BDB3DD"
_ACROSS = 4


def population_figure(found: Population, check: PredictiveCheck | None = None) -> Figure:
    """Everybody's parameters alone and in the group; a new subject's curves and the predictive check; effects of covariates.

    Above: 5, 50 and 95 % of every subject, alone (thin) and in the group (bold), before the population's mean and a new subject. In the
    middle: what a new subject answers, mean and central 50 and 90 %, among all answers; how subjects differ in what they did beside new
    groups. Below: what covariates do to the mean of every parameter.

    Parameters
    ----------
    found : Population
    check : PredictiveCheck, optional
        Made here where it is not given.
    """
    values, quantities, effects = marked(found), _main_quantities(found), effects_of(found)
    across, effects_across = (
        even_columns(len(quantities), _ACROSS),
        even_columns(max(len(effects), 1), _ACROSS + 1),
    )
    down, effects_down = -(-len(quantities) // across), -(-len(effects) // effects_across)
    heights = [0.3 + down * _forest_height(found), 2.9]
    labels = effect_labels(found)
    heights += [0.3 + effects_down * (0.85 + 0.4 * len(labels))] if effects else []
    figure = new_figure(PAGE, 0.6 + sum(heights))
    figure.suptitle(
        _heading(found), fontsize=LETTERS + 1.0, color="black" if found.converged else BAD
    )
    parts = figure.subfigures(len(heights), 1, height_ratios=heights, squeeze=False)[:, 0]
    forests = first_panels(parts[0].add_gridspec(down, across), len(quantities))
    for i, (name, ax) in enumerate(zip(quantities, forests, strict=True)):
        forest(ax, found, name, values[name])
        if i % across:
            ax.tick_params(labelleft=False)
        elif len(found.study) > MOST_NAMED_IN_GROUP:
            ax.set_ylabel(f"{len(found.study):,} subjects, sorted in each panel", fontsize=LETTERS)
    legend_below(parts[0], size=SMALL, columns=4, side="upper")
    left, right = parts[1].subplots(1, 2)
    new_subject(left, found)
    check_panel(right, predictive_check(found) if check is None else check)
    if effects:
        what = (
            "differences between conditions on average"
            if found.differences
            else "effects of covariates on the population's mean"
        )
        said = f"{what}, 5, 50 and 95 %, on the scales on which subjects scatter"
        parts[2].suptitle(said, fontsize=SMALL)
        panels = first_panels(parts[2].add_gridspec(effects_down, effects_across), len(effects))
        for i, ((name, draws), ax) in enumerate(zip(effects.items(), panels, strict=True)):
            effects_panel(ax, draws, GROUP_PARAMETERS[name].label, labels)
            ax.tick_params(labelleft=i % effects_across == 0)
    return figure


def _heading(found: Population) -> str:
    """How many subjects under which model, whether to believe it, what is said of them on average, and where a typical subject is."""
    answer, said = on_average(found), list[str]()
    if answer is None:
        mean = found.quantities(found.chains.mean.reshape(-1, len(found.names)))
        said += [
            f"{name} {said_interval(np.quantile(mean[name], MARKED))}"
            for name in _main_quantities(found)[:2]
        ]
    else:
        factors = ", ".join(f"{row.parameter} {row.of_none}" for row in answer.means)
        said += [
            f"order effect: {answer.words} (P of none {compared(answer.p_none)})\nBayes factors of a mean of 0: {factors}"
        ]
    model = found.settings.model + (" (synthetic data)" if found.study.synthetic else "")
    badge = "" if found.converged else "NOT CONVERGED, not to be reported as it stands\n"
    return f"{badge}Population of {len(found.study)} subjects: {model}\n{'; '.join(said)}"


def _main_quantities(found: Population) -> tuple[str, ...]:
    """What the answers depend on, with mu1 in the place of the offset that follows from it."""
    names = found.typical.names
    return tuple(
        "mu1" if name == "offset" and "mu1" in names.natural else name for name in names.identified
    )


def _direction(above: float) -> str:
    """The probability of the sign that is the likelier one."""
    return f"P(> 0) {compared(above)}" if above >= 0.5 else f"P(< 0) {compared(1.0 - above)}"


# --- everybody, alone and in the group ----------------------------------------------------------------------------------------------


class Marked(NamedTuple):
    """Quantiles 5, 50 and 95 % of one quantity, first axis, of every subject alone and in the group, of the mean, and of a new subject."""

    alone: FloatArray
    group: FloatArray
    mean: FloatArray
    new: FloatArray


def marked(found: Population) -> dict[str, Marked]:
    """Quantiles of every quantity, by its name."""
    k = len(found.names)
    of_subjects = (found.unpooled, found.chains.eta.reshape(-1, len(found.study), k))
    some = [eta[:: max(1, len(eta) // _DRAWS)] for eta in of_subjects]
    points = (*some, found.chains.mean.reshape(-1, k), found.new_subject().reshape(-1, k))
    quantiles = [
        {
            name: np.quantile(values, MARKED, axis=0)
            for name, values in found.quantities(eta).items()
        }
        for eta in points
    ]
    return {name: Marked(*(one[name] for one in quantiles)) for name in quantiles[0]}


def forest(ax: Axes, found: Population, quantity: str, shown: Marked) -> None:
    """One quantity of every subject before the population's mean and a new subject; of very many subjects, sorted and in the group only."""
    at = " at reference" if found.regressors.columns else ""
    ax.axvspan(shown.new[0], shown.new[2], color=BAND, lw=0, label=f"new subject{at}")
    ax.axvspan(shown.mean[0], shown.mean[2], color=_MEAN, lw=0, label=f"typical subject (mean{at})")
    ax.axvline(shown.mean[1], color=BELIEF, lw=0.8)
    if len(found.study) > MOST_NAMED_IN_GROUP:
        low, middle, high = shown.group[:, np.argsort(shown.group[1], kind="stable")]
        y = np.arange(len(middle))
        ax.hlines(y, low, high, color=POSTERIOR, lw=min(1.2, 160.0 / len(y)), alpha=0.6)
        ax.plot(
            middle,
            y,
            "o",
            ms=1.8 if len(y) <= 100 else 1.2,
            color=POSTERIOR,
            label="subjects in the group (5-50-95 %)",
        )
        ax.set(ylim=(len(y) - 0.5, -0.5), yticks=[])
    else:
        _draw_named(ax, shown, [plain(name, 14) for name in found.study.names])
    ax.set_xlabel(LABELS.get(quantity, quantity))
    ax.locator_params(axis="x", nbins=4)
    dress(ax).tick_params(axis="y", length=0)
    ax.set_title(said_interval(shown.mean), fontsize=SMALL, color=BELIEF)


def _draw_named(ax: Axes, shown: Marked, names: list[str]) -> None:
    """Subjects alone and in the group; where one alone says little, its interval is cut, since it would squeeze all others."""
    y = np.arange(len(names))
    inner = (
        float(min(shown.group[0].min(), shown.new[0])),
        float(max(shown.group[2].max(), shown.new[2])),
    )
    more = 0.25 * (inner[1] - inner[0])
    low = min(inner[0], max(inner[0] - more, float(shown.alone[0].min())))
    high = max(inner[1], min(inner[1] + more, float(shown.alone[2].max())))
    low, high = low - 0.03 * (high - low), high + 0.03 * (high - low)
    ax.set_xlim(low, high)
    ax.hlines(y - 0.2, shown.alone[0], shown.alone[2], color=_ALONE, lw=0.7)
    ax.plot(
        shown.alone[1],
        y - 0.2,
        "o",
        ms=2.6,
        mfc="white",
        mec=_ALONE,
        mew=0.7,
        label="subject alone (5-50-95 %)",
    )
    for edge, marker, beyond in (
        (low, "<", shown.alone[0] < low),
        (high, ">", shown.alone[2] > high),
    ):
        if (
            beyond.any()
        ):  # without any, an empty line that is not clipped would take room at the page's corner
            ax.plot(
                np.full(beyond.sum(), edge),
                y[beyond] - 0.2,
                marker,
                ms=2.6,
                color=_ALONE,
                mew=0,
                clip_on=False,
            )
    ax.hlines(y + 0.15, shown.group[0], shown.group[2], color=POSTERIOR, lw=1.6)
    ax.plot(
        shown.group[1],
        y + 0.15,
        "o",
        ms=3.4,
        color=POSTERIOR,
        mec="white",
        mew=0.4,
        label="in the group",
    )
    ax.set_yticks(y, names)
    ax.set_ylim(len(names) - 0.5, -0.6)


def _forest_height(found: Population) -> float:
    """Inches of a forest."""
    subjects = len(found.study)
    return 0.75 + (
        0.6 * HIGH
        if subjects > MOST_NAMED_IN_GROUP
        else max(0.8, subjects * (0.2 if subjects <= 20 else 0.16))
    )


# --- a new subject ------------------------------------------------------------------------------------------------------------------


def new_subject(ax: Axes, found: Population) -> None:
    """P of the counted answer of a new subject, mean and central 50 % over draws, of few curves 90 %; points: all answers together.

    With covariates, a new subject that has those of a random one of the study. Of pairs at several intervals those at the one that was
    met most often; of several weaker stimuli the one in most pairs, which the panel then names.
    """
    isi = _main_interval(found.study)
    study = found.study if isi is None else found.study.at_isi(isi)
    everyone = pooled(study.subjects)
    equal, reference = _curve(found, isi), main_weaker(everyone)
    low = float(everyone.s1.min()) if reference is None else reference
    order_panel(ax, everyone, None, low, size=4.0)
    lines = lines_along(everyone, low, 60)
    few = len(lines) <= len(ORDERS)  # dotted ends of many curves would hide each other
    for line in lines:
        colour, q = line.mark.colour, equal(line.s1, line.s2)
        draw_band(ax, line.x, q, colour, bands=((0.25, 0.75, 0.2),))
        if few:  # areas of both orders would hide each other
            ax.plot(line.x, np.quantile(q, (0.05, 0.95), axis=0).T, color=colour, lw=0.9, ls=":")
    ax.set(yticks=[0.0, 0.5, 1.0], ylabel=chance(study.task))
    at = "" if isi is None else f" at {isi:g} s"
    who = "new subject with covariates of the study" if found.regressors.columns else "new subject"
    if about := which_weaker(everyone, low):
        ax.set_xlabel(f"stronger stimulus (ln), {about}")
    legend_above(
        ax, columns=3, title=f"{who}:\nmean, 50 %{', dotted 90 %' * few}; points: all answers{at}"
    )
    dress(ax)


def _main_interval(study: Study) -> float | None:
    """The interval of most trials."""
    if not study.intervals:
        return None
    isi, trials = (
        np.concatenate([np.asarray(getattr(one, key)) for one in study])
        for key in ("isi", "n_trials")
    )
    return max(study.intervals, key=lambda seconds: int(trials[isi == seconds].sum()))


def _curve(found: Population, isi: float | None) -> Curve:
    """P of the counted answer of pairs for draws of a new subject."""
    columns, k = found.regressors.x, len(found.names)
    some = slice(None, None, max(1, found.chains.mean[..., 0].size // CURVE_DRAWS))
    eta = found.new_subject().reshape(-1, k)[some]
    effects = found.chains.effects.reshape(found.chains.mean[..., 0].size, -1, k)[some]
    whose = generator(found.settings.seed, "population", "whose covariates").integers(
        len(columns), size=len(eta)
    )
    target = found.typical
    fitted = Predictor(
        target, target.from_group(eta + np.einsum("dr,drk->dk", columns[whose], effects))[0]
    )
    return lambda s1, s2: fitted.yes(s1, s2, None if isi is None else np.full(len(s1), isi))


# --- the form of the population, and covariates -------------------------------------------------------------------------------------


def check_panel(ax: Axes, check: PredictiveCheck) -> None:
    """How subjects differ in what they did (points) beside new groups of the population, whose 5 to 95 % are one bar each.

    Every row has a scale of its own: the median of new groups is in the middle, their central 90 % are as wide as in any other row.
    """
    for i, one in enumerate(check.statistics):
        colour = BAD if one.p_value < CONTRADICTED else "black"
        side = one.q95 - one.q50 if one.observed > one.q50 else one.q50 - one.q05
        where = (one.observed - one.q50) / side if side > 0.0 else 0.0
        shown = float(np.clip(where, -2.0, 2.0))
        marker = "D" if shown == where else "<" if where < 0.0 else ">"
        ax.barh(i, 2.0, 0.36, -1.0, color=BAND, label="" if i else "new groups, 5 to 95 %")
        ax.plot([0.0, 0.0], [i - 0.18, i + 0.18], color=EQUAL, lw=0.8)
        ax.plot(shown, i, marker, ms=4.0, color=colour, label="" if i else "observed", ls="")
        low, high, observed = rounded(one.q05, one.q95, one.q05, one.q95, one.observed)
        words = f"{observed}, expected {low} to {high}, p = {one.p_value:.2g}"
        ax.text(0.0, i - 0.24, words, ha="center", va="bottom", fontsize=SMALL, color=colour)
    count = len(check.statistics)
    ax.set_yticks(range(count), [fill(one.label, 18) for one in check.statistics])
    ax.set(ylim=(count - 0.5, -0.6), xlim=(-2.2, 2.2), xticks=[])
    legend_above(ax, columns=2, title=f"does a {check.scatter} population fit?")
    dress(ax).tick_params(axis="y", length=0)
    ax.spines[:].set_visible(False)


def effects_panel(ax: Axes, draws: FloatArray, label: str, labels: Sequence[str]) -> None:
    """Effects on one thing, shape (draws, effects): 5, 50 and 95 %, and the probability of the direction."""
    y = np.arange(len(labels))
    low, middle, high = np.quantile(draws, MARKED, axis=0)
    ax.axvline(0.0, color="black", lw=0.8)
    ax.hlines(y, low, high, color=POSTERIOR, lw=1.6)
    ax.plot(middle, y, "o", ms=3.4, color=POSTERIOR)
    words: dict[str, Any] = {
        "ha": "center",
        "va": "bottom",
        "fontsize": SMALL,
        "bbox": {"facecolor": "white", "edgecolor": "none", "pad": 0.6},
    }
    for i, above in enumerate((draws > 0.0).mean(axis=0).tolist()):
        ax.text(0.5, i - 0.18, _direction(above), transform=ax.get_yaxis_transform(), **words)
    reach = 1.08 * float(max(np.abs(low).max(), np.abs(high).max()))
    ax.set(xlim=(-reach, reach), ylim=(len(y) - 0.6, -0.7), xlabel=label)
    ax.locator_params(axis="x", nbins=4)
    ax.set_yticks(y, [plain(fill(about, 22), 70) for about in labels])
    dress(ax).tick_params(axis="y", length=0)
    ax.spines["left"].set_visible(False)


def effect_labels(found: Population) -> list[str]:
    """What each effect is one of: a covariate's column, or a comparison of conditions."""
    if found.differences is None:
        return [column.about for column in found.regressors.columns]
    conditions = found.differences.conditions
    return [
        f"{conditions.name} {level} − {reference}" for level, reference in conditions.comparisons
    ]


def effects_of(found: Population) -> dict[str, FloatArray]:
    """Draws of the effects on the parameters, or of conditions, shape (draws, columns)."""
    columns = found.regressors.columns
    if found.differences is not None:
        return {
            name: values.reshape(-1, values.shape[-1])
            for name, values in found.differences.on_average().items()
        }
    if not columns:
        return {}
    return {
        name: found.chains.effects[..., i].reshape(-1, len(columns))
        for i, name in enumerate(found.names)
    }
