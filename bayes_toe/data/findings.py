"""What speaks against pooling a subject's answers: blocks with swapped buttons, unlike blocks, drift, accuracy near chance, one order only.

Pooled counts assume that the answers to a pair have one probability from the first trial to the last. The tests of that are exact given
how often each pair was called 'equal': tables are drawn as if these answers had fallen on the blocks by chance (independent
hypergeometric rows), so small cells need no chi-square. A study of clean observers has one named by a test with probability
:data:`STUDY_LEVEL` at most, however many subjects it has (Bonferroni); the draws have a fixed seed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri, chndtr, logit, ndtri

from bayes_toe.arrays import BLOCK, BoolArray, FloatArray, IntArray
from bayes_toe.data.answers import Answers
from bayes_toe.data.messages import bare, counted
from bayes_toe.data.study import Study, Subject, as_option, require_study
from bayes_toe.seeds import generator

#: Chance that a test names anyone in a study of clean observers.
STUDY_LEVEL = 0.01
#: Answers are called independent of the stimuli, and accuracy near chance, only where the data exclude more with this chance of error.
EXCLUSION = 0.05
#: A standard deviation of P(equal) between pairs that would have to be found before nothing found means independent answers.
NOTICEABLE = 0.15
#: Accuracy is near chance where P(equal) of equal pairs exceeds that of different ones by less.
NEAR_CHANCE = 0.1
#: A block is called answered the wrong way round where its answers are e^5 = 150 times as probable with the buttons swapped.
SWAPPED = 5.0
#: Changes of P(equal), or of accuracy, from the first trial to the last that are too small to matter for pooled counts.
SMALL_DRIFT = 0.2
#: Orders are not told apart where two standard errors of the difference of P(equal) between them are larger.
WIDE = 0.25
#: What makes the data of a subject doubtful, by code, in the words of tables.
DOUBTS = {
    "swapped_blocks": "swapped blocks",
    "block_dispersion": "unlike blocks",
    "drift": "drift",
    "independent_answers": "independent of the stimuli",
    "reversed_answers": "reversed answers",
    "chance_accuracy": "near chance",
    "one_order": "one order only",
}

_STRETCHES = 10  # of the trials, among which drift is looked for
_FEWEST_DRAWS, _LARGER = 99, 10  # drawing ends with so many tables, or sooner with so many that deviate more
_MOST_DRAWN = 10**8  # answers of a subject: beyond them tables cannot be drawn, and no experiment has so many
_Rule = Iterable[tuple[str, ...]]


@dataclass(frozen=True)
class Finding:
    """Something that the data of a subject cannot tell, or that speaks against them.

    Parameters
    ----------
    subject : str
        Whom it concerns; empty for the whole study.
    code : str
        What kind of finding it is: one of :data:`DOUBTS` or "few_trials"; from a look at the file
        (:mod:`bayes_toe.experiments.answers_check`) "raw_stimuli", "far_from_prior", "column_alike" or "columns_ignored"; from a look at
        the design (:mod:`bayes_toe.experiments.checks`) "few_pairs", "rounding", "all_equal", "all_different", "only_equal_pairs",
        "no_equal_pairs", "one_first_stimulus", "one_order", "one_interval", "design_rank", "repeated_trials", "prior_scale",
        "long_intervals", "names_differ_in_case", "names_look_alike" (but for invisible characters, or how characters are composed) or
        "names_are_formulas" (to a spreadsheet).
    message : str
        One sentence that says what to conclude.
    option : str
        What to type behind a command to act on it, such as "--turn 946:2,4,6"; empty where nothing helps.

    Examples
    --------
    >>> Finding("S01", "chance_accuracy", "Accuracy is near chance.", "--leave-out S01").kind
    'near chance'
    """

    subject: str
    code: str
    message: str
    option: str = ""

    @property
    def kind(self) -> str:
        """The code in the words of tables."""
        return DOUBTS.get(self.code, self.code.replace("_", " "))


def data_findings(study: Study) -> tuple[Finding, ...]:
    """What makes the data of subjects doubtful, the same for the same study: findings with a code of :data:`DOUBTS`, subject by subject.

    Some 10 milliseconds a subject, 50 where the answers are unlike; 0.5 where the study has counts alone.

    Examples
    --------
    >>> one, other = Subject("S01", [0, 0, 1, 1], [0, 1, 0, 1], [9, 2, 5, 8], [9] * 4), Subject("S02", [0, 0], [0, 1], [90, 20], [99, 99])
    >>> [(found.subject, found.kind, found.option) for found in data_findings(Study((one, other)))]
    [('S02', 'one order only', '')]
    """
    return tuple(one for one in answer_findings(study) if one.code in DOUBTS)


def answer_findings(study: Study) -> tuple[Finding, ...]:
    """The same, and who has too few trials."""
    require_study(study)
    found = ((one, _of(one, study.reading.answers.get(one.name), STUDY_LEVEL / len(study))) for one in study)
    return tuple(Finding(one.name, *said) for one, rules in found for said in rules)


def _of(subject: Subject, answers: Answers | None, level: float) -> _Rule:
    yield from _few_trials(subject)
    yield from _one_order(subject)
    if subject.total_trials > _MOST_DRAWN:
        return
    if answers is not None:
        blocks = list(_blocks(subject.name, answers, level))
        yield from blocks
        if any(code == "swapped_blocks" for code, *_ in blocks):
            return  # which explains what else may be found
        if answers.trials:
            yield from _drift(subject.name, answers, level)
    yield from _stimuli(subject, level)


# --- The counts of a subject -----------------------------------------------------------------------


def _few_trials(subject: Subject) -> _Rule:
    up, down = (int(subject.n_trials[chosen].sum()) for chosen in (subject.s1 < subject.s2, subject.s1 > subject.s2))
    if up and down and 2 * math.sqrt(0.25 / up + 0.25 / down) > WIDE:
        yield (
            "few_trials",
            f"Only {counted(up, 'trial')} with the stronger stimulus second and {down} with it first: orders whose P(equal) differ "
            f"by {WIDE:.0%} cannot be told apart, so expect the prior back.",
        )


def _one_order(subject: Subject) -> _Rule:
    unequal = subject.s1 != subject.s2
    isi = np.zeros(subject.n_pairs) if subject.isi is None else subject.isi
    pairs = set(zip(subject.s1[unequal].tolist(), subject.s2[unequal].tolist(), isi[unequal].tolist(), strict=True))
    if pairs and not any((second, first, at) in pairs for first, second, at in pairs):
        yield "one_order", "Every pair was presented in one order only: an order effect is not observed but predicted by the model."


def _stimuli(subject: Subject, level: float) -> _Rule:
    """Whether answers depend on the stimuli, and the right way round."""
    n, k, same = subject.n_trials, subject.n_yes, subject.s1 == subject.s2
    if not 0 < k.sum() < n.sum() or len(n) < 2:
        return
    table, share = _Table(n[None, :], k[None, :]), k.sum() / n.sum()
    p = table.p_value(table.chi_square, EXCLUSION, subject.name)
    if p > EXCLUSION and _would_show(table.freedom, n.sum() * NOTICEABLE**2 / (share * (1 - share))):
        ratio, option = f"X^2 / d.f. = {table.ratio(table.k):.2f}, p = {p:.2g}", f"--leave-out {as_option(subject.name)}"
        message = f"Answers look independent of the stimuli ({ratio}): {option} leaves the subject out."
        yield "independent_answers", message, option
    elif same.any() and not same.all():
        yield from _accuracy(subject.name, n, k, same, level)


def _would_show(freedom: int, noncentrality: float) -> bool:
    """Whether a test of X^2 nearly always finds so large an effect."""
    return bool(chndtr(chdtri(freedom, EXCLUSION), freedom, noncentrality) < EXCLUSION)


def _accuracy(name: str, n: IntArray, k: IntArray, same: BoolArray, level: float) -> _Rule:
    """Whether equal pairs are called equal more often than different ones (Fisher's exact test, and a bound that is Wald's)."""
    equal, answers = (np.array([counts[chosen].sum() for chosen in (same, ~same)]) for counts in (k, n))
    share = (equal + 0.5) / (answers + 1)
    most = share[0] - share[1] - ndtri(EXCLUSION) * math.sqrt((share * (1 - share) / (answers + 1)).sum())
    said = "'equal' to {:.0%} of the equal and {:.0%} of the different pairs".format(*equal / answers)
    turned = equal[0] * answers[1] < equal[1] * answers[0]  # else it is at least a half
    if turned and _fisher(equal, answers) <= level:
        option = f"--turn {as_option(name)}"
        message = f"Answers look reversed, {said}: does --equal-code name the other answer? Or {option} turns them."
        yield "reversed_answers", message, option
    elif most < NEAR_CHANCE:
        option = f"--leave-out {as_option(name)}"
        yield "chance_accuracy", f"Accuracy is near chance, {said}: {option} leaves the subject out.", option


def _fisher(equal: IntArray, answers: IntArray) -> float:
    """One-sided p-value, of the first share being the smaller."""
    from scipy.stats import hypergeom  # slow to import, and few subjects ask

    return float(hypergeom.cdf(equal[0], answers.sum(), equal.sum(), answers[0]))


# --- The answers in their blocks, and in their order -----------------------------------------------


@dataclass(frozen=True)
class _Table:
    """Answers n and answers 'equal' k, shape (pairs, blocks)."""

    n: IntArray
    k: IntArray

    @property
    def both_ways(self) -> BoolArray:
        """Which pairs were answered in both ways: the others cannot deviate."""
        return np.asarray((self.k.sum(1) > 0) & (self.k.sum(1) < self.n.sum(1)))

    def told(self) -> _Table:
        """Those pairs alone."""
        return _Table(self.n[self.both_ways], self.k[self.both_ways])

    @property
    def freedom(self) -> int:
        """Degrees of freedom."""
        return int(np.maximum((self.n > 0).sum(1) - 1, 0).sum())

    @property
    def by_block(self) -> FloatArray:
        """What each block adds to X^2."""
        return np.asarray(self._deviations(self.k).sum(0))

    def chi_square(self, k: IntArray) -> FloatArray:
        """X^2 of tables k with the margins of this one, shape (..., pairs, blocks) to (...)."""
        return np.asarray(self._deviations(k).sum((-2, -1)))

    def _deviations(self, k: IntArray) -> FloatArray:
        share = self.k.sum(1, keepdims=True) / self.n.sum(1, keepdims=True)
        variance = self.n * share * (1 - share)
        return np.asarray((k - self.n * share) ** 2 / np.where(self.n > 0, variance, 1))

    def agreement(self, k: IntArray) -> FloatArray:
        """Log odds, for each block, that it was answered as the other blocks and not with the buttons swapped, shape (..., blocks)."""
        others, trials = k.sum(-1, keepdims=True) - k, self.n.sum(1, keepdims=True) - self.n
        return np.asarray(((2 * k - self.n) * logit((others + 0.5) / (trials + 1))).sum(-2))

    def worst_agreement(self, k: IntArray) -> FloatArray:
        """How much the block that agrees least speaks for swapped buttons, shape (...)."""
        return np.asarray(-self.agreement(k).min(-1))

    def ratio(self, k: IntArray) -> float:
        """X^2 / d.f."""
        return float(self.chi_square(k)) / self.freedom

    def p_value(self, statistic: Callable[[IntArray], FloatArray], level: float, name: str) -> float:
        """Chance of a statistic at least as large where the answers to each pair fall on its trials at random.

        Tables are drawn until ten deviate as much (Besag and Clifford 1991) or until the level can be told.
        """
        rng, observed = generator(0, name, "answers"), float(statistic(self.k)) * (1 - 1e-12)
        most, batch = max(_FEWEST_DRAWS, math.ceil(5 / level)), max(1, BLOCK // self.n.size)
        larger = drawn = 0
        while drawn < most and larger < _LARGER:
            size = min(batch, most - drawn, 32 + 3 * drawn)  # most tables do not deviate, which a few tell
            rows = [rng.multivariate_hypergeometric(n, k, size) for n, k in zip(self.n, self.k.sum(1), strict=True)]
            larger += int((statistic(np.stack(rows, 1)) >= observed).sum())
            drawn += size
        return (1 + larger) / (1 + drawn)


def _tabulated(answers: Answers, column: IntArray) -> tuple[FloatArray, _Table]:
    """Distinct pairs, and their answers by column."""
    pairs, row = np.unique(answers.keys, axis=0, return_inverse=True)
    n, k = (np.zeros((len(pairs), column.max() + 1), np.int64) for _ in range(2))
    np.add.at(n, (row.ravel(), column), answers.n_trials)
    np.add.at(k, (row.ravel(), column), answers.n_yes)
    return pairs, _Table(n, k)


def _blocks(name: str, answers: Answers, level: float) -> _Rule:
    if answers.block is None:
        return
    pairs, table = _tabulated(answers, answers.block)
    told = table.told()
    if told.freedom == 0:
        return
    # Half the level each: dispersion finds any difference, agreement a single swapped block among many.
    p = told.p_value(told.chi_square, level / 2, name)
    suspect = p <= level / 2 or table.p_value(table.worst_agreement, level / 2, name) <= level / 2
    turned = _swapped(table, pairs[:, 1] - pairs[:, 0]) if suspect else []
    names = [answers.blocks[index] for index in turned]
    option = f"--turn {as_option(name, names)}" if turned else ""
    if p <= level / 2:
        straight = table.k.copy()
        straight[:, turned] = table.n[:, turned] - table.k[:, turned]
        after = _Table(table.n, straight).told()
        rest = f" ({after.ratio(after.k):.2f} with the blocks below turned)" if turned and after.freedom else ""
        ratio = f"X^2 / d.f. of pair x block = {told.ratio(told.k):.2f} with {told.freedom} d.f., p = {p:.1g}"
        message, one = f"Blocks differ in their answers to the same pairs, {ratio}{rest}: pooled counts look surer than they are", option
        if not turned and len(answers.blocks) > 2:
            most = answers.blocks[int(np.argmax(told.by_block))]
            one = f"--leave-out {as_option(name, [most])}"
            message += f"; block {bare(most)} differs most, {one} shows what rests on it"
        yield "block_dispersion", f"{message}.", one
    if turned:
        shown = [*map(bare, names)]
        several = f"Blocks {', '.join(shown[:-1])} and {shown[-1]} look" if len(shown) > 1 else f"Block {shown[0]} looks"
        out = f"--leave-out {as_option(name, names)}"
        message = f"{several} answered the wrong way round (swapped buttons): {option} turns these answers, {out} leaves them out."
        yield "swapped_blocks", message, option


def _swapped(table: _Table, difference: FloatArray) -> list[int]:
    """Blocks whose answers agree with those of the others only if they are turned.

    Blocks start as they relate to the sizes of the differences, which in the end also tells which of two camps is right; between, each is
    turned to where the others have it, until nothing changes.
    """
    lean = np.abs(difference).mean() - np.abs(difference)
    sign = np.where(lean @ (2 * table.k - table.n) < 0, -1, 1)
    excess = np.zeros(len(sign))
    for _ in range(20):
        excess = sign * table.agreement(np.where(sign > 0, table.k, table.n - table.k))
        if (np.where(excess < 0, -1, 1) == sign).all():
            break
        sign = np.where(excess < 0, -1, 1)
    right = np.sign(lean @ (2 * np.where(sign > 0, table.k, table.n - table.k) - table.n).sum(1))
    return np.flatnonzero((excess if right >= 0 else -excess) < -SWAPPED).tolist()


def _drift(name: str, answers: Answers, level: float) -> _Rule:
    """Answers, or right answers, that become more or fewer over the trials."""
    count = len(answers.n_trials)
    pairs, table = _tabulated(answers, np.arange(count) * min(_STRETCHES, count) // count)
    pairs, table = pairs[table.both_ways], table.told()
    if table.freedom == 0:
        return
    kinds = np.stack([np.ones(len(pairs)), np.where(pairs[:, 0] == pairs[:, 1], 1, -1)])
    time = np.arange(table.n.shape[1]) / table.n.shape[1]
    centred = time - (table.n @ time / table.n.sum(1))[:, None]
    slopes = kinds[:, :, None] * centred / (table.n * centred**2).sum()  # least squares: the change from the first trial to the last

    def largest(k: IntArray) -> FloatArray:
        return np.asarray(np.abs(np.tensordot(k, slopes, ((-2, -1), (1, 2)))).max(-1))

    change = np.tensordot(slopes, table.k, 2)
    which = int(np.argmax(np.abs(change)))
    # Most changes are too small to be named, and then their p-value, which takes hundreds of tables, need not be known.
    p = table.p_value(largest, level, name) if abs(change[which]) >= SMALL_DRIFT else 1.0
    if p <= level:
        what = ("P(equal)", "share of right answers")[which]
        way = f"{'rises' if change[which] > 0 else 'falls'} by {abs(change[which]):.2f} from the first trial to the last"
        yield "drift", f"Answers drift: the {what} for the same pairs {way} (p = {p:.1g}), and pooled counts are an average over that."
