"""Figures of curves and of evidence, and figures as files; corner plots have :mod:`bayes_toe.corner_plot`.

Functions take Axes or make a Figure of their own, return it, never show it and never touch global settings. Colours keep the
paper's meaning in a palette safe for colour-blind readers: red weaker stimulus first, blue stronger first, grey equal stimuli;
markers differ too.
"""

from __future__ import annotations

import io
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt

from bayes_toe.coordinates import Natural
from bayes_toe.draws import Draws
from bayes_toe.errors import InputError
from bayes_toe.model import equal_probability, normalised_distance
from bayes_toe.model_evidence import EvidenceTable
from bayes_toe.outputs import require_writable, whole_file
from bayes_toe.study import Subject

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FloatArray = npt.NDArray[np.float64]

WEAKER_FIRST, STRONGER_FIRST, EQUAL = "#D55E00", "#0072B2", "#6E6E6E"
POSTERIOR = "#0072B2"
#: Panels of one weaker stimulus each, beyond which curves give way to the normalised distance.
_MAX_PANELS = 6
_CURVE_DRAWS = 600
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
    _legend_below(figure)
    figure.suptitle(plain(subject) + (" (synthetic data)" if draws.synthetic else ""), fontsize=12)
    return figure


def thinned(theta: Natural) -> Natural:
    """A few hundred draws, each value of shape (draws, 1), as the panels take them."""
    every = max(1, theta.mu1.size // _CURVE_DRAWS)
    return Natural(*(values.ravel()[::every, None] for values in theta))


def order_panel(ax: Axes, counts: Subject, theta: Natural, weaker: float, *, title: bool = False) -> Axes:
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
    """
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
            _draw_band(ax, x, equal_probability(s1, s2, *theta), colour)
            _draw_points(ax, np.maximum(counts.s1, counts.s2)[at], counts, at, _Mark(colour, marker, label))
    ax.set(xlabel="stronger stimulus (ln intensity)", ylim=(-0.03, 1.03))
    if title:
        ax.set_title(f"weaker stimulus {weaker:.3g}", fontsize=10)
    return ax


def distance_panel(ax: Axes, counts: Subject, theta: Natural) -> Axes:
    """All pairs over their normalised distance z (posterior median) on the common curve; as in Fig. 3, lower row."""
    z = np.median(normalised_distance(counts.s1, counts.s2, theta.mu1, theta.sigma_p, theta.sigma_l), axis=0)
    reach = max(1.5, 1.05 * float(np.abs(z).max()))
    x = np.linspace(-reach, reach, 200)
    _draw_band(ax, x, theta.q0 * 2.0 ** -np.square(x), "#333333")
    kinds = (
        (counts.s1 < counts.s2, _Mark(WEAKER_FIRST, "o", "weaker first")),
        (counts.s1 > counts.s2, _Mark(STRONGER_FIRST, "s", "stronger first")),
        (counts.s1 == counts.s2, _Mark(EQUAL, "D", "equal stimuli")),
    )
    for at, mark in kinds:
        if at.any():
            _draw_points(ax, z[at], counts, at, mark)
    ax.set(xlabel=r"normalised distance $(s_2 - \mu_2)/w$", ylabel="P('equal')", ylim=(-0.03, 1.03))
    return ax


@dataclass(frozen=True)
class _Mark:
    colour: str
    marker: str
    label: str


def _draw_band(ax: Axes, x: FloatArray, q: FloatArray, colour: str) -> None:
    for low, high, opacity in _BANDS:
        ax.fill_between(x, *np.quantile(q, [low, high], axis=0), color=colour, alpha=opacity, lw=0)
    ax.plot(x, q.mean(axis=0), color=colour, lw=1.6)


def _draw_points(ax: Axes, x: FloatArray, counts: Subject, at: npt.NDArray[np.bool_], mark: _Mark) -> None:
    """The Laplace estimator and its standard deviation, Eq. e:2b."""
    k, n = counts.n_equal[at], counts.n_trials[at]
    q = (k + 1.0) / (n + 2.0)
    error = np.sqrt(q * (1.0 - q) / (n + 3.0))
    crowded = len(counts.s1) > 60
    style: dict[str, Any] = {"ms": 3.0, "alpha": 0.35, "elinewidth": 0.4} if crowded else {"ms": 5.5, "elinewidth": 1.2}
    ax.errorbar(x, q, error, fmt=mark.marker, color=mark.colour, mec="white", mew=0.5, label=mark.label, **style)


def _legend_below(figure: Figure) -> None:
    """One legend for the figure, outside the panels: points may be anywhere in them."""
    found = {label: handle for ax in figure.axes for handle, label in _main_first(ax)}
    figure.legend(found.values(), found.keys(), loc="outside lower center", ncols=3, frameon=False, fontsize=10)


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
    _legend_below(figure)
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


def _say_missing(ax: Axes, rows: Sequence[Any], value: FloatArray, laplace: FloatArray) -> None:
    """A subject without an estimate gets words in its row, not an empty line."""
    for i in range(len(rows)):
        if np.isnan(value[i]):
            words = "no reliable estimate" if np.isnan(laplace[i]) else "no reliable estimate, Laplace only"
            ax.text(0.99, i, words, transform=ax.get_yaxis_transform(), ha="right", va="center", fontsize=8, color=EQUAL)


# --- files --------------------------------------------------------------------------------------------------------------------------


def png(figure: Figure, *, dpi: int = 150) -> bytes:
    """A figure as PNG; characters that the font lacks are drawn as boxes without a warning."""
    buffer = io.BytesIO()
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing from font", category=UserWarning)
        figure.savefig(buffer, format="png", dpi=dpi, metadata={"Software": None})
    return buffer.getvalue()


def save_figure(figure: Figure, path: str | Path, *, overwrite: bool = False, dpi: int = 200) -> Path:
    """Write a figure, whole or not at all; the format follows from the suffix.

    Raises
    ------
    OutputError
        If the file exists and may not be replaced, or cannot be written.
    InputError
        If matplotlib knows no such format.
    """
    _require_format(path)
    with whole_file(path, overwrite=overwrite) as target, warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing from font", category=UserWarning)
        figure.savefig(target, dpi=dpi)
    return Path(path)


def require_figure(path: str | Path, *, overwrite: bool = False) -> None:
    """Refuse now what :func:`save_figure` would refuse after long work; leaves nothing behind.

    Raises
    ------
    OutputError
        If the file exists and may not be replaced, or cannot be written.
    InputError
        If matplotlib knows no such format.
    """
    _require_format(path)
    require_writable(path, overwrite=overwrite)


def _require_format(path: str | Path) -> None:
    from matplotlib.backend_bases import FigureCanvasBase

    suffix = Path(path).suffix.lstrip(".").lower()
    if suffix not in FigureCanvasBase.get_supported_filetypes():
        raise InputError(f"{path}: found suffix {suffix!r}, allowed: png, pdf, svg and what else matplotlib writes")


def new_figure(wide: float, high: float, layout: Literal["constrained"] | None = "constrained") -> Figure:
    """A figure that no global state knows of: nothing to close, nothing pops up."""
    from matplotlib.figure import Figure

    return Figure(figsize=(wide, high), layout=layout)
