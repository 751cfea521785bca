"""Fitted curves over the answers: both orders over the stronger stimulus, or all pairs over the normalised distance."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from bayes_toe.arrays import BoolArray, FloatArray
from bayes_toe.classical.frequencies import laplace_error, laplace_estimate, presentation_order
from bayes_toe.data.study import Subject, refuse_intervals
from bayes_toe.inference.draws import Draws
from bayes_toe.inference.prediction import Predictor
from bayes_toe.model.closed_form import equal_probability
from bayes_toe.model.coordinates import Natural
from bayes_toe.model.free_frequencies import FrequencyPosterior
from bayes_toe.plots.style import ORDERS, Mark, first_panels, legend_below, new_figure, plain

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


#: Panels of one weaker stimulus each, beyond which curves give way to the normalised distance.
_MAX_PANELS = 6
CURVE_DRAWS = 600
#: From the stimuli of pairs, shape (pairs,) each, to P(equal), shape (draws, pairs).
Curve = Callable[[FloatArray, FloatArray], FloatArray]
#: Inches left and right of the panels, between columns, below the lowest row, below a row for its words, above it for its name.
_LEFT, _RIGHT, _APART, _BELOW, _WORDS, _NAME = 0.6, 0.2, 0.2, 0.85, 0.5, 0.22
_LABEL_BELOW, _LABEL_LEFT = 0.28, 0.4
#: Of a mark's size: how far marks of both orders stand beside their stimulus, so that none hides another.
_ASIDE = 0.7
_BANDS = ((0.025, 0.975, 0.15), (0.2, 0.8, 0.35))  # lower and upper quantile, opacity


def curves(draws: Draws, subject: str, *, title: str | None = None) -> Figure:
    """Answers of one subject in both orders with the fitted P(equal): posterior mean, central 60 % and 95 % bands.

    One panel per weaker stimulus; designs with more than six of those are shown against the normalised distance. A model that
    connects no pairs has no curve: its answers stand alone. The title is, by default, subject and model.
    """
    counts = draws.subject(subject)
    free = isinstance(draws.posterior(subject), FrequencyPosterior)
    fitted = None if free else Predictor.of(draws, subject, most=CURVE_DRAWS)
    words = subject_and_model(draws, subject) if title is None else title
    return answers_figure(counts, None if fitted is None else fitted.equal, lambda ax: distance_panel(ax, counts, fitted), words)


def subject_and_model(draws: Draws, subject: str) -> str:
    """The title of a figure of one subject."""
    return f"{plain(subject)}: {draws.model}" + (" (synthetic data)" if draws.synthetic else "") + unconverged(draws, subject)


def over_panel(draws: Draws, subject: str) -> str:
    """The title of a panel of one subject among others."""
    return plain(subject, 20) + (" (synthetic)" if draws.synthetic else "") + unconverged(draws, subject)


def unconverged(draws: Draws, subject: str) -> str:
    """A line below a title where the draws are not to be believed; else nothing."""
    return "\nNOT CONVERGED" if subject in draws.not_converged else ""


def answers_figure(counts: Subject, equal: Curve | None, many: Callable[[Axes], Axes], title: str) -> Figure:
    """One panel per weaker stimulus with curves, or a single one, which `many` draws, where a design has more than six of those."""
    weaker = weaker_stimuli(counts)
    if not 1 <= len(weaker) <= _MAX_PANELS:
        figure, [ax] = _answers_panels(1, title)
        many(ax)
    else:
        figure, panels = _answers_panels(len(weaker), title)
        for ax, stimulus in zip(panels, weaker, strict=True):
            order_panel(ax, counts, equal, float(stimulus), title=len(weaker) > 1)
        boxes = [ax.get_position() for ax in panels]
        figure.supylabel("P('equal')", fontsize=10, x=0.012, y=(boxes[0].y1 + boxes[-1].y0) / 2)  # the middle of the panels
    legend_below(figure)
    return figure


def _answers_panels(count: int, title: str) -> tuple[Figure, list[Axes]]:
    """A figure under its title, and panels with room for their words, which all have the same size: no layout has to be found."""
    across = min(2, count)
    down = -(-count // across)
    wide, high = 6.0, 3.8 if down == 1 else 2.5 * down + 0.6
    over = 0.1 + 0.2 * len(title.splitlines()) + (_NAME if count > 1 else 0.0)
    each = (wide - _LEFT - _RIGHT - (across - 1) * _APART) / across, (high - _BELOW - over - (down - 1) * (_WORDS + _NAME)) / down
    figure = new_figure(wide, high, layout=None)
    grid = figure.add_gridspec(
        down,
        across,
        left=_LEFT / wide,
        right=1.0 - _RIGHT / wide,
        bottom=_BELOW / high,
        top=1.0 - over / high,
        wspace=_APART / each[0],
        hspace=(_WORDS + _NAME) / each[1],
    )
    figure.suptitle(title, fontsize=12, y=1.0 - 0.05 / high, va="top")
    panels = first_panels(grid, count, sharey=True)
    for ax in panels:
        ax.xaxis.set_label_coords(0.5, -_LABEL_BELOW / each[1])
        ax.yaxis.set_label_coords(-_LABEL_LEFT / each[0], 0.5)
    return figure, panels


def thinned(theta: Natural) -> Natural:
    """A few hundred draws, each value of shape (draws, 1), as the panels take them."""
    every = max(1, theta.mu1.size // CURVE_DRAWS)
    return Natural(*(values.ravel()[::every, None] for values in theta))


def natural_curve(theta: Natural) -> Curve:
    """P(equal) of pairs at natural parameters, a few hundred of them, as the panels take it."""
    some = thinned(theta)
    return lambda s1, s2: equal_probability(s1, s2, *some)


def order_panel(ax: Axes, counts: Subject, equal: Curve | None, weaker: float, *, title: bool = False, size: float = 5.5) -> Axes:
    """Both orders of all pairs with one weaker stimulus, over the stronger one; as in Fig. 3, upper row.

    Parameters
    ----------
    ax : matplotlib Axes
    counts : Subject
    equal : callable, optional
        From the stimuli of pairs, shape (pairs,) each, to P(equal), shape (draws, pairs); None draws no curve.
    weaker : float
        The weaker stimulus, natural-log intensity.
    title : bool
        Whether to name the weaker stimulus above the panel.
    size : float
        Of the marks, points.
    """
    refuse_intervals([counts], "panel of both orders")
    stronger, shown = np.maximum(counts.s1, counts.s2), _in_order_panel(counts, weaker)
    pairs = pairs_along(counts, weaker, 120)
    for order, mark in ORDERS.items():
        at = shown & (presentation_order(counts) == order)
        if at.any():
            if equal is not None:
                x, s1, s2 = pairs[order]
                draw_band(ax, x, equal(s1, s2), mark.colour, 0.3 * size)
            draw_points(ax, stronger[at], counts, at, mark, size=size, aside=_ASIDE * order * size)
    ax.set(xlabel="stronger stimulus (ln intensity)", ylim=(-0.03, 1.03))
    if title:
        ax.set_title(said_weaker(weaker), fontsize=10)
    return ax


def weaker_stimuli(counts: Subject) -> FloatArray:
    """The weaker ones of all pairs of different stimuli, ascending."""
    return np.unique(np.minimum(counts.s1, counts.s2)[counts.s1 != counts.s2])


def said_weaker(weaker: float) -> str:
    """Which pairs a panel shows."""
    return f"weaker stimulus {weaker:.3g}".replace("-", "−")


def pairs_along(counts: Subject, weaker: float, points: int) -> dict[int, tuple[FloatArray, FloatArray, FloatArray]]:
    """Places along :func:`order_panel`, and the pairs (s1, s2) there of which each order has a curve, each of shape (points,)."""
    low, high = shown_range(counts, weaker)
    x, alike = (np.linspace(start, max(high, weaker + 1e-9), points) for start in (weaker, low))
    fixed = np.full_like(x, weaker)
    return {0: (alike, alike, alike), -1: (x, fixed, x), 1: (x, x, fixed)}


def shown_range(counts: Subject, weaker: float) -> tuple[float, float]:
    """The weakest and the strongest stimulus along the panel of one weaker stimulus, that one included."""
    stronger = np.maximum(counts.s1, counts.s2)[_in_order_panel(counts, weaker)]
    return float(stronger.min(initial=weaker)), float(stronger.max(initial=weaker))


def _in_order_panel(counts: Subject, weaker: float) -> BoolArray:
    """Pairs with this weaker stimulus, and equal ones from it on; with the weakest one, which is shown anyway, all equal ones."""
    lower, alike = np.minimum(counts.s1, counts.s2), counts.s1 == counts.s2
    weakest = weaker <= weaker_stimuli(counts).min(initial=np.inf)
    return np.asarray((lower == weaker) | (alike & ((counts.s1 >= weaker) | weakest)))


def distance_panel(ax: Axes, counts: Subject, fitted: Predictor | None) -> Axes:
    """All pairs over their normalised distance z (posterior median) on the common curve; as in Fig. 3, lower row.

    Where nothing is fitted that connects them, over the difference of their stimuli.
    """
    refuse_intervals([counts], "panel of normalised distances")
    z = counts.s2 - counts.s1 if fitted is None else np.median(fitted.distance(), axis=0)
    reach = 1.05 * max(float(np.abs(z).max()), 0.3 if fitted is None else 1.43)
    x = np.linspace(-reach, reach, 200)
    if fitted is not None:
        draw_band(ax, x, fitted.equal_at_distance(x), "#333333")
    for order, mark in ORDERS.items():
        at = presentation_order(counts) == order
        if at.any():
            draw_points(ax, z[at], counts, at, mark)
    label = r"difference $s_2 - s_1$ (ln intensity)" if fitted is None else r"normalised distance $(s_2 - \mu_2)/w$"
    ax.set(xlabel=label, ylabel="P('equal')", ylim=(-0.03, 1.03))
    return ax


def draw_band(ax: Axes, x: FloatArray, q: FloatArray, colour: str, line: float = 1.6) -> None:
    """Mean over draws (the first axis of q) and central 60 % and 95 % bands."""
    edges = np.quantile(q, [edge for low, high, _ in _BANDS for edge in (low, high)], axis=0).reshape(len(_BANDS), 2, -1)
    for (*_, opacity), (low, high) in zip(_BANDS, edges, strict=True):
        ax.fill_between(x, low, high, color=colour, alpha=opacity, lw=0)
    ax.plot(x, q.mean(axis=0), color=colour, lw=line)


def draw_points(ax: Axes, x: FloatArray, counts: Subject, at: BoolArray, mark: Mark, *, size: float = 5.5, aside: float = 0.0) -> None:
    """The Laplace estimator and its standard deviation, Eq. e:2b; size of the marks, and how far beside their place they are, points."""
    from matplotlib.transforms import ScaledTranslation

    figure = ax.get_figure(root=True)
    assert figure is not None
    beside = ax.transData + ScaledTranslation(aside / 72.0, 0.0, figure.dpi_scale_trans)
    k, n = counts.n_equal[at], counts.n_trials[at]
    crowded = len(counts.s1) > 60
    style: dict[str, Any] = {"ms": 3.0, "alpha": 0.35, "elinewidth": 0.4} if crowded else {"ms": size, "elinewidth": size / 4.6}
    value, error = laplace_estimate(k, n), laplace_error(k, n)
    ax.errorbar(x, value, error, fmt=mark.marker, color=mark.colour, mec="white", mew=0.5, label=mark.label, transform=beside, **style)
    ax.update_datalim(np.column_stack([x, value]))  # marks that are set aside do not say where data are
    ax.autoscale_view()
