"""The data of one subject under one model in the page of the explorer.

`entries_of` makes an `Entry` for each subject and model of a file of draws. `Entry.packed` has its
draws, contours, curves, counts and answer for JSON. An array is a text there: base64 of
little-endian numbers, of which the browser makes a typed array.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations
from typing import Any

import numpy as np
import numpy.typing as npt

from bayes_toe.answers.order_effect import (
    MISFIT_FLAG,
    QUESTIONS,
    SIZE_OF,
    Size,
    answer_subject,
    describe_fit,
)
from bayes_toe.arrays import ArrayPair, BoolArray, FloatArray, IndexArray, NamedArrays, Record
from bayes_toe.checks.alarm_rate import flag_limit
from bayes_toe.classical.frequencies import laplace_error, laplace_estimate, presentation_order
from bayes_toe.data.messages import visible
from bayes_toe.data.read_study import Truth
from bayes_toe.data.stimulus_unit import StimulusUnit
from bayes_toe.data.study import Subject
from bayes_toe.data.tasks import WHICH_STRONGER
from bayes_toe.inference.draws import Draws
from bayes_toe.inference.engine import Precision
from bayes_toe.inference.order_evidence import (
    EVERY_MODEL,
    PRIOR_PROBABILITIES,
    order_evidence,
)
from bayes_toe.inference.prediction import Predictor
from bayes_toe.model.models import ObserverPosterior, model_title
from bayes_toe.model.paper_model import PaperPosterior
from bayes_toe.model.parameters import QUANTITY_BY_NAME
from bayes_toe.model.posterior import DOMINATED, RANGE, posterior_contraction
from bayes_toe.plots.corner import (
    Span,
    all_true_values,
    axis_limits,
    axis_values,
    contour_grid,
    prior_values,
    quantity_names,
)
from bayes_toe.plots.curves import pairs_with_weaker
from bayes_toe.plots.style import MARKED, Scale, difference_scale, stimulus_scale
from bayes_toe.seeds import generator

#: Of badges the kind and the words, of questions the words of the answer.
Pairs = tuple[tuple[str, str], ...]
#: What the two tabs are called.
EFFECTS_TAB, PAPER_TAB = "effects", "paper's parameters"
#: Sizes of the answer by quantity; differences are in per cent.
_SIZES = {**SIZE_OF, "jnd": "jnd_percent", "zone": "zone_percent"}
#: Of every curve; with straight lines between them a bell is a bell.
POINTS = 21


@dataclass(frozen=True, eq=False)
class Entry:
    """One posterior of one subject.

    Attributes
    ----------
    label : str
        The model, or what else distinguishes it from other posteriors of the subject.
    target : ObserverPosterior or PaperPosterior
    x : ndarray, shape (chains, draws, k)
        Draws in unconstrained coordinates.
    badges : tuple
        Kind (unconverged, misfit, untold, fine) and words of each.
    words : tuple
        Questions with the words of the answer.
    truth : mapping, optional
        Known values; those that the model does not have are ignored.
    estimates : mapping
        By quantity the interval that tables have, where it is not of these draws.
    is_averaged : bool
        Whether the draws are averaged over the four models; an effect that a draw lacks is 0.
    synthetic : bool
        Whether the responses are simulated.
    description : str
        Model, source, seed and prior in a sentence.
    """

    label: str
    target: ObserverPosterior | PaperPosterior
    x: FloatArray
    badges: Pairs = ()
    words: Pairs = ()
    truth: Mapping[str, float] = field(default_factory=dict)
    estimates: Mapping[str, Size] = field(default_factory=dict)
    is_averaged: bool = False
    synthetic: bool = False
    description: str = ""

    @property
    def tab(self) -> str:
        """The tab in which it is shown."""
        return PAPER_TAB if isinstance(self.target, PaperPosterior) else EFFECTS_TAB

    @property
    def unit(self) -> StimulusUnit:
        """The unit of the stimuli."""
        return self.target.subject.unit

    @cached_property
    def quantities(self) -> NamedArrays:
        """All quantities of the draws, (draws,) each."""
        return self.target.quantities(self.x.reshape(-1, self.x.shape[-1]))

    @property
    def names(self) -> tuple[str, ...]:
        """All quantities, those that are shown first at the front."""
        return tuple(dict.fromkeys((*self.main, *self.target.names.all)))

    @property
    def main(self) -> tuple[str, ...]:
        """The quantities that are shown first."""
        return quantity_names(self.target, "natural")

    def columns(self) -> dict[str, FloatArray]:
        """The draws as axes show them, (draws,) each; NaN where a draw lacks the effect."""
        columns = {}
        for name in self.names:
            values = self.quantities[name]
            if name in QUESTIONS:
                values = np.where(values == 0.0, np.nan, values)
            if _is_plottable(~np.isnan(values)):
                columns[name] = axis_values(name, values, self.unit)
        return columns

    def packed(self, rows: int) -> Record:
        """The entry as the page stores it, with about so many draws."""
        draws = self.x.reshape(-1, self.x.shape[-1])
        n_rows = min(len(draws), rows)
        index = np.arange(n_rows) * len(draws) // n_rows  # explorer.js inverts this rule

        columns = self.columns()
        present = {name: values[~np.isnan(values)] for name, values in columns.items()}
        names = self.target.names.all
        truth = {name: value for name, value in self.truth.items() if name in names}
        truth = all_true_values(truth, self.target)
        spans = axis_limits(present.values(), list(columns), self.target, truth)

        prior, quantiles, shares = prior_values(self.target), [], []
        for name in columns:
            values = np.quantile(prior[name], np.linspace(0.0, 1.0, 201))
            quantiles.append(axis_values(name, values, self.unit))
            # The models of the draws that have the quantity.
            has_quantity = QUESTIONS.get(name, EVERY_MODEL) if self.is_averaged else EVERY_MODEL
            shares.append(float(PRIOR_PROBABILITIES[has_quantity].sum()))

        return {
            "subject": visible(self.target.subject.name),
            "label": visible(self.label),
            "synthetic": self.synthetic,
            "about": visible(self.description),
            "badges": [*self.badges, *self._dominated()],
            "words": self.words,
            "rows": n_rows,
            "of": len(draws),
            "perChain": self.x.shape[1],
            "names": list(columns),
            "main": [name for name in self.main if name in columns],
            "values": text_of(np.stack(list(columns.values()))[:, index]),
            "marked": [*map(self._interval, present, present.values())],
            "with": [*map(len, present.values())],
            "truth": truth,
            "spans": spans,
            "contours": outlined(columns, spans),
            "prior": text_of(quantiles),
            "priorShares": shares,
            **self._responses(draws[index], index),
        }

    def _interval(self, name: str, values: FloatArray) -> list[float]:
        """Median and ends of the interval of a quantity: those of the tables, or of the draws."""
        if name not in self.estimates:
            return np.quantile(values, MARKED).tolist()
        interval = np.asarray(self.estimates[name])
        if QUANTITY_BY_NAME[name].display == "difference":
            return self.unit.from_percent(interval).tolist()
        return axis_values(name, interval, self.unit).tolist()

    def _dominated(self) -> list[tuple[str, str]]:
        """Quantities whose 5 to 95 % range is not much narrower than the prior's."""
        if self.is_averaged:
            return []
        dominated = []
        for name in self.names:
            low, high = np.quantile(self.quantities[name], RANGE).tolist()
            if posterior_contraction(self.target, name, low, high) < DOMINATED:
                dominated.append(("dominated", name))
        return dominated

    def _responses(self, x: FloatArray, index: IndexArray) -> Record:
        """Counts, and curves over them at the draws x with this index."""
        counts, target = self.target.subject, self.target
        shared, position = along(counts)
        low, high = float(counts.stimuli.min()), float(counts.stimuli.max())
        pad = 0.08 * (high - low) or 0.5
        ends = [low - pad, high + pad]

        pairs = {
            "s1": counts.s1,
            "s2": counts.s2,
            "k": counts.n_yes,
            "n": counts.n_trials,
            "order": presentation_order(counts),
            "estimate": laplace_estimate(counts.n_yes, counts.n_trials),
            "error": laplace_error(counts.n_yes, counts.n_trials),
            "along": position,
        }

        stimuli = [", ".join(map(counts.unit.describe, pair)) for pair in counts.pairs]
        plane = None
        if counts.unit.of_stimuli:
            plane = _packed_scale(stimulus_scale("first stimulus", counts.unit, 0.0, ends), ends)

        # A slice without trials of different stimuli is left out, unless all slices are.
        keys, index_of_key = np.unique(shared, return_inverse=True)
        n_trials = np.bincount(index_of_key, counts.n_trials * (counts.s1 != counts.s2))
        n_slices = max(1, int(np.count_nonzero(n_trials)))
        # The six slices with the most trials, in the order of the fixed stimulus.
        most_first = np.argsort(-n_trials, kind="stable")
        shown_keys = np.sort(keys[most_first][: min(6, n_slices)]).tolist()
        fitted = Predictor(target, x)

        # The second stimulus that seems equal to the first, at both ends of a line.
        quantities, first = self.quantities, np.array(ends)[:, None]
        none = np.zeros_like(quantities["jnd"])
        share = quantities.get("contraction", quantities.get("pull", none))
        shift = quantities.get("constant_error", quantities.get("offset", none))
        equal = first - share * (first - target.sbar) + shift

        return {
            "pairs": {
                **{key: values.tolist() for key, values in pairs.items()},
                "stimuli": [text.replace("-", "−") for text in stimuli],
            },
            "plane": plane,
            "slices": [pack_slice(fitted, key, has_title=n_slices > 1) for key in shown_keys],
            "undrawn": n_slices - len(shown_keys),
            "ends": ends,
            "axis": text_of(equal[:, index]),
        }


def _is_plottable(is_present: BoolArray) -> bool:
    """Whether enough draws have an effect to show it."""
    return bool(is_present.sum() >= min(100, len(is_present)))


def outlined(columns: NamedArrays, spans: Sequence[Span]) -> list[list[str]]:
    """Contours that hold shares of the draws, of every two quantities; the inner one first.

    Each has its x, then its y, with NaN between two lines. There are none where few draws have
    both quantities.
    """
    from bokeh.plotting.contour import contour_data

    packed = list[list[str]]()
    for (x, across), (y, up) in combinations(zip(columns.values(), spans, strict=True), 2):
        is_present = ~np.isnan(x + y)
        packed.append([])
        if _is_plottable(is_present):
            grid = contour_grid(x[is_present], y[is_present], across, up)
            lines = contour_data(*grid, want_fill=False).line_data
            assert lines is not None
            for points in zip(lines.xs[::-1], lines.ys[::-1], strict=True):
                packed[-1].append(text_of(points))
    return packed


def entries_of(draws: Draws, label: str, subjects: tuple[str, ...], truths: Truth) -> list[Entry]:
    """The entries of subjects in a file of draws.

    If the draws are of the paper's model, each subject also has an entry with the average of the
    four models.
    """
    refused = draws.not_interpreted
    source = f"{draws.study.source}, seed {draws.seed}"
    average_label = label.replace(model_title(draws.model), "four models averaged")
    prior = draws.prior.observer
    entries = []
    for name in subjects:
        subject = draws.subject(name)
        answer, _ = answer_subject(subject, draws.seed, prior)
        answer = answer.in_study(len(draws.names))
        words = tuple((line.question, line.word) for line in answer.lines.values())
        if name in refused:
            words = (("not interpreted:", refused[name]),)

        entry = Entry(
            label,
            draws.posterior(name),
            draws.points(name),
            badges(draws, name),
            words,
            truths.get(name, {}),
            synthetic=draws.synthetic,
            description=f"{label}: {source}, prior {draws.described_prior()}.",
        )

        entries.append(entry)
        if entry.tab == EFFECTS_TAB:
            continue

        (evidence,) = order_evidence(
            [subject], draws.seed, prior, Precision(effective_draws=3000.0)
        )
        average = evidence.averaged()
        flags = [("untold", flag) for flag in answer.flags if flag != MISFIT_FLAG]
        sizes = answer.sizes
        estimates = {name: sizes[size] for name, size in _SIZES.items() if size in sizes}
        points = average.resampled(generator(draws.seed, name, "explorer"), 4000)
        averaged = replace(
            entry,
            label=average_label,
            target=average.posterior,
            x=points[None],
            badges=(_fit_badge(answer.fit_p, answer.n_subjects), *flags),
            estimates=estimates,
            is_averaged=True,
            description=f"{average_label} by their posterior probabilities: {source}, prior "
            f"{prior.describe(subject.task)}. Draws are resampled by their weights.",
        )
        entries.append(averaged)
    return entries


def badges(draws: Draws, name: str) -> Pairs:
    """Whether the draws converged and the model fits."""
    fit = draws.fit(name)
    shortfall = draws.not_converged.get(name)
    sampled = ("unconverged", shortfall) if shortfall else ("fine", "converged")
    is_testable = fit.degrees_of_freedom > 0
    if is_testable and np.isnan(fit.fit_p):
        return (sampled,)
    return sampled, _fit_badge(fit.fit_p if is_testable else None, len(draws.names))


def _fit_badge(fit_p: float | None, n_subjects: int) -> tuple[str, str]:
    text = describe_fit(fit_p, n_subjects)
    if fit_p is None:
        return "untold", f"fit: {text}"
    if fit_p < flag_limit(n_subjects):
        return "misfit", text.removeprefix("poor, ")
    return "fine", f"fit: {text}"


# --- curves ---------------------------------------------------------------------------------------


def pack_slice(fitted: Predictor, fixed: float, *, has_title: bool) -> Record:
    """Pairs with one fixed stimulus (ln), and curves over them, as the page stores them.

    One panel of curves shows them. There is a curve for each order: -1 weaker first, 1 stronger
    first, 0 equal stimuli of several intensities, and the only curve of 'which is stronger'.

    Parameters
    ----------
    fitted : Predictor
    fixed : float
        The weaker stimulus of the pairs, or the first one in 'which is stronger'.
    has_title : bool
        Whether the fixed stimulus stands above the panel.
    """
    counts = fitted.target.subject
    unit, is_by_first = counts.unit, counts.task == WHICH_STRONGER
    shared, position = along(counts)
    if is_by_first:
        is_member, orders = shared == fixed, [0]
        start, end = float(position.min() - 0.04 * np.ptp(position)), float(position.max())
        low = start
    else:
        is_member = pairs_with_weaker(counts, fixed)
        position, order = position[is_member], presentation_order(counts)[is_member]
        orders = [sign for sign in (-1, 1) if sign in order]
        if (order == 0).sum() > 1 or not orders:
            orders.append(0)
        start, end = fixed, float(position.max())
        low = min(fixed, float(position.min()))

    # A curve goes on beyond its last pair.
    x = np.linspace(start, end + 0.04 * max(end - start, 1e-9), POINTS)
    ends = [low, float(x[-1])]
    same = np.full_like(x, fixed)
    presented = {-1: (same, x), 1: (x, same), 0: (x, x)}
    scale = stimulus_scale("stronger stimulus", unit, 0.0, ends)
    if is_by_first:
        presented[0] = same, same + x
        scale = difference_scale(unit, ends)
    curves = np.stack([fitted.yes(*presented[sign]).T for sign in orders])

    title = f"{counts.task.slice_stimulus} stimulus {unit.describe(fixed)}".replace("-", "−")
    return {
        "title": title if has_title else "",
        "pairs": np.flatnonzero(is_member).tolist(),
        "low": low,
        "x": x.tolist(),
        "scale": _packed_scale(scale, ends) if unit.of_stimuli else None,
        "orders": orders,
        "yes": text_of(np.rint(curves * 65535), "<u2"),
    }


def _packed_scale(scale: Scale, ends: Sequence[float]) -> Record | None:
    """A scale as the page stores it; none for natural logs."""
    if scale.unit is None:
        return None
    positions, texts = scale.ticks(*ends)
    return {"label": scale.label, "at": positions.tolist(), "texts": texts}


def along(counts: Subject) -> ArrayPair:
    """The stimulus that a pair shares with its slice, and its position there, shape (pairs,) each.

    These are the weaker and the stronger stimulus, or the first one and s2 - s1 in 'which is
    stronger'.
    """
    if counts.task == WHICH_STRONGER:
        return counts.s1, counts.s2 - counts.s1
    return np.minimum(counts.s1, counts.s2), np.maximum(counts.s1, counts.s2)


# --- numbers as text ------------------------------------------------------------------------------


def text_of(values: npt.ArrayLike, kind: str = "<f4") -> str:
    """An array as text: float32 or another kind, such as "<u2", unsigned integers of 16 bits.

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
    text = json.dumps(content, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return text.replace("<", r"\u003c")
