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
    OrderEffect,
    Size,
    answer_subject,
    describe_fit,
    format_limit,
)
from bayes_toe.arrays import (
    ArrayPair,
    BoolArray,
    FloatArray,
    IndexArray,
    NamedArrays,
    Record,
    Texts,
)
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
from bayes_toe.plots.curves import pairs_with_stronger, pairs_with_weaker
from bayes_toe.plots.style import MARKED_QUANTILES, Scale, difference_scale, stimulus_scale
from bayes_toe.seeds import generator

#: Pairs of texts: the kind and the words of each badge, or questions with the words of the answer.
TextPairs = tuple[tuple[str, str], ...]
#: The names of the two tabs.
EFFECTS_TAB = "effects"
PAPER_TAB = "paper's parameters"
#: The names of the sizes of an answer by quantity. Sizes of differences are in per cent.
_SIZE_NAMES = {**SIZE_OF, "jnd": "jnd_percent", "zone": "zone_percent"}
#: Points of every curve, which the page joins by straight lines: enough for a bell to look smooth.
POINTS = 21
#: Largest number of slices of an entry. A slice is a panel of curves.
MOST_SLICES = 6
#: Smallest number of draws with an effect for which the effect is shown.
FEWEST_DRAWS = 100
#: Margin of the plane of stimuli, as a share of the range of stimuli.
_PLANE_MARGIN = 0.08
#: Margin of a curve beyond its last pair, as a share of the length of the curve.
_CURVE_MARGIN = 0.04


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
        Known true values. Values of quantities that the model does not have are ignored.
    estimates : mapping
        The 95 % intervals of tables, by quantity, if they are not computed from these draws.
        Differences are in per cent.
    is_averaged : bool
        Whether the draws come from all four models. A draw of a model without an effect has 0 for
        this effect.
    synthetic : bool
        Whether the responses are simulated.
    description : str
        Model, source, seed and prior in a sentence.
    """

    label: str
    target: ObserverPosterior | PaperPosterior
    x: FloatArray
    badges: TextPairs = ()
    words: TextPairs = ()
    truth: Mapping[str, float] = field(default_factory=dict)
    estimates: Mapping[str, Size] = field(default_factory=dict)
    is_averaged: bool = False
    synthetic: bool = False
    description: str = ""

    @property
    def tab(self) -> str:
        """The tab that shows the entry."""
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
    def names(self) -> Texts:
        """The names of all quantities, those of :attr:`main_names` first."""
        return tuple(dict.fromkeys((*self.main_names, *self.target.names.all)))

    @property
    def main_names(self) -> Texts:
        """The names of the quantities that the page shows when it opens."""
        return quantity_names(self.target, "natural")

    def columns(self) -> NamedArrays:
        """The draws of each quantity as axes show them, (draws,) each; NaN without the effect.

        An effect that too few draws have is left out.
        """
        columns = {}
        for name in self.names:
            values = self.quantities[name]
            if name in QUESTIONS:  # An effect is exactly 0 in the draws of a model without it.
                values = np.where(values == 0.0, np.nan, values)
            if _is_plottable(~np.isnan(values)):
                columns[name] = axis_values(name, values, self.unit)
        return columns

    def packed(self, most_rows: int) -> Record:
        """The entry as the page stores it, with at most `most_rows` rows, one for a draw.

        The keys are the names by which explorer.js reads the values.
        """
        draws = self.x.reshape(-1, self.x.shape[-1])  # of all chains, (draws, k)
        n_rows = min(len(draws), most_rows)
        # Equally spaced draws; explorer.js inverts this rule to name the draw of a row.
        draw_of_row = np.arange(n_rows) * len(draws) // n_rows
        return {
            "subject": visible(self.target.subject.name),
            "label": visible(self.label),
            "synthetic": self.synthetic,
            "about": visible(self.description),
            "badges": [*self.badges, *self._dominated_badges()],
            "words": self.words,
            "rows": n_rows,
            "of": len(draws),  # the number of all draws
            "perChain": self.x.shape[1],
            **self._packed_quantities(draw_of_row),
            **self._packed_responses(draws[draw_of_row], draw_of_row),
        }

    def _packed_quantities(self, draw_of_row: IndexArray) -> Record:
        """Values of each quantity in the rows; contours, intervals and spans of all draws."""
        columns = self.columns()
        # The values of each quantity in the draws that have it.
        finite_values = {name: values[~np.isnan(values)] for name, values in columns.items()}
        names = self.target.names.all
        known_values = {name: value for name, value in self.truth.items() if name in names}
        truth = all_true_values(known_values, self.target)  # with the values that follow from them
        spans = axis_limits(finite_values, self.target, truth)
        return {
            "names": list(columns),
            "main": [name for name in self.main_names if name in columns],
            "values": to_base64(np.stack(list(columns.values()))[:, draw_of_row]),  # (names, rows)
            "marked": [self._interval(name, values) for name, values in finite_values.items()],
            "with": list(map(len, finite_values.values())),  # how many draws have each quantity
            "truth": truth,
            "spans": spans,
            "contours": packed_contours(columns, spans),
            **self._packed_priors(list(columns)),
        }

    def _packed_priors(self, names: Sequence[str]) -> Record:
        """Quantiles of the prior of each quantity, and the prior probability that a draw has it.

        The page makes a density of 201 quantiles, from 0 to 100 %.
        """
        prior = prior_values(self.target)  # draws by quantity
        quantiles = []
        probabilities = []
        for name in names:
            values = np.quantile(prior[name], np.linspace(0.0, 1.0, 201))
            quantiles.append(axis_values(name, values, self.unit))
            # A single model has each quantity that it shows, so that the probability is that of
            # every model, 1. Of the four models, some lack an effect.
            has_quantity = EVERY_MODEL
            if self.is_averaged:
                has_quantity = QUESTIONS.get(name, EVERY_MODEL)
            probabilities.append(float(PRIOR_PROBABILITIES[has_quantity].sum()))
        return {"prior": to_base64(quantiles), "priorShares": probabilities}

    def _interval(self, name: str, values: FloatArray) -> list[float]:
        """Low end, median and high end of a quantity, as its axis shows them.

        They come from `estimates`, or else from `values`, its draws in the unit of the axis.
        """
        if name not in self.estimates:
            return np.quantile(values, MARKED_QUANTILES).tolist()
        interval = np.asarray(self.estimates[name])
        # The estimates are those of tables. They are per cents for differences, and have the unit
        # of the model for any other quantity.
        if QUANTITY_BY_NAME[name].display == "difference":
            return self.unit.from_percent(interval).tolist()
        return axis_values(name, interval, self.unit).tolist()

    def _dominated_badges(self) -> list[tuple[str, str]]:
        """Badges of the quantities that the prior determines, such as ('dominated', 'mu1').

        The range of such a quantity from 5 to 95 % is not much narrower than under the prior.
        """
        if self.is_averaged:  # Several models have several priors.
            return []
        dominated_badges = []
        for name in self.names:
            low, high = np.quantile(self.quantities[name], RANGE).tolist()
            if posterior_contraction(self.target, name, low, high) < DOMINATED:
                dominated_badges.append(("dominated", name))
        return dominated_badges

    def _packed_responses(self, x: FloatArray, draw_of_row: IndexArray) -> Record:
        """Pairs with their counts, curves over them, and the line of stimuli that seem equal.

        `x` has the draws of the rows, shape (rows, k), and `draw_of_row` their numbers among all
        draws. The keys are the names by which explorer.js reads the values.
        """
        subject = self.target.subject
        low = float(subject.stimuli.min())
        high = float(subject.stimuli.max())
        pad = _PLANE_MARGIN * (high - low)
        ends = [low - pad, high + pad]
        # Only a scale in per cent of the mean needs the mean. The page has natural logs in place of
        # such a scale.
        plane_scale = stimulus_scale("first stimulus", subject.unit, mean=0.0, limits=ends)

        fitted = Predictor(self.target, x)
        slices = []
        stimuli_of_slices, n_slices = _selected_slices(subject)
        for stimulus in stimuli_of_slices:
            slices.append(pack_slice(fitted, stimulus, has_title=n_slices > 1))

        return {
            "pairs": _packed_pairs(subject),
            "plane": _packed_scale(plane_scale, subject.unit, ends),
            "slices": slices,
            "undrawn": n_slices - len(slices),
            "ends": ends,
            "axis": to_base64(self._equal_stimuli(ends)[:, draw_of_row]),  # (2, rows)
        }

    def _equal_stimuli(self, ends: Sequence[float]) -> FloatArray:
        """The second stimulus that seems equal to each of two first stimuli, shape (2, draws).

        `ends` has the first stimuli. The page draws the line between the two pairs:
        s2 = s1 - contraction * (s1 - mean) + constant_error.
        """
        quantities = self.quantities
        first_stimuli = np.array(ends)[:, None]  # (2, 1)
        zeros = np.zeros_like(quantities["jnd"])  # for a model without the effect
        # The paper's model has 'pull' and 'offset' in place of contraction and constant error.
        contraction = quantities.get("contraction", quantities.get("pull", zeros))
        constant_error = quantities.get("constant_error", quantities.get("offset", zeros))
        return first_stimuli - contraction * (first_stimuli - self.target.sbar) + constant_error


def _is_plottable(is_present: BoolArray) -> bool:
    """Whether enough draws have an effect to show it.

    That is at least FEWEST_DRAWS draws, or all draws if there are fewer than that.
    """
    return bool(is_present.sum() >= min(FEWEST_DRAWS, len(is_present)))


def packed_contours(columns: NamedArrays, spans: Sequence[Span]) -> list[list[str]]:
    """The contours of every two quantities, each contour a text, the innermost contour first.

    `columns` has the draws of each quantity, (draws,) each, and `spans` the limits of its axis, as
    axes show them. A contour has its x, then its y, with NaN between two lines. Two quantities have
    no contours if few draws have both.
    """
    from bokeh.plotting.contour import contour_data

    packed = []
    for (x, x_span), (y, y_span) in combinations(zip(columns.values(), spans, strict=True), 2):
        is_present = ~np.isnan(x + y)  # Both quantities are numbers in the draw.
        contours: list[str] = []
        if _is_plottable(is_present):
            # Middles of bins across and upward, counts, and levels of contours.
            grid = contour_grid(x[is_present], y[is_present], x_span, y_span)
            lines = contour_data(*grid, want_fill=False).line_data
            assert lines is not None
            for points in zip(lines.xs, lines.ys, strict=True):
                contours.insert(0, to_base64(points))  # Bokeh has the outermost one first.
        packed.append(contours)
    return packed


def entries_of(draws: Draws, label: str, subjects: Texts, truths: Truth) -> list[Entry]:
    """The entries of subjects in a file of draws; `label` names the model on the page.

    `truths` has the known true values by subject. If the draws are of the paper's model, each
    subject also has an entry with the average of the four models.
    """
    reasons = draws.not_interpreted  # by subject, the reason why it is not interpreted
    entries = []
    for name in subjects:
        answer, _ = answer_subject(draws.subject(name), draws.seed, draws.prior.observer)
        answer = answer.in_study(len(draws.names))
        if name in reasons:
            words: TextPairs = (("not interpreted:", reasons[name]),)
        else:
            words = tuple((line.question, line.word) for line in answer.lines.values())

        entry = Entry(
            label,
            target=draws.posterior(name),
            x=draws.points(name),
            badges=badges(draws, name),
            words=words,
            truth=truths.get(name, {}),
            synthetic=draws.synthetic,
            description=f"{label}: {draws.study.source}, seed {draws.seed}, prior "
            f"{draws.described_prior()}.",
        )
        entries.append(entry)
        if entry.tab == PAPER_TAB:
            entries.append(_averaged_entry(entry, answer, draws))
    return entries


def _averaged_entry(entry: Entry, answer: OrderEffect, draws: Draws) -> Entry:
    """The entry of the four models averaged, made from the entry of the paper's model.

    `answer` is the answer of the subject, and `draws` are those of the paper's model.
    """
    subject = entry.target.subject
    prior = draws.prior.observer
    # More draws than an answer needs, because the page shows them. The list has one result.
    (evidence,) = order_evidence([subject], draws.seed, prior, Precision(effective_draws=3000.0))
    average = evidence.averaged()
    # The page takes draws of equal weight, here as one chain, as long as a file has by default.
    points = average.resampled(generator(draws.seed, subject.name, "explorer"), size=4000)

    # The flag of a misfit is left out, because the badge of the fit says the same.
    flags = [("untold", flag) for flag in answer.flags if flag != MISFIT_FLAG]
    sizes = answer.sizes
    label = entry.label.replace(model_title(draws.model), "four models averaged")
    return replace(
        entry,
        label=label,
        target=average.posterior,
        x=points[None],  # (1, draws, k)
        badges=(_fit_badge(answer.fit_p, answer.n_subjects), *flags),
        estimates={name: sizes[size] for name, size in _SIZE_NAMES.items() if size in sizes},
        is_averaged=True,
        description=f"{label} by their posterior probabilities: {draws.study.source}, "
        f"seed {draws.seed}, prior {prior.describe(subject.task)}. Draws are resampled by their "
        "weights.",
    )


def badges(draws: Draws, name: str) -> TextPairs:
    """Badges, kind and words each: whether the draws of a subject converged, and the model fits."""
    shortfall = draws.not_converged.get(name)
    convergence = ("unconverged", shortfall) if shortfall else ("fine", "converged")

    # The p-value is NaN if the pairs determine about as many parameters as there are pairs.
    fit_p = draws.fit(name).fit_p
    return convergence, _fit_badge(None if np.isnan(fit_p) else fit_p, len(draws.names))


def _fit_badge(fit_p: float | None, n_subjects: int) -> tuple[str, str]:
    """Kind and text of the badge of the fit; `fit_p` is None if the fit is not testable."""
    description = f"fit: {describe_fit(fit_p, n_subjects)}"
    if fit_p is None:
        return "untold", description
    if fit_p < flag_limit(n_subjects):
        # The page writes 'the model does not fit: ' before it.
        return "misfit", format_limit(fit_p, n_subjects)
    return "fine", description


# --- pairs and curves -----------------------------------------------------------------------------


def _packed_pairs(subject: Subject) -> Record:
    """Stimuli, counts and shares of every pair; the keys are the names that explorer.js reads."""
    _, position = slice_and_position(subject)  # of each pair on the axis of its slice
    describe = subject.unit.describe
    texts = [f"{describe(s1)}, {describe(s2)}" for s1, s2 in subject.pairs]
    return {
        "s1": subject.s1.tolist(),
        "s2": subject.s2.tolist(),
        "k": subject.n_yes.tolist(),
        "n": subject.n_trials.tolist(),
        "order": presentation_order(subject).tolist(),
        "estimate": laplace_estimate(subject.n_yes, subject.n_trials).tolist(),
        "error": laplace_error(subject.n_yes, subject.n_trials).tolist(),
        "along": position.tolist(),
        "stimuli": [text.replace("-", "−") for text in texts],
    }


def pack_slice(fitted: Predictor, stimulus: float, *, has_title: bool) -> Record:
    """Pack a slice: the pairs that share a stimulus, and the curves of one panel over them.

    There is a curve for each order: -1 weaker first, 1 stronger first, 0 equal stimuli of several
    intensities. 'Which is stronger' has one curve, which is stored as order 0.

    Parameters
    ----------
    fitted : Predictor
    stimulus : float
        The weaker stimulus of the pairs (ln), or their first stimulus in 'which is stronger'.
    has_title : bool
        Whether `stimulus` stands above the panel.
    """
    subject = fitted.target.subject
    unit = subject.unit
    stimulus_of_pair, position = slice_and_position(subject)  # (pairs,) each
    if subject.task == WHICH_STRONGER:
        # The position is s2 - s1. All panels show the same range of positions.
        is_member = stimulus_of_pair == stimulus
        low = float(position.min() - _CURVE_MARGIN * np.ptp(position))
        x = _curve_positions(low, float(position.max()))  # (POINTS,)
        ends = [low, float(x[-1])]
        scale = difference_scale(unit, ends)
        pairs_by_order = {0: (np.full_like(x, stimulus), stimulus + x)}
    else:
        # The position is the stronger stimulus. Curves start at the weaker stimulus. The panel of
        # the weakest stimulus also has the pairs of equal stimuli below it.
        is_member = pairs_with_weaker(subject, stimulus)
        position = position[is_member]
        x = _curve_positions(stimulus, float(position.max()))  # (POINTS,)
        ends = [min(stimulus, float(position.min())), float(x[-1])]
        # Like the scale of the plane, this scale does not need the mean.
        scale = stimulus_scale("stronger stimulus", unit, mean=0.0, limits=ends)

        order = presentation_order(subject)[is_member]
        orders = [sign for sign in (-1, 1) if sign in order]
        # The other curves begin at a single pair of equal stimuli, which needs no curve of its own.
        if (order == 0).sum() > 1:
            orders.append(0)
        all_pairs = pairs_with_stronger(stimulus, x)
        pairs_by_order = {sign: all_pairs[sign] for sign in orders}

    # P of the counted answer along the curve of each order, (orders, POINTS, rows).
    curves = np.stack([fitted.yes(*pairs).T for pairs in pairs_by_order.values()])
    title = f"{subject.task.slice_stimulus} stimulus {unit.describe(stimulus)}".replace("-", "−")
    # The keys are the names by which explorer.js reads the values.
    return {
        "title": title if has_title else "",
        "pairs": np.flatnonzero(is_member).tolist(),
        "low": ends[0],
        "x": x.tolist(),
        "scale": _packed_scale(scale, unit, ends),
        "orders": list(pairs_by_order),
        # Probabilities as whole numbers of 16 bits, which the page divides by the largest one.
        "yes": to_base64(np.rint(curves * 65535), kind="<u2"),
    }


def _curve_positions(start: float, end: float) -> FloatArray:
    """Positions along a curve from `start` to beyond `end`, the position of the last pair.

    If all pairs have one position, the curve has a length near 0.
    """
    return np.linspace(start, end + _CURVE_MARGIN * max(end - start, 1e-9), POINTS)


def _packed_scale(scale: Scale, unit: StimulusUnit, ends: Sequence[float]) -> Record | None:
    """Label and ticks of a scale between two ends; None for natural logs, which the page labels.

    Stimuli without a unit are natural logs on the page, although other figures have per cents.
    """
    if scale.unit is None or not unit.stimulus_unit:
        return None
    positions, texts = scale.ticks(*ends)
    return {"label": scale.label, "at": positions.tolist(), "texts": texts}


def slice_and_position(subject: Subject) -> ArrayPair:
    """The slice of each pair, and the position of the pair in its slice, (pairs,) each.

    A slice is all pairs with one stimulus: the weaker stimulus, and the position is the stronger
    one. In 'which is stronger' it is the first stimulus, and the position is s2 - s1.
    """
    if subject.task == WHICH_STRONGER:
        return subject.s1, subject.s2 - subject.s1
    return np.minimum(subject.s1, subject.s2), np.maximum(subject.s1, subject.s2)


def _selected_slices(subject: Subject) -> tuple[list[float], int]:
    """The stimuli of the slices with the most trials, ascending; the number of all slices.

    A slice without trials of different stimuli does not count.
    """
    stimulus_of_pair, _ = slice_and_position(subject)
    # `slice_of_pair` has the number of the slice of each pair, (pairs,).
    stimuli, slice_of_pair = np.unique(stimulus_of_pair, return_inverse=True)
    n_different = subject.n_trials * (subject.s1 != subject.s2)
    n_trials = np.bincount(slice_of_pair, weights=n_different)  # (slices,)
    n_slices = int(np.count_nonzero(n_trials))
    most_trials_first = np.argsort(-n_trials, kind="stable")
    selected_stimuli = stimuli[most_trials_first][: min(MOST_SLICES, n_slices)]
    return np.sort(selected_stimuli).tolist(), n_slices


# --- numbers as text ------------------------------------------------------------------------------


def to_base64(values: npt.ArrayLike, kind: str = "<f4") -> str:
    """An array as text: float32 or another kind, such as "<u2", unsigned integers of 16 bits.

    Examples
    --------
    >>> to_base64([1.0])
    'AACAPw=='
    """
    return base64.b64encode(np.ascontiguousarray(values, kind).tobytes()).decode("ascii")


def json_for_script(content: Any) -> str:
    r"""JSON for a script element: nothing in it ends the element, whatever a subject is called.

    Examples
    --------
    >>> json_for_script({"subject": "</script>"})
    '{"subject":"\\u003c/script>"}'
    """
    text = json.dumps(content, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return text.replace("<", r"\u003c")
