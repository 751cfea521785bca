"""Fitted curves over the answers of a subject.

Over the stimuli, the normalised distance, or the inter-stimulus interval.

Of 'same or different' over the stronger stimulus in both orders; of 'which is stronger'
psychometric curves, over s2 - s1 by the first stimulus, of which one half is the point of
subjective equality (PSE).

Bands are central 50 % and 95 % of the posterior; between and beyond tested intervals they are
predictions of the random walk.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from matplotlib.transforms import ScaledTranslation
from scipy.stats import mode

from bayes_toe.analysis import Analysis
from bayes_toe.arrays import BoolArray, FloatArray
from bayes_toe.classical.frequencies import laplace_error, laplace_estimate, presentation_order
from bayes_toe.data.study import Subject, refuse_intervals
from bayes_toe.data.tasks import SAME_DIFFERENT, WHICH_STRONGER
from bayes_toe.inference.draws import Draws
from bayes_toe.inference.prediction import Predictor
from bayes_toe.model.models import model_title
from bayes_toe.model.paper_model import PaperPosterior
from bayes_toe.plots.style import (
    BANDS,
    EQUAL,
    ORDERS,
    POSTERIOR,
    Band,
    Mark,
    chance,
    draw_band,
    dress,
    first_panels,
    legend_below,
    new_figure,
    percent_axis,
    plain,
)

#: Panels of one weaker stimulus each, or of one interval, beyond which curves give way to a single
#: panel.
MOST_PANELS = 6
CURVE_DRAWS = 600
#: From the stimuli of pairs, shape (pairs,) each, to P of the answer that is counted, shape (draws,
#: pairs).
Curve = Callable[[FloatArray, FloatArray], FloatArray]
_ASIDE = 0.7  # of a mark's size: how far marks of both orders stand beside their stimulus, so that none hides another
#: What panels of answers are drawn over.
_ALONG = {
    SAME_DIFFERENT: "stronger stimulus (ln intensity)",
    WHICH_STRONGER: "$s_2 - s_1$ (ln intensity)",
}
_BEYOND = 2.0  # the default range goes so many times below the shortest and above the longest tested interval


# --- one subject, over the stimuli ----------------------------------------------------------------


def curves(source: Analysis | Draws, subject: str, *, title: str | None = None) -> Figure:
    """Responses of one subject in both orders, with the fitted probabilities.

    The lines are posterior means with central 50 % and 95 % bands: P('equal'), or P('second') over
    s2 - s1 with 50 % bands, a curve for each of up to six first stimuli or groups of them. Where a
    curve of P('second') crosses one half is the point of subjective equality (PSE).

    One panel per weaker stimulus; designs with more than six of those are shown over the distance
    z. With intervals, one panel for each of up to six of them; with the paper's model (H1) also the
    gain over the interval.

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
        fitted = Predictor.of(source, subject, most=CURVE_DRAWS)
        model, draws = model_title(source.model), source
    else:
        fitted, model, draws = source.curve(subject), "average of the four models", source.draws
    if title is None:
        synthetic = " (synthetic data)" if draws.synthetic else ""
        unconverged = _unconverged(draws, subject) if isinstance(source, Draws) else ""
        title = f"{plain(subject)}: {model}{synthetic}{unconverged}"
    return fitted_figure(fitted, title)


def fitted_figure(fitted: Predictor, title: str) -> Figure:
    """The responses and curves of the subject whose posterior draws these are."""
    counts = fitted.target.subject
    if counts.intervals:
        return _interval_figure(counts, fitted, title)
    weaker = _panels(counts)
    several = 1 <= len(weaker) <= MOST_PANELS
    count = len(weaker) if several else 1
    across = min(2, count)
    down = -(-count // across)
    figure = new_figure(6.0, 3.8 if down == 1 else 2.5 * down + 0.6)
    panels = first_panels(figure.add_gridspec(down, across), count, sharey=True)
    for i, ax in enumerate(panels):
        if several:
            order_panel(ax, counts, fitted.yes, weaker[i])
            label_in_percent(ax, counts)
            ax.set_title(_percent_weaker(counts, weaker[i]) if count > 1 else "", fontsize=10)
        else:
            distance_panel(ax, fitted)
        ax.set_ylabel("" if i % across else chance(counts.task))
    figure.suptitle(title, fontsize=12)
    legend_below(figure)
    return figure


def mean_first(counts: Subject) -> float:
    """The mean first stimulus, of which axes show per cent, natural-log intensity."""
    return float(np.average(counts.s1, weights=counts.n_trials))


def label_in_percent(ax: Axes, counts: Subject) -> None:
    """The axis below :func:`order_panel` in per cent."""
    if counts.task == WHICH_STRONGER:
        percent_axis(ax, "second stimulus, % of the first", 0.0)
    else:
        percent_axis(ax, "stronger stimulus, % of the mean", mean_first(counts))


def _percent_weaker(counts: Subject, weaker: float) -> str:
    """Words for a panel in per cent that shows the pairs with one weaker stimulus (ln)."""
    return f"weaker stimulus {100.0 * np.exp(weaker - mean_first(counts)):.0f} %"


def title_of(draws: Draws, subject: str) -> str:
    """The title of a panel of one subject among others."""
    synthetic = " (synthetic)" if draws.synthetic else ""
    return f"{plain(subject, 20)}{synthetic}{_unconverged(draws, subject)}"


def _unconverged(draws: Draws, subject: str) -> str:
    """A line below a title where the draws are not to be believed; else nothing."""
    return "\nNOT CONVERGED" if subject in draws.not_converged else ""


# --- panels ---------------------------------------------------------------------------------------


class Line(NamedTuple):
    """A curve along a panel, and the answers to which it belongs.

    How both are drawn; which pairs these are and where every pair stands along the panel, shape
    (pairs,) each; how far to the side their marks are set; places along the curve and the pairs
    there, shape (points,) each.
    """

    mark: Mark
    at: BoolArray
    place: FloatArray
    side: float
    x: FloatArray
    s1: FloatArray
    s2: FloatArray


def lines_along(counts: Subject, weaker: float, points: int) -> list[Line]:
    """Curves of a panel.

    Of both orders and of equal stimuli over the stronger one, with one weaker one (ln); or by the
    first stimulus.
    """
    if counts.task == WHICH_STRONGER:
        return _by_first(counts, points)
    stronger, shown, order = (
        np.maximum(counts.s1, counts.s2),
        _in_order_panel(counts, weaker),
        presentation_order(counts),
    )
    low, high = (
        float(stronger[shown].min(initial=weaker)),
        float(stronger[shown].max(initial=weaker)),
    )
    x, alike = (np.linspace(start, max(high, weaker + 1e-9), points) for start in (weaker, low))
    fixed = np.full_like(x, weaker)
    along = {0: (alike, alike, alike), -1: (x, fixed, x), 1: (x, x, fixed)}
    found = (
        Line(mark, shown & (order == side), stronger, side, *along[side])
        for side, mark in ORDERS.items()
    )
    return [line for line in found if line.at.any()]


def _by_first(counts: Subject, points: int) -> list[Line]:
    """P('second') over s2 - s1 by the first stimulus.

    Neighbouring first stimuli are taken together where there are more than six.
    """
    firsts, place = np.unique(counts.s1), counts.s2 - counts.s1
    pad = 0.05 * max(float(np.ptp(place)), 1e-9)
    x, groups = (
        np.linspace(place.min() - pad, place.max() + pad, points),
        np.array_split(firsts, min(len(firsts), MOST_PANELS)),
    )
    middle, colours = (
        0.5 * (len(groups) - 1),
        colormaps["viridis"](np.linspace(0.0, 0.85, len(groups))),
    )
    found = []
    for i, group in enumerate(groups):
        ends = " to ".join(dict.fromkeys(f"{end:.3g}" for end in (group[0], group[-1]))).replace(
            "-", "−"
        )
        mark, fixed = (
            Mark(to_hex(colours[i]), "osD^vh"[i], f"$s_1$ = {ends}"),
            np.full_like(x, group[len(group) // 2]),
        )
        found.append(Line(mark, np.isin(counts.s1, group), place, i - middle, x, fixed, fixed + x))
    return found


def order_panel(
    ax: Axes,
    counts: Subject,
    equal: Curve | None,
    weaker: float,
    *,
    size: float = 5.5,
    points: int = 120,
    bands: Sequence[Band] | None = None,
) -> Axes:
    """Draw both orders of all pairs with one weaker stimulus (ln), as in Fig. 3, upper row.

    The axis is the stronger stimulus; `size` is that of the marks in points.

    Of 'which is stronger' the psychometric curves after every first stimulus, whatever the weaker one is. `equal` goes from the stimuli of
    pairs, shape (pairs,) each, to P of the answer that is counted, shape (draws, pairs); None draws no curve. By default bands are of 50 and
    95 %, and of 50 % in 'which is stronger', where wide bands of many curves hide each other.
    """
    refuse_intervals([counts], "panel of both orders")
    if bands is None:
        bands = BANDS if counts.task == SAME_DIFFERENT else BANDS[1:]
    for line in lines_along(counts, weaker, points):
        if equal is not None:
            draw_band(ax, line.x, equal(line.s1, line.s2), line.mark.colour, 0.3 * size, bands)
        _draw_points(
            ax,
            line.place[line.at],
            counts,
            line.at,
            line.mark,
            size=size,
            aside=_ASIDE * line.side * size,
        )
    if counts.task == WHICH_STRONGER:
        ax.axhline(0.5, color=EQUAL, lw=0.8, ls=":", zorder=0, label="one half: PSE")
        ax.axvline(0.0, color=EQUAL, lw=0.8, ls=":", zorder=0)
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
    order = presentation_order(counts)
    for side, mark in ORDERS.items():
        at = order == side
        if at.any():
            _draw_points(ax, z[at], counts, at, mark)
    ax.set(xlabel="normalised distance $z$", ylim=(-0.03, 1.03))


def _panels(counts: Subject) -> Sequence[float]:
    """The weaker stimulus of every panel; of 'which is stronger' there is one for all pairs."""
    return [0.0] if counts.task == WHICH_STRONGER else np.unique(_weaker(counts)).tolist()


def _weaker(counts: Subject) -> FloatArray:
    """The weaker stimulus of every pair of different ones."""
    return np.asarray(np.minimum(counts.s1, counts.s2)[counts.s1 != counts.s2])


def main_weaker(counts: Subject) -> float | None:
    """The weaker stimulus that most pairs of different stimuli share; None without such pairs.

    It is the reference r of the paper's design.
    """
    weaker = _weaker(counts)
    return float(mode(weaker).mode) if weaker.size else None


def which_weaker(counts: Subject, weaker: float | None) -> str:
    """Words for a panel that shows the pairs with one weaker stimulus.

    None where there is no other.
    """
    return "" if weaker is None or len(_panels(counts)) < 2 else _said_weaker(weaker)


def _said_weaker(weaker: float) -> str:
    return f"weaker stimulus {weaker:.3g}".replace("-", "−")


def _in_order_panel(counts: Subject, weaker: float) -> BoolArray:
    """Pairs with this weaker stimulus, and equal ones from it on.

    With the weakest one, which is shown anyway, all equal ones.
    """
    lower, alike = np.minimum(counts.s1, counts.s2), counts.s1 == counts.s2
    weakest = weaker <= _weaker(counts).min(initial=np.inf)
    return np.asarray((lower == weaker) | (alike & ((counts.s1 >= weaker) | weakest)))


def _draw_points(
    ax: Axes,
    x: FloatArray,
    counts: Subject,
    at: BoolArray,
    mark: Mark,
    *,
    size: float = 5.5,
    aside: float = 0.0,
) -> None:
    """The Laplace estimator and its standard deviation, Eq. e:2b.

    Size of the marks, and how far beside their place they are, points.
    """
    figure = ax.get_figure(root=True)
    assert figure is not None
    beside = ax.transData + ScaledTranslation(aside / 72.0, 0.0, figure.dpi_scale_trans)
    k, n = counts.n_yes[at], counts.n_trials[at]
    crowded = at.sum() > 25
    style: dict[str, Any] = (
        {"ms": 3.0, "alpha": 0.35, "elinewidth": 0.4}
        if crowded
        else {"ms": size, "elinewidth": size / 4.6}
    )
    value, error = laplace_estimate(k, n), laplace_error(k, n)
    ax.errorbar(
        x,
        value,
        error,
        fmt=mark.marker,
        color=mark.colour,
        mec="white",
        mew=0.5,
        label=mark.label,
        transform=beside,
        **style,
    )
    ax.update_datalim(
        np.column_stack([x, value])
    )  # marks that are set aside do not say where data are
    ax.autoscale_view()


# --- over the interval ----------------------------------------------------------------------------


def _interval_figure(counts: Subject, fitted: Predictor, title: str) -> Figure:
    """Responses and curves at up to six of the intervals; of the paper's model the gain below."""
    tested = counts.intervals
    last = len(tested) - 1
    shown = [tested[i] for i in np.unique(np.linspace(0, last, MOST_PANELS).round().astype(int))]
    across = min(3, len(shown))
    n_rows = -(-len(shown) // across)
    has_gain = isinstance(fitted.target, PaperPosterior)
    heights = [2.3 * n_rows + 0.5] + [2.3] * has_gain
    figure = new_figure(6.6, sum(heights) + 0.3)
    parts = figure.subfigures(len(heights), 1, height_ratios=heights, squeeze=False)[:, 0]
    panels = first_panels(parts[0].add_gridspec(n_rows, across), len(shown), sharey=True)
    for i, (isi, ax) in enumerate(zip(shown, panels, strict=True)):
        here = counts.at_isi(isi)
        weaker = main_weaker(counts)
        if weaker not in np.minimum(here.s1, here.s2):
            weaker = main_weaker(here)
        low = float(here.s1.min()) if weaker is None else weaker
        order_panel(ax, here, _at(fitted, isi), low, size=4.5)
        about = _percent_weaker(counts, low) if which_weaker(counts, low) else ""
        label_in_percent(ax, counts)
        ax.set_xlabel(ax.get_xlabel(), fontsize=8)
        ax.set(
            title=f"{isi:g} s" + (about and f", {about}"),
            ylabel="" if i % across else chance(counts.task),
            yticks=[0.0, 0.5, 1.0],
        )
        dress(ax)
    legend_below(parts[0], size=8.0)
    if isinstance(fitted.target, PaperPosterior):
        _gain_panel(parts[1].subplots(), tested, fitted.target, fitted.x)
    figure.suptitle(title, fontsize=11)
    return figure


def _at(fitted: Predictor, isi: float) -> Curve:
    """P of the counted response of pairs at one interval."""
    return lambda s1, s2: fitted.yes(s1, s2, np.full(len(s1), isi))


def _gain_panel(
    ax: Axes, tested: tuple[float, ...], target: PaperPosterior, draws: FloatArray
) -> None:
    """Kalman gain over the interval: the weight of the first stimulus, 1 without an order effect.

    Short bars are the tested intervals.
    """
    x = np.geomspace(tested[0] / _BEYOND, tested[-1] * _BEYOND, 120)
    draw_band(ax, x, target.gain(draws, x), POSTERIOR, 1.3)
    ax.axhline(1.0, color=EQUAL, lw=0.8, ls=":")
    ax.set_xscale("log")
    ax.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if x[-1] / x[0] < 300.0 else (1.0,)))
    ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    ax.xaxis.set_minor_formatter(NullFormatter())
    places = ax.get_xaxis_transform()
    ax.plot(tested, np.full(len(tested), 0.03), "|", color="#111111", ms=7, transform=places)
    ax.set(xlabel="inter-stimulus interval (s)", xlim=(x[0], x[-1]))
    ax.set(ylabel="gain K", ylim=(min(0.5, ax.get_ylim()[0]), 1.03))
    dress(ax)
