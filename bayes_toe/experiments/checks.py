"""What a study can and cannot tell, known from its pairs and counts before any sampling.

The model has z = ((s2 - s1) - c + p (s1 - sbar)) / w with offset c, pull p and width w; P(equal) is q0 2^(-z^2) with the peak q0, and
P(second) the normal distribution of z, but for lapses. A parameter that drops out of z, or that only enters together with
another one, is not identified: its posterior exists because the prior is proper, and reflects that prior.
"""

from __future__ import annotations

import unicodedata
from collections import Counter
from collections.abc import Iterable
from itertools import pairwise

import numpy as np

from bayes_toe.data.conditions import Stimuli, by_person, follows_from_pairs
from bayes_toe.data.findings import Finding
from bayes_toe.data.messages import counted, listed, quoted, said_intervals
from bayes_toe.data.study import Study, Subject, require_study
from bayes_toe.data.tasks import SAME_DIFFERENT
from bayes_toe.data.validation import runs
from bayes_toe.experiments.identifiability import FULL, PARAMETERS, identifiability
from bayes_toe.model.prior import Prior

_MOST_PAIRS_SHOWN = 3
_SELECTORS = (*range(0xFE00, 0xFE10), *range(0xE0100, 0xE01F0))
#: Beside format and control characters: joiners, fillers and selectors, which are letters or marks to Unicode, and the braille blank.
_INVISIBLE = frozenset("\u034f\u115f\u1160\u17b4\u17b5\u2800\u3164\uffa0") | frozenset(
    map(chr, _SELECTORS)
)
_NEAR, _SELDOM = (
    10.0,
    0.1,
)  # a prior of another unit has sigma_p within this factor of the stimuli's step less often
_ROUNDED = 1e-6  # of the range of the stimuli: no observer tells them apart, and stimuli in single precision are as near
#: Shares of right answers: two just noticeable differences (75 % points) give 91 % without lapses; few lapse in more than 5 %.
_EASY, _CERTAIN = 0.9, 0.95
_APART = 0.25  # of the sd of the stimuli: how far their means may differ between conditions
_LONG = (
    100.0  # seconds: nobody compares two stimuli over that time, but 100 milliseconds are common
)


def check_study(study: Study, prior: Prior | None = None) -> tuple[Finding, ...]:
    """What a study leaves open: findings about its file and its names first, then those of each subject.

    Stimuli are compared exactly, as the pairs of :class:`~bayes_toe.data.study.Subject` are; a prior's scale is compared with theirs.
    """
    require_study(study)
    of_all = (
        *_repeated(study),
        *prior_scale(study, prior),
        *_names(study.names),
        *_units(study),
        *_conditions(study),
    )
    designs: dict[bytes, list[list[tuple[str, str]]]] = {}
    return (*of_all, *(finding for subject in study for finding in _of_subject(subject, designs)))


def doubts(study: Study, prior: Prior | None = None) -> tuple[Finding, ...]:
    """What is probably a mistake and would stand behind everything: those findings of :func:`check_study` that every command says."""
    rounding = (
        Finding(subject.name, code, message)
        for subject in study
        for code, message in _rounding(subject)
    )
    return (*_repeated(study), *prior_scale(study, prior), *rounding)


def prior_scale(study: Study, prior: Prior | None) -> list[Finding]:
    """Where stimuli and a prior of numbers have different units: hardly a sigma_p of the prior is of the size of the stimuli's steps.

    A width far from the steps has all pairs answered alike, so that where the data ask for a sigma_p that the prior hardly has, evidence
    and posterior tell about the prior. With a half-normal sigma_p that is so below 1/80 of its scale and above 16 times it.
    """
    stimuli = Stimuli.of(*study)
    if prior is None or stimuli is None or prior.of_stimuli(prior.spread):
        return []
    step, spread = stimuli.step, prior.distribution(prior.spread)
    near = float(spread.cdf(_NEAR * step) - spread.cdf(step / _NEAR))
    if near >= _SELDOM:
        return []
    how = "wide" if spread.cdf(step) < 0.5 else "narrow"
    message = (
        f"The prior is far too {how} for these stimuli, {prior.spread} ~ {spread.describe()} with steps of {step:.2g} (root mean square of "
        "s2 - s1): are they natural logs of intensity? If they are, the default prior takes its scales from them."
    )
    return [Finding("", "prior_scale", message)]


def described(subject: Subject) -> dict[str, str | int | float]:
    """How much a subject was asked, and how balanced: columns of the table that check prints.

    Pairs are distinct ordered ones, at an interval where there are some; n_both_orders and n_one_order count those of different stimuli,
    order aside; fraction_equal or fraction_second is the share of trials with that answer.
    """
    one = len(_one_order(subject))
    equal = int(np.count_nonzero(subject.s1 == subject.s2))
    return {
        "subject": subject.name,
        "n_pairs": subject.n_pairs,
        **({} if subject.isi is None else {"n_intervals": len(subject.intervals)}),
        "n_trials": subject.total_trials,
        "n_both_orders": (subject.n_pairs - equal - one) // 2,
        "n_one_order": one,
        "n_equal_pairs": equal,
        f"fraction_{subject.task.yes}": subject.fraction_yes,
    }


def _one_order(subject: Subject) -> list[str]:
    """Pairs of different stimuli that were presented in this order only, at one interval where there are intervals."""
    isi = np.zeros(subject.n_pairs) if subject.isi is None else subject.isi
    pairs = list(zip(subject.s1.tolist(), subject.s2.tolist(), isi.tolist(), strict=True))
    present = set(pairs)
    lone = [
        (first, second, at)
        for first, second, at in pairs
        if first != second and (second, first, at) not in present
    ]
    return [
        f"({first:.4g}, {second:.4g})" + (f" at {at:g} s" if subject.isi is not None else "")
        for first, second, at in lone
    ]


_Rule = Iterable[tuple[str, str]]


def _of_subject(
    subject: Subject, designs: dict[bytes, list[list[tuple[str, str]]]]
) -> tuple[Finding, ...]:
    """The findings of one subject; what the design alone tells is told once of all subjects with the same."""
    pairs = (
        subject.s1,
        subject.s2,
        subject.n_trials,
        *(() if subject.isi is None else (subject.isi,)),
    )
    design = b"".join(values.tobytes() for values in pairs)
    if design not in designs:
        of_design = [] if subject.task != SAME_DIFFERENT else _design(subject)
        designs[design] = [
            [*_few_pairs(subject), *_rounding(subject)],
            [*_of_pairs(subject), *of_design],
        ]
    first, rest = designs[design]
    return tuple(
        Finding(subject.name, code, message)
        for code, message in (*first, *_answers(subject), *rest)
    )


def _few_pairs(subject: Subject) -> _Rule:
    if subject.n_pairs < PARAMETERS:
        few = f"{subject.n_pairs} distinct pair{'' if subject.n_pairs == 1 else 's'}"
        yield (
            "few_pairs",
            f"Only {few} for {PARAMETERS} parameters: at least {PARAMETERS - subject.n_pairs} of them cannot be told "
            "from the data, and the posterior will reflect the prior there.",
        )


def _rounding(subject: Subject) -> _Rule:
    """Stimuli so near each other that they were meant to be one, and pairs that are several for that reason."""
    both = np.concatenate([subject.s1, subject.s2])
    gaps = np.diff(np.sort(both))
    if not (
        (gaps > 0) & (gaps <= _ROUNDED * gaps.sum())
    ).any():  # as nearly always: cheap for 100,000 subjects
        return
    stimuli, place = np.unique(both, return_inverse=True)
    shown = np.bincount(place.ravel(), np.tile(subject.n_trials, 2))
    near = np.diff(stimuli) <= _ROUNDED * gaps.sum()
    # Where every trial has a stimulus of its own, two may fall together by chance.
    near &= np.maximum(shown[1:], shown[:-1]) > 2
    if not near.any():
        return
    meant = np.cumsum([0, *~near])[place].reshape(2, -1)
    keys = [*meant, *([] if subject.isi is None else [subject.isi])]
    pairs, several = len(np.unique(np.column_stack(keys), axis=0)), int(np.count_nonzero(near))
    first = int(np.argmax(near))
    more = f" and {several - 1} more" if several > 1 else ""
    yield (
        "rounding",
        f"Stimuli {float(stimuli[first])!r} and {float(stimuli[first + 1])!r}{more} differ by rounding only (by less than {_ROUNDED:g} of "
        f"their range), so that {counted(subject.n_pairs, 'pair')} are told apart where {pairs} were meant: give one stimulus one number.",
    )


def _answers(subject: Subject) -> _Rule:
    if subject.task != SAME_DIFFERENT:
        yield from _right_answers(subject)
        return
    if (subject.n_yes == subject.n_trials).all():
        yield (
            "all_equal",
            "Every trial was answered 'equal': the data give the width no upper bound and show no order effect, so the "
            "posterior of the width, and of offset and pull with it, will reflect the prior.",
        )
    if (subject.n_yes == 0).all():
        yield (
            "all_different",
            "No trial was answered 'equal': a low peak q0, a small width and a large offset explain that alike, so "
            "their posterior will reflect the prior.",
        )


def _right_answers(subject: Subject) -> _Rule:
    """Answers to 'which is stronger?' that are all alike, hardly ever surely right, or hardly ever wrong."""
    if subject.n_yes.sum() in (0, subject.total_trials):
        only = subject.task.yes if subject.n_yes.any() else subject.task.no
        yield (
            "all_alike",
            f"Every trial was answered {only!r}: a constant error beyond all stimuli explains that at any width, so the posterior of both "
            "will reflect the prior.",
        )
        return
    difference = np.round(subject.s2 - subject.s1, 9)
    right = subject.n_trials - subject.task.wrong(difference, subject.n_yes, subject.n_trials)
    sizes, place = np.unique(np.abs(difference), return_inverse=True)
    shares = np.bincount(place.ravel(), right) / np.bincount(
        place.ravel(), subject.n_trials
    )  # over both orders, whatever is preferred
    shares = shares[sizes > 0]
    if len(shares) and shares.max() < _EASY:
        yield (
            "no_easy_pairs",
            f"No pair was easy: no difference s2 - s1 was answered rightly in {_EASY:.0%} or more (two just noticeable differences are), "
            "so lapses and a large width are hardly told apart, and the lapse rate will reflect the prior.",
        )
    if len(shares) and shares.min() > _CERTAIN:
        yield (
            "only_easy_pairs",
            f"Every pair was easy: all differences s2 - s1 were answered rightly in more than {_CERTAIN:.0%}, so the data give the width "
            "no lower bound, and its posterior will reflect the prior there.",
        )


def _of_pairs(subject: Subject) -> _Rule:
    """What pairs of equal stimuli, one first stimulus, one order and one interval leave open."""
    equal, of_equal = subject.s1 == subject.s2, subject.task == SAME_DIFFERENT
    if equal.all():
        same = "|offset - pull (s1 - mean s1)| / width alone, so neither their scale nor the sign of the offset at a small pull can be told"
        enters = (
            same
            if of_equal
            else "(offset - pull (s1 - mean s1)) / width alone, so their scale cannot be told"
        )
        only = "Only pairs of equal stimuli were presented: offset, pull and width enter as"
        yield "only_equal_pairs", f"{only} {enters}, and their posterior will reflect the prior."
    elif not equal.any() and of_equal:
        yield (
            "no_equal_pairs",
            "No pair of equal stimuli was presented: the peak q0 and the offset rest on the assumed shape of the curve "
            "between the pairs presented, so compare their posterior with the prior.",
        )
    # With several intervals offsets and widths tell the pull apart even so.
    if of_equal and (subject.s1 == subject.s1[0]).all() and len(subject.intervals) <= 1:
        yield (
            "one_first_stimulus",
            f"All pairs have the first stimulus {subject.s1[0]:.4g}: the pull does not enter the likelihood, so the "
            "posterior of the pull will reflect the prior, and with it that of gamma and mu1; the offset can be told.",
        )
    if one := _one_order(subject):
        shown = ", ".join(one[:_MOST_PAIRS_SHOWN])
        more = f" and {len(one) - _MOST_PAIRS_SHOWN} more" if len(one) > _MOST_PAIRS_SHOWN else ""
        what = "pair was" if len(one) == 1 else "pairs were"
        yield (
            "one_order",
            f"{len(one)} {what} presented in one order only, {shown}{more}: the order effect there is not observed but "
            "predicted by the model.",
        )
    if len(subject.intervals) == 1:
        yield (
            "one_interval",
            f"All pairs have the interval {said_intervals(subject.intervals)}: what is said of other intervals rests on the assumed random "
            "walk of the memory alone.",
        )


def _units(study: Study) -> list[Finding]:
    """Times that were probably meant in milliseconds: the longest interval; the median pause, since between sessions may lie days."""
    pauses = [
        one.answers.iti for one in study if one.answers is not None and one.answers.iti is not None
    ]
    pause = float(np.nanmedian(np.concatenate([*pauses, [0.0]])))  # 0 where no pause is known
    longest = max(study.intervals, default=0.0)
    times = (
        (longest, "intervals", f"isi has intervals up to {longest:g}"),
        (pause, "pauses", f"iti has pauses of {pause:g} (median)"),
    )
    message = "Column {} s: it is read in seconds, so divide by 1000 if these are milliseconds."
    return [
        Finding("", f"long_{what}", message.format(said))
        for time, what, said in times
        if time >= _LONG
    ]


def _conditions(study: Study) -> list[Finding]:
    """What makes a difference between conditions one of something else, or not to be seen."""
    if study.conditions is None:
        return []
    found, orders = list[Finding](), Counter[str]()
    for person, units in by_person(study).items():
        missing = [
            level
            for level in study.conditions.levels
            if level not in {one.condition for one in units}
        ]
        if missing:
            message = f"Never in condition {listed(missing)}: that says nothing there of this subject, who stays in the population."
            found.append(Finding(person, "missing_condition", message))
        means, felt = (
            [0.5 * float(np.average(one.s1 + one.s2, weights=one.n_trials)) for one in units],
            units[0].felt,
        )
        if felt is not None and (apart := (max(means) - min(means)) / felt.sd) > _APART:
            message = (
                f"Stimuli differ between conditions, by {apart:.2g} of their standard deviation in the mean: a difference in answers may "
                "be due to them, where the model does not hold over all stimuli."
            )
            found.append(Finding(person, "stimuli_by_condition", message))
        elif follows_from_pairs([units]):
            message = "No pair was presented under two conditions: a difference in answers may be due to the pairs, or their order."
            found.append(Finding(person, "stimuli_by_condition", message))
        known = [(one.condition, one.answers.span) for one in units if one.answers is not None]
        places = sorted((place, level) for level, place in known if place is not None)
        if len(places) == len(units) > 1 and all(
            one[0][1] < other[0][0] for one, other in pairwise(places)
        ):
            orders[", ".join(level for _, level in places)] += 1
    if len(orders) == 1 and orders.total() > 0.5 * len(by_person(study)):
        message = (
            f"Conditions came one after the other, {listed([*orders])}, in {counted(orders.total(), 'subject')} and in no other order: a "
            "difference between them may be one of time, such as practice or tiredness."
        )
        found.append(Finding("", "conditions_in_order", message))
    return found


def _repeated(study: Study) -> list[Finding]:
    return [Finding("", "repeated_trials", f"{doubt}.") for doubt in study.reading.doubts]


def _design(subject: Subject) -> _Rule:
    found = identifiability(subject)
    if found.rank < PARAMETERS:
        told = (
            f"{', '.join(found.told)} can be told" if found.told else "none can be told by itself"
        )
        enough = (
            "no smaller model of the ladder carries"
            if found.model == FULL
            else f"the smaller model '{found.model}' carries"
        )
        yield (
            "design_rank",
            f"The pairs can tell {found.rank} of {PARAMETERS} combinations of the parameters, whatever the answers: {told}, "
            f"{', '.join(found.open)} depend on the prior however many trials there are; {enough} all the information ({found.reason}).",
        )


def _names(names: Iterable[str]) -> list[Finding]:
    """Names that are probably one person's, as they look the same, and names that are formulas to a spreadsheet.

    Looks leave out case, invisible characters and repeated spaces, and letters are composed.
    """
    alike: dict[str, list[str]] = {}
    for name in names:
        seen = (
            one
            for one in unicodedata.normalize("NFKC", name)
            if unicodedata.category(one) not in ("Cf", "Cc") and one not in _INVISIBLE
        )
        alike.setdefault(
            unicodedata.normalize("NFKC", " ".join("".join(seen).split()).casefold()), []
        ).append(name)
    found, join = list[Finding](), "if they are one person, join them under one name."
    for same in (some for some in alike.values() if len(some) > 1):
        if len({name.casefold() for name in same}) == 1:
            found.append(
                Finding(
                    "",
                    "names_differ_in_case",
                    f"Subjects {', '.join(map(repr, same))} differ in case only: {join}",
                )
            )
        else:
            found.append(
                Finding(
                    "",
                    "names_look_alike",
                    f"Subjects {', '.join(map(ascii, same))} look alike: {join}",
                )
            )
    if formulas := [quoted(name) for same in alike.values() for name in same if runs(name)]:
        message = f"A spreadsheet would run names of subjects as formulas: {listed(formulas)}; write tables with --spreadsheet-safe."
        found.append(Finding("", "names_are_formulas", message))
    return found
