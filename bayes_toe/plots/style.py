"""Figures of curves and of evidence, and figures as files; corner plots have :mod:`bayes_toe.plots.corner`.

Functions take Axes or make a Figure of their own, return it, never show it and never touch global settings. Colours keep the
paper's meaning in a palette safe for colour-blind readers: red weaker stimulus first, blue stronger first, grey equal stimuli;
markers differ too.
"""

from __future__ import annotations

import io
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from bayes_toe.arrays import BoolArray, FloatArray
from bayes_toe.comparison.evidence_table import EvidenceTable
from bayes_toe.data.study import Subject, refuse_intervals
from bayes_toe.data.whole_files import require_writable, whole_file
from bayes_toe.errors import InputError
from bayes_toe.inference.draws import Draws
from bayes_toe.model.closed_form import equal_probability, normalised_distance
from bayes_toe.model.coordinates import Natural

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


WEAKER_FIRST, STRONGER_FIRST, EQUAL = "#D55E00", "#0072B2", "#6E6E6E"
POSTERIOR = "#0072B2"
#: Panels of one weaker stimulus each, beyond which curves give way to the normalised distance.
_MAX_PANELS = 6
_CURVE_DRAWS = 600
#: Inches of one and of two columns of a journal's page; points of small and of ordinary letters on it.
COLUMN, PAGE = 3.4, 7.0
SMALL, LETTERS = 7.0, 8.0
_BANDS = ((0.025, 0.975, 0.15), (0.2, 0.8, 0.35))  # lower and upper quantile, opacity


def plain(name: str, limit: int = 32) -> str:
    r"""A subject's name as matplotlib may draw it: shortened, and no dollar sign read as mathematics.

    Examples
    --------
    >>> plain("a$b")
    'a\\$b'
    """
    short = name if len(name) <= limit else name[: limit - 1] + "…"
    return short.replace("$", r"\$")


# --- fitted curves over the data --------------------------------------------------------------------------------------------------


def curves(draws: Draws, subject: str) -> Figure:
    """Answers of one subject in both orders with the fitted P(equal): posterior mean, central 60 % and 95 % bands.

    One panel per weaker stimulus; designs with more than six of those are shown against the normalised distance.
    """
    counts = draws.subject(subject)
    weaker = np.unique(np.minimum(counts.s1, counts.s2)[counts.s1 != counts.s2])
    theta = thinned(draws.natural(subject))
    if not 1 <= len(weaker) <= _MAX_PANELS:
        figure = new_figure(6.0, 3.8)
        distance_panel(figure.subplots(), counts, theta)
    else:
        across = min(2, len(weaker))
        down = -(-len(weaker) // across)
        figure = new_figure(6.0, 3.8 if down == 1 else 2.5 * down + 0.6)
        panels = figure.subplots(down, across, sharey=True, squeeze=False)
        for ax, stimulus in zip(panels.ravel(), weaker, strict=False):
            order_panel(ax, counts, theta, float(stimulus), title=len(weaker) > 1)
        for ax in panels.ravel()[len(weaker) :]:
            ax.remove()
        figure.supylabel("P('equal')", fontsize=10)
    legend_below(figure)
    figure.suptitle(plain(subject) + (" (synthetic data)" if draws.synthetic else ""), fontsize=12)
    return figure


def thinned(theta: Natural) -> Natural:
    """A few hundred draws, each value of shape (draws, 1), as the panels take them."""
    every = max(1, theta.mu1.size // _CURVE_DRAWS)
    return Natural(*(values.ravel()[::every, None] for values in theta))


def order_panel(ax: Axes, counts: Subject, theta: Natural, weaker: float, *, title: bool = False, size: float = 5.5) -> Axes:
    """Both orders of all pairs with one weaker stimulus, over the stronger one; as in Fig. 3, upper row.

    Parameters
    ----------
    ax : matplotlib Axes
    counts : Subject
    theta : Natural
        Draws, each of shape (draws, 1).
    weaker : float
        The weaker stimulus, natural-log intensity.
    title : bool
        Whether to name the weaker stimulus above the panel.
    size : float
        Of the marks, points.
    """
    refuse_intervals([counts], "panel of both orders")
    shown = (np.minimum(counts.s1, counts.s2) == weaker) | ((counts.s1 == counts.s2) & (counts.s1 >= weaker))
    top = max(float(np.maximum(counts.s1, counts.s2)[shown].max()), weaker + 1e-9)
    x = np.linspace(weaker, top, 120)
    fixed = np.full_like(x, weaker)
    kinds = (
        (fixed, x, counts.s1 < counts.s2, WEAKER_FIRST, "o", "weaker first"),
        (x, fixed, counts.s1 > counts.s2, STRONGER_FIRST, "s", "stronger first"),
        (x, x, counts.s1 == counts.s2, EQUAL, "D", "equal stimuli"),
    )
    for s1, s2, of_kind, colour, marker, label in kinds:
        at = shown & of_kind
        if at.any():
            draw_band(ax, x, equal_probability(s1, s2, *theta), colour, 0.3 * size)
            draw_points(ax, np.maximum(counts.s1, counts.s2)[at], counts, at, Mark(colour, marker, label, size))
    ax.set(xlabel="stronger stimulus (ln intensity)", ylim=(-0.03, 1.03))
    if title:
        ax.set_title(f"weaker stimulus {weaker:.3g}", fontsize=10)
    return ax


def distance_panel(ax: Axes, counts: Subject, theta: Natural) -> Axes:
    """All pairs over their normalised distance z (posterior median) on the common curve; as in Fig. 3, lower row."""
    refuse_intervals([counts], "panel of normalised distances")
    z = np.median(normalised_distance(counts.s1, counts.s2, theta.mu1, theta.sigma_p, theta.sigma_l), axis=0)
    reach = max(1.5, 1.05 * float(np.abs(z).max()))
    x = np.linspace(-reach, reach, 200)
    draw_band(ax, x, theta.q0 * 2.0 ** -np.square(x), "#333333")
    kinds = (
        (counts.s1 < counts.s2, Mark(WEAKER_FIRST, "o", "weaker first")),
        (counts.s1 > counts.s2, Mark(STRONGER_FIRST, "s", "stronger first")),
        (counts.s1 == counts.s2, Mark(EQUAL, "D", "equal stimuli")),
    )
    for at, mark in kinds:
        if at.any():
            draw_points(ax, z[at], counts, at, mark)
    ax.set(xlabel=r"normalised distance $(s_2 - \mu_2)/w$", ylabel="P('equal')", ylim=(-0.03, 1.03))
    return ax


@dataclass(frozen=True)
class Mark:
    """Colour, marker, label and size (points) of one kind of answers."""

    colour: str
    marker: str
    label: str
    size: float = 5.5


def draw_band(ax: Axes, x: FloatArray, q: FloatArray, colour: str, line: float = 1.6) -> None:
    """Mean over draws (the first axis of q) and central 60 % and 95 % bands."""
    for low, high, opacity in _BANDS:
        ax.fill_between(x, *np.quantile(q, [low, high], axis=0), color=colour, alpha=opacity, lw=0)
    ax.plot(x, q.mean(axis=0), color=colour, lw=line)


def draw_points(ax: Axes, x: FloatArray, counts: Subject, at: BoolArray, mark: Mark) -> None:
    """The Laplace estimator and its standard deviation, Eq. e:2b."""
    k, n = counts.n_equal[at], counts.n_trials[at]
    q = (k + 1.0) / (n + 2.0)
    error = np.sqrt(q * (1.0 - q) / (n + 3.0))
    crowded = len(counts.s1) > 60
    style: dict[str, Any] = {"ms": 3.0, "alpha": 0.35, "elinewidth": 0.4} if crowded else {"ms": mark.size, "elinewidth": mark.size / 4.6}
    ax.errorbar(x, q, error, fmt=mark.marker, color=mark.colour, mec="white", mew=0.5, label=mark.label, **style)


def legend_below(figure: Figure, *, size: float = 10.0, columns: int = 3) -> None:
    """One legend for the figure, outside the panels: points may be anywhere in them. Size of letters in points."""
    found = {label: handle for ax in figure.axes for handle, label in _main_first(ax)}
    style: dict[str, Any] = {"handletextpad": 0.3, "columnspacing": 1.2, "borderaxespad": 0.2} if size <= LETTERS else {}
    figure.legend(found.values(), found.keys(), loc="outside lower center", ncols=columns, frameon=False, fontsize=size, **style)


def legend_above(ax: Axes, *, columns: int = 1) -> None:
    """One legend for a panel, above it, in small letters; estimates with error bars come first."""
    pairs = _main_first(ax)
    ax.legend(
        [handle for handle, _ in pairs],
        [label for _, label in pairs],
        loc="lower center",
        bbox_to_anchor=(0.5, 1.0),
        ncols=columns,
        frameon=False,
        fontsize=SMALL,
        handletextpad=0.3,
        columnspacing=1.0,
        borderaxespad=0.2,
        labelspacing=0.25,
    )


def _main_first(ax: Axes) -> list[tuple[Any, str]]:
    """Handles and labels, estimates with error bars before plain points: matplotlib itself lists all lines first."""
    pairs = list(zip(*ax.get_legend_handles_labels(), strict=True))
    return sorted(pairs, key=lambda pair: not isinstance(pair[0], tuple))


# --- evidence -----------------------------------------------------------------------------------------------------------------------


def evidence_figure(table: EvidenceTable, *, synthetic: bool = False) -> Figure:
    """Log Bayes factor of every subject: the default estimate with twice its standard error, and Laplace's.

    Parameters
    ----------
    table : EvidenceTable
    synthetic : bool
        Whether to say that the data are synthetic.
    """
    figure = new_figure(7.2, 1.7 + 0.27 * len(table.rows))
    axes = evidence_axes(figure.subplots(), table)
    if synthetic:
        axes.set_title("synthetic data", fontsize=10, loc="right")
    legend_below(figure)
    return figure


def evidence_axes(ax: Axes, table: EvidenceTable) -> Axes:
    """The panel of :func:`evidence_figure`."""
    rows = table.rows
    y = list(range(len(rows)))
    value = np.array([np.nan if row.log_bayes_factor is None else row.log_bayes_factor for row in rows])
    error = np.array([np.nan if row.log_evidence_h1_se is None else row.log_evidence_h1_se for row in rows])
    laplace = np.array([np.nan if row.log_bayes_factor_laplace is None else row.log_bayes_factor_laplace for row in rows])
    ax.axvline(0.0, color="black", lw=1.0)
    for i in y:
        ax.axhline(i, color="#EEEEEE", lw=0.8, zorder=0)
    ax.errorbar(value, y, xerr=2.0 * error, fmt="o", ms=6, color=POSTERIOR, label="importance sampling, 2 s.e.")
    ax.plot(laplace, y, "D", ms=5, mfc="none", color=WEAKER_FIRST, label="Laplace (both models)")
    ax.set_yticks(y, [plain(row.subject, 24) for row in rows])
    ax.set_ylim(len(rows) - 0.5, -0.5)
    ax.set_xlabel("log Bayes factor (nats)\n$\\leftarrow$ free frequencies (H0)  |  predictive update (H1) $\\rightarrow$")
    ax.margins(x=0.08)
    _say_missing(ax, rows, value, laplace)
    return ax


def evidence_plane_axes(table: EvidenceTable, ax: Axes | None = None) -> Axes:
    """Log evidence of H1 (upward) against H0 (to the right), one point a subject, as the paper's figure in Appendix C.

    Per trial, so that studies and subjects of any length share one scale; above the diagonal the predictive update is favoured.
    Subjects without a reliable estimate are left out and counted in the panel.
    """
    ax = panel(ax, high=COLUMN)
    known = [(row.log_evidence_h0, row.log_evidence_h1, row.n_trials) for row in table.rows if row.log_evidence_h1 is not None]
    points = np.array([(h0 / trials, h1 / trials) for h0, h1, trials in known], np.float64).reshape(-1, 2)
    ax.axline((0.0, 0.0), slope=1.0, color="black", lw=0.8)
    for favoured, colour, marker, label in ((True, POSTERIOR, "o", "H1 favoured"), (False, WEAKER_FIRST, "s", "H0 favoured")):
        at = (points[:, 1] > points[:, 0]) == favoured
        if at.any():
            ax.plot(*points[at].T, marker, ms=4.5, mfc="none", mew=1.1, color=colour, label=label)
    if len(points):
        pad = max(0.08 * float(np.ptp(points)), 0.02)
        limits = (float(points.min()) - pad, float(points.max()) + pad)
        ax.set(xlim=limits, ylim=limits)
        ax.locator_params(nbins=6)
        legend_above(ax, columns=2)
    if len(points) < len(table.rows):
        said = f"{len(table.rows) - len(points)} without a reliable estimate"
        ax.text(0.98, 0.03, said, transform=ax.transAxes, ha="right", va="bottom", fontsize=SMALL, color=EQUAL)
    ax.set_aspect("equal")
    ax.set(xlabel="log evidence per trial, H0 (nats)", ylabel="log evidence per trial, H1 (nats)")
    return dress(ax)


def _say_missing(ax: Axes, rows: Sequence[Any], value: FloatArray, laplace: FloatArray) -> None:
    """A subject without an estimate gets words in its row, not an empty line."""
    for i in range(len(rows)):
        if np.isnan(value[i]):
            words = "no reliable estimate" if np.isnan(laplace[i]) else "no reliable estimate, Laplace only"
            ax.text(0.99, i, words, transform=ax.get_yaxis_transform(), ha="right", va="center", fontsize=8, color=EQUAL)


# --- files --------------------------------------------------------------------------------------------------------------------------


#: What would differ from one writing to the next, by format.
_UNDATED: dict[str, dict[str, None]] = {
    "png": {"Software": None},
    "pdf": {"CreationDate": None, "Producer": None, "Creator": None},
    "svg": {"Date": None, "Creator": None},
}


def png(figure: Figure, *, dpi: int = 150) -> bytes:
    """A figure as PNG; characters that the font lacks are drawn as boxes without a warning."""
    return picture(figure, "png", dpi=dpi)


def picture(figure: Figure, suffix: str, *, dpi: int = 300) -> bytes:
    """A figure as the content of a file; without dates or random names, so that the same figure gives the same bytes.

    Raises
    ------
    InputError
        If matplotlib knows no such format.
    """
    buffer = io.BytesIO()
    _write(figure, buffer, _require_suffix(f"figure.{suffix}"), dpi)
    return buffer.getvalue()


@contextmanager
def any_characters() -> Iterator[None]:
    """Lay out or draw without a warning for characters that the font lacks: they become boxes."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing from font", category=UserWarning)
        yield


def _write(figure: Figure, where: Any, suffix: str, dpi: int) -> None:
    import matplotlib as mpl

    # Only in here: fonts as fonts, not as outlines, which some journals refuse; names in an SVG from its content, not from chance.
    settings: dict[Any, Any] = {"pdf.fonttype": 42, "ps.fonttype": 42, "svg.fonttype": "none", "svg.hashsalt": "bayes_toe"}
    with any_characters(), mpl.rc_context(settings):
        figure.savefig(where, format=suffix, dpi=dpi, metadata=_UNDATED.get(suffix))


def save_figure(figure: Figure, path: str | Path, *, overwrite: bool = False, dpi: int = 200) -> Path:
    """Write a figure, whole or not at all; the format follows from the suffix.

    Raises
    ------
    OutputError
        If the file exists and may not be replaced, or cannot be written.
    InputError
        If matplotlib knows no such format.
    """
    suffix = _require_suffix(path)
    with whole_file(path, overwrite=overwrite) as target:
        _write(figure, target, suffix, dpi)
    return Path(path)


def picture_beside(table: Path) -> Path:
    """Where the figure of a table goes: beside it, as PNG.

    Raises
    ------
    InputError
        If the table itself is to have that name.
    """
    picture = table.with_name(f"{table.stem}.png")
    if picture == table:
        raise InputError(f"{table}: found the name of the figure for the table, allowed: another suffix, such as .csv")
    return picture


def require_figure(path: str | Path, *, overwrite: bool = False) -> None:
    """Refuse now what :func:`save_figure` would refuse after long work; leaves nothing behind.

    Raises
    ------
    OutputError
        If the file exists and may not be replaced, or cannot be written.
    InputError
        If matplotlib knows no such format.
    """
    _require_suffix(path)
    require_writable(path, overwrite=overwrite)


def _require_suffix(path: str | Path) -> str:
    from matplotlib.backend_bases import FigureCanvasBase

    suffix = Path(path).suffix.lstrip(".").lower()
    if suffix not in FigureCanvasBase.get_supported_filetypes():
        raise InputError(f"{path}: found suffix {suffix!r}, allowed: png, pdf, svg and what else matplotlib writes")
    return suffix


def even_columns(panels: int, most: int) -> int:
    """Columns, at most so many, with which the rows of a grid of panels are as even as they can be.

    Examples
    --------
    >>> even_columns(4, most=3), even_columns(7, most=3), even_columns(2, most=3)
    (2, 3, 2)
    """
    return -(-panels // -(-panels // most))


def new_figure(wide: float, high: float, layout: Literal["constrained"] | None = "constrained") -> Figure:
    """A figure that no global state knows of: nothing to close, nothing pops up."""
    from matplotlib.figure import Figure

    return Figure(figsize=(wide, high), layout=layout)


def panel(ax: Axes | None, *, wide: float = COLUMN, high: float = 2.6) -> Axes:
    """The Axes given, or those of a new figure of so many inches."""
    return new_figure(wide, high).subplots() if ax is None else ax


def dress(ax: Axes) -> Axes:
    """Letters and lines of a panel as a journal prints them: 7 points for numbers, 8 for words, no box."""
    ax.tick_params(labelsize=SMALL, width=0.6, length=2.5, pad=2.0)
    for text in (ax.xaxis.label, ax.yaxis.label, ax.title):
        text.set_fontsize(LETTERS)
    for side, spine in ax.spines.items():
        spine.set_linewidth(0.6)
        spine.set_visible(side in ("left", "bottom"))
    return ax
