"""Problems in the responses of a subject, known before any sampling.

`check_answers` finds repeated trials, too few trials, one response only, swapped blocks, blocks
that differ, and drift. By the evidences of :mod:`bayes_toe.checks.alternative_models` it finds
swapped keys, responses of another task, and responses that say little about the stimuli.
`answer_flags` has the findings of every subject.

Each alarm has a false-alarm rate for a whole study of sound observers, however many they are, see
:mod:`bayes_toe.checks.alarm_rate`.

Pooled counts assume that the responses to a pair have one probability from the first trial to the
last. The tests of blocks and of drift are exact, given how often each response was given to each
pair: tables are drawn as if these responses had fallen on the blocks by chance, so small cells
need no chi-square. The draws have a fixed seed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from itertools import compress, product
from typing import TypeAlias, cast

import numpy as np
from scipy.special import logit, logsumexp

from bayes_toe.arrays import BLOCK, BoolArray, FloatArray, IntArray, run_starts
from bayes_toe.checks.alarm_rate import (
    FALSE_ALARM_SHARE,
    REFUSAL_SHARE,
    evidence_limit,
    flag_limit,
    simulated_p_value,
)
from bayes_toe.checks.alternative_models import (
    Alternatives,
    compare_alternatives,
    log_bayes_factor,
)
from bayes_toe.data.answers import Answers
from bayes_toe.data.messages import cli_argument, describe_p_value, display_name, join_words, plural
from bayes_toe.data.study import Study, Subject, require_study
from bayes_toe.data.tasks import SAME_DIFFERENT, WHICH_STRONGER, Task
from bayes_toe.seeds import generator

#: Log Bayes factor, nats, above which a subject seems to have another task than the study. A large
#: constant error stays below: in 2AFC, one of 3 times the difference of a pair reaches 4.7, in
#: 'same or different?' one of 1.6 times reaches 3.8.
OTHER_TASK_LIMITS = {WHICH_STRONGER: 5.0, SAME_DIFFERENT: 4.0}
#: Trials below which a subject is flagged.
FEW_TRIALS = 60

#: The words that tables have for a flag after which a subject is not interpreted.
FAULTS = {
    "repeated_trials": "trials are repeated",
    "one_answer": "all responses are the same",
    "other_task": "responses look like another task",
    "swapped_blocks": "responses look swapped",
    "reversed_answers": "responses look reversed",
}
#: The words of all flags.
FLAG_WORDS = {
    **FAULTS,
    "independent_answers": "responses say little about the stimuli",
    "like_2afc": "responses look like 2AFC, or a large constant error",
    "block_dispersion": "blocks differ",
    "drift": "responses drift",
    "few_trials": f"fewer than {FEW_TRIALS} trials",
}

#: Trials in sequence that are compared, to find repeated trials.
_WINDOW = 16
#: Share of a response below which a constant error may explain it: if it is large, one response is
#: rare whatever the pair.
_RARE_SHARE = 0.15
#: Logits by which a block's answers may differ from other blocks, with Laplace's prior.
_LOGIT_SHIFTS = np.linspace(-6.0, 6.0, 25)
#: Scale of further logits that are proportional to s2 - s1, at its largest value.
_TILT_SCALE = 0.75


@dataclass(frozen=True)
class Finding:
    """A problem of a subject or a study, or something that its design cannot show.

    Parameters
    ----------
    subject : str
        Empty for the whole study.
    code : str
        A key of :data:`FLAG_WORDS`, or a code of :mod:`bayes_toe.checks.design_checks`.
    message : str
        One sentence that says what to conclude.
    option : str
        What to type after a command to act on it, such as "--swap 946:2,4,6"; often empty.
    """

    subject: str
    code: str
    message: str
    option: str = ""

    @property
    def words(self) -> str:
        """The words that tables have for a problem of the responses."""
        return FLAG_WORDS[self.code]

    @property
    def is_interpretable(self) -> bool:
        """Whether a subject with this problem of the responses is interpreted all the same."""
        return self.code not in FAULTS


Findings: TypeAlias = Iterable[Finding]


def answer_flags(study: Study) -> list[tuple[Finding, ...]]:
    """The findings about the responses of every subject, in the order of the study.

    Examples
    --------
    >>> subject = Subject("S01", [0, 0, 1, 1], [0, 1, 0, 1], [9, 9, 9, 9], [9] * 4)
    >>> [flag.words for flag in answer_flags(Study([subject]))[0]]
    ['fewer than 60 trials', 'all responses are the same']
    """
    flags = {name: list[Finding]() for name in study.names}
    for finding in check_answers(study):
        flags[finding.subject].append(finding)
    return list(map(tuple, flags.values()))


def not_interpreted(study: Study) -> dict[str, str]:
    """Subjects whose responses have a fault that allows no conclusion, with the first fault.

    Examples
    --------
    >>> subject = Subject("S01", [0, 0, 1, 1], [0, 1, 0, 1], [9, 9, 9, 9], [9] * 4)
    >>> not_interpreted(Study([subject]))
    {'S01': 'all responses are the same'}
    """
    faults: dict[str, str] = {}
    for finding in uninterpretable_findings(study):
        faults.setdefault(finding.subject, finding.words)
    return faults


@lru_cache(maxsize=4)  # a command asks for the findings of its study several times
def check_answers(study: Study) -> tuple[Finding, ...]:
    """Findings about the responses of every subject, with codes of :data:`FLAG_WORDS`."""
    require_study(study)
    alternatives = compare_alternatives(study)
    other_task_findings = _other_task(study, alternatives)
    limit = _guess_limit(alternatives, len(study))
    findings = []
    for subject in study:
        findings += other_task_findings.get(subject.name, [])
        findings += subject_findings(
            subject, len(study), alternatives.get(subject.name), guess_limit=limit
        )
    return tuple(findings)


def uninterpretable_findings(study: Study) -> list[Finding]:
    """Findings that forbid the interpretation of a subject."""
    return [finding for finding in check_answers(study) if not finding.is_interpretable]


def subject_findings(
    subject: Subject, n_subjects: int, alternatives: Alternatives | None, guess_limit: float
) -> Findings:
    """Findings about the responses of one subject, with limits for a study of `n_subjects`.

    `alternatives` are the log Bayes factors of other explanations; None if the subject leaves no
    doubt. The subject may guess if the log Bayes factor of guesses is above `guess_limit`.
    """
    yield from _repeated_trials(subject, n_subjects)
    if subject.total_trials < FEW_TRIALS:
        yield Finding(
            subject.name,
            "few_trials",
            f"Only {plural(subject.total_trials, 'trial')}, so the prior has much influence.",
        )
    answers = subject.answers_given
    if len(answers) == 1:
        yield Finding(subject.name, "one_answer", f"Every response is {answers[0]!r}.")

    swapped_blocks = list(_swapped_blocks(subject, n_subjects))
    yield from swapped_blocks
    # Swapped blocks differ from the other blocks, and may look like a drift or like guesses.
    # Findings of differences, drift or guesses would hide the cause, which is the swap.
    if swapped_blocks:
        return
    yield from _unlike_blocks(subject, n_subjects)
    yield from _drift(subject, n_subjects)
    if alternatives is not None:
        yield from _reversed_or_guessed(subject, n_subjects, alternatives, guess_limit)


def _reversed_or_guessed(
    subject: Subject, n_subjects: int, alternatives: Alternatives, guess_limit: float
) -> Findings:
    """A finding if swapped keys, or guesses, explain the responses far better than the observer."""
    # Not None: `compare_alternatives` leaves out a subject whose answers are all 'equal'.
    two_answers = cast(Subject, subject.two_answers)
    largest_factor = max(alternatives)
    # Guesses may look swapped by chance, so that swapped keys must be far more probable. The
    # observer of the four models has the log Bayes factor 0.
    margin = largest_factor - max(0.0, alternatives.guesses)
    is_sure = margin > evidence_limit(n_subjects, REFUSAL_SHARE)
    # A large constant error makes one answer rare, and is no guessing.
    neither_is_rare = _RARE_SHARE < two_answers.fraction_yes < 1.0 - _RARE_SHARE

    if largest_factor == alternatives.swapped and is_sure:
        yield Finding(
            subject.name,
            "reversed_answers",
            f"Responses look reversed. Check which code means {two_answers.task.yes!r}.",
            f"--swap {cli_argument(subject.name)}",
        )
    elif alternatives.guesses > guess_limit and not is_sure and neither_is_rare:
        yield Finding(
            subject.name,
            "independent_answers",
            "The responses say little about the stimuli. The subject guesses or hardly "
            "distinguishes them, or the file has other responses.",
        )


def _drawable_answers(subject: Subject) -> Answers | None:
    """The answered rows, of which the tests of blocks and of drift draw random tables.

    None if the subject has counts only, or too many trials. NumPy draws no multivariate
    hypergeometric numbers of 10^9 trials and more. Tables of so many also take long, so the limit
    is lower.
    """
    if subject.answers is None or subject.total_trials > 10**8:
        return None
    return subject.answers.answered


# --- Trials that are there twice -----------------------------------------------------------------


def _repeated_trials(subject: Subject, n_subjects: int) -> Findings:
    """One finding if long sequences of trials repeat the stimuli and answers of earlier trials.

    Trials without an answer are left out, and not counted.
    """
    if subject.answers is None or not subject.answers.has_trial_rows:
        return
    answers = subject.answers.answered
    n_rows = len(answers.n_trials)
    if n_rows < 2 * _WINDOW:  # no room for a window and its copy
        return

    is_copy = _copied_rows(subject, answers, n_subjects)
    if is_copy.any():  # argmax is the index of the first copy, and messages count from 1
        yield Finding(
            subject.name,
            "repeated_trials",
            f"{is_copy.sum()} of {n_rows} answered trials repeat earlier ones. The first copy "
            f"is answered trial {is_copy.argmax() + 1}. "
            "Remove the copies from the file. The option leaves out the whole subject.",
            f"--exclude {cli_argument(subject.name)}",
        )


def _copied_rows(subject: Subject, answers: Answers, n_subjects: int) -> BoolArray:
    """Whether each row belongs to a sequence of rows that is a copy of an earlier sequence.

    A list of stimuli may be used again on purpose, so that equal stimuli alone are no evidence of
    a copy. What counts is the probability that all answers of two sequences agree by chance. A
    sequence is a copy if this probability is below exp(-12), in a study of one subject.
    """
    # Rows with the same stimuli and answers have the same code, (rows,).
    rows = np.column_stack([answers.keys, answers.counts.T])
    _, codes = np.unique(rows, axis=0, return_inverse=True)

    # A window is a row and the rows after it. Its lag is how many rows before it the first equal
    # window begins, and 0 if no earlier window is equal.
    windows = np.lib.stride_tricks.sliding_window_view(codes.ravel(), _WINDOW)  # (windows, _WINDOW)
    _, first_window, group = np.unique(windows, axis=0, return_index=True, return_inverse=True)
    lag = np.arange(len(windows)) - first_window[group.ravel()]

    # A run has windows of the same lag in sequence, so that it repeats one earlier sequence. It
    # ends with the last row of its last window.
    run_start = run_starts(lag)  # the first row of each run
    run_end = np.append(run_start[1:], len(lag)) - 1 + _WINDOW  # the row after its last one
    nats_before = np.concatenate([[0.0], np.cumsum(_coincidence_nats(subject, answers))])
    nats_in_run = nats_before[run_end] - nats_before[run_start]

    # With a lag shorter than a window, a window overlaps its copy: this is the same trial several
    # times in sequence, and no copy. A study of n subjects has n times as many coincidences as one
    # subject, hence ln n.
    is_repeat = (lag[run_start] >= _WINDOW) & (nats_in_run > 12.0 + math.log(n_subjects))
    is_copy = np.zeros(len(rows), np.bool_)
    for start, end in zip(run_start[is_repeat], run_end[is_repeat], strict=True):
        is_copy[start:end] = True
    return is_copy


def _coincidence_nats(subject: Subject, answers: Answers) -> FloatArray:
    """Minus the log probability, (rows,), that a second answer to a row's pair agrees by chance.

    The probability is estimated from the answers to the pair, and from the right and wrong answers
    to all pairs. The larger estimate counts, so that agreement by chance does not look rarer than
    it is.
    """
    n = subject.n_trials  # (pairs,)
    k = subject.n_yes
    difference = subject.s2 - subject.s1
    n_wrong = subject.task.wrong(difference, k, n).sum()
    n_judged = n[subject.task.right(difference) != 0].sum()  # trials with a right answer
    agreement = np.maximum(_agreement(k, n), _agreement(int(n_wrong), int(n_judged)))
    return -np.log(agreement)[answers.pair]


def _agreement(k: IntArray | int, n: IntArray | int) -> FloatArray:
    """Probability that two answers are the same, if one of two answers was given k times in n."""
    p = (k + 0.5) / (n + 1.0)  # the posterior mean with Jeffreys' prior, never 0 or 1
    return np.square(p) + np.square(1.0 - p)  # both are this answer, or both the other one


# --- Other explanations --------------------------------------------------------------------------


def _guess_limit(alternatives: Mapping[str, Alternatives], n_subjects: int) -> float:
    """The log Bayes factor, nats, above which a subject guesses, by all subjects of the study.

    `alternatives` has the doubtful subjects. A few of them among sound ones need less evidence than
    many. If many subjects are doubtful, and guesses explain all of them together far better, any
    evidence will do, so that the limit is 0. Only 1 % of the studies of sound observers reach this
    limit, even if the noise of the observers is four times the difference of a pair.
    """
    if len(alternatives) <= n_subjects / 5:  # a few are doubtful
        return math.log(n_subjects)
    if sum(factors.guesses for factors in alternatives.values()) > 9.0 + n_subjects:
        return 0.0
    return evidence_limit(n_subjects, FALSE_ALARM_SHARE)


def has_other_task(alternatives: Alternatives, task: Task) -> bool:
    """Whether another task explains the responses of a subject best, and beyond its limit."""
    largest_factor = max(alternatives)
    return largest_factor == alternatives.other_task and largest_factor > OTHER_TASK_LIMITS[task]


def _other_task(study: Study, alternatives: Mapping[str, Alternatives]) -> dict[str, list[Finding]]:
    """Findings by subject, if more than half of the subjects seem to answer another task.

    In 2AFC no subject is then interpreted. In 'same or different?', a large constant error that
    subjects share looks like 2AFC, so that these subjects have a flag only.
    """
    names = [name for name in alternatives if has_other_task(alternatives[name], study.task)]
    if len(names) <= 0.5 * len(study):
        return {}

    subjects = f"{len(names)} of {plural(len(study), 'subject')}"
    if study.task.has_criterion:  # 'same or different?'
        code = "like_2afc"
        flagged = tuple(names)
        message = (
            f"P(equal) rises or falls with s2 - s1 in {subjects}. Check whether the question was "
            "'which was stronger?'. If it was 'same or different?', they share a large constant "
            "error."
        )
    else:
        code = "other_task"
        flagged = study.names
        message = (
            f"Responses look like another task. In {subjects}, P(second) is highest or lowest near "
            "s2 = s1, as in 'same or different?'. Check which code means 'equal'."
        )
    return {name: [Finding(name, code, message)] for name in flagged}


# --- The answers in their blocks, and in their order ---------------------------------------------


@dataclass(frozen=True)
class AnswerTable:
    """Answers n, and those k that the task counts, shape (pairs, blocks).

    For the test of drift, the columns are stretches of trials in place of blocks.
    """

    n: IntArray
    k: IntArray

    @property
    def is_mixed(self) -> BoolArray:
        """Whether a pair got both answers, shape (pairs,); otherwise its blocks cannot differ."""
        n_yes = self.k.sum(axis=1)
        return (n_yes > 0) & (n_yes < self.n.sum(axis=1))

    @property
    def excess_yes(self) -> IntArray:
        """The number of counted answers minus that of all other answers, (pairs, blocks)."""
        return 2 * self.k - self.n  # k - (n - k)

    def of_mixed_pairs(self) -> AnswerTable:
        """The table of the pairs with both answers, without which X^2 divides by 0."""
        return AnswerTable(self.n[self.is_mixed], self.k[self.is_mixed])

    @property
    def freedom(self) -> int:
        """Degrees of freedom of X^2: for each pair, one less than the blocks with this pair."""
        return int(np.maximum((self.n > 0).sum(axis=1) - 1, 0).sum())

    def block_chi_square(self, k: IntArray) -> FloatArray:
        """Each block's part of X^2 for counts k of tables with the margins of this one.

        That is the sum over pairs of (k - n p)^2 / (n p (1 - p)), with the share p of counted
        answers to a pair. From the shape (..., pairs, blocks) to (..., blocks).
        """
        p = self.k.sum(axis=1, keepdims=True) / self.n.sum(axis=1, keepdims=True)  # (pairs, 1)
        variance = np.where(self.n > 0, self.n * p * (1 - p), 1.0)  # an empty cell adds 0
        return (np.square(k - self.n * p) / variance).sum(axis=-2)

    def chi_square(self, k: IntArray) -> FloatArray:
        """X^2 for counts k of tables with these margins, (..., pairs, blocks) -> (...)."""
        return self.block_chi_square(k).sum(axis=-1)

    def other_logits(self) -> FloatArray:
        """Logit of the counted answer to a pair in all blocks but this one, (pairs, blocks).

        The half answer of Jeffreys' prior keeps it finite.
        """
        n_yes = self.k.sum(axis=1, keepdims=True) - self.k
        n_all = self.n.sum(axis=1, keepdims=True) - self.n
        return logit((n_yes + 0.5) / (n_all + 1.0))

    @property
    def chi_square_ratio(self) -> float:
        """X^2 over its degrees of freedom, about 1 if blocks differ by chance; 0 without these."""
        # Without freedom, X^2 is 0, and 0/1 avoids 0/0.
        return float(self.chi_square(self.k)) / max(1, self.freedom)

    def p_value(self, statistic: Callable[[IntArray], FloatArray], name: str) -> float:
        """Probability of a statistic at least as large if the answers to a pair fall at random.

        How many counted answers a pair has is given; any of its trials may have them. The statistic
        maps counts k, (tables, pairs, blocks), to one value a table. `name` is that of the subject,
        which has a random stream of its own.
        """
        rng = generator(0, name, "answers")  # seed 0: the same study has the same findings
        largest_batch = max(1, BLOCK // self.n.size)  # tables that take limited memory

        def simulate(n_tables: int) -> FloatArray:
            """The statistic of random tables with these margins, (tables,)."""
            statistics = []  # of each batch
            for start in range(0, n_tables, largest_batch):
                batch = min(largest_batch, n_tables - start)
                # For each pair, its counted answers in each block, (batch, blocks).
                k_of_pairs = [
                    rng.multivariate_hypergeometric(n, n_yes, batch)
                    for n, n_yes in zip(self.n, self.k.sum(axis=1), strict=True)
                ]
                statistics.append(statistic(np.stack(k_of_pairs, axis=1)))
            return np.concatenate(statistics)

        return simulated_p_value(float(statistic(self.k)), simulate)


def _tabulate(subject: Subject, answers: Answers, column: IntArray) -> AnswerTable:
    """The counts of a subject's answers by pair and column.

    `column` is the column of the table, a block or a stretch, for each row of `answers`.
    """
    cell = answers.pair, column
    n, k = np.zeros((2, subject.n_pairs, column.max() + 1), np.int64)
    np.add.at(n, cell, answers.n_trials)
    np.add.at(k, cell, answers.n_yes)
    return AnswerTable(n, k)


def _swapped_blocks(subject: Subject, n_subjects: int) -> Findings:
    """Blocks with swapped response keys, in one finding.

    The blocks are reported if their swap makes all blocks more alike, and makes the responses of
    the whole subject far more probable.
    """
    # Of three answers, 'second' and 'first'; None if all are 'equal', which has no opposite.
    two_answers = subject.two_answers
    if two_answers is None:
        return
    answers = _drawable_answers(two_answers)
    if answers is None or answers.block is None:
        return
    table = _tabulate(two_answers, answers, answers.block)
    mixed_pairs = table.of_mixed_pairs()
    if mixed_pairs.freedom == 0:  # no pair with both answers is in two blocks
        return

    is_swapped = _find_swapped(table, two_answers.task, two_answers.s2 - two_answers.s1)
    # If all blocks are swapped, the keys of the subject are swapped, which is another finding.
    if not is_swapped.any() or is_swapped.all():
        return
    # The swap must halve the difference between blocks at least. Blocks that differ by chance have
    # a ratio of 1.
    excess = mixed_pairs.chi_square_ratio - 1.0
    remaining_excess = _swap_blocks(table, is_swapped).of_mixed_pairs().chi_square_ratio - 1.0
    if remaining_excess >= 0.5 * max(0.0, excess):
        return

    # And the swap must make the responses of the whole subject far more probable.
    is_swapped_row = is_swapped[answers.block]
    corrected = Subject.from_answers(
        subject.name, answers.swapped(is_swapped_row), two_answers.task
    )
    n_tests = n_subjects * len(is_swapped)  # one test for each block of each subject
    if log_bayes_factor(corrected, two_answers) > evidence_limit(n_tests, REFUSAL_SHARE):
        blocks = list(compress(answers.blocks, is_swapped))
        noun = "block" if len(blocks) == 1 else "blocks"
        yield Finding(
            subject.name,
            "swapped_blocks",
            f"Responses look swapped in {noun} {join_words(map(display_name, blocks))}.",
            f"--swap {cli_argument(subject.name, blocks)}",
        )


def _unlike_blocks(subject: Subject, n_subjects: int) -> Findings:
    """A finding that names the block that differs most, if blocks differ by more than chance."""
    answers = _drawable_answers(subject)
    if answers is None or answers.block is None:
        return
    table = _tabulate(subject, answers, answers.block).of_mixed_pairs()
    # Blocks whose X^2 is at most its mean do not differ, so that no tables need be drawn.
    if table.chi_square_ratio <= 1.0:
        return

    p = table.p_value(table.chi_square, subject.name)
    if p <= 0.5 * flag_limit(n_subjects):  # the test of drift has the other half
        block = answers.blocks[table.block_chi_square(table.k).argmax()]
        yield Finding(
            subject.name,
            "block_dispersion",
            f"Block {display_name(block)} differs from the others ({describe_p_value(p)}). "
            "Intervals are too narrow if blocks differ.",
        )


def _swap_blocks(table: AnswerTable, is_swapped: BoolArray) -> AnswerTable:
    """The table where each answer in some blocks is the other one: k becomes n - k."""
    return AnswerTable(table.n, np.where(is_swapped, table.n - table.k, table.k))


def _find_swapped(table: AnswerTable, task: Task, difference: FloatArray) -> BoolArray:
    """Whether the answers of each block agree with the other blocks only if they are swapped.

    A block is first swapped if its counted answers are rarer where the task expects them more
    often. Blocks that disagree with other blocks are then swapped, or swapped back, until nothing
    changes. This leaves two camps: swapped blocks and others. The camp with the expected relation
    counts as right. `difference` is s2 - s1 of each pair, (pairs,).
    """
    if task == SAME_DIFFERENT:
        trend = -np.abs(difference)
        # A constant error makes 'equal' more frequent on one side of s2 = s1.
        tilt = difference
    else:
        trend = difference
        tilt = np.zeros(len(difference))
    # The task expects the counted answer more often where this trend of a pair is above 0. In a
    # block that follows the task, the sum over pairs of trend times excess is above 0.
    expected_trend = trend - trend.mean()
    is_swapped: BoolArray = expected_trend @ table.excess_yes < 0  # (blocks,)

    for _ in range(20):  # two blocks might swap each other without an end
        corrected = _swap_blocks(table, is_swapped)
        # A block disagrees if its more frequent answers are the rarer answers in other blocks.
        disagrees = (corrected.excess_yes * corrected.other_logits()).sum(axis=0) < 0
        if not disagrees.any():
            break
        is_swapped = is_swapped ^ disagrees

    # If all blocks together contradict the task, the other camp is the swapped camp.
    if np.sum(expected_trend @ _swap_blocks(table, is_swapped).excess_yes) < 0:
        is_swapped = ~is_swapped
    return _surely_swapped(table, is_swapped, tilt)


def _surely_swapped(table: AnswerTable, candidates: BoolArray, tilt: FloatArray) -> BoolArray:
    """The candidates that are likely swapped, (blocks,); none if no candidate is surely swapped.

    A gain of log evidence of 2 nats makes a swap likely, one of 5 nats makes it sure. A candidate
    that is not likely joins the blocks that candidates are compared with. This changes the evidence
    of the other candidates.
    """
    no_block = np.zeros_like(candidates)
    while candidates.any():
        gain = _swap_gain(_swap_blocks(table, candidates), tilt)
        likely: BoolArray = candidates & (gain > 2.0)
        if np.array_equal(likely, candidates):
            return candidates if gain[candidates].max() > 5.0 else no_block
        candidates = likely
    return no_block


def _swap_gain(table: AnswerTable, tilt: FloatArray) -> FloatArray:
    """Log evidence of each block as it is, minus that of its swapped form, nats, (blocks,).

    In both forms, a block is answered as the other blocks are, but it may prefer one answer more
    than they do, and its answers may tilt. So a block whose criterion moved does not look swapped.
    An evidence is the sum of prior times likelihood over a grid of preferences and slopes, whose
    constants cancel. With the other blocks' logit, the logit of the counted answer is

        logit + preference + slope * tilt,   tilt from -1 to 1.
    """
    logits = table.other_logits()  # (pairs, blocks)
    # In 2AFC, and without different stimuli, all tilts are 0, and 0/1 avoids 0/0.
    relative_tilt = tilt[:, None] / (np.abs(tilt).max() or 1.0)  # (pairs, 1)
    slopes = _TILT_SCALE * _LOGIT_SHIFTS if tilt.any() else np.zeros(1)

    unswapped = []  # log of prior times likelihood at each grid point, (blocks,) each
    swapped = []
    for preference, slope in product(_LOGIT_SHIFTS.tolist(), slopes.tolist()):
        shifted_logits = logits + preference + slope * relative_tilt
        log_prior = -abs(preference) - abs(slope) / _TILT_SCALE  # Laplace's
        # k ln P + (n - k) ln(1 - P) = k x - n ln(1 + exp(x)), with P = 1/(1 + exp(-x)).
        log_rest = table.n * np.logaddexp(0.0, shifted_logits)
        log_unswapped = table.k * shifted_logits - log_rest  # (pairs, blocks)
        log_swapped = (table.n - table.k) * shifted_logits - log_rest
        unswapped.append(log_prior + log_unswapped.sum(axis=0))
        swapped.append(log_prior + log_swapped.sum(axis=0))
    return logsumexp(unswapped, axis=0) - logsumexp(swapped, axis=0)


def _drift(subject: Subject, n_subjects: int) -> Findings:
    """Answers that change slowly over the trials: trends, and waves as of a moving criterion.

    A change of a share below 0.2 hardly matters for pooled counts, and is not reported.
    """
    answers = _drawable_answers(subject)
    if answers is None or not answers.has_trial_rows:
        return
    # Stretches of equally many trials in place of blocks; ten follow three half waves well.
    n_rows = len(answers.n_trials)
    n_stretches = min(10, n_rows)
    stretch = np.arange(n_rows) * n_stretches // n_rows  # of each row
    table = _tabulate(subject, answers, stretch)
    difference = (subject.s2 - subject.s1)[table.is_mixed]  # (mixed pairs,)
    table = table.of_mixed_pairs()  # other pairs cannot drift
    if table.freedom == 0:
        return

    # The kinds of what may drift. The counted answer to a pair raises a kind where the value of the
    # pair is 1, and lowers it where the value is -1.
    kinds = {
        f"P({subject.task.yes})": np.ones(len(difference)),
        "share of correct responses": subject.task.right(difference),
    }
    if subject.task.has_criterion:
        kinds["order effect"] = np.sign(difference)
    # Half a wave, a whole wave, and one and a half waves, from the first trial to the last.
    time = (np.arange(n_stretches) + 0.5) / n_stretches  # the middle of each stretch
    waves = np.cos(np.pi * np.outer([1, 2, 3], time))  # (waves, stretches)
    weights = _wave_weights(table.n, waves, np.array(list(kinds.values())))

    def amplitudes(k: IntArray) -> FloatArray:
        """The amplitudes of waves, (..., pairs, stretches) -> (..., kinds, waves)."""
        return np.tensordot(k, weights, ((-2, -1), (2, 3)))  # sums over pairs and stretches

    def powers(k: IntArray) -> FloatArray:
        """The power of each kind, (..., pairs, stretches) -> (..., kinds)."""
        return np.square(amplitudes(k)).sum(axis=-1)

    # The kind that drifts most, and the range of its fitted course over the trials.
    largest_kind = powers(table.k).argmax()
    change = np.ptp(amplitudes(table.k)[largest_kind] @ waves)  # over the stretches
    if change < 0.2:
        return
    p = table.p_value(lambda k: powers(k).max(axis=-1), subject.name)
    if p <= 0.5 * flag_limit(n_subjects):  # the test of blocks has the other half
        yield Finding(
            subject.name,
            "drift",
            f"Responses drift ({describe_p_value(p)}). The {[*kinds][largest_kind]} changes by "
            f"{change:.2f} over the trials.",
        )


def _wave_weights(n: IntArray, waves: FloatArray, kinds: FloatArray) -> FloatArray:
    """Weights w of the counts k: the sum of w k is the least-squares amplitude of a kind's wave.

    w = x / sum(n x^2) with x = kind times centred wave. n has the shape (pairs, stretches), waves
    (waves, stretches), and kinds (kinds, pairs). The weights have (kinds, waves, pairs, stretches).
    """
    # Waves without their mean over the trials of each pair, because pairs have rates of their own.
    pair_means = (waves @ n.T) / n.sum(axis=1)  # (waves, pairs)
    centred = waves[:, None, :] - pair_means[:, :, None]  # (waves, pairs, stretches)
    x = kinds[:, None, :, None] * centred
    squares = (n * np.square(x)).sum(axis=(2, 3), keepdims=True)
    # A kind that is 0 for all pairs has no amplitude, and 0/1 avoids 0/0.
    return x / np.where(squares > 0.0, squares, 1.0)
