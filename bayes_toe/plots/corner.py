"""Corner plots of one subject's draws; the only module that imports corner.

The panels are laid out in inches, so that key and tick labels stay clear of them and of each other whatever their number. Few
panels leave no room beside them: the key then stands above.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from bayes_toe.arrays import FloatArray
from bayes_toe.errors import InputError
from bayes_toe.inference.draws import Draws
from bayes_toe.model.coordinates import NATURAL, Natural, quantities
from bayes_toe.model.ladder import posterior_of
from bayes_toe.model.posterior import Posterior
from bayes_toe.model.prior import Prior
from bayes_toe.model.target import Answering
from bayes_toe.plots.style import POSTERIOR, WEAKER_FIRST, new_figure, plain

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Values = Mapping[str, float]

PRIOR, TRUTH = "#999999", WEAKER_FIRST
LABELS = {
    "mu1": r"$\mu_1$",
    "sigma_p": r"$\sigma_p$",
    "sigma_l": r"$\sigma_\ell$",
    "q0": r"$q_0$",
    "gamma": r"$\gamma$",
    "sigma1": r"$\sigma_1$",
    "gain": r"gain $K$",
    "width": r"width $w$",
    "offset": r"offset $c$",
    "pull": r"pull $p$",
    "rho": r"$\rho$",
    "noise_slope": r"noise slope $b$",
    "lapse_rate": r"lapse rate $\lambda$",
    "exponent": r"exponent $\nu$",
    "icc": "intra-class\ncorrelation",
}
COORDINATES = ("natural", "identified")
_PRIOR_DRAWS = 100_000
_BINS = 40

# Inches: margins with room for tick and axis labels, the gap between panels, a panel, the widest line of the key.
_LEFT, _BOTTOM, _RIGHT, _TOP, _GAP = 0.95, 0.9, 0.15, 0.15, 0.1
_PANEL, _LONE_PANEL = 1.6, 2.6
_KEY = 2.7


def corner(
    draws: Draws,
    subject: str,
    *,
    coordinates: str | Sequence[str] = "natural",
    truths: Values | None = None,
    prior: Prior | None = None,
    fig: Figure | None = None,
) -> Figure:
    """Corner plot of one subject: contours hold 50 % and 90 % of the posterior, dashed lines mark 5, 50 and 95 %.

    Parameters
    ----------
    draws : Draws
    subject : str
    coordinates : {"natural", "identified"} or sequence of str
        Which quantities; a sequence names quantities of the model, such as `gain`, `offset` or `pull`.
    truths : mapping of str to float, optional
        Known values of a synthetic subject. What follows from them is drawn too: natural parameters are enough for any quantity.
    prior : Prior, optional
        Its marginals are drawn in grey on the diagonal, on the scale of the posterior's histograms; `draws.prior` is the one
        that the draws were made under.
    fig : matplotlib Figure or SubFigure, optional
        Drawn into, where given.

    Raises
    ------
    InputError
        For an unknown subject or quantity, no quantity at all, or a true value that cannot be one.
    """
    target = draws.posterior(subject)
    names = _names(coordinates, target)
    samples = np.column_stack([draws.values(subject, name).ravel() for name in names])
    known = {} if truths is None else _known(truths, target)
    spans = [_span(column, _support(target, name)) for name, column in zip(names, samples.T, strict=True)]
    lines = _title(draws, subject) + _key(len(names), prior is not None, _truth_key(names, spans, known))
    figure = _figure_for(len(names), lines) if fig is None else fig
    axes = _panels(figure, samples, names, spans)
    if prior is not None:
        believed = posterior_of(target.subject, prior, model=draws.model)
        drawn = believed.quantities(believed.sample_prior(np.random.default_rng(0), _PRIOR_DRAWS))
        _draw_prior(axes, drawn, names, len(samples))
    _draw_truths(axes, names, known)
    for i, span in enumerate(spans):
        _draw_ticks(axes, i, span)
    _lay_out(figure, axes, lines)
    return figure


def _names(coordinates: str | Sequence[str], target: Answering) -> tuple[str, ...]:
    if not isinstance(coordinates, str):
        if len(coordinates) == 0:
            raise InputError(f"coordinates: found none, allowed: {', '.join(COORDINATES)} or some of {', '.join(target.names.all)}")
        return tuple(coordinates)
    if coordinates not in COORDINATES:
        raise InputError(f"coordinates {coordinates!r} must be one of: {', '.join(COORDINATES)}")
    return target.names.natural if coordinates == "natural" else target.names.identified


def _label(name: str) -> str:
    return LABELS.get(name, name)


def _support(target: Answering, name: str) -> tuple[float, float]:
    """Where a quantity can lie."""
    if name in ("mu1", "offset"):
        return -np.inf, np.inf
    if name in ("gamma", "rho") or name.startswith("q"):
        return 0.0, 1.0
    if name.startswith("sigma") or name == "width":
        return 0.0, np.inf
    return target.prior_quantile(name, 0.0), target.prior_quantile(name, 1.0)  # as far as the model's prior reaches


def _span(values: FloatArray, support: tuple[float, float]) -> tuple[float, float]:
    """Axis limits from quantiles, within the support: a few draws far out in a funnel do not squeeze the rest into one bin."""
    low, high = np.quantile(values, [0.005, 0.995])
    pad = 0.08 * (high - low) if high > low else 0.5 * abs(low) + 1e-12
    return max(float(low - pad), support[0]), min(float(high + pad), support[1])


# --- panels -------------------------------------------------------------------------------------------------------------------------


def _panels(figure: Figure, samples: FloatArray, names: Sequence[str], spans: Sequence[tuple[float, float]]) -> npt.NDArray[Any]:
    """Histograms and contours; returns the Axes, of which those above the diagonal are empty."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)  # corner imports ArviZ, which announces its refactoring
        import corner as corner_package

    corner_package.corner(
        samples,
        fig=figure,
        bins=_BINS,
        range=list(spans),
        labels=[_label(name) for name in names],
        quantiles=(0.05, 0.5, 0.95),
        levels=(0.5, 0.9),
        color=POSTERIOR,
        smooth=1.0,
        plot_datapoints=False,
        fill_contours=True,
        label_kwargs={"fontsize": 13},
    )
    return np.array(figure.axes).reshape(len(names), len(names))


def _draw_prior(axes: npt.NDArray[Any], prior: Mapping[str, FloatArray], names: Sequence[str], size: int) -> None:
    for ax, name in zip(axes.diagonal(), names, strict=True):
        low, high = ax.get_xlim()
        edges = np.linspace(low, high, _BINS + 1)
        counts = np.histogram(prior[name], edges)[0] * (size / _PRIOR_DRAWS)
        ax.stairs(counts, edges, color=PRIOR, lw=1.4, label="prior")
        ax.set_ylim(top=max(ax.get_ylim()[1], 1.1 * counts.max()))


# --- true values --------------------------------------------------------------------------------------------------------------------


def _known(truths: Values, target: Answering) -> dict[str, float]:
    """The true values given and all that follow from them."""
    allowed = target.names.all
    for name, value in truths.items():
        if name not in allowed:
            raise InputError(f"truths: unknown quantity {name!r}; there are: {', '.join(allowed)}")
        if not np.isfinite(value) or (name == "sigma_p" and value <= 0):
            raise InputError(f"truths: {name}={value!r}, allowed: a {'positive ' if name == 'sigma_p' else ''}finite number")
    # NaN stands for what was not given, and marks what cannot be known without it.
    given = {name: np.asarray(truths.get(name, np.nan), np.float64) for name in target.names.natural}
    if isinstance(target, Posterior) and set(NATURAL) <= set(given):  # the paper's parameters may also lie outside the prior's support
        found = quantities(Natural(*(given[name] for name in NATURAL)), target.sbar)
    else:
        found = target.quantities(target.points(given))
    follow = {name: float(value) for name, value in found.items() if np.isfinite(value)}
    return {**follow, **truths}


def _truth_key(names: Sequence[str], spans: Sequence[tuple[float, float]], known: Values) -> list[str]:
    """What the key says of true values: nothing where none is shown, and which lie outside their panels."""
    shown = [(name, known[name], low <= known[name] <= high) for name, (low, high) in zip(names, spans, strict=True) if name in known]
    outside = [f"{_label(name)} = {value:.5g}".replace("-", "−") for name, value, inside in shown if not inside]
    lines = ["red: true value"] if len(outside) < len(shown) else []
    return lines + ([f"true value outside: {', '.join(outside)}"] if outside else [])


def _draw_truths(axes: npt.NDArray[Any], names: Sequence[str], known: Values) -> None:
    values = [known.get(name) for name in names]
    for i, below in enumerate(values):
        for j, across in enumerate(values[: i + 1]):
            _draw_truth(axes[i, j], across, below if j < i else None)


def _draw_truth(ax: Axes, x: float | None, y: float | None) -> None:
    if x is not None:
        ax.axvline(x, color=TRUTH)
    if y is not None:
        ax.axhline(y, color=TRUTH)
    if x is not None and y is not None:
        ax.plot(x, y, "s", color=TRUTH)


# --- ticks --------------------------------------------------------------------------------------------------------------------------


def _draw_ticks(axes: npt.NDArray[Any], i: int, span: tuple[float, float]) -> None:
    """Ticks of one quantity: below its column and left of its row."""
    ticks = _ticks(*span)
    for ax in axes[i:, i]:
        ax.set_xticks(ticks, [])
    for ax in axes[i, :i]:
        ax.set_yticks(ticks, [])
    axes[-1, i].set_xticks(ticks, _tick_labels(ticks), rotation=45, ha="right", va="top", rotation_mode="anchor")
    if i > 0:
        axes[i, 0].set_yticks(ticks, _tick_labels(ticks), rotation=0)


def _ticks(low: float, high: float) -> FloatArray:
    """Three or a few more round numbers, none so near an end that its label could touch the next panel's."""
    from matplotlib.ticker import MaxNLocator

    margin = 0.06 * (high - low)
    for most in range(4, 12):
        ticks = np.asarray(MaxNLocator(most).tick_values(low, high))
        ticks = ticks[(ticks >= low + margin) & (ticks <= high - margin)]
        if len(ticks) > 2:
            break
    return ticks


def _tick_labels(ticks: FloatArray) -> list[str]:
    r"""All with the same decimals, as many as they need; powers of ten where that would be long.

    Examples
    --------
    >>> _tick_labels(np.array([-0.25, 0.0, 0.5])), _tick_labels(np.array([0.0, 2e-7]))
    (['−0.25', '0.00', '0.50'], ['0', '2e−07'])
    """
    largest = np.abs(ticks).max()
    if not 1e-4 <= largest < 1e6:
        return [f"{tick:.6g}".replace("-", "−") for tick in ticks]
    step = np.diff(ticks).min() if len(ticks) > 1 else largest
    decimals = next(d for d in range(18) if (np.abs(ticks - np.round(ticks, d)) <= 1e-3 * step).all())
    return [f"{tick:.{decimals}f}".replace("-", "−") for tick in np.round(ticks, decimals) + 0.0]


# --- words and layout ---------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Line:
    """A line of the title or the key; sizes in points."""

    text: str
    size: float = 10.0
    weight: str = "normal"
    colour: str = "#444444"

    @property
    def height(self) -> float:
        """Inches from this line to the next."""
        return 1.3 * self.size / 72.0

    def size_within(self, room: float) -> float:
        """Points at which the text is no wider than so many inches."""
        share = 0.68 if self.weight == "bold" else 0.54  # of the size, the mean width of a letter
        return min(self.size, 72.0 * room / (share * max(1, len(self.text))))


def _title(draws: Draws, subject: str) -> list[_Line]:
    lines = [_Line(plain(subject), 14.0, "bold", "black")]
    lines.append(_Line(draws.model, 11.0, colour="black"))
    lines += [_Line("synthetic data", 11.0, colour="black")] if draws.synthetic else []
    return lines + ([_Line("NOT CONVERGED", 13.0, "bold", "black")] if subject in draws.not_converged else [])


def _key(count: int, with_prior: bool, about_truths: Sequence[str]) -> list[_Line]:
    key = ["blue: posterior" + (", contours 50 and 90 %" if count > 1 else ""), "dashed: 5, 50, 95 %"]
    key += ["grey: prior"] if with_prior else []
    return [_Line(text) for text in (*key, *about_truths, "intensities: natural log")]


def _height(lines: Sequence[_Line]) -> float:
    return sum(line.height for line in lines)


def _figure_for(count: int, lines: Sequence[_Line]) -> Figure:
    panel = _LONE_PANEL if count == 1 else _PANEL
    side = count * panel + (count - 1) * _GAP
    header = _height(lines) + _TOP if _beside(count, panel) < _KEY else 0.0
    return new_figure(_LEFT + side + _RIGHT, _BOTTOM + side + _TOP + header, layout=None)


def _beside(count: int, panel: float) -> float:
    """Inches to the right of the topmost panel, where the key stands if it fits."""
    return (count - 1) * (panel + _GAP)


def _lay_out(figure: Figure, axes: npt.NDArray[Any], lines: Sequence[_Line]) -> None:
    """Place panels, axis labels and words; all measures in inches."""
    count = len(axes)
    wide, high = (float(side) / figure.dpi for side in (figure.bbox.width, figure.bbox.height))
    across = (wide - _LEFT - _RIGHT - (count - 1) * _GAP) / count
    beside = _beside(count, across)
    header = 0.0 if beside >= _KEY else _height(lines) + _TOP
    down = (high - _BOTTOM - _TOP - header - (count - 1) * _GAP) / count
    figure.subplots_adjust(
        left=_LEFT / wide,
        right=1.0 - _RIGHT / wide,
        bottom=_BOTTOM / high,
        top=1.0 - (_TOP + header) / high,
        wspace=_GAP / across,
        hspace=_GAP / down,
    )
    for i in range(count):
        axes[-1, i].xaxis.set_label_coords(0.5, -0.62 / down)
        axes[i, 0].yaxis.set_label_coords(-0.68 / across, 0.5)
    x, room = (0.15, wide - 0.3) if header else (wide - _RIGHT, beside)
    y = high - _TOP
    for line in lines:
        style: dict[str, Any] = {"ha": "left" if header else "right", "va": "top", "weight": line.weight, "color": line.colour}
        figure.text(x / wide, y / high, line.text, fontsize=line.size_within(room), **style)
        y -= line.height
