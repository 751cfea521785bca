"""Probable mistakes in a file, and what its design cannot show.

`check` gives all findings of a study. `check_design` gives those that do not use the responses: raw
stimuli, missing decimal points, similar names, ignored columns, pairs in one order, conditions that
differ in time or stimuli. `urgent_findings` gives those that every command prints.
"""

from __future__ import annotations

import math
import unicodedata
from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from itertools import compress

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.checks.answer_checks import Finding, Findings, check_answers
from bayes_toe.checks.identification import CRITERION_NOTES, identify
from bayes_toe.data.answers import Reading
from bayes_toe.data.messages import (
    capitalized,
    cli_argument,
    display_name,
    join_display_names,
    join_names,
    join_words,
    plural,
)
from bayes_toe.data.stimulus_unit import StimulusUnit, why_not_logs
from bayes_toe.data.study import Study, Subject, require_study, units_by_subject
from bayes_toe.data.units import follows_from_pairs
from bayes_toe.data.validation import number
from bayes_toe.errors import Remedy

#: The subject of a finding about the whole study.
_WHOLE_STUDY = ""
#: Codes of findings that are no warnings.
NOTES = frozenset({"columns_ignored", "criterion"})


def check(study: Study) -> tuple[Finding, ...]:
    """Find out what the design of a study can identify, and problems in file and responses.

    Parameters
    ----------
    study : Study

    Returns
    -------
    tuple of Finding
        Those about the whole study first, then those about subjects.

    Examples
    --------
    >>> study = Study([Subject("S01", [20, 80], [80, 20], [90, 20], [99, 99])])
    >>> [finding.code for finding in check(study)]
    ['raw_stimuli', 'not_identified', 'two_scales']
    """
    require_study(study)
    findings = (*check_design(study), *check_answers(study))
    # Findings about the whole study come first, as False comes before True.
    return tuple(sorted(findings, key=lambda finding: finding.subject != _WHOLE_STUDY))


def check_design(study: Study) -> tuple[Finding, ...]:
    """The findings of :func:`check` that do not use the responses."""
    findings = list(urgent_findings(study))
    findings += _similar_names(study.names)
    findings += _conditions(study)
    findings += _columns(study.reading)
    findings += identification_findings(study)
    if study.task in CRITERION_NOTES:
        findings.append(
            Finding(_WHOLE_STUDY, "criterion", f"{capitalized(CRITERION_NOTES[study.task])}.")
        )
    for subject in study:
        findings += _one_order(subject)
    return tuple(findings)


def urgent_findings(study: Study) -> tuple[Finding, ...]:
    """Probable mistakes, which every command prints before its work."""
    findings = [
        Finding(_WHOLE_STUDY, "repeated_rows", f"{doubt}.") for doubt in study.reading.doubts
    ]
    findings += _raw_stimuli(study)
    findings += _two_scales(study)
    findings += _scales_of_subjects(study)
    return tuple(findings)


# --- The file ------------------------------------------------------------------------------------


def _raw_stimuli(study: Study) -> Findings:
    """Stimuli that look like intensities but are taken as natural logs.

    A file of them is refused when it is read; this is for studies that are made in Python.
    """
    # A unit, or the column i1 of intensities, says what the stimuli are.
    if study.unit.name or "i1" in study.reading.read:
        return
    pairs = np.concatenate([subject.pairs for subject in study])
    reason, _ = why_not_logs(*pairs.T)
    if reason:
        yield Finding(
            _WHOLE_STUDY,
            "raw_stimuli",
            f"Stimuli look like raw intensities ({reason}), but are taken as natural logs. Take "
            "their logarithms, or the unit 'ln' if they are logs.",
        )


def _two_scales(study: Study) -> Findings:
    """Stimuli in two groups that are far apart, as where some decimal points are missing.

    A gap of more than a factor of 100, and of more than twice all other gaps together, is that of
    two scales: the rows are wrong. If the gap is only wider than all other gaps together, the
    smaller group may be a mistake, but only with at most 1 % of the trials.
    """
    for subject in study:
        levels = np.unique(subject.stimuli)
        if len(levels) == 1:
            continue
        # Levels are natural logs, so a gap between them is the log of a ratio of stimuli.
        gaps = np.diff(levels)
        gap = gaps.max()
        other_gaps = np.ptp(levels) - gap  # the sum of all others
        below, above = np.split(levels, [gaps.argmax() + 1])

        # The ratio of the stimuli at the gap, with two digits. No float is as large as exp(710).
        rounded_ratio = float(f"{math.exp(min(gap, 700.0)):.2g}")
        factor = f"a factor of {rounded_ratio:,.6g}"
        ranges = [_range_of(group, subject.unit, study.reading) for group in (below, above)]
        # The trials with a stimulus in each group. A trial may have stimuli in both.
        is_below = np.stack([subject.s1, subject.s2]) <= below[-1]  # (2, pairs)
        n_below = subject.n_trials[is_below.any(axis=0)].sum()
        n_above = subject.n_trials[~is_below.all(axis=0)].sum()
        n_smaller = min(n_below, n_above)

        if gap > max(math.log(100.0), 2.0 * other_gaps):
            yield Finding(
                subject.name,
                "two_scales",
                f"Stimuli lie in two groups, {' and '.join(ranges)}, {factor} apart. Correct rows "
                "in another unit or without a decimal point.",
                f"--exclude {cli_argument(subject.name)}",
            )
        elif gap > other_gaps > 0.0 and n_smaller <= 0.01 * subject.total_trials:
            trials = f"{plural(n_smaller, 'trial')} of {subject.total_trials:,}"
            smaller, larger = ranges if n_below < n_above else ranges[::-1]
            yield Finding(
                subject.name,
                "two_scales",
                f"In {trials}, a stimulus ({smaller}) lies {factor} from all others ({larger}). "
                "Check its decimal point.",
            )


def _scales_of_subjects(study: Study) -> Findings:
    """Subjects whose median stimulus is a factor of 10, or of more than 100, from that of most.

    Conditions may have stimuli of their own, so a study with conditions has no such finding.
    """
    medians = np.array([np.median(subject.stimuli) for subject in study])
    usual = np.sort(medians)[len(study) // 2]  # the median of a subject, not a mean of two
    decades = np.abs(medians - usual) / math.log(10.0)
    is_odd = (decades > 2.0) | (np.abs(decades - 1.0) < 1e-3)  # logs in a file may be rounded
    if study.conditions is not None or not is_odd.any():
        return

    ranges = []
    for is_member in (is_odd, ~is_odd):
        stimuli = np.concatenate([subject.stimuli for subject in compress(study, is_member)])
        ranges.append(_range_of(np.sort(stimuli), study.unit, study.reading))
    odd_range, usual_range = ranges
    names = join_display_names(compress(study.names, is_odd))
    yield Finding(
        _WHOLE_STUDY,
        "two_scales",
        f"The stimuli of {names} are {odd_range}, those of other subjects {usual_range}. "
        "Correct them if they are in another unit.",
    )


def _range_of(levels: FloatArray, unit: StimulusUnit, reading: Reading) -> str:
    """The weakest and the strongest of sorted stimuli as the file has them: '0.1 to 0.35 g'."""
    ends = levels[[0, -1]]
    if "i1" in reading.read or unit.stimulus_unit:  # intensities or decibels
        ends = unit.to_stimuli(ends)
    # Ends with the same four digits are one number.
    text = " to ".join(dict.fromkeys(f"{end:.4g}" for end in ends))
    return f"{text} {unit.stimulus_unit}".rstrip()


def _columns(reading: Reading) -> Findings:
    """Columns that are pooled or ignored."""
    for name in reading.pooled:
        yield Finding(
            _WHOLE_STUDY,
            "pooled_condition",
            f"Column {display_name(name)} differs within subjects, and its levels are pooled. If "
            "they are experiments with other stimuli, --where chooses one. If other people have "
            "the same names in each level, give them different names.",
            Remedy("condition", name).typed,
        )
    if reading.ignored:
        yield Finding(
            _WHOLE_STUDY,
            "columns_ignored",
            f"Ignored columns: {join_display_names(reading.ignored)}.",
        )


# --- Names ---------------------------------------------------------------------------------------


def _similar_names(names: Iterable[str]) -> Findings:
    """Names that are probably one subject's: they look alike, or are the same number."""
    groups = defaultdict(list)  # names by their number, or by their letters in lower case
    for name in names:
        # '01' and '1' are the same number. A name that is no number gives NaN.
        letters = unicodedata.normalize("NFKC", name).casefold()
        value = number(name)
        key = letters if math.isnan(value) else value
        groups[key].append(name)
    for alike_names in groups.values():
        if len(alike_names) > 1:
            # In ASCII, letters that look alike are printed differently.
            subjects = ", ".join(map(ascii, alike_names))
            yield Finding(
                _WHOLE_STUDY,
                "names_look_alike",
                f"Subjects {subjects} look alike. If they are one subject, give them one name.",
            )


# --- Pairs ---------------------------------------------------------------------------------------


def identification_findings(study: Study) -> Findings:
    """Questions that cannot be told, with the reason, once if it holds for all subjects."""
    names_by_message = defaultdict(list)
    for subject in study:
        reasons = identify(subject).reasons
        if reasons:
            (reason,) = set(reasons.values())  # all questions of a subject have the same reason
            questions = capitalized(join_words(reasons)).replace("_", " ")
            message = f"{questions} cannot be told, because {reason}."
            names_by_message[message].append(subject.name)
    for message, names in names_by_message.items():
        if len(names) == len(study):
            names = [_WHOLE_STUDY]
        for name in names:
            yield Finding(name, "not_identified", message)


def _one_order(subject: Subject) -> Findings:
    """A few pairs in one order among others that were shown in both."""
    presented_pairs = set(subject.pairs)
    lone_pairs = [pair for pair in subject.pairs if pair[::-1] not in presented_pairs]
    # Where at least half of the pairs have one order, this is the design and no mistake.
    if not 0 < len(lone_pairs) < 0.5 * len(presented_pairs):
        return

    describe = subject.unit.describe
    pairs = join_names([f"({describe(s1)}, {describe(s2)})" for s1, s2 in lone_pairs], max_items=3)
    verb = "was" if len(lone_pairs) == 1 else "were"
    yield Finding(
        subject.name,
        "one_order",
        f"{plural(len(lone_pairs), 'pair')} {verb} presented in one order only: {pairs}.",
    )


# --- Conditions ----------------------------------------------------------------------------------


def _conditions(study: Study) -> Findings:
    """Missing conditions, and differences in stimuli or time that look like one of conditions."""
    if study.conditions is None:
        return
    orders = Counter[str]()  # the number of subjects who had the conditions in each known order
    subjects = units_by_subject(study)
    for name, units in subjects.items():
        met_levels = [unit.condition for unit in units]
        missing_levels = [level for level in study.conditions.levels if level not in met_levels]
        if missing_levels:
            yield Finding(
                name,
                "missing_condition",
                f"No trials in condition {join_names(missing_levels)}. The subject does not count "
                "in this comparison, but does in the group.",
            )
        yield from _stimuli_by_condition(name, units)
        order = _order_of_conditions(units)
        if order:
            orders[order] += 1

    # All known orders are the same order, and more than half of the subjects have it.
    if len(orders) == 1 and orders.total() > 0.5 * len(subjects):
        yield Finding(
            _WHOLE_STUDY,
            "conditions_in_order",
            f"The conditions came in one order, {join_names(orders)}, for "
            f"{plural(orders.total(), 'subject')}. A difference between conditions may be an "
            "effect of time, such as practice.",
        )


def _stimuli_by_condition(name: str, units: Sequence[Subject]) -> Findings:
    """Conditions of a subject that differ in their mean stimulus, or share no pair.

    Means count as different beyond a quarter of the standard deviation of all stimuli.
    """
    means = [0.5 * np.average(unit.s1 + unit.s2, weights=unit.n_trials) for unit in units]
    scales = units[0].shared_scales
    distance = 0.0  # of the means, in standard deviations; no two stimuli differ without scales
    if scales is not None:
        distance = np.ptp(means) / scales.spread

    if distance > 0.25:
        message = (
            f"The mean stimulus differs between conditions by {distance:.2g} standard deviations. "
            "A difference between conditions may be an effect of the stimuli."
        )
    elif follows_from_pairs([units]):
        message = (
            "No pair was presented in two conditions. A difference between conditions may be an "
            "effect of the pairs."
        )
    else:
        return
    yield Finding(name, "stimuli_by_condition", message)


def _order_of_conditions(units: Sequence[Subject]) -> str:
    """Conditions in their order in time, such as 'left, right'.

    Empty for a single condition, and where conditions overlap or the order is not known.
    """
    spans = []  # first trial, last trial and condition
    for unit in units:
        if unit.answers is None or unit.answers.span is None:
            return ""
        spans.append((*unit.answers.span, unit.condition))
    starts, ends, conditions = zip(*sorted(spans), strict=True)
    # Conditions overlap if a condition has not ended where the next one starts.
    if len(spans) == 1 or np.greater_equal(ends[:-1], starts[1:]).any():
        return ""
    return ", ".join(conditions)
