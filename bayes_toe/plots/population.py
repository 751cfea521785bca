"""The figure of a population: its subjects alone and in the group, a new subject's curves, what covariates do, whether its form fits."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from itertools import zip_longest
from textwrap import fill
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.classical.frequencies import presentation_order
from bayes_toe.comparison.words import compared
from bayes_toe.data.study import Study, Subject
from bayes_toe.errors import InputError
from bayes_toe.groups.hyperprior_fields import GROUP_PARAMETERS
from bayes_toe.groups.population import Population
from bayes_toe.groups.predictive_check import CONTRADICTED, PredictiveCheck, Statistic, predictive_check
from bayes_toe.plots.corner_content import LABELS
from bayes_toe.plots.curves import CURVE_DRAWS, Curve, order_panel, over_stronger
from bayes_toe.plots.sorted import HIGH
from bayes_toe.plots.style import (
    BELIEF,
    COLUMN,
    EQUAL,
    LETTERS,
    ORDERS,
    PAGE,
    POSTERIOR,
    SMALL,
    dress,
    even_columns,
    legend_above,
    new_figure,
    panel,
    plain,
)
from bayes_toe.plots.subject import main_weaker
from bayes_toe.seeds import generator

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Subjects beyond which they have no names, and no interval of their own beside that in the group.
MOST_NAMED_IN_GROUP = 40
_MARKED = (0.05, 0.5, 0.95)
_DRAWS = 1000  # of each subject, for quantiles
_ACROSS = 4
#: The name under which :func:`effects_axes` knows the difference of both orders.
ASYMMETRY = "asymmetry"
_LONGEST = 14  # letters of a name
#: Inches of the key over the forests, and of the strip of a new subject and the predictive check.
_KEY, _NEW_HEIGHT = 0.25, 3.1
_BAD, _ALONE, _NEW, _MEAN = "#C00000", "#8C8C8C", "#EDEDED", "#BDB3DD"


class Marked(NamedTuple):
    """Quantiles 5, 50 and 95 % of one quantity, first axis, of every subject alone and in the group, of the mean, and of a new subject."""

    alone: FloatArray
    group: FloatArray
    mean: FloatArray
    new: FloatArray


def main_quantities(found: Population) -> tuple[str, ...]:
    """What the answers depend on, with mu1 in the place of the offset that follows from it."""
    names = found.posterior(found.study.names[0]).names
    return tuple("mu1" if name == "offset" and "mu1" in names.natural else name for name in names.identified)


def marked(found: Population) -> dict[str, Marked]:
    """Quantiles of every quantity, by its name."""
    k, members = len(found.names), found.chains.eta.reshape(-1, len(found.study), len(found.names))
    of = (found.alone, members), (found.chains.mean.reshape(-1, k), found.new_subject().reshape(-1, k))
    thinned = [eta[:: max(1, len(eta) // _DRAWS)] for eta in of[0]]
    quantiles = [
        {name: np.quantile(values, _MARKED, axis=0) for name, values in found.quantities(eta).items()} for eta in (*thinned, *of[1])
    ]
    return {name: Marked(*(one[name] for one in quantiles)) for name in quantiles[0]}


def population_figure(found: Population, check: PredictiveCheck | None = None) -> Figure:
    """Everybody's parameters alone and in the group, :func:`new_subject_axes`, :func:`predictive_check_axes`, :func:`effects_axes`.

    Parameters
    ----------
    found : Population
    check : PredictiveCheck, optional
        Made here where it is not given.
    """
    values, title = marked(found), heading(found)
    blocks = [partial(_draw_forests, found, values), partial(_draw_new, found, check)]
    heights = [_forests_height(found), _NEW_HEIGHT]
    if found.regressors.columns:
        blocks.append(partial(_draw_effects, found))
        heights.append(_effects_height(found))
    over = 0.08 + 0.155 * len(title.splitlines())
    figure = new_figure(PAGE, over + sum(heights), layout=None)
    figure.suptitle(
        title, fontsize=LETTERS + 1.0, color="black" if found.converged else _BAD, y=1.0 - 0.06 / (over + sum(heights)), va="top"
    )
    for block, height in zip(blocks, heights, strict=True):
        block(_Block(figure, over, height))
        over += height
    return figure


class _Block(NamedTuple):
    """A strip of a figure: so many inches from its top, so many high."""

    figure: Figure
    top: float
    height: float

    def panels(self, rows: int, columns: int, *, left: float, over: float, under: float, apart: float, right: float = 0.12) -> list[Axes]:
        """Panels with so many inches left of all, over and under each, and between two, row by row."""
        wide, high = self.figure.get_size_inches()
        each = (wide - left - right - (columns - 1) * apart) / columns, self.height / rows - over - under
        grid = self.figure.add_gridspec(
            rows,
            columns,
            left=left / wide,
            right=1.0 - right / wide,
            top=1.0 - (self.top + over) / high,
            bottom=1.0 - (self.top + self.height - under) / high,
            wspace=apart / each[0],
            hspace=(over + under) / each[1],
        )
        return list(grid.subplots(squeeze=False).ravel())

    def say(self, words: str, under: float) -> None:
        """Words in the middle, so many inches below the top."""
        self.figure.text(0.5, 1.0 - (self.top + under) / self.figure.get_figheight(), words, ha="center", va="center", fontsize=SMALL)

    def legend(self, ax: Axes, under: float) -> None:
        """What is in a panel, so many inches below the top."""
        high = self.figure.get_figheight()
        handles, labels = ax.get_legend_handles_labels()
        self.figure.legend(
            handles,
            labels,
            loc="center",
            bbox_to_anchor=(0.5, 1.0 - (self.top + under) / high),
            ncols=4,
            frameon=False,
            fontsize=SMALL,
            handletextpad=0.4,
            columnspacing=1.4,
        )


def heading(found: Population) -> str:
    """How many subjects under which model, whether to believe it, how they answer in both orders, and where a typical subject is."""
    model = found.settings.model + (" (synthetic data)" if found.study.synthetic else "")
    mean = found.quantities(found.chains.mean.reshape(-1, len(found.names)))
    said = [f"{name} {said_interval(np.quantile(mean[name], _MARKED))}" for name in main_quantities(found)[:2]]
    badge = "" if found.converged else "NOT CONVERGED, not to be reported as it stands\n"
    return f"{badge}Population of {len(found.study)} subjects: {model}\n{'; '.join([*_order_effect(found), *said])}"


def _order_effect(found: Population) -> list[str]:
    """The population's asymmetry and its direction, where it can be seen."""
    if found.asymmetries is None:
        return []
    draws = found.asymmetries.draws[:, :, 0, 0]
    return [f"asymmetry {said_interval(np.quantile(draws, _MARKED))}, {_direction(float((draws > 0.0).mean()))}"]


def said_interval(quantiles: FloatArray) -> str:
    """Quantiles 5, 50, 95 % as words have them: with the digits that the width of the interval asks for.

    Examples
    --------
    >>> said_interval(np.array([-0.0312, 0.0154, 0.41])), said_interval(np.array([0.8891, 0.91, 0.93]))
    ('0.02 (−0.03, 0.41)', '0.910 (0.889, 0.930)')
    """
    low, middle, high = _figures(quantiles[0], quantiles[2], *quantiles.tolist())
    return f"{middle} ({low}, {high})"


def _figures(low: float, high: float, *values: float) -> list[str]:
    """Numbers with two digits of the distance between two others."""
    digits = max(0, 1 - int(np.floor(np.log10(high - low)))) if high > low else 3
    return [f"{round(value, digits) + 0.0:.{digits}f}".replace("-", "−") for value in values]  # never -0.0


# --- Subjects -----------------------------------------------------------------------------------------


def forest_axes(found: Population, quantity: str, ax: Axes | None = None, *, values: Marked | None = None) -> Axes:
    """One quantity of every subject, alone (thin) and in the group (bold), 5, 50 and 95 %, before the population's mean and a new subject.

    More than :data:`MOST_NAMED_IN_GROUP` subjects are sorted by their median in the group, and drawn as they are in it alone.

    Parameters
    ----------
    found : Population
    quantity : str
    ax : matplotlib Axes, optional
        Drawn into, where given.
    values : Marked, optional
        Made here where they are not given.
    """
    shown = marked(found)[quantity] if values is None else values
    ax = panel(ax, wide=2.4, high=_forest_height(found))
    at = " at reference" if found.regressors.columns else ""
    ax.axvspan(shown.new[0], shown.new[2], color=_NEW, lw=0, label=f"new subject{at}")
    ax.axvspan(
        shown.mean[0], shown.mean[2], color=_MEAN, lw=0, label=f"typical subject (mean{' at reference' * bool(found.regressors.columns)})"
    )
    ax.axvline(shown.mean[1], color=BELIEF, lw=0.8)
    if len(found.study) > MOST_NAMED_IN_GROUP:
        _draw_ranked(ax, shown.group)
    else:
        _limit(ax, shown)
        _draw_named(ax, shown, [plain(name, _LONGEST) for name in found.study.names])
    ax.set_xlabel(LABELS.get(quantity, quantity))
    ax.locator_params(axis="x", nbins=4)
    dress(ax).tick_params(axis="y", length=0)
    ax.set_title(said_interval(shown.mean), fontsize=SMALL, color=BELIEF)
    return ax


def _draw_named(ax: Axes, shown: Marked, names: list[str]) -> None:
    y = np.arange(len(names))
    low, high = ax.get_xlim()
    ax.hlines(y - 0.2, shown.alone[0], shown.alone[2], color=_ALONE, lw=0.7)
    ax.plot(shown.alone[1], y - 0.2, "o", ms=2.6, mfc="white", mec=_ALONE, mew=0.7, label="subject alone (5-50-95 %)")
    for edge, marker, beyond in ((low, "<", shown.alone[0] < low), (high, ">", shown.alone[2] > high)):
        ax.plot(np.full(beyond.sum(), edge), y[beyond] - 0.2, marker, ms=2.6, color=_ALONE, mew=0, clip_on=False)
    ax.hlines(y + 0.15, shown.group[0], shown.group[2], color=POSTERIOR, lw=1.6)
    ax.plot(shown.group[1], y + 0.15, "o", ms=3.4, color=POSTERIOR, mec="white", mew=0.4, label="in the group")
    ax.set_yticks(y, names)
    ax.set_ylim(len(names) - 0.5, -0.6)


def _draw_ranked(ax: Axes, group: FloatArray) -> None:
    low, middle, high = group[:, np.argsort(group[1], kind="stable")]
    y = np.arange(len(middle))
    ax.hlines(y, low, high, color=POSTERIOR, lw=min(1.2, 160.0 / len(y)), alpha=0.6)
    ax.plot(middle, y, "o", ms=1.8 if len(y) <= 100 else 1.2, color=POSTERIOR, label="subjects in the group (5-50-95 %)")
    ax.set(ylim=(len(y) - 0.5, -0.5), yticks=[])


def _limit(ax: Axes, shown: Marked) -> None:
    """The group with room for what subjects alone say, but no more than half as much again: a subject alone may say nothing."""
    inner = float(min(shown.group[0].min(), shown.new[0])), float(max(shown.group[2].max(), shown.new[2]))
    more = 0.25 * (inner[1] - inner[0])
    low, high = max(inner[0] - more, float(shown.alone[0].min())), min(inner[1] + more, float(shown.alone[2].max()))
    low, high = min(low, inner[0]), max(high, inner[1])
    pad = 0.03 * (high - low)
    ax.set_xlim(low - pad, high + pad)


def _forest_height(found: Population) -> float:
    subjects = len(found.study)
    return 0.75 + (0.6 * HIGH if subjects > MOST_NAMED_IN_GROUP else max(0.8, subjects * (0.2 if subjects <= 20 else 0.16)))


def _grid(panels: int, most: int) -> tuple[int, int]:
    """Rows, and panels across."""
    across = even_columns(panels, most)
    return -(-panels // across), across


def _forest_grid(found: Population) -> tuple[int, int]:
    return _grid(len(main_quantities(found)), _ACROSS)


def _forests_height(found: Population) -> float:
    return _KEY + _forest_grid(found)[0] * _forest_height(found)


def _draw_forests(found: Population, values: Mapping[str, Marked], block: _Block) -> None:
    (rows, across), crowded = _forest_grid(found), len(found.study) > MOST_NAMED_IN_GROUP
    inner = block._replace(top=block.top + _KEY, height=block.height - _KEY)
    longest = max(len(plain(name, _LONGEST)) for name in found.study.names)
    axes = inner.panels(rows, across, left=0.4 if crowded else 0.2 + 0.06 * max(longest, 4), over=0.2, under=0.5, apart=0.2)
    for i, (name, ax) in enumerate(zip_longest(main_quantities(found), axes)):
        if name is None:
            ax.remove()
            continue
        forest_axes(found, name, ax, values=values[name])
        if i % across:
            ax.tick_params(labelleft=False)
        elif crowded:
            ax.set_ylabel(f"{len(found.study):,} subjects, sorted in each panel", fontsize=LETTERS)
    block.legend(axes[0], 0.5 * _KEY)


# --- A new subject ------------------------------------------------------------------------------------


def new_subject_axes(found: Population, ax: Axes | None = None) -> Axes:
    """P(equal) of a new subject in both orders, mean and central 50 and 90 % over draws; points: all subjects' answers taken together.

    With covariates, a new subject that has those of a random one of the study. Of pairs at several intervals those at the one that was
    met most often.

    Parameters
    ----------
    found : Population
    ax : matplotlib Axes, optional
        Drawn into, where given.
    """
    ax = panel(ax, high=2.6)
    isi = _main_interval(found.study)
    everyone, equal = _together(found.study if isi is None else found.study.at_isi(isi)), _curve(found, isi)
    reference = main_weaker(everyone)
    low = float(everyone.s1.min()) if reference is None else reference
    order_panel(ax, everyone, None, low, size=4.0)
    x = over_stronger(everyone, low, 60)
    for order, pair in {0: (x, x), -1: (np.full_like(x, low), x), 1: (x, np.full_like(x, low))}.items():
        if (presentation_order(everyone) == order).any():
            _draw_band(ax, x, equal(*pair), ORDERS[order].colour)
    ax.set(yticks=[0.0, 0.5, 1.0], ylabel="P('equal')")
    at = "" if isi is None else f" at {isi:g} s"
    who = "new subject with covariates of the study" if found.regressors.columns else "new subject"
    legend_above(ax, columns=3, title=f"{who}:\nmean, 50 %, dotted 90 %; points: all answers{at}")
    return dress(ax)


def _draw_band(ax: Axes, x: FloatArray, q: FloatArray, colour: str) -> None:
    """Mean and central 50 and 90 % over draws, the latter by their edges alone: bands of both orders lie one over the other."""
    outer, inner, inner_high, outer_high = np.quantile(q, (0.05, 0.25, 0.75, 0.95), axis=0)
    ax.fill_between(x, inner, inner_high, color=colour, alpha=0.2, lw=0)
    ax.plot(x, np.stack([outer, outer_high], axis=1), color=colour, lw=0.9, ls=":")
    ax.plot(x, q.mean(axis=0), color=colour, lw=1.6)


def _curve(found: Population, isi: float | None) -> Curve:
    """P(equal) of pairs for draws of a new subject."""
    posterior, columns, k = found.posterior(found.study.names[0]), found.regressors.x, len(found.names)
    some = slice(None, None, max(1, found.chains.mean[..., 0].size // CURVE_DRAWS))
    eta = found.new_subject().reshape(-1, k)[some]
    effects = found.chains.effects.reshape(len(found.chains.mean) * found.chains.mean.shape[1], -1, k)[some]
    whose = generator(found.settings.seed, "population", "whose covariates").integers(len(columns), size=len(eta))
    x, _ = posterior.from_group(eta + np.einsum("dr,drk->dk", columns[whose], effects))

    def equal(s1: FloatArray, s2: FloatArray) -> FloatArray:
        pairs, which = np.unique(np.column_stack([s1, s2]), axis=0, return_inverse=True)  # a subject has its pairs once, in this order
        once = np.ones(len(pairs), np.int64)
        asked = Subject("new", pairs[:, 0], pairs[:, 1], 0 * once, once, None if isi is None else np.full(len(pairs), isi))
        return np.asarray(np.exp(posterior.for_subject(asked).log_answers(x)[0])[:, which.ravel()])

    return equal


def _together(study: Study) -> Subject:
    """The answers of all subjects as those of one."""
    keys = ("s1", "s2", "n_equal", "n_trials")
    return Subject.from_counts("all", *(np.concatenate([getattr(one, key) for one in study]) for key in keys))


def _main_interval(study: Study) -> float | None:
    if not study.intervals:
        return None
    isi, trials = (np.concatenate([np.asarray(getattr(one, key)) for one in study]) for key in ("isi", "n_trials"))
    return max(study.intervals, key=lambda seconds: int(trials[isi == seconds].sum()))


# --- Covariates ---------------------------------------------------------------------------------------


def effects_axes(found: Population, parameter: str, ax: Axes | None = None) -> Axes:
    """What covariates do to one parameter, on the scale on which subjects scatter: 5, 50 and 95 %, and the probability of the direction.

    Parameters
    ----------
    found : Population
    parameter : str
        One of `found.names`, or :data:`ASYMMETRY`.
    ax : matplotlib Axes, optional
        Drawn into, where given.

    Raises
    ------
    InputError
        If there is none of this name.
    """
    known = _effects(found)
    if parameter not in known:
        raise InputError(f"effects of covariates: found {parameter!r}, allowed: {', '.join(known)}")
    ax = panel(ax, wide=COLUMN, high=1.0 + 0.4 * len(found.regressors.columns))
    _draw_intervals(ax, known[parameter])
    ax.set_yticks(range(len(found.regressors.columns)), [plain(fill(column.about, 22), 70) for column in found.regressors.columns])
    ax.set_xlabel("asymmetry" if parameter == ASYMMETRY else GROUP_PARAMETERS[parameter].label)
    dress(ax).tick_params(axis="y", length=0)
    ax.spines["left"].set_visible(False)
    return ax


def _effects(found: Population) -> dict[str, FloatArray]:
    """Draws of the effects on everything, shape (draws, r): parameters, and the asymmetry where it can be seen."""
    columns = found.regressors.columns
    if not columns:
        return {}
    of_parameters = {name: found.chains.effects[..., i].reshape(-1, len(columns)) for i, name in enumerate(found.names)}
    if found.asymmetries is None:
        return of_parameters
    of_answers = found.asymmetries.draws[:, :, np.flatnonzero(found.asymmetries.differences), 0]  # in the order of the columns
    return of_parameters | {ASYMMETRY: of_answers.reshape(-1, len(columns))}


def _draw_intervals(ax: Axes, draws: FloatArray) -> None:
    """A row for each column, with its direction over it."""
    low, middle, high = np.quantile(draws, _MARKED, axis=0)
    y = np.arange(draws.shape[1])
    ax.axvline(0.0, color="black", lw=0.8)
    ax.hlines(y, low, high, color=POSTERIOR, lw=1.6)
    ax.plot(middle, y, "o", ms=3.4, color=POSTERIOR)
    behind = {"facecolor": "white", "edgecolor": "none", "pad": 0.6}
    for i, above in enumerate((draws > 0.0).mean(axis=0).tolist()):
        where = ax.get_yaxis_transform()
        ax.text(0.5, i - 0.18, _direction(above), transform=where, ha="center", va="bottom", fontsize=SMALL, bbox=behind)
    reach = 1.08 * float(max(np.abs(low).max(), np.abs(high).max()))
    ax.set(xlim=(-reach, reach), ylim=(len(y) - 0.6, -0.7))
    ax.locator_params(axis="x", nbins=4)


def _direction(above: float) -> str:
    """The probability of the sign that is the likelier one."""
    return f"P(> 0) {compared(above)}" if above >= 0.5 else f"P(< 0) {compared(1.0 - above)}"


def _effects_grid(found: Population) -> tuple[int, int]:
    return _grid(len(found.names) + (found.asymmetries is not None), _ACROSS + 1)


def _effects_height(found: Population) -> float:
    return _effects_grid(found)[0] * (0.85 + 0.4 * len(found.regressors.columns))


def _draw_effects(found: Population, block: _Block) -> None:
    (rows, across), names = _effects_grid(found), (*found.names, *([] if found.asymmetries is None else [ASYMMETRY]))
    axes = block.panels(rows, across, left=1.35, over=0.3, under=0.45, apart=0.15)
    block.say("effects of covariates on the population's mean, 5, 50 and 95 %, on the scales on which subjects scatter", 0.12)
    for i, (name, ax) in enumerate(zip_longest(names, axes)):
        if name is None:
            ax.remove()
            continue
        effects_axes(found, name, ax)
        ax.tick_params(labelleft=i % across == 0)


# --- Predictive check ---------------------------------------------------------------------------------


def predictive_check_axes(check: PredictiveCheck, ax: Axes | None = None) -> Axes:
    """How subjects differ in what they did (points) beside new groups of the population, whose 5 to 95 % are one bar each.

    Parameters
    ----------
    check : PredictiveCheck
    ax : matplotlib Axes, optional
        Drawn into, where given.
    """
    ax = panel(ax, high=2.6)
    for i, one in enumerate(check.statistics):
        _draw_statistic(ax, i, one)
    y = np.arange(len(check.statistics))
    ax.set_yticks(y, [fill(one.label, 18) for one in check.statistics])
    ax.set(ylim=(len(y) - 0.5, -0.6), xlim=(-2.2, 2.2), xticks=[])
    legend_above(ax, columns=2, title=f"does a {check.scatter} population fit?")
    dress(ax).tick_params(axis="y", length=0)
    ax.spines[:].set_visible(False)
    return ax


def _draw_new(found: Population, check: PredictiveCheck | None, block: _Block) -> None:
    left, right = block.panels(1, 2, left=0.55, over=0.55, under=0.5, apart=1.4)
    new_subject_axes(found, left)
    predictive_check_axes(predictive_check(found) if check is None else check, right)


def _draw_statistic(ax: Axes, i: int, one: Statistic) -> None:
    """A row with a scale of its own: the median of new groups in the middle, their central 90 % as wide as in any other row."""
    wrong = one.p_value < CONTRADICTED
    side = one.q95 - one.q50 if one.observed > one.q50 else one.q50 - one.q05
    where = (one.observed - one.q50) / side if side > 0.0 else 0.0
    ax.barh(i, 2.0, 0.36, -1.0, color=_NEW, label="new groups, 5 to 95 %" if i == 0 else None)
    ax.plot([0.0, 0.0], [i - 0.18, i + 0.18], color=EQUAL, lw=0.8)
    shown = float(np.clip(where, -2.0, 2.0))
    marker = "D" if shown == where else "<" if where < 0.0 else ">"
    ax.plot(shown, i, marker, ms=4.0, color=_BAD if wrong else "black", label="observed" if i == 0 else None, ls="")
    low, high = _figures(one.q05, one.q95, one.q05, one.q95)
    words = f"{_figures(one.q05, one.q95, one.observed)[0]}, expected {low} to {high}, p = {one.p_value:.2g}"
    ax.text(0.0, i - 0.24, words, ha="center", va="bottom", fontsize=SMALL - 1.0, color=_BAD if wrong else "black")
