"""Figure of the observer's beliefs in one trial (Fig. 2)."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from bayes_toe.arrays import FloatArray
from bayes_toe.model.beliefs import Gaussian, TrialView, trial_view
from bayes_toe.model.closed_form import equal_probability
from bayes_toe.plots.style import BELIEF, EQUAL, LETTERS, STRONGER_FIRST, WEAKER_FIRST, dress, panel

#: Height of the tallest curve in units of the distance between rows.
_TALL = 0.78


def filter_axes(
    s1: float,
    s2: float,
    mu1: float,
    sigma_p: float,
    sigma_l: float,
    q0: float | None = None,
    *,
    span: tuple[float, float] | None = None,
    said: str | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Beliefs of one trial from top to bottom, with the likelihood of each stimulus and the shift that decides. Source: Fig. 2.

    Violet: the belief; dotted: the belief of the row above; dashed in the colour of the order: likelihood of the stimulus (triangle).
    Heights are not to scale: they go with the root of the precision. All in natural-log intensity; with q0, P('equal') is written too;
    the panel reaches over `span`, by default :func:`filter_span`, and `said` stands in the place of z and P('equal').
    """
    view = trial_view(s1, s2, mu1, sigma_p, sigma_l)
    ax = panel(ax, high=3.4)
    colour = WEAKER_FIRST if s1 < s2 else STRONGER_FIRST if s1 > s2 else EQUAL
    rows = (
        ("prior", view.prior, None, None),
        ("posterior\nafter $s_1$", view.after_first, view.prior, s1),
        ("evolved,\nbefore $s_2$", view.evolved, view.after_first, None),
        ("posterior\nafter $s_2$", view.after_second, view.evolved, s2),
    )
    grid = _grid(
        view, s1, s2, sigma_l, filter_span(s1, s2, mu1, sigma_p, sigma_l) if span is None else span
    )
    narrowest = min(float(sd) for sd in (view.after_first.sd, view.after_second.sd))
    for base, (_, belief, before, stimulus) in zip(range(3, -1, -1), rows, strict=True):
        _draw_row(ax, base, grid, narrowest, belief, before)
        if stimulus is not None:
            noise = Gaussian(np.asarray(stimulus), np.square(np.asarray(sigma_l, np.float64)))
            _draw_stimulus(ax, base, grid, narrowest, noise, (f"$s_{1 if base else 2}$", colour))
    start, end = (
        float(view.evolved.mean),
        float(view.after_second.mean),
    )  # the shift of the mean by the second stimulus, mu_f - mu_2
    style = {
        "arrowstyle": "->",
        "lw": 1.1,
        "color": "black",
        "shrinkA": 0.0,
        "shrinkB": 0.0,
        "mutation_scale": 7.0,
    }
    ax.annotate("", (end, 0.1), (start, 0.1), arrowprops=style, zorder=5)
    ax.set_yticks([3.2, 2.2, 1.2, 0.2], [label for label, *_ in rows])
    ax.set(
        xlim=(grid[0], grid[-1]),
        ylim=(-0.16, 3.2 + _height(float(view.prior.sd), narrowest)),
        xlabel="stimulus (ln intensity)",
    )
    order = "weaker first" if s1 < s2 else "stronger first" if s1 > s2 else "equal stimuli"
    if said is None:
        chance = (
            ""
            if q0 is None
            else f", P('equal') = {float(equal_probability(s1, s2, mu1, sigma_p, sigma_l, q0)):.2f}"
        )
        said = f"$z$ = {float(view.distance):.2f}".replace("-", "−") + chance
    ax.set_title(f"{order}: {said}")
    ax.locator_params(axis="x", nbins=6)
    dress(ax).tick_params(axis="y", length=0)
    ax.spines["left"].set_visible(False)
    ax.title.set_color(colour)
    return ax


def filter_span(
    s1: float, s2: float, mu1: float, sigma_p: float, sigma_l: float
) -> tuple[float, float]:
    """How far the beliefs of one trial reach, natural-log intensity; arguments as :func:`filter_axes` has them."""
    view = trial_view(s1, s2, mu1, sigma_p, sigma_l)
    beliefs = (view.prior, view.after_first, view.evolved, view.after_second)
    low = min(
        *(float(b.mean - 2.6 * b.sd) for b in beliefs), s1 - 2.8 * sigma_l, s2 - 2.8 * sigma_l
    )
    high = max(
        *(float(b.mean + 2.6 * b.sd) for b in beliefs), s1 + 2.8 * sigma_l, s2 + 2.8 * sigma_l
    )
    return low, high


def _grid(
    view: TrialView, s1: float, s2: float, sigma_l: float, span: tuple[float, float]
) -> FloatArray:
    """Places along the panel, more of them where a curve may be narrow."""
    narrow = [(float(b.mean), float(b.sd)) for b in (view.after_first, view.after_second)] + [
        (s1, sigma_l),
        (s2, sigma_l),
    ]
    steps = np.linspace(-3.0, 3.0, 61)
    points = np.unique(
        np.concatenate([np.linspace(*span, 400), *(mean + sd * steps for mean, sd in narrow)])
    )
    return points[(points >= span[0]) & (points <= span[1])]


def _height(sd: float, narrowest: float) -> float:
    """Peak of a curve: the narrowest is the tallest, others go with the root of the precision, so that all can be seen."""
    return _TALL * float(np.sqrt(narrowest / sd))


def _draw_row(
    ax: Axes,
    base: float,
    x: FloatArray,
    narrowest: float,
    belief: Gaussian,
    before: Gaussian | None,
) -> None:
    ax.axhline(base, color="#BBBBBB", lw=0.6, zorder=0)
    y = base + _curve(x, belief, narrowest)
    ax.fill_between(x, base, y, color=BELIEF, alpha=0.18, lw=0)
    ax.plot(x, y, color=BELIEF, lw=1.3)
    ax.plot(
        [float(belief.mean)] * 2,
        [base, base + _height(float(belief.sd), narrowest)],
        color=BELIEF,
        lw=0.8,
    )
    if before is not None:
        ax.plot(x, base + _curve(x, before, narrowest), ":", color=BELIEF, lw=0.9)


def _curve(x: FloatArray, belief: Gaussian, narrowest: float) -> FloatArray:
    return np.asarray(
        belief.density(x) / belief.density(belief.mean) * _height(float(belief.sd), narrowest)
    )


def _draw_stimulus(
    ax: Axes, base: float, x: FloatArray, narrowest: float, noise: Gaussian, mark: tuple[str, str]
) -> None:
    """Likelihood of a stimulus and the stimulus itself; `mark` is its name and colour."""
    name, colour = mark
    seen = float(noise.variance) > 0
    top = base + (_height(float(noise.sd), narrowest) if seen else _TALL)
    ax.annotate(
        name,
        (float(noise.mean), top),
        (0.0, 2.5),
        textcoords="offset points",
        fontsize=LETTERS,
        color=colour,
        ha="center",
    )
    if seen:
        ax.plot(x, base + _curve(x, noise, narrowest), "--", color=colour, lw=0.9)
    ax.plot(
        float(noise.mean),
        base,
        "^",
        ms=5.5,
        color=colour,
        mec="white",
        mew=0.5,
        zorder=4,
        clip_on=False,
    )
