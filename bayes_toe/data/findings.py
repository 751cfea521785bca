"""What speaks against pooling a subject's answers: blocks with swapped buttons, unlike blocks, drift, accuracy near chance, one order only.

Pooled counts assume that the answers to a pair have one probability from the first trial to the last. The tests of that are exact given
how often each answer was given to each pair: tables are drawn as if these answers had fallen on the blocks by chance (independent
hypergeometric rows), so small cells need no chi-square. A study of clean observers has one named by a test with probability
:data:`STUDY_LEVEL` at most, however many subjects it has (Bonferroni); the draws have a fixed seed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import isotonic_regression
from scipy.special import chdtrc, chdtri, chndtr, logit, ndtri, xlogy

from bayes_toe.arrays import BLOCK, BoolArray, FloatArray, IntArray
from bayes_toe.data.answers import Answers
from bayes_toe.data.messages import as_option, bare, counted
from bayes_toe.data.study import Study, Subject, require_study
from bayes_toe.data.tasks import SAME_DIFFERENT, WHICH_STRONGER
from bayes_toe.errors import InputError
from bayes_toe.seeds import generator

#: Chance that a test names anyone in a study of clean observers.
STUDY_LEVEL = 0.01
#: Answers are called independent of the stimuli, and accuracy near chance, only where the data exclude more with this chance of error.
EXCLUSION = 0.05
#: A standard deviation of the share of an answer between pairs that would have to be found before nothing found means independent answers.
NOTICEABLE = 0.15
#: Accuracy is near chance where an answer is given by less more often where it is right than where it is not.
NEAR_CHANCE = 0.1
#: A block is called answered the wrong way round where its answers are e^5 = 150 times as probable with the buttons swapped.
SWAPPED = 5.0
#: Changes of an answer's share, or of accuracy, from the first trial to the last that are too small to matter for pooled counts.
SMALL_DRIFT = 0.2
#: Orders are not told apart where two standard errors of the difference of an answer's share between them are larger.
WIDE = 0.25
#: What makes the data of a subject doubtful, by code, in the words of tables.
DOUBTS = {
    "swapped_blocks": "swapped blocks",
    "block_dispersion": "unlike blocks",
    "drift": "drift",
    "independent_answers": "independent of the stimuli",
    "reversed_answers": "reversed answers",
    "chance_accuracy": "near chance",
    "other_task": "like another task",
    "one_order": "one order only",
    "pull_not_told": "pull cannot be told",
}

_ONE_LINE = 1e-7  # of the extent of the pairs: stimuli that are equal up to rounding stay below it
_REVERSED, _STRAIGHT = -5.0, 3.0  # z scores that nobody has by chance
_STRETCHES = 10  # of the trials, among which drift is looked for
_FEWEST_DRAWS, _LARGER = (
    99,
    10,
)  # drawing ends with so many tables, or sooner with so many that deviate more
_MOST_DRAWN = (
    10**8
)  # answers of a subject: beyond them tables cannot be drawn, and no experiment has so many
_Rule = Iterable[tuple[str, ...]]


@dataclass(frozen=True)
class Finding:
    """Something that the data of a subject cannot tell, or that speaks against them.

    Parameters
    ----------
    subject : str
        Whom it concerns; empty for the whole study.
    code : str
        What kind of finding it is: one of :data:`DOUBTS`, "few_trials", or what a look at the file
        (:mod:`bayes_toe.experiments.answers_check`) or at the design (:mod:`bayes_toe.experiments.checks`) calls it.
    message : str
        One sentence that says what to conclude.
    option : str
        What to type behind a command to act on it, such as "--turn 946:2,4,6"; empty where nothing helps.
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


def refuse_reversed(study: Study, remedy: str) -> None:
    """Refuse answers 'second' that are rarer the larger s2 - s1 is, in all of a study: they mean the opposite of what they say.

    The InputError has the correlation within subjects; those of whom it holds while it does not of others are a finding.
    """
    if study.task != WHICH_STRONGER:
        return
    rows = []
    for one in study:
        share, x = (
            one.fraction_yes,
            one.s2 - one.s1 - np.average(one.s2 - one.s1, weights=one.n_trials),
        )
        rows.append((x @ one.n_yes, (x**2) @ one.n_trials, share * (1 - share), one.total_trials))
    together, of_x, of_y, n = np.array(rows).T
    z = together / np.sqrt(np.maximum(of_x * of_y, 1e-300))
    if together.sum() < _REVERSED * math.sqrt((of_x * of_y).sum()) and z.max() < _STRAIGHT:
        correlation = together.sum() / math.sqrt(of_x.sum() * (of_y * n).sum())
        found = f"found 'second' less often the larger s2 - s1 is (correlation {correlation:.2f})"
        raise InputError(
            f"{study.source}: {found}, allowed: 'second' where the second stimulus was called the stronger; {remedy}"
        )


def answer_findings(study: Study) -> tuple[Finding, ...]:
    """The same, and who has too few trials."""
    require_study(study)
    of_all, level = tuple(_other_task(study)), STUDY_LEVEL / len(study)
    return tuple(Finding(one.name, *said) for one in study for said in (*of_all, *_of(one, level)))


def _of(subject: Subject, level: float) -> _Rule:
    yield from _few_trials(subject)
    yield from _orders(subject)
    if subject.total_trials > _MOST_DRAWN:
        return
    if subject.answers is not None:
        answers = subject.answers.given
        blocks = list(_blocks(subject, answers, level))
        yield from blocks
        if any(code == "swapped_blocks" for code, *_ in blocks):
            return  # which explains what else may be found
        if answers.trials:
            yield from _drift(subject, answers, level)
    yield from _stimuli(subject, level)


# --- The counts of a subject -----------------------------------------------------------------------


def _few_trials(subject: Subject) -> _Rule:
    up, down = (
        int(subject.n_trials[chosen].sum())
        for chosen in (subject.s1 < subject.s2, subject.s1 > subject.s2)
    )
    if up and down and 2 * math.sqrt(0.25 / up + 0.25 / down) > WIDE:
        yield (
            "few_trials",
            f"Only {counted(up, 'trial')} with the stronger stimulus second and {down} with it first: an effect of the order on "
            f"P({subject.task.yes}) of {WIDE:.0%} cannot be told from none, so expect the prior back.",
        )


def _orders(subject: Subject) -> _Rule:
    """Designs that show no order effect, or not of which kind it is."""
    if subject.task == SAME_DIFFERENT:
        unequal = subject.s1 != subject.s2
        isi = np.zeros(subject.n_pairs) if subject.isi is None else subject.isi
        pairs = set(
            zip(
                subject.s1[unequal].tolist(),
                subject.s2[unequal].tolist(),
                isi[unequal].tolist(),
                strict=True,
            )
        )
        if pairs and not any((second, first, at) in pairs for first, second, at in pairs):
            yield (
                "one_order",
                "Every pair was presented in one order only: an order effect is not observed but predicted by the model.",
            )
        return
    points = np.column_stack([subject.s1, subject.s2])
    points = points - points.mean(0)
    # On one line z = ((s2 - s1) + p (s1 - sbar) - c)/width has two coefficients for three parameters.
    values = np.linalg.svd(points, compute_uv=False)
    if len(points) < 3 or (len(subject.intervals) <= 1 and values[-1] <= _ONE_LINE * values[0]):
        one = (subject.s1 == subject.s1[0]).all()
        design = (
            f"All pairs have the first stimulus {subject.s1[0]:.4g}"
            if one
            else "s1 and s2 are one linear function of each other"
        )
        told = "from a constant error" if one else "from a constant error and the width"
        yield (
            "pull_not_told",
            f"{design}: a pull cannot be told {told}, so which kind an order effect is rests on the prior.",
        )


def _other_task(study: Study) -> _Rule:
    """Answers that rise or fall with s2 - s1 where they should have a peak, or have a peak where they should rise, in all of a study."""
    monotone = off = equal = 0.0
    for one in study.subjects[:100]:  # who are enough to tell
        difference = one.s2 - one.s1
        shifts = np.abs(difference).max() * np.array(
            [-0.5, -0.25, 0.0, 0.25, 0.5]
        )  # an order effect moves the peak
        monotone += _isotonic(difference, one) - max(
            _isotonic(np.abs(difference - shift), one) for shift in shifts.tolist()
        )
        off += np.abs(one.n_yes - 0.5 * one.n_trials)[difference == 0].sum()
        equal += one.n_trials[difference == 0].sum()
    said = ""
    if study.task == SAME_DIFFERENT and monotone > SWAPPED and off <= 0.25 * equal:
        said = "rises or falls with s2 - s1 and is about one half near s2 = s1, as in answers to 'which is stronger?'"
    elif study.task != SAME_DIFFERENT and -monotone > SWAPPED:
        said = "is highest or lowest near s2 = s1, as in answers to 'same or different?'"
    if said:
        yield "other_task", f"Was the other question asked? P({study.task.yes}) {said}."


def _isotonic(x: FloatArray, subject: Subject) -> float:
    """Log likelihood of shares of the counted answer that only rise, or only fall, with x."""
    places = np.unique(np.round(x, 9), return_inverse=True)[1].ravel()
    k, n = (np.bincount(places, counts) for counts in (subject.n_yes, subject.n_trials))
    fits = (isotonic_regression(k / n, weights=n, increasing=rises).x for rises in (True, False))
    return max(float((xlogy(k, fit) + xlogy(n - k, 1 - fit)).sum()) for fit in fits)


def _stimuli(subject: Subject, level: float) -> _Rule:
    """Whether answers depend on the stimuli, and the right way round."""
    n, k = subject.n_trials, subject.n_yes
    if not 0 < k.sum() < n.sum() or len(n) < 2:
        return
    table, share = _Table(n[None, :], k[None, :]), k.sum() / n.sum()
    right = subject.task.right(subject.s2 - subject.s1)
    # A test of X^2 that nearly always finds a noticeable effect, and finds none.
    missed = chndtr(
        chdtri(table.freedom, EXCLUSION),
        table.freedom,
        n.sum() * NOTICEABLE**2 / (share * (1 - share)),
    )
    doubtful = (
        missed < EXCLUSION and chdtrc(table.freedom, table.chi_square(table.k)) > 0.01 * EXCLUSION
    )
    p = (
        table.p_value(table.chi_square, EXCLUSION, subject.name) if doubtful else 0.0
    )  # which takes a hundred tables
    if p > EXCLUSION:
        option = f"--leave-out {as_option(subject.name)}"
        message = f"Answers look independent of the stimuli (X^2 / d.f. = {table.ratio:.2f}, p = {p:.2g}): {option} leaves the subject out."
        yield "independent_answers", message, option
    elif (right > 0).any() and (right < 0).any():
        yield from _accuracy(subject, right, level)


def _accuracy(subject: Subject, right: FloatArray, level: float) -> _Rule:
    """Whether an answer is given more often where it is right than elsewhere (Fisher's exact test, and a bound that is Wald's)."""
    yes, answers = (
        np.array([counts[chosen].sum() for chosen in (right > 0, right < 0)])
        for counts in (subject.n_yes, subject.n_trials)
    )
    share = (yes + 0.5) / (answers + 1)
    most = (
        share[0]
        - share[1]
        - ndtri(EXCLUSION) * math.sqrt((share * (1 - share) / (answers + 1)).sum())
    )
    of = (
        ("equal", "different")
        if subject.task == SAME_DIFFERENT
        else ("weaker-first", "stronger-first")
    )
    given = yes / answers
    said = f"{subject.task.yes!r} to {given[0]:.0%} of the {of[0]} and {given[1]:.0%} of the {of[1]} pairs"
    turned = yes[0] * answers[1] < yes[1] * answers[0]  # else the p-value is at least a half
    if turned:
        from scipy.stats import hypergeom  # slow to import, and few subjects ask

        turned = hypergeom.cdf(yes[0], answers.sum(), yes.sum(), answers[0]) <= level
    if turned:
        option = f"--turn {as_option(subject.name)}"
        message = f"Answers look reversed, {said}: does --{subject.task.yes}-code name the other answer? Or {option} turns them."
        yield "reversed_answers", message, option
    elif most < NEAR_CHANCE:
        option = f"--leave-out {as_option(subject.name)}"
        yield (
            "chance_accuracy",
            f"Accuracy is near chance, {said}: {option} leaves the subject out.",
            option,
        )


# --- The answers in their blocks, and in their order -----------------------------------------------


@dataclass(frozen=True)
class _Table:
    """Answers n, and those k that the task counts, shape (pairs, blocks)."""

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

    def by_block(self, k: IntArray) -> FloatArray:
        """What each block adds to X^2 of tables k with the margins of this one, shape (..., pairs, blocks) to (..., blocks)."""
        share = self.k.sum(1, keepdims=True) / self.n.sum(1, keepdims=True)
        variance = self.n * share * (1 - share)
        return np.asarray(((k - self.n * share) ** 2 / np.where(self.n > 0, variance, 1)).sum(-2))

    def chi_square(self, k: IntArray) -> FloatArray:
        """X^2 of such tables, shape (...)."""
        return np.asarray(self.by_block(k).sum(-1))

    def agreement(self, k: IntArray) -> FloatArray:
        """Log odds, for each block, that it was answered as the other blocks and not with the buttons swapped, shape (..., blocks)."""
        others, trials = k.sum(-1, keepdims=True) - k, self.n.sum(1, keepdims=True) - self.n
        return np.asarray(((2 * k - self.n) * logit((others + 0.5) / (trials + 1))).sum(-2))

    @property
    def ratio(self) -> float:
        """X^2 / d.f."""
        return float(self.chi_square(self.k)) / self.freedom

    def p_value(
        self, statistic: Callable[[IntArray], FloatArray], level: float, name: str
    ) -> float:
        """Chance of a statistic at least as large where the answers to each pair fall on its trials at random.

        Tables are drawn until ten deviate as much (Besag and Clifford 1991) or until the level can be told.
        """
        rng, observed = generator(0, name, "answers"), float(statistic(self.k)) * (1 - 1e-12)
        most, batch = max(_FEWEST_DRAWS, math.ceil(5 / level)), max(1, BLOCK // self.n.size)
        larger = drawn = 0
        while drawn < most and larger < _LARGER:
            size = min(
                batch, most - drawn, 32 + 3 * drawn
            )  # most tables do not deviate, which a few tell
            rows = [
                rng.multivariate_hypergeometric(n, k, size)
                for n, k in zip(self.n, self.k.sum(1), strict=True)
            ]
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


def _blocks(subject: Subject, answers: Answers, level: float) -> _Rule:
    if answers.block is None:
        return
    name = subject.name
    pairs, table = _tabulated(answers, answers.block)
    told = table.told()
    if told.freedom == 0:
        return
    # Half the level each: dispersion finds any difference, agreement a single swapped block among many.
    # X^2 below what it is on average needs no table.
    p = told.p_value(told.chi_square, level / 2, name) if told.ratio > 1.0 else 1.0
    difference = pairs[:, 1] - pairs[:, 0]
    turned = _swapped(table, -np.abs(difference) if subject.task == SAME_DIFFERENT else difference)
    if (
        turned
        and p > level / 2
        and table.p_value(lambda k: -table.agreement(k).min(-1), level / 2, name) > level / 2
    ):
        turned = []
    names = [answers.blocks[index] for index in turned]
    option = f"--turn {as_option(name, names)}" if turned else ""
    if p <= level / 2:
        straight = table.k.copy()
        straight[:, turned] = table.n[:, turned] - table.k[:, turned]
        after = _Table(table.n, straight).told()
        rest = (
            f" ({after.ratio:.2f} with the blocks below turned)" if turned and after.freedom else ""
        )
        ratio = (
            f"X^2 / d.f. of pair x block = {told.ratio:.2f} with {told.freedom} d.f., p = {p:.1g}"
        )
        message, one = (
            f"Blocks differ in their answers to the same pairs, {ratio}{rest}: pooled counts look surer than they are",
            option,
        )
        if not turned and len(answers.blocks) > 2:
            most = answers.blocks[int(np.argmax(told.by_block(told.k)))]
            one = f"--leave-out {as_option(name, [most])}"
            message += f"; block {bare(most)} differs most, {one} shows what rests on it"
        yield "block_dispersion", f"{message}.", one
    if turned:
        shown = [*map(bare, names)]
        several = (
            f"Blocks {', '.join(shown[:-1])} and {shown[-1]} look"
            if len(shown) > 1
            else f"Block {shown[0]} looks"
        )
        out = f"--leave-out {as_option(name, names)}"
        message = f"{several} answered the wrong way round (swapped buttons): {option} turns these answers, {out} leaves them out."
        yield "swapped_blocks", message, option


def _swapped(table: _Table, toward: FloatArray) -> list[int]:
    """Blocks whose answers agree with those of the others only if they are turned.

    Blocks start as they relate to what speaks `toward` the counted answer, which in the end also tells which of two camps is right;
    between, each is turned to where the others have it, until nothing changes.
    """
    lean = toward - toward.mean()
    sign = np.where(lean @ (2 * table.k - table.n) < 0, -1, 1)
    excess = np.zeros(len(sign))
    for _ in range(20):
        excess = sign * table.agreement(np.where(sign > 0, table.k, table.n - table.k))
        if (np.where(excess < 0, -1, 1) == sign).all():
            break
        sign = np.where(excess < 0, -1, 1)
    right = np.sign(lean @ (2 * np.where(sign > 0, table.k, table.n - table.k) - table.n).sum(1))
    return np.flatnonzero((excess if right >= 0 else -excess) < -SWAPPED).tolist()


def _drift(subject: Subject, answers: Answers, level: float) -> _Rule:
    """Answers, or right answers, that become more or fewer over the trials."""
    count = len(answers.n_trials)
    pairs, table = _tabulated(answers, np.arange(count) * min(_STRETCHES, count) // count)
    pairs, table = pairs[table.both_ways], table.told()
    if table.freedom == 0:
        return
    kinds = np.stack([np.ones(len(pairs)), subject.task.right(pairs[:, 1] - pairs[:, 0])])
    time = np.arange(table.n.shape[1]) / table.n.shape[1]
    centred = time - (table.n @ time / table.n.sum(1))[:, None]
    slopes = (
        kinds[:, :, None] * centred / (table.n * centred**2).sum()
    )  # least squares: the change from the first trial to the last

    def largest(k: IntArray) -> FloatArray:
        return np.asarray(np.abs(np.tensordot(k, slopes, ((-2, -1), (1, 2)))).max(-1))

    change = np.tensordot(slopes, table.k, 2)
    which = int(np.argmax(np.abs(change)))
    # Most changes are too small to be named, and then their p-value, which takes hundreds of tables, need not be known.
    p = table.p_value(largest, level, subject.name) if abs(change[which]) >= SMALL_DRIFT else 1.0
    if p <= level:
        what = (f"P({subject.task.yes})", "share of right answers")[which]
        way = f"{'rises' if change[which] > 0 else 'falls'} by {abs(change[which]):.2f} from the first trial to the last"
        yield (
            "drift",
            f"Answers drift: the {what} for the same pairs {way} (p = {p:.1g}), and pooled counts are an average over that.",
        )
