"""What a corner plot shows, whichever way it is drawn: quantities, ranges, prior, true values, words, ticks; lengths in inches."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.data.messages import listed
from bayes_toe.errors import InputError
from bayes_toe.inference.draws import Draws
from bayes_toe.model.coordinates import NATURAL, Natural, quantities
from bayes_toe.model.ladder import posterior_of
from bayes_toe.model.posterior import PRIOR_DRAWS, Model, Posterior, prior_draws
from bayes_toe.model.prior import Prior
from bayes_toe.model.target import Answering
from bayes_toe.plots.style import POSTERIOR, WEAKER_FIRST, new_figure, plain

if TYPE_CHECKING:
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
BINS = 40
#: Shares of the posterior inside the contours; quantiles that lines mark.
LEVELS, MARKED = (0.5, 0.9), (0.05, 0.5, 0.95)
SPANNED = (0.005, 0.995)
#: Areas within the contours of one subject, the largest first.
AREAS: Mapping[str, Any] = {"facecolors": ((POSTERIOR, 1.0 / 3.0), POSTERIOR), "edgecolors": POSTERIOR, "linewidths": 1.5}

#: Of several subjects in the same panels: colour, and the line that tells them apart in grey.
OVERLAID = ((POSTERIOR, "solid"), ("#B8520A", "dashed"), ("#00704F", "dotted"), ("#A0458A", "dashdot"))

#: Margins with room for tick and axis labels, the gap between panels, a panel, the widest line of the key.
LEFT, BOTTOM, RIGHT, TOP, GAP = 0.95, 0.9, 0.15, 0.15, 0.1
PANEL, LONE_PANEL = 1.6, 2.6
KEY = 2.7
#: From the panels to the middle of a row's and the top of a column's label.
LABEL_LEFT, LABEL_BELOW = 0.68, 0.62


@dataclass(frozen=True)
class Line:
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


@dataclass(frozen=True, eq=False)
class Content:
    """What a corner plot of one subject shows.

    Attributes
    ----------
    names : tuple of str
        The quantities.
    samples : array, shape (draws, quantities)
    spans : sequence of (float, float)
        From where to where each panel shows its quantity.
    marked : array, shape (3, quantities)
        The quantiles :data:`MARKED` of all draws.
    known : mapping of str to float
        True values.
    believed : sequence of array, shape (BINS,)
        Draws from the prior in the bins of each panel, as many in all as draws from the posterior; empty without a prior.
    lines : sequence of Line
        Title and key.
    """

    names: tuple[str, ...]
    samples: FloatArray
    spans: Sequence[tuple[float, float]]
    marked: FloatArray
    known: Values
    believed: Sequence[FloatArray]
    lines: Sequence[Line]

    @property
    def labels(self) -> list[str]:
        """What the axes of the quantities are called."""
        return [label(name) for name in self.names]


def content(
    draws: Draws,
    subject: str,
    coordinates: str | Sequence[str],
    truths: Values | None,
    prior: Prior | None,
    within: Sequence[tuple[float, float]] | None = None,
) -> Content:
    """What is to be drawn of one subject; arguments and errors as :func:`bayes_toe.plots.corner.corner` has them.

    The panels reach as far as they need, or `within` what is given.
    """
    target = draws.posterior(subject)
    names = _names(coordinates, target)
    samples = np.column_stack([draws.values(subject, name).ravel() for name in names])
    known = {} if truths is None else known_from(truths, target)
    found = np.quantile(samples, [*SPANNED, *MARKED], axis=0)
    needed = [span(low, high, support(target, name)) for name, low, high in zip(names, *found[:2].tolist(), strict=True)]
    spans = needed if within is None else within
    believed = [] if prior is None else _believed(posterior_of(target.subject, prior, model=draws.model), names, spans, len(samples))
    lines = _title(draws, subject) + _key(len(names), prior is not None, _truth_key(names, spans, known))
    return Content(names, samples, spans, found[2:], known, believed, lines)


def overlaid(
    draws: Draws, subjects: Sequence[str], coordinates: str | Sequence[str], truths: Mapping[str, Values] | None, prior: Prior | None
) -> list[Content]:
    """What is to be drawn of several subjects in the same panels: each with the spans and the words of all.

    Raises
    ------
    InputError
        As :func:`content`; for fewer than two subjects, more than :data:`OVERLAID` has styles for, or a repeated one.
    """
    if not 2 <= len(subjects) <= len(OVERLAID) or len(set(subjects)) < len(subjects):
        raise InputError(f"subjects in one corner plot: found {listed([*map(repr, subjects)])}; allowed: 2 to {len(OVERLAID)}, each once")
    alone = [content(draws, name, coordinates, None, None) for name in subjects]
    spans = [(min(low for low, _ in of), max(high for _, high in of)) for of in zip(*(one.spans for one in alone), strict=True)]
    known = {} if truths is None else truths
    found = [content(draws, name, coordinates, known.get(name), prior, spans) for name in subjects]
    shown = any(name in one.known for one in found for name in one.names)
    lines = _titles(draws, subjects) + _overlaid_key(len(spans), prior is not None, shown)
    return [replace(one, lines=lines) for one in found]


def _names(coordinates: str | Sequence[str], target: Answering) -> tuple[str, ...]:
    if not isinstance(coordinates, str):
        if len(coordinates) == 0:
            raise InputError(f"coordinates: found none, allowed: {', '.join(COORDINATES)} or some of {', '.join(target.names.all)}")
        return tuple(coordinates)
    if coordinates not in COORDINATES:
        raise InputError(f"coordinates {coordinates!r} must be one of: {', '.join(COORDINATES)}")
    return target.names.natural if coordinates == "natural" else target.names.identified


def label(name: str) -> str:
    """What the axis of a quantity is called."""
    return LABELS.get(name, name)


def support(target: Answering, name: str) -> tuple[float, float]:
    """Where a quantity can lie."""
    if name in ("mu1", "offset"):
        return -np.inf, np.inf
    if name in ("gamma", "rho") or name.startswith("q"):
        return 0.0, 1.0
    if name.startswith("sigma") or name == "width":
        return 0.0, np.inf
    return target.prior_quantile(name, 0.0), target.prior_quantile(name, 1.0)  # as far as the model's prior reaches


def span(low: float, high: float, support: tuple[float, float]) -> tuple[float, float]:
    """Axis limits from quantiles, within the support: a few draws far out in a funnel do not squeeze the rest into one bin."""
    pad = 0.08 * (high - low) if high > low else 0.5 * abs(low) + 1e-12
    return max(low - pad, support[0]), min(high + pad, support[1])


def _believed(target: Answering, names: tuple[str, ...], spans: Sequence[tuple[float, float]], size: int) -> list[FloatArray]:
    """Draws from the prior, counted in the bins of the panels as if there were `size` of them."""
    if isinstance(target, Posterior):
        drawn = _of_design(target.model, target.prior, target.sbar, names)
    else:
        drawn = _ascending(target.quantities(target.sample_prior(np.random.default_rng(0), PRIOR_DRAWS)), names)
    edges = (np.linspace(low, high, BINS + 1) for low, high in spans)
    return [np.diff(np.searchsorted(drawn[name], at)) * (size / PRIOR_DRAWS) for name, at in zip(names, edges, strict=True)]


@lru_cache(maxsize=1)
def _of_design(model: Model, prior: Prior, sbar: float, names: tuple[str, ...]) -> dict[str, FloatArray]:
    """Draws of quantities from the prior, ascending: the same for all subjects of a design, one after the other."""
    return _ascending(prior_draws(model, prior, sbar), names)


def _ascending(values: Mapping[str, FloatArray], names: tuple[str, ...]) -> dict[str, FloatArray]:
    return {name: np.sort(values[name]) for name in names}


# --- true values --------------------------------------------------------------------------------------------------------------------


def known_from(truths: Values, target: Answering) -> dict[str, float]:
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
    outside = [f"{label(name)} = {value:.5g}".replace("-", "−") for name, value, inside in shown if not inside]
    lines = ["red: true value"] if len(outside) < len(shown) else []
    return lines + ([f"true value outside: {', '.join(outside)}"] if outside else [])


# --- words, ticks, layout -----------------------------------------------------------------------------------------------------------


def _title(draws: Draws, subject: str) -> list[Line]:
    lines = [Line(plain(subject), 14.0, "bold", "black")]
    lines.append(Line(draws.model, 11.0, colour="black"))
    lines += [Line("synthetic data", 11.0, colour="black")] if draws.synthetic else []
    return lines + ([Line("NOT CONVERGED", 13.0, "bold", "black")] if subject in draws.not_converged else [])


def _titles(draws: Draws, subjects: Sequence[str]) -> list[Line]:
    """Each subject in its colour, with its line in words, for who cannot tell the colours apart."""
    lines = []
    for name, (colour, line) in zip(subjects, OVERLAID, strict=False):
        missed = ", NOT CONVERGED" if name in draws.not_converged else ""
        lines.append(Line(f"{plain(name, 24)} ({line}{missed})", 12.0, "bold", colour))
    about = f"{draws.model}, synthetic data" if draws.synthetic else draws.model
    return [*lines, Line(about, 11.0, colour="black")]


def _overlaid_key(count: int, with_prior: bool, with_truths: bool) -> list[Line]:
    key = ["contours: 50 and 90 %" if count > 1 else "", "upright: medians", "grey: prior" if with_prior else ""]
    key += [f"{'squares, ' if count > 1 else ''}triangles: true values" if with_truths else "", "intensities: natural log"]
    return [Line(text) for text in key if text]


def _key(count: int, with_prior: bool, about_truths: Sequence[str]) -> list[Line]:
    key = ["blue: posterior" + (", contours 50 and 90 %" if count > 1 else ""), "dashed: 5, 50, 95 %"]
    key += ["grey: prior"] if with_prior else []
    return [Line(text) for text in (*key, *about_truths, "intensities: natural log")]


def height(lines: Sequence[Line]) -> float:
    """Of title and key."""
    return sum(line.height for line in lines)


def panel_side(count: int) -> float:
    """Of a panel, in a figure of its own."""
    return LONE_PANEL if count == 1 else PANEL


def beside(count: int, panel: float) -> float:
    """What is free to the right of the topmost panel, where the key stands if it fits."""
    return (count - 1) * (panel + GAP)


def header(count: int, panel: float, lines: Sequence[Line]) -> float:
    """What title and key take above the panels: nothing where they stand beside them."""
    return 0.0 if beside(count, panel) >= KEY else height(lines) + TOP


def figure_for(found: Content) -> Figure:
    """A figure of its own for the panels, and title and key where these stand above."""
    count = len(found.names)
    panel = panel_side(count)
    across = panel + beside(count, panel)
    return new_figure(LEFT + across + RIGHT, BOTTOM + across + TOP + header(count, panel, found.lines), layout=None)


def write(figure: Figure, lines: Sequence[Line], count: int, panel: float) -> None:
    """Title and key of so many panels a side: beside the topmost one, or above it."""
    wide, high = (float(side) / figure.dpi for side in (figure.bbox.width, figure.bbox.height))
    above = header(count, panel, lines) > 0.0
    x, room = (0.15, wide - 0.3) if above else (wide - RIGHT, beside(count, panel))
    y = high - TOP
    for line in lines:
        style: dict[str, Any] = {"ha": "left" if above else "right", "va": "top", "weight": line.weight, "color": line.colour}
        figure.text(x / wide, y / high, line.text, fontsize=line.size_within(room), **style)
        y -= line.height


def ticks(low: float, high: float) -> FloatArray:
    """Three or a few more round numbers, none so near an end that its label could touch the next panel's."""
    from matplotlib.ticker import MaxNLocator

    margin = 0.06 * (high - low)
    for most in range(4, 12):
        found = np.asarray(MaxNLocator(most).tick_values(low, high))
        found = found[(found >= low + margin) & (found <= high - margin)]
        if len(found) > 2:
            break
    return found


def tick_labels(ticks: FloatArray) -> list[str]:
    r"""All with the same decimals, as many as they need; powers of ten where that would be long.

    Examples
    --------
    >>> tick_labels(np.array([-0.25, 0.0, 0.5])), tick_labels(np.array([0.0, 2e-7]))
    (['−0.25', '0.00', '0.50'], ['0', '2e−07'])
    """
    largest = np.abs(ticks).max()
    if not 1e-4 <= largest < 1e6:
        return [f"{tick:.6g}".replace("-", "−") for tick in ticks]
    step = np.diff(ticks).min() if len(ticks) > 1 else largest
    decimals = next(d for d in range(18) if (np.abs(ticks - np.round(ticks, d)) <= 1e-3 * step).all())
    return [f"{tick:.{decimals}f}".replace("-", "−") for tick in np.round(ticks, decimals) + 0.0]
