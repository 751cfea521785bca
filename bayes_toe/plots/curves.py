"""Fitted curves with the responses of one subject.

`curves` draws the whole figure, `order_panel` and `distance_panel` one panel; other figures use the
panels too.

The axis depends on the task. In 'same or different' it is the stronger stimulus, with a curve for
each order. In 'which is stronger' it is s2 - s1, with a curve for each first stimulus, which
crosses one half at the point of subjective equality (PSE). Bands are central 50 % and 95 %
intervals of the posterior.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.transforms import ScaledTranslation
from scipy.stats import mode

from bayes_toe.analysis import Analysis
from bayes_toe.arrays import BoolArray, FloatArray, IntArray
from bayes_toe.classical.frequencies import laplace_error, laplace_estimate, presentation_order
from bayes_toe.data.study import Subject
from bayes_toe.data.tasks import SAME_DIFFERENT, WHICH_STRONGER
from bayes_toe.inference.draws import Draws
from bayes_toe.inference.prediction import Predictor
from bayes_toe.model.models import model_title
from bayes_toe.plots.style import (
    BANDS,
    EQUAL,
    ORDERS,
    Band,
    Mark,
    Style,
    difference_scale,
    draw_band,
    grid_panels,
    legend_below,
    n_rows,
    new_figure,
    plain,
    probability_label,
    rows_by_order,
    stimulus_axis,
    zero_line,
)

#: Panels of one weaker stimulus each, beyond which curves give way to a single panel.
MOST_PANELS = 6
CURVE_DRAWS = 600
_LONG_LABEL = 20  # letters, beyond which a legend has two columns
#: From the stimuli of pairs, shape (pairs,) each, to P of the answer that is counted, shape (draws,
#: pairs).
Curve = Callable[[FloatArray, FloatArray], FloatArray]
#: How far marks of several lines stand beside their stimulus, so that none hides another, in sizes
#: of a mark.
_MARK_SHIFT = 0.7
#: What panels of answers are drawn over.
_ALONG = {
    SAME_DIFFERENT: "stronger stimulus (ln intensity)",
    WHICH_STRONGER: "$s_2 - s_1$ (ln intensity)",
}


# --- one subject, over the stimuli ----------------------------------------------------------------


def curves(source: Analysis | Draws, subject: str, *, title: str | None = None) -> Figure:
    """Responses of one subject in both orders, with the fitted probabilities.

    The lines are posterior means with central 50 % and 95 % bands: P('equal'), or P('second') over
    s2 - s1 with 50 % bands, a curve for each of up to six first stimuli or groups of them. Where a
    curve of P('second') crosses one half is the point of subjective equality (PSE).

    One panel per weaker stimulus; designs with more than six of those are shown over the distance
    z.

    Parameters
    ----------
    source : Analysis or Draws
        The curves of an analysis are averaged over the four models; those of draws belong to the
        model of the draws.
    subject : str
    title : str, optional
        By default the subject and the model.

    Raises
    ------
    InputError
        For an unknown subject.
    """
    if isinstance(source, Draws):
        fitted = Predictor.from_draws(source, subject, n_draws=CURVE_DRAWS)
        model, draws = model_title(source.model), source
    else:
        fitted, model, draws = source.curve(subject), "average of the four models", source.draws
    if title is None:
        title = f"{plain(subject)}: {model}"
        if draws.synthetic:
            title += " (synthetic data)"
        if isinstance(source, Draws):
            title += _unconverged(draws, subject)
    return fitted_figure(fitted, title)


def fitted_figure(fitted: Predictor, title: str) -> Figure:
    """The responses and curves of the subject whose posterior draws these are."""
    counts = fitted.target.subject
    stimuli = _panels(counts)
    if len(stimuli) > MOST_PANELS:
        stimuli = []
    n_panels = max(1, len(stimuli))
    n_columns = min(2, n_panels)
    figure = new_figure(6.0, max(3.8, 2.5 * n_rows(n_panels, n_columns) + 0.6))
    panels = grid_panels(figure, n_panels, n_columns, sharey=True)
    if not stimuli:
        distance_panel(panels[0], fitted)
    for ax, stimulus in zip(panels, stimuli, strict=False):
        order_panel(ax, counts, fitted.yes, stimulus)
        label_along(ax, counts)
        if n_panels > 1:
            ax.set_title(_describe_weaker(counts, stimulus), fontsize=10)
    for ax in panels[::n_columns]:
        ax.set_ylabel(probability_label(counts.task))
    figure.suptitle(title, fontsize=12)
    labels = panels[0].get_legend_handles_labels()[1]
    legend_below(figure, columns=2 if max(map(len, labels)) > _LONG_LABEL else 3)
    return figure


def mean_first(counts: Subject) -> float:
    """The mean first stimulus, of which axes show per cent, natural-log intensity."""
    return float(np.average(counts.s1, weights=counts.n_trials))


def label_along(ax: Axes, counts: Subject) -> None:
    """The axis below :func:`order_panel` in the unit of the stimuli."""
    if counts.task == WHICH_STRONGER:
        difference_scale(counts.unit, ax.get_xlim()).draw(ax)
    else:
        stimulus_axis(ax, "stronger stimulus", counts.unit, mean_first(counts))


def _describe_weaker(counts: Subject, weaker: float) -> str:
    """Words for a panel that shows the pairs with one weaker stimulus (ln)."""
    unit = counts.unit.or_percent_of(mean_first(counts))
    digits = ".4g" if counts.unit.of_stimuli else ".0f"
    return f"weaker stimulus {unit.stimuli(weaker):{digits}} {unit.of_stimuli}"


def _unconverged(draws: Draws, subject: str) -> str:
    """A line below a title where the draws are not to be believed; else nothing."""
    return "\nNOT CONVERGED" if subject in draws.not_converged else ""


# --- panels ---------------------------------------------------------------------------------------


class Line(NamedTuple):
    """A curve along a panel, and the responses to which it belongs.

    Attributes
    ----------
    mark : Mark
    rows : ndarray of bool, shape (pairs,)
        The pairs of these responses.
    position : ndarray, shape (pairs,)
        Where every pair stands along the panel.
    shift : float
        How far to the side the marks are set, in steps.
    x, s1, s2 : ndarray, shape (points,)
        Positions along the curve and the pairs there.
    """

    mark: Mark
    rows: BoolArray
    position: FloatArray
    shift: float
    x: FloatArray
    s1: FloatArray
    s2: FloatArray


def lines_along(counts: Subject, weaker: float, points: int) -> list[Line]:
    """The curves of a panel.

    In 'same or different' there is a curve for each order and one for equal stimuli, for pairs with
    one weaker stimulus (ln). In 'which is stronger' there is a curve for each first stimulus.
    """
    if counts.task == WHICH_STRONGER:
        return _lines_by_first(counts, points)
    stronger = np.maximum(counts.s1, counts.s2)
    is_in_panel = _has_weaker(counts, weaker)
    low = float(stronger[is_in_panel].min(initial=weaker))
    high = max(float(stronger[is_in_panel].max(initial=weaker)), weaker + 1e-9)
    x = np.linspace(weaker, high, points)
    equal = np.linspace(low, high, points)
    fixed = np.full_like(x, weaker)
    along = {0: (equal, equal, equal), -1: (x, fixed, x), 1: (x, x, fixed)}
    order = presentation_order(counts)
    lines = []
    for sign, mark in ORDERS.items():
        rows = is_in_panel & (order == sign)
        if rows.any():
            lines.append(Line(mark, rows, stronger, sign, *along[sign]))
    return lines


def _lines_by_first(counts: Subject, points: int) -> list[Line]:
    """P('second') over s2 - s1 by the first stimulus.

    Neighbouring first stimuli are taken together where there are more than six.
    """
    difference = counts.s2 - counts.s1
    pad = 0.05 * max(float(np.ptp(difference)), 1e-9)
    x = np.linspace(difference.min() - pad, difference.max() + pad, points)
    firsts = np.unique(counts.s1)
    groups = np.array_split(firsts, min(len(firsts), MOST_PANELS))
    colours = colormaps["viridis"](np.linspace(0.0, 0.85, len(groups)))
    numbers, unit = counts.unit.numbers(firsts, mean_first(counts))
    numbers_of_groups = np.array_split(numbers, len(groups))
    lines = []
    for i, group in enumerate(groups):
        ends = dict.fromkeys(numbers_of_groups[i][[0, -1]].tolist())
        label = f"$s_1$ = {' to '.join(ends)} {unit}".replace("-", "−")
        mark = Mark(to_hex(colours[i]), "osD^vh"[i], label)
        rows = np.isin(counts.s1, group)
        fixed = np.full_like(x, group[len(group) // 2])
        shift = i - 0.5 * (len(groups) - 1)
        lines.append(Line(mark, rows, difference, shift, x, fixed, fixed + x))
    return lines


def order_panel(
    ax: Axes,
    counts: Subject,
    curve: Curve | None,
    weaker: float,
    *,
    size: float = 5.5,
    points: int = 120,
    bands: Sequence[Band] | None = None,
) -> Axes:
    """Draw both orders of all pairs with one weaker stimulus (ln), as in Fig. 3, upper row.

    The axis is the stronger stimulus; `size` is that of the marks in points.

    In 'which is stronger' there is a psychometric curve after every first stimulus, whatever the
    weaker one is. `curve` gives P of the counted response; None draws no curve. By default bands
    hold 50 and 95 %, and 50 % in 'which is stronger', where wide bands hide each other.
    """
    if bands is None:
        bands = BANDS if counts.task == SAME_DIFFERENT else BANDS[1:]
    for line in lines_along(counts, weaker, points):
        if curve is not None:
            draw_band(ax, line.x, curve(line.s1, line.s2), line.mark.colour, 0.3 * size, bands)
        n_yes, n_trials = counts.n_yes[line.rows], counts.n_trials[line.rows]
        shift = _MARK_SHIFT * line.shift * size
        draw_shares(
            ax, line.position[line.rows], n_yes, n_trials, line.mark, size=size, shift=shift
        )
    if counts.task == WHICH_STRONGER:
        ax.axhline(0.5, color=EQUAL, lw=0.8, ls=":", zorder=0, label="one half: PSE")
        zero_line(ax)
    ax.set(xlabel=_ALONG[counts.task], ylim=(-0.03, 1.03))
    return ax


def distance_panel(ax: Axes, fitted: Predictor) -> None:
    """Draw all pairs over their distance z on the common curve (Fig. 3, lower row).

    The distance is the posterior median.
    """
    counts = fitted.target.subject
    z = np.median(fitted.target.distance(fitted.x), axis=0)
    reach = 1.05 * max(float(np.abs(z).max()), 1.43)
    x = np.linspace(-reach, reach, 200)
    draw_band(ax, x, fitted.target.yes_at_distance(fitted.x, x), "#333333")
    for mark, rows in rows_by_order(presentation_order(counts)):
        draw_shares(ax, z[rows], counts.n_yes[rows], counts.n_trials[rows], mark)
    ax.set(xlabel="normalised distance $z$", ylim=(-0.03, 1.03))


def _panels(counts: Subject) -> Sequence[float]:
    """The weaker stimulus of every panel; 'which is stronger' has one panel for all pairs."""
    if counts.task == WHICH_STRONGER:
        return [0.0]
    return sorted(set(_weaker(counts).tolist()))


def _weaker(counts: Subject) -> FloatArray:
    """The weaker stimulus of every pair of different ones."""
    return np.minimum(counts.s1, counts.s2)[counts.s1 != counts.s2]


def main_weaker(counts: Subject) -> float | None:
    """The weaker stimulus that most pairs of different stimuli share; None without such pairs.

    It is the reference r of the paper's design.
    """
    weaker = _weaker(counts)
    return float(mode(weaker).mode) if weaker.size else None


def has_several_weaker(counts: Subject) -> bool:
    """Whether a panel of one weaker stimulus shows only some of the pairs."""
    return len(_panels(counts)) > 1


def _has_weaker(counts: Subject, weaker: float) -> BoolArray:
    """Pairs with this weaker stimulus, and pairs of equal stimuli that are not weaker.

    The panel of the weakest stimulus has all pairs of equal stimuli.
    """
    has_weaker = np.minimum(counts.s1, counts.s2) == weaker
    is_equal = counts.s1 == counts.s2
    is_weakest = weaker <= _weaker(counts).min(initial=np.inf)
    return has_weaker | (is_equal & ((counts.s1 >= weaker) | is_weakest))


def draw_shares(
    ax: Axes,
    x: FloatArray,
    n_yes: IntArray,
    n_trials: IntArray,
    mark: Mark,
    *,
    size: float = 5.5,
    shift: float = 0.0,
) -> None:
    """The Laplace estimator and its standard deviation, Eq. e:2b.

    `size` of the marks, and by how much they are moved to the right, points.
    """
    figure = ax.get_figure(root=True)
    assert figure is not None
    moved = ax.transData + ScaledTranslation(shift / 72.0, 0.0, figure.dpi_scale_trans)
    style: Style = {"ms": size, "elinewidth": size / 4.6}
    if len(x) > 25:
        style = {"ms": 3.0, "alpha": 0.35, "elinewidth": 0.4}
    style |= {"color": mark.colour, "mec": "white", "mew": 0.5, "transform": moved}
    value, error = laplace_estimate(n_yes, n_trials), laplace_error(n_yes, n_trials)
    ax.errorbar(x, value, error, fmt=mark.marker, label=mark.label, **style)
    # Marks that are moved do not say where data are.
    ax.update_datalim(np.column_stack([x, value]))
    ax.autoscale_view()
