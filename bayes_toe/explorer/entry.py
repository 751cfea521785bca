"""What the page keeps of one subject under one model: draws, contours, curves, counts, and what to know before believing them.

Arrays are text in a page: base64 of little-endian numbers, which a browser turns into typed arrays without parsing them.
"""

from __future__ import annotations

import base64
import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
import numpy.typing as npt

from bayes_toe.arrays import FloatArray, IndexArray
from bayes_toe.classical.frequencies import laplace_error, laplace_estimate, presentation_order
from bayes_toe.data.study import Subject
from bayes_toe.data.tasks import SAME_DIFFERENT, WHICH_STRONGER, Task
from bayes_toe.inference.draws import Draws
from bayes_toe.inference.prediction import Predictor
from bayes_toe.model.observer import ObserverPosterior
from bayes_toe.model.paper_model import PaperPosterior
from bayes_toe.model.posterior import DOMINATED, RANGE, contraction
from bayes_toe.plots.corner import (
    AROUND,
    BINS,
    Density,
    Span,
    axis_values,
    known_from,
    prior_values,
    spans_of,
)
from bayes_toe.plots.style import MARKED

#: What is the same in all pairs of a slice.
FIXED = {SAME_DIFFERENT: "weaker", WHICH_STRONGER: "first"}
#: Quantities of the four models that the page opens with: PSE shift, contraction and JND.
EFFECTS = ("constant_error", "contraction", "jnd")
#: Of every curve; with straight lines between them a bell is a bell.
POINTS = 21
#: Numbers of a contour's coordinate from one end of its frame to the other; one more parts two lines.
FRAME = 65534
_BEYOND = 0.04  # of its length, by which a curve goes on after its last pair
_QUANTILES = np.linspace(0.0, 1.0, 201)


@dataclass(frozen=True, eq=False)
class Entry:
    """One choice of the page: a subject's posterior, called by its model or what else tells it from others of the subject."""

    label: str
    target: ObserverPosterior | PaperPosterior
    x: FloatArray  # draws in unconstrained coordinates, shape (chains, draws, k)
    badges: tuple[tuple[str, str], ...] = ()  # kind - unconverged, misfit, untold, fine - and words
    truth: Mapping[str, float] | None = (
        None  # known values, as given; those that the model does not have are those of another model
    )
    synthetic: bool = False
    about: str = ""

    @property
    def names(self) -> tuple[str, ...]:
        """The quantities that are shown."""
        every = self.target.names.all
        return (*self.main, *(name for name in every if name not in self.main))

    @property
    def main(self) -> tuple[str, ...]:
        """The quantities that are shown first."""
        if isinstance(self.target, ObserverPosterior):
            return tuple(name for name in EFFECTS if name in self.target.names.all)
        return self.target.names.natural

    def values_a_draw(self, most_slices: int) -> int:
        """Numbers that :meth:`packed` keeps of every draw."""
        shown = slices(self.target.subject, most_slices)
        return len(self.names) + 2 + POINTS * sum(len(one.orders) for one in shown)

    def packed(self, rows: int, most_slices: int) -> dict[str, Any]:
        """What the page holds of it: about so many draws, and so many slices of curves at most."""
        x = self.x.reshape(-1, self.x.shape[-1])
        kept = (
            np.arange(min(len(x), rows)) * len(x) // min(len(x), rows)
        )  # by the rule that explorer.js goes back by
        quantities = self.target.quantities(x)
        columns = [axis_values(name, quantities[name]) for name in self.names]
        samples = np.column_stack(columns)
        marked = np.quantile(samples, MARKED, axis=0)
        some = {name: values[kept] for name, values in quantities.items()}
        given = {
            name: value
            for name, value in (self.truth or {}).items()
            if name in self.target.names.all
        }
        known = known_from(given, self.target) if given else {}
        return {
            "subject": self.target.subject.name,
            "label": self.label,
            "synthetic": self.synthetic,
            "about": self.about,
            "badges": [*self.badges, *self._dominated(quantities)],
            "rows": len(kept),
            "of": len(x),
            "perChain": self.x.shape[1],
            "names": self.names,
            "main": self.main,
            "identified": [name for name in self.names if name in self.target.names.identified],
            "values": text_of(samples[kept].T),
            "marked": marked.T.tolist(),
            "truth": {name: float(known[name]) for name in self.names if name in known},
            **outlined(samples, spans_of(columns, self.names, self.target)),
            **self._answers(x[kept], some, most_slices),
        }

    def _dominated(self, quantities: Mapping[str, FloatArray]) -> list[tuple[str, str]]:
        """Quantities whose 5 to 95 % range is not much narrower than the prior's."""
        dominated = []
        for name in self.names:
            low, high = np.quantile(quantities[name], RANGE).tolist()
            if contraction(self.target, name, low, high) < DOMINATED:
                dominated.append(("dominated", name))
        return dominated

    def _answers(
        self, x: FloatArray, quantities: Mapping[str, FloatArray], most_slices: int
    ) -> dict[str, Any]:
        """Counts, and curves over them."""
        counts = self.target.subject
        low, high = (float(edge([counts.s1, counts.s2])) for edge in (np.min, np.max))
        pad = 0.08 * (high - low) if high > low else 0.5
        ends = [low - pad, high + pad]
        fitted = Predictor(self.target, x)
        knows_intervals = isinstance(self.target, PaperPosterior) and counts.isi is not None
        shown = slices(counts, most_slices)
        return {
            "pairs": {
                **{
                    key: getattr(counts, key).tolist()
                    for key in ("s1", "s2", "isi")
                    if getattr(counts, key) is not None
                },
                "k": counts.n_yes.tolist(),
                "n": counts.n_trials.tolist(),
                "order": presentation_order(counts).tolist(),
                "estimate": laplace_estimate(counts.n_yes, counts.n_trials).tolist(),
                "error": laplace_error(counts.n_yes, counts.n_trials).tolist(),
                "along": along(counts).tolist(),
            },
            "slices": [
                {
                    "title": one.title(len(shown) > 1),
                    "isi": one.isi,
                    "pairs": one.pairs.tolist(),
                    "x": one.x.tolist(),
                    "orders": one.orders,
                    "equal": text_of(one.yes(fitted)),
                }
                for one in shown
            ],
            "undrawn": len(_trials(counts)) - len(shown),
            "reference": getattr(self.target, "reference", None) if knows_intervals else None,
            "ends": ends,
            "axis": text_of(axis(quantities, self.target.sbar, ends)),
        }


def outlined(samples: FloatArray, spans: list[Span]) -> dict[str, Any]:
    """Spans, frames, and of every two quantities the contours that hold shares of the draws, in parts of the frames; the inner one first.

    A frame goes from the middle of one of the outermost bins of the density to that of the other.
    """
    beyond = (AROUND - 0.5) / BINS
    frames = [(low - beyond * (high - low), high + beyond * (high - low)) for low, high in spans]
    packed = [
        _contours(samples[:, [j, i]], [spans[j], spans[i]], [frames[j], frames[i]])
        for j, i in combinations(range(len(spans)), 2)
    ]
    return {"spans": spans, "frames": frames, "contours": packed}


def _contours(samples: FloatArray, spans: list[Span], frames: list[Span]) -> list[str]:
    """Of each level x and y, point after point."""
    from bokeh.plotting.contour import contour_data

    found = Density.of(*samples.T, *spans)
    lines = contour_data(
        found.x, found.y, found.values, sorted(set(found.levels)), want_fill=False, want_line=True
    ).line_data
    assert lines is not None
    (left, right), (bottom, top) = frames
    at = [
        np.stack([(xs - left) / (right - left), (ys - bottom) / (top - bottom)], axis=1)
        for xs, ys in zip(lines.xs, lines.ys, strict=True)
    ]
    return [
        text_of(np.where(np.isnan(points), FRAME + 1, np.rint(points * FRAME)), "<u2")
        for points in at[::-1]
    ]


def prior_of(entry: Entry) -> dict[str, Any] | None:
    """Quantiles of the prior of every quantity, evenly spaced in probability, and their names."""
    drawn = prior_values(entry.target)
    return quantiles({name: axis_values(name, drawn[name]) for name in entry.names})


def quantiles(drawn: Mapping[str, FloatArray]) -> dict[str, Any]:
    """Evenly spaced quantiles by name."""
    return {
        "names": list(drawn),
        "quantiles": text_of([np.quantile(values, _QUANTILES) for values in drawn.values()]),
    }


def entries_of(
    draws: Draws, label: str, subjects: tuple[str, ...], truths: Mapping[str, Mapping[str, float]]
) -> list[Entry]:
    """Subjects of a posterior file."""
    missed, made = draws.not_converged, []
    about = f"{label}: {draws.attrs.get('source', '')}, seed {draws.seed}, prior {draws.described_prior()}."
    for name in subjects:
        told, true = badges(draws, name, missed), truths.get(name)
        made.append(
            Entry(
                label,
                draws.posterior(name),
                draws.points(name),
                told,
                true,
                synthetic=draws.synthetic,
                about=about,
            )
        )
    return made


def badges(draws: Draws, name: str, missed: Mapping[str, str]) -> tuple[tuple[str, str], ...]:
    """Whether draws converged and the model describes the answers, as far as that was checked; `missed` is what did not converge."""
    fit = draws.fit(name)
    sampled = ("unconverged", missed[name]) if name in missed else ("fine", "converged")
    if np.isnan(fit.p_overall):
        return (sampled,)
    if fit.describes is None:
        return sampled, (
            "untold",
            f"fit: not testable, predictive p {_said(fit.p_overall)}",
        )
    if fit.misfit:
        return sampled, (
            "misfit",
            f"predictive p {_said(fit.p_overall)}, p of the deviance {_said(fit.p_deviance)}",
        )
    return sampled, ("fine", f"fit: good, predictive p {_said(fit.p_overall)}")


def _said(p: float) -> str:
    return f"{p:.2g}" if p >= 0.001 else "below 0.001"


# --- curves -------------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Slice:
    """Pairs with one weaker stimulus (ln), at one interval (seconds): what one panel of curves shows.

    Which of the subject's pairs these are; the stronger stimulus along the curves, shape (POINTS,); and the orders that have a curve: -1
    weaker first, 1 stronger first, 0 equal stimuli of several intensities. Of 'which is stronger' pairs with one first stimulus, s2 - s1
    along the curve, which is one, 0.
    """

    task: Task
    weaker: float
    isi: float | None
    pairs: IndexArray
    x: FloatArray
    orders: tuple[int, ...]

    def title(self, several: bool) -> str:
        """What tells it from others."""
        words = [f"{FIXED[self.task]} stimulus {self.weaker:.3g}"] if several else []
        return ", ".join(
            words + ([] if self.isi is None else [f"interval {self.isi:g} s"])
        ).replace("-", "−")

    def yes(self, fitted: Predictor) -> FloatArray:
        """P of the counted answer at every draw, shape (orders, POINTS, draws)."""
        fixed = np.full_like(self.x, self.weaker)
        presented = {-1: (fixed, self.x), 1: (self.x, fixed), 0: (self.x, self.x)}
        if self.task == WHICH_STRONGER:
            presented = {0: (fixed, fixed + self.x)}
        seconds = None if self.isi is None else np.full_like(self.x, self.isi)
        return np.stack([fitted.yes(*presented[order], seconds).T for order in self.orders])


def slices(counts: Subject, most: int) -> list[Slice]:
    """The slices with the most trials of different stimuli, at most so many, in the order of fixed stimulus and interval."""
    chosen = [key for key, _ in _trials(counts).most_common(most)]
    return [
        _slice(counts, low, isi)
        for low, isi in sorted(chosen, key=lambda key: (key[0], key[1] or 0.0))
    ]


def _trials(counts: Subject) -> Counter[tuple[float, float | None]]:
    """Trials of different stimuli by fixed stimulus and interval; without any, of all stimuli at once."""
    weaker, order = _fixed(counts), presentation_order(counts)
    seconds = [None] * counts.n_pairs if counts.isi is None else counts.isi.tolist()
    found: Counter[tuple[float, float | None]] = Counter()
    for low, isi, kind, count in zip(
        weaker.tolist(), seconds, order.tolist(), counts.n_trials.tolist(), strict=True
    ):
        if kind:
            found[low, isi] += count
    return found or Counter({(float(weaker.min()), seconds[0]): 1})


def _fixed(counts: Subject) -> FloatArray:
    """What a slice has one of: the weaker stimulus of every pair, or the first one, shape (pairs,)."""
    return counts.s1 if counts.task == WHICH_STRONGER else np.minimum(counts.s1, counts.s2)


def along(counts: Subject) -> FloatArray:
    """Where every pair stands along its slice: at its stronger stimulus, or at s2 - s1, shape (pairs,)."""
    return (
        counts.s2 - counts.s1 if counts.task == WHICH_STRONGER else np.maximum(counts.s1, counts.s2)
    )


def _slice(counts: Subject, weaker: float, isi: float | None) -> Slice:
    low, high, order = _fixed(counts), along(counts), presentation_order(counts)
    at = np.ones(counts.n_pairs, bool) if isi is None else np.asarray(counts.isi) == isi
    if counts.task == WHICH_STRONGER:
        pad = _BEYOND * max(float(np.ptp(high)), 1e-9)
        x = np.linspace(high.min() - pad, high.max() + pad, POINTS)
        return Slice(counts.task, weaker, isi, np.flatnonzero(at & (low == weaker)), x, (0,))
    shown = at & ((low == weaker) | ((order == 0) & (high >= weaker)))
    top = max(float(high[shown].max()), weaker + 1e-9)
    x = np.linspace(weaker, top + _BEYOND * (top - weaker), POINTS)
    orders = [one for one in (-1, 1) if (order[shown] == one).any()]
    several = len(np.unique(high[shown & (order == 0)])) > 1 or not orders
    return Slice(
        counts.task,
        weaker,
        isi,
        np.flatnonzero(shown),
        x,
        (*orders, 0) if several else tuple(orders),
    )


def axis(quantities: Mapping[str, FloatArray], sbar: float, ends: Sequence[float]) -> FloatArray:
    """Second stimulus that seems equal to the first, at both ends of a line: s2 = s1 - p (s1 - sbar) + c, (draws,) -> (2, draws).

    At the reference interval, where there are several.
    """
    first = np.asarray(ends)[:, None]
    none = np.zeros(len(next(iter(quantities.values()))))
    share = quantities.get("contraction", quantities.get("pull", none))
    shift = quantities.get("constant_error", quantities.get("offset", none))
    return np.asarray(first - share * (first - sbar) + shift)


# --- numbers as text ----------------------------------------------------------------------------------------------------------------


def text_of(values: npt.ArrayLike, kind: str = "<f4") -> str:
    """As float32, or as another kind, such as "<u2", unsigned integers of 16 bits.

    Examples
    --------
    >>> text_of([1.0])
    'AACAPw=='
    """
    return base64.b64encode(np.ascontiguousarray(values, kind).tobytes()).decode("ascii")


def island(content: Any) -> str:
    r"""JSON for a script element: nothing in it ends the element, whatever a subject is called.

    Examples
    --------
    >>> island({"subject": "</script>"})
    '{"subject":"\\u003c/script>"}'
    """
    return json.dumps(content, ensure_ascii=False, allow_nan=False, separators=(",", ":")).replace(
        "<", r"\u003c"
    )
