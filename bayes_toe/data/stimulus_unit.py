"""The unit of the stimuli: how screens, figures and reports show stimuli and their differences.

All stimuli are stored as natural-log intensities. A difference x of two of them is shown in
decibels if that is the unit of the stimuli, and else as 100 (e^x - 1) per cent of intensity.
Differences above 1,000 %, a factor of 11, are shown as natural logs, x, in both directions.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from bayes_toe.arrays import BoolArray, FloatArray
from bayes_toe.data.messages import join_names, plural, quoted
from bayes_toe.data.text_table import Column
from bayes_toe.errors import InputError

#: Units of logarithms, each with its natural logs.
LOG_UNITS = {
    "ln": 1.0,
    "log10": math.log(10.0),
    "dB": math.log(10.0) / 20.0,
    "dB-power": math.log(10.0) / 10.0,
    "octaves": math.log(2.0),
    "semitones": math.log(2.0) / 12.0,
    "cents": math.log(2.0) / 1200.0,
}
#: Names of logarithms, such as 'dB SPL', that no unit has.
_LOGARITHM = re.compile(
    "(db|de[cz]ibel|log|oct|halbt).*|l[ng]|st|phons?|cents?|semitones?", re.IGNORECASE
)
#: The unit to type where intensities have no known unit.
ANY_UNIT = "a.u."
#: Largest difference of the natural logs of a pair: a factor of 20. If all natural logs are whole
#: numbers, or all are above 0, it is also their largest range.
LARGEST_STEP = 3.0
#: The smallest natural log is not larger, even of intensities of many billions.
_LARGEST_LOG = 25.0
#: If all natural logs are whole numbers, the smallest of them is not larger.
_LARGEST_WHOLE_LOG = 10.0
#: Per cent of intensity beyond which differences are shown as natural logs: a factor of 11.
_SMALLEST_PERCENT = -1000.0 / 11.0
_LARGEST_PERCENT = 1000.0
#: Share of the range of the stimuli up to which two stimuli are equal: rounding may leave such a
#: difference, and nobody perceives it.
ROUNDED = 1e-6
#: Two stimuli may be near each other by chance, if neither is shown more often than this.
_BY_CHANCE = 2
#: Letters of a unit at most.
_LONGEST = 16
#: Characters with a meaning in figures and pages.
_NOT_ALLOWED = frozenset("$\\<>&")


#: Stimuli in whose unit a prior can be written.
ALLOWED_STIMULI = "0, or natural logs from 1e-99 to 1e100 in size"


def out_of_range(logs: FloatArray) -> BoolArray:
    """Whether each natural-log intensity is too large to compute with, or all are too small."""
    sizes = np.abs(logs)
    largest = np.nan_to_num(sizes).max(initial=0.0)
    return (sizes > 1e100) | ((sizes > 0.0) & (largest < 1e-99))


def percent(logs: npt.ArrayLike) -> FloatArray:
    """Differences of natural-log intensities in per cent of intensity."""
    with np.errstate(over="ignore"):
        return 100.0 * np.expm1(np.asarray(logs, float))


def why_not_logs(first: FloatArray, second: FloatArray) -> tuple[str, int | None]:
    """Why the stimuli of pairs can be no natural logs, and the index of the pair that shows it.

    The text is empty if they can be natural logs. The index is None if all pairs together show it.

    Examples
    --------
    >>> why_not_logs(np.array([-45.0, 60.0]), np.array([60.0, 45.5]))
    ('-45 and 60 in one pair, too far apart for natural logs', 0)
    >>> why_not_logs(np.array([60.0, 60.5]), np.array([60.5, 60.0]))
    ('numbers from 60 to 60.5', None)
    >>> why_not_logs(np.array([3.8, 4.1]), np.array([4.1, 3.8]))
    ('', None)
    >>> why_not_logs(np.array([-3.0, 1.0]), np.array([-1.0, 4.0]))
    ('whole numbers from -3 to 4', None)
    >>> why_not_logs(np.array([1.0, 4.0]), np.array([2.0, 7.0]))
    ('whole numbers from 1 to 7, perhaps the numbers of levels', None)
    """
    stimuli = np.concatenate([first, second])
    low = stimuli.min()
    high = stimuli.max()
    is_whole = (stimuli % 1.0 == 0.0).all()  # logarithms are seldom all whole
    if is_whole:
        kind = "whole numbers"
        largest_log = _LARGEST_WHOLE_LOG
    else:
        kind = "numbers"
        largest_log = _LARGEST_LOG

    if is_whole and low == 1.0 and high > 2.0:
        return f"{kind} from 1 to {high:g}, perhaps the numbers of levels", None
    # Logarithms of a wide range are seldom all above 0.
    is_wide = high - low > LARGEST_STEP and (is_whole or low > 0.0)
    if is_wide or low > largest_log:
        return f"{kind} from {low:g} to {high:g}", None
    steps = np.abs(second - first)
    widest = int(steps.argmax())
    if steps[widest] <= LARGEST_STEP:
        return "", None
    pair = f"{first[widest]:g} and {second[widest]:g} in one pair"
    return f"{pair}, too far apart for natural logs", widest


def log_doubts(stimuli: FloatArray) -> list[str]:
    """A doubt about natural logs that may rather be intensities; none if they are hardly any.

    Intensities are above 0 and have few decimals. Of 47 studies in natural logs that were all above
    0, none had three decimals or fewer.

    Examples
    --------
    >>> log_doubts(np.array([[0.4, 0.55], [0.55, 0.4]]))[0].partition(". ")[0]
    'stimuli such as 0.4 are read as natural logs'
    >>> log_doubts(np.array([[6.2146, 6.3099]])), log_doubts(np.array([[0.0, 0.5]]))
    ([], [])
    """
    values = stimuli[~np.isnan(stimuli)]
    if values.min() <= 0.0 or (values.round(3) != values).any():
        return []
    return [
        f"stimuli such as {values[0]:g} are read as natural logs. If they are intensities, type "
        "--unit with the name of their unit, such as --unit s; if they are natural logs, --unit ln"
    ]


def _without_rounding(pairs: FloatArray) -> FloatArray:
    """Pairs of a subject, shape (rows, 2), in which stimuli are equal if they differ by rounding.

    The stimulus that was shown most often replaces its neighbours. If every trial has stimuli of
    its own, only the two stimuli of a pair become equal.

    Examples
    --------
    >>> _without_rounding(np.array([[0.1 + 0.2, 0.3], [0.3, 0.0], [0.3, 0.0]])).tolist()
    [[0.3, 0.3], [0.3, 0.0], [0.3, 0.0]]
    """
    # `index` has the shape of the pairs.
    values, index, n_shown = np.unique(pairs, return_inverse=True, return_counts=True)
    low, high = np.quantile(pairs, (0.05, 0.95))  # without a mistyped stimulus
    limit = ROUNDED * (high - low)

    # Each value but the first, compared with the value before.
    is_repeated = np.maximum(n_shown[1:], n_shown[:-1]) > _BY_CHANCE
    is_like_previous = (np.diff(values) <= limit) & is_repeated
    group = np.concatenate([[0], np.cumsum(~is_like_previous)])  # of each value
    by_group = np.lexsort([-n_shown, group])  # the commonest value of each group is its first
    _, first_rows = np.unique(group[by_group], return_index=True)
    commonest = values[by_group][first_rows]  # of each group

    first, second = commonest[group[index]].T
    return np.column_stack([first, np.where(np.abs(second - first) <= limit, first, second)])


@dataclass(frozen=True)
class StimulusUnit:
    """A unit of stimuli.

    Parameters
    ----------
    name : str
        One of :data:`LOG_UNITS`, or the unit of raw intensities, as 'g'. Empty if it is not known.
    log_reference : float
        Natural log of the raw intensity at which the natural-log intensity is 0.
    has_log_differences : bool
        Whether differences are shown as natural logs, because they are too large for per cent.

    Raises
    ------
    InputError
        If the name is too long or has characters that are not allowed, or the reference is not
        finite.

    Examples
    --------
    >>> decibel, gram = StimulusUnit("dB"), StimulusUnit("g", np.log(10.0))
    >>> float(decibel.to_differences(np.log(2.0)).round(2)), decibel.difference_unit
    (6.02, 'dB')
    >>> gram.describe(np.log(2.0)), StimulusUnit().describe(np.log(2.0))
    ('20 g', '0.693')
    """

    name: str = ""
    log_reference: float = 0.0
    has_log_differences: bool = False

    def __post_init__(self) -> None:
        is_text = self.name.isprintable() and not _NOT_ALLOWED.intersection(self.name)
        is_unknown_log = self.name not in LOG_UNITS and _LOGARITHM.fullmatch(self.name)
        if is_unknown_log or not is_text or len(self.name) > _LONGEST or self.name == "NAME":
            raise InputError(
                f"--unit: found {quoted(self.name)}, allowed: {', '.join(LOG_UNITS)}, or a unit of "
                f"intensity of at most {_LONGEST} letters, such as g; log2 is octaves, and dB has "
                "20 dB for a factor of ten"
            )
        if not math.isfinite(self.log_reference):
            raise InputError("the reference of the unit of the stimuli is not a finite number")

    @property
    def is_decibel(self) -> bool:
        """Whether differences are decibels."""
        return self.name in ("dB", "dB-power")

    @property
    def difference_unit(self) -> str:
        """The unit of differences of stimuli."""
        if self.is_decibel:
            return "dB"
        return "ln" if self.has_log_differences else "%"

    @property
    def stimulus_unit(self) -> str:
        """The unit of stimuli; empty if they are logarithms of unknown intensities."""
        if self.is_decibel:
            return "dB"
        return "" if self.name in LOG_UNITS else self.name

    def to_differences(self, logs: npt.ArrayLike) -> FloatArray:
        """Differences of natural-log intensities in per cent, decibels or natural logs."""
        logs = np.asarray(logs, float)
        if self.is_decibel:
            return logs / LOG_UNITS[self.name]
        return logs if self.has_log_differences else percent(logs)

    def from_percent(self, values: npt.ArrayLike) -> FloatArray:
        """Differences in this unit, from differences in per cent of intensity."""
        values = np.asarray(values, float)
        if self.difference_unit == "%":
            return values
        with np.errstate(divide="ignore"):
            return self.to_differences(np.log1p(values / 100.0))

    def with_logs_if_large(self, values: npt.ArrayLike) -> StimulusUnit:
        """The unit that shows differences given in per cent: with logs if one is too large.

        Examples
        --------
        >>> unit = StimulusUnit("g")
        >>> unit.with_logs_if_large([-20.0, 30.0]).difference_unit
        '%'
        >>> unit.with_logs_if_large(2e3).difference_unit
        'ln'
        """
        values = np.asarray(values, float)
        is_small = (values >= _SMALLEST_PERCENT) & (values <= _LARGEST_PERCENT)  # NaN is not small
        return self if is_small.all() else replace(self, has_log_differences=True)

    def to_stimuli(self, logs: npt.ArrayLike) -> FloatArray:
        """Natural-log intensities in this unit, or raw where the unit of intensity is not known."""
        logs = np.asarray(logs, float)
        if self.is_decibel:
            return logs / LOG_UNITS[self.name]
        return np.exp(logs + self.log_reference)

    def to_logs(self, stimuli: npt.ArrayLike) -> FloatArray:
        """Natural-log intensities of stimuli in this unit."""
        stimuli = np.asarray(stimuli, float)
        if self.is_decibel:
            return stimuli * LOG_UNITS[self.name]
        return np.log(stimuli) - self.log_reference

    def or_percent_of(self, mean: float) -> StimulusUnit:
        """This unit; per cent of a mean natural-log intensity if the unit is not known."""
        if self.stimulus_unit:
            return self
        return StimulusUnit("%", math.log(100.0) - mean)

    def numbers(self, logs: npt.ArrayLike, mean: float) -> tuple[list[str], str]:
        """Stimuli as texts of numbers, with as many digits as distinguish them, and their unit.

        Without a unit they are per cent of a mean natural-log intensity, or natural logs.

        Examples
        --------
        >>> StimulusUnit("g").numbers(np.log([9.0, 10.5]), 2.0)
        (['9', '10.5'], 'g')
        >>> StimulusUnit().numbers([0.1, 0.3], 0.2), StimulusUnit().numbers([20.0, 0.0], 10.0)
        ((['90', '111'], '% of mean'), (['20', '0'], 'ln'))
        """
        logs = np.asarray(logs, float)
        if self.stimulus_unit:
            values = self.to_stimuli(logs)
            unit = self.stimulus_unit
            form = "g"
            fewest_digits = 4
        elif self.with_logs_if_large(percent(logs - mean)).difference_unit == "ln":
            values = logs
            unit = "ln"
            form = "g"
            fewest_digits = 3
        else:
            values = self.or_percent_of(mean).to_stimuli(logs)
            unit = "% of mean"
            form = "f"
            fewest_digits = 0

        texts = []
        for n_digits in range(fewest_digits, 15):  # more digits would show errors of rounding
            texts = [f"{value:.{n_digits}{form}}" for value in values]
            if len(set(texts)) == len(set(values.tolist())):
                break
        return texts, unit

    def describe(self, log: float) -> str:
        """A stimulus with its unit; its natural-log intensity if the unit is not known."""
        if not self.stimulus_unit:
            return f"{log:.3g}"
        return f"{float(self.to_stimuli(log)):.4g} {self.stimulus_unit}"


def merge_rounded(
    stimuli: FloatArray, subject: Column, unit: StimulusUnit
) -> tuple[FloatArray, list[str]]:
    """Pairs in which stimuli of a subject are equal if they differ by rounding only, and a note.

    `stimuli` are the pairs of all rows, shape (rows, 2); those with a NaN stay as they are. There
    is no note if no stimulus changes.
    """
    merged = stimuli.copy()
    valid_rows = np.flatnonzero(~np.isnan(stimuli).any(axis=1))
    for rows in subject.rows_by_text(valid_rows).values():
        merged[rows] = _without_rounding(stimuli[rows])

    is_changed = merged[valid_rows] != stimuli[valid_rows]
    n_changed = is_changed.any(axis=1).sum()
    if not n_changed:
        return merged, []

    changed_stimuli = np.unique(merged[valid_rows][is_changed])
    names = join_names(map(unit.describe, changed_stimuli), max_items=3)
    note = f"stimuli in {plural(n_changed, 'row')} differ by rounding only, and are read as one"
    return merged, [f"{note}: {names}"]


#: Logarithms of intensities of which nothing is known.
UNKNOWN_UNIT = StimulusUnit()
