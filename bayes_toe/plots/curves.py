"""Fitted curves with the responses of one subject.

`curves` draws the whole figure, the other functions one panel; the report uses the panels too.

In 'same or different' a panel has the pairs with one weaker stimulus, over their stronger stimulus,
with a curve for each order. In 'which is stronger' it has the pairs with one first stimulus, over
s2 - s1; the curve crosses one half at the point of subjective equality (PSE). Such panels also show
'same or different' with more than six weaker stimuli. With three answers, each answer has a curve
over s2 - s1. `responses_panel` pools the pairs of a subject in one panel. Bands are central 95 %
intervals of the posterior.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.stats import mode

from bayes_toe.analysis import Analysis
from bayes_toe.arrays import ArrayPair, BoolArray, FloatArray, IntArray
from bayes_toe.classical.frequencies import laplace_error, laplace_estimate, presentation_order
from bayes_toe.data.study import Subject
from bayes_toe.data.tasks import WHICH_STRONGER
from bayes_toe.errors import require_kind
from bayes_toe.inference.draws import Draws
from bayes_toe.inference.prediction import Predictor
from bayes_toe.model.models import ObserverPosterior, model_title
from bayes_toe.plots.style import (
    EQUAL,
    LETTERS,
    ORDERS,
    SMALL,
    Mark,
    Style,
    difference_axis,
    draw_band,
    explain_curves,
    grid_panels,
    grid_rows,
    label_outer,
    legend_outside,
    new_figure,
    plain,
    proportion_axis,
    stimulus_axis,
    write_note,
)

#: Largest number of panels of a figure, and of pooled points of an order in a panel.
MOST_PANELS = 6
#: A function of the first and second stimuli of pairs, shape (pairs,) each. It returns P of the
#: counted answer, shape (draws, pairs).
Curve = Callable[[FloatArray, FloatArray], FloatArray]
_INK = "#333333"
POINTS = 60  # along a curve
#: Distance of marks from their stimulus, as a share of the range of stimuli, so that no mark hides
#: another mark.
_SHIFT = 0.008


# --- one subject, over the stimuli ----------------------------------------------------------------


def curves(source: Analysis | Draws, subject: str) -> Figure:
    """Draw the responses of one subject in both orders, with the fitted probabilities.

    The lines are posterior means with central 95 % bands: P('equal') in a panel for each weaker
    stimulus, or P('second') over s2 - s1 in a panel for each first stimulus or for neighbouring
    first stimuli. Where P('second') crosses one half is the point of subjective equality (PSE).

    If 'same or different' has more than six weaker stimuli, its panels are over s2 - s1 too.

    Parameters
    ----------
    source : Analysis or Draws
        The curves of an analysis are averaged over the four models. The curves of draws belong to
        the model of the draws.
    subject : str

    Raises
    ------
    InputError
        For an unknown subject.
    """
    require_kind("source", source, (Analysis, Draws), "Analysis | Draws")
    if isinstance(source, Draws):
        fitted = Predictor.from_draws(source, subject, n_draws=600)
        model = model_title(source.model)
        draws = source
    else:
        fitted = source.curve(subject)
        model = "average of the four models"
        draws = source.draws
    title = f"{plain(subject)}: {model}"
    if draws.synthetic:
        title += " (synthetic data)"
    if source is draws and subject in draws.not_converged:
        title += "\nNOT CONVERGED"
    return fitted_figure(fitted, title)


def fitted_figure(fitted: Predictor, title: str) -> Figure:
    """Draw the responses and curves of a subject in panels by weaker or by first stimulus."""
    subject = fitted.target.subject
    # The paper's model has no curves for 'first' and 'second'.
    has_three_curves = (
        isinstance(fitted.target, ObserverPosterior) and subject.task.has_three_answers
    )
    is_by_first = subject.task == WHICH_STRONGER or has_three_curves
    stimuli = np.unique(_weaker_stimuli(subject))  # none if no pair has different stimuli
    if is_by_first or not 1 <= len(stimuli) <= MOST_PANELS:
        stimulus_name = "first"
        stimuli = np.unique(subject.s1)
    else:
        stimulus_name = "weaker"
    # The stimuli (ln) of each panel. First stimuli share panels if there are many.
    groups = np.array_split(stimuli, min(len(stimuli), MOST_PANELS))

    n_columns = min(2, len(groups))
    figure = new_figure(max(3.6, 2.2 * n_columns), 1.75 * grid_rows(len(groups), n_columns) + 0.9)
    # The legend of a subfigure stands below the title of its figure.
    subfigure: Any = figure.subfigures()  # a single subfigure
    panels = grid_panels(subfigure, len(groups), n_columns)
    for ax, group in zip(panels, groups, strict=True):
        if has_three_curves:
            three_answers_panel(ax, subject, fitted, group)
        elif stimulus_name == "weaker":
            weaker_stimulus_panel(ax, subject, fitted.yes, float(group[0]))  # a single stimulus
        else:
            first_stimulus_panel(ax, subject, fitted.yes, group)
        if len(groups) > 1:
            ax.set_title(_describe_group(subject, group, stimulus_name), loc="left", fontsize=SMALL)
    finish_panels(panels, n_columns)
    legend_outside(subfigure, side="upper")
    figure.suptitle(title, fontsize=LETTERS + 1.0)
    return figure


def finish_panels(panels: Sequence[Axes], n_columns: int) -> None:
    """Set axes and labels of panels of responses, and add the curves to the legend."""
    proportion_axis(panels[0])  # the panels share this axis
    label_outer(panels, n_columns)
    explain_curves(panels[0])


def _describe_group(subject: Subject, group: FloatArray, stimulus_name: str) -> str:
    """The title of a panel of sorted stimuli (ln), as in 'first stimulus 20 to 25 g'."""
    # Of the lowest and the highest stimulus; one number if both are the same.
    numbers, unit = subject.unit.numbers(group[[0, -1]], subject.mean_first)
    ends = " to ".join(dict.fromkeys(numbers))
    return f"{stimulus_name} stimulus {ends} {unit}".replace("-", "−")


# --- panels ---------------------------------------------------------------------------------------


def responses_panel(ax: Axes, subject: Subject, fitted: Predictor) -> None:
    """Draw the responses and curves of a subject by order.

    In 'which is stronger' and with three answers the panel has all pairs, pooled. In 'same or
    different' it has the pairs with the weaker stimulus that most pairs share.
    """
    if subject.task.has_three_answers:
        three_answers_panel(ax, subject, fitted, subject.s1)
        return
    if subject.task == WHICH_STRONGER:
        correct_panel(ax, subject, fitted.yes)
        return
    weaker = main_weaker(subject)
    weaker_stimulus_panel(ax, subject, fitted.yes, weaker)
    if len(np.unique(_weaker_stimuli(subject))) > 1:
        write_note(ax, _describe_group(subject, np.array([weaker]), "weaker"))


def weaker_stimulus_panel(ax: Axes, subject: Subject, curve: Curve, weaker: float) -> None:
    """Draw P('equal') over the stronger stimulus of the pairs with one weaker stimulus (ln).

    There is a curve for each order, as in Fig. 3, upper row.
    """
    stronger = np.maximum(subject.s1, subject.s2)  # (pairs,), the horizontal axis
    is_in_panel = pairs_with_weaker(subject, weaker)
    low = float(stronger[is_in_panel].min(initial=weaker))
    high = float(stronger[is_in_panel].max())
    # The curves of different stimuli start at `weaker`. Equal stimuli may be below it.
    pairs_by_order = pairs_with_stronger(weaker, np.linspace(weaker, high, POINTS))
    equal_stimuli = np.linspace(low, high, POINTS)
    pairs_by_order[0] = equal_stimuli, equal_stimuli

    order = presentation_order(subject)
    for sign, mark in ORDERS.items():
        rows = is_in_panel & (order == sign)
        if not rows.any():
            continue
        first, second = pairs_by_order[sign]
        draw_band(ax, np.maximum(first, second), curve(first, second), mark.colour)
        position = stronger[rows] + sign * _SHIFT * (high - low)
        draw_shares(ax, position, subject.n_yes[rows], subject.n_trials[rows], mark)

    stimulus_axis(ax, "stronger stimulus", subject.unit, subject.mean_first)
    ax.set_ylabel(f"proportion '{subject.task.yes}'")


def pairs_with_stronger(weaker: float, stronger: FloatArray) -> dict[int, ArrayPair]:
    """The first and the second stimuli along the curve of each order, the sign of s1 - s2.

    All have the shape of `stronger`, (points,). The order 0 has pairs of equal stimuli, both of
    them the stronger stimulus.
    """
    weaker_stimuli = np.full_like(stronger, weaker)
    return {
        -1: (weaker_stimuli, stronger),
        1: (stronger, weaker_stimuli),
        0: (stronger, stronger),
    }


def first_stimulus_panel(
    ax: Axes, subject: Subject, curve: Curve, first_stimuli: FloatArray
) -> None:
    """Draw P of the counted answer over s2 - s1 of all pairs with one of these first stimuli (ln).

    The curve is for the middle stimulus of `first_stimuli`, which are sorted.
    """
    difference = subject.s2 - subject.s1  # (pairs,)
    # A margin of 5 %. If all differences are the same, 1e-9 is the width that a curve needs.
    pad = 0.05 * max(float(np.ptp(difference)), 1e-9)
    x = np.linspace(difference.min() - pad, difference.max() + pad, POINTS)
    middle_first = np.full_like(x, first_stimuli[len(first_stimuli) // 2])
    draw_band(ax, x, curve(middle_first, middle_first + x), _INK)

    is_in_panel = np.isin(subject.s1, first_stimuli)
    order = presentation_order(subject)
    for sign, mark in ORDERS.items():
        rows = is_in_panel & (order == sign)
        if rows.any():
            draw_shares(ax, difference[rows], subject.n_yes[rows], subject.n_trials[rows], mark)

    if subject.task == WHICH_STRONGER:
        _draw_half(ax, label="one half: PSE")
    difference_axis(ax, subject.unit)
    ax.set_ylabel(f"proportion '{subject.task.yes}'")


def three_answers_panel(
    ax: Axes, subject: Subject, fitted: Predictor, first_stimuli: FloatArray
) -> None:
    """Draw P of three answers over s2 - s1, of all pairs with one of these first stimuli (ln).

    Pairs whose difference is the same are pooled. The marks of the answers stand side by side.
    """
    difference = subject.steps  # s2 - s1, (pairs,)
    is_in_panel = np.isin(subject.s1, first_stimuli)
    different_values = np.unique(difference[is_in_panel])
    has_value = difference == different_values[:, None]  # (values, pairs)
    weights = (is_in_panel & has_value) * subject.n_trials

    p_by_answer = fitted.answers(subject.s1, subject.s2)  # (draws, pairs) each
    # The counts of each answer, (pairs,), with the order of stimuli for which the answer is right.
    # In this order the marks stand at the left, in the middle and at the right.
    counts = (
        ("first", subject.n_first, 1),
        ("equal", subject.n_yes, 0),
        ("second", subject.n_second, -1),
    )
    for answer, n_answers, order in counts:
        mark = ORDERS[order]._replace(label=repr(answer))
        shift = -order * _SHIFT * np.ptp(different_values)
        n_present = cast(IntArray, n_answers)  # None only in tasks of two answers
        _draw_pooled(ax, weights, difference, p_by_answer[answer], n_present, mark, shift)
    difference_axis(ax, subject.unit)
    ax.set_ylabel("proportion")


def correct_panel(ax: Axes, subject: Subject, curve: Curve) -> None:
    """Draw the proportion correct of 'which is stronger' over the middle of the pair, by order.

    Pairs with neighbouring middles are pooled if there are more than MOST_PANELS middles. A curve
    joins them only if all differences are similar: larger differences are easier everywhere.
    """
    middle = 0.5 * (subject.s1 + subject.s2)  # (pairs,), as all arrays of the subject
    order = presentation_order(subject)  # the sign of s1 - s2
    is_second_stronger = order < 0
    n_correct = np.where(is_second_stronger, subject.n_yes, subject.n_trials - subject.n_yes)
    p_second = curve(subject.s1, subject.s2)  # (draws, pairs)
    p_correct = np.where(is_second_stronger, p_second, 1.0 - p_second)

    # Equal stimuli have no correct answer. Neighbouring middles are a group. If there are fewer
    # middles than MOST_PANELS, some groups are empty, and not drawn.
    middles = np.unique(middle[order != 0])
    neighbours = np.array_split(middles, MOST_PANELS)
    groups = np.array([np.isin(middle, group) for group in neighbours])  # (groups, pairs)
    sizes = np.abs(subject.steps[order != 0])
    is_joined = sizes.max() < 1.2 * sizes.min()
    for sign in (-1, 1):
        shift = sign * _SHIFT * np.ptp(middle)
        weights = (groups & (order == sign)) * subject.n_trials
        mark = ORDERS[sign]
        _draw_pooled(ax, weights, middle, p_correct, n_correct, mark, shift, is_joined=is_joined)

    _draw_half(ax, label="chance")
    stimulus_axis(ax, "middle of the pair", subject.unit, subject.mean_first)
    ax.set_ylabel("proportion correct")


def _draw_pooled(
    ax: Axes,
    weights: IntArray,
    x: FloatArray,
    expected: FloatArray,
    n_answers: IntArray,
    mark: Mark,
    shift: float,
    *,
    is_joined: bool = True,
) -> None:
    """Draw observed shares of an answer, and the expected band or bars, of groups of pairs.

    `weights` has the trials of the pairs of each group, shape (groups, pairs), and 0 for pairs of
    other groups; groups without trials are left out. `x` and `n_answers` have the shape (pairs,),
    and `expected` has P of the answer, shape (draws, pairs). The observed shares stand by `shift`
    beside the mean of `x`.
    """
    weights = weights[weights.any(axis=1)]
    if len(weights) == 0:
        return
    n_trials = weights.sum(axis=1)  # (groups,)
    # The means of x and of P over the trials of each group.
    mean_x = weights @ x / n_trials  # (groups,)
    mean_p = expected @ weights.T / n_trials  # (draws, groups)
    draw_band(ax, mean_x, mean_p, mark.colour, is_joined=is_joined)
    draw_shares(ax, mean_x + shift, (weights > 0) @ n_answers, n_trials, mark)


def _draw_half(ax: Axes, label: str) -> None:
    """Draw a dotted line at the proportion one half."""
    ax.axhline(0.5, color=EQUAL, lw=0.8, ls=":", zorder=0, label=label)


def _weaker_stimuli(subject: Subject) -> FloatArray:
    """The weaker stimulus of every pair of different stimuli."""
    return np.minimum(subject.s1, subject.s2)[subject.s1 != subject.s2]


def main_weaker(subject: Subject) -> float:
    """The weaker stimulus that most pairs share: the reference r of the paper's design."""
    return float(mode(_weaker_stimuli(subject)).mode)


def pairs_with_weaker(subject: Subject, weaker: float) -> BoolArray:
    """Which pairs the panel of a weaker stimulus has, (pairs,).

    They are the pairs with this weaker stimulus, and pairs of equal stimuli from this stimulus
    upward. The panel of the weakest stimulus has all pairs of equal stimuli.
    """
    has_weaker = np.minimum(subject.s1, subject.s2) == weaker
    is_equal = subject.s1 == subject.s2
    if weaker == _weaker_stimuli(subject).min():
        return has_weaker | is_equal
    return has_weaker | (is_equal & (subject.s1 >= weaker))


def draw_shares(ax: Axes, x: FloatArray, n_yes: IntArray, n_trials: IntArray, mark: Mark) -> None:
    """Draw the Laplace estimator of shares with its standard deviation, Eq. e:2b.

    `x`, `n_yes` and `n_trials` have the shape (points,).
    """
    style: Style = {"color": mark.colour, "mec": "white", "mew": 0.5, "label": mark.label}
    if len(x) > 25:  # So many points overlap.
        style |= {"ms": 3.0, "alpha": 0.35, "elinewidth": 0.4}
    else:
        style |= {"ms": 4.0, "elinewidth": 0.9}
    share = laplace_estimate(n_yes, n_trials)
    error = laplace_error(n_yes, n_trials)
    ax.errorbar(x, share, error, fmt=mark.marker, **style)
