"""Small studies, an analysis of them, and the paths of the real data where they are present."""

import gc
import importlib
import os
import re
import shlex
import signal
import tempfile
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from browsers import launched_browser
from hypothesis import settings

import bayes_toe as bt
from bayes_toe.answers.words import Word
from bayes_toe.data.options import parse_columns
from bayes_toe.data.tasks import SAME_DIFFERENT, WHICH_STRONGER

# Modules that take seconds to load are imported by the functions that use them: the process that
# hands the tests to others waits for this file, and needs none of them.

REAL = Path(__file__).resolve().parents[2] / "shared" / "data"


def pytest_configure(config):
    """Listen to interrupts, which processes started in the background ignore."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    if hasattr(config, "workerinput"):  # of several processes that run tests
        import_arviz_beside_others()


def import_arviz_beside_others():
    """Import ArviZ while another process may do the same.

    ArviZ 0.23 notes the day of its warning in a file at its first import. Where two processes do so
    at once, one has a FileNotFoundError, and the day is noted at its second attempt.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            importlib.import_module("arviz")
        except FileNotFoundError:
            importlib.import_module("arviz")


def pytest_collection():
    """Do not look for garbage among libraries and tests, which all stay."""
    gc.disable()


def pytest_collection_finish():
    """Look for garbage from here on, and only among the objects that tests make."""
    gc.freeze()
    gc.set_threshold(10_000)  # fewer looks than Python's own: each takes time
    gc.enable()


BOTH_TASKS = pytest.mark.parametrize(
    "task", [SAME_DIFFERENT, WHICH_STRONGER], ids=["same/different", "2AFC"]
)


def text_table(text):
    """The rows of a text, each with its cells between bars.

    `a | b c |` has the cells 'a', 'b c' and ''; a bar without spaces belongs to its cell.
    """
    cell_border = r"(?:^| )\|(?: |$)"
    return [re.split(cell_border, line.strip()) for line in text.strip().splitlines()]


def each_row(parameters, text):
    """Run a test once for each row of a text, with the cells as these parameters."""
    return pytest.mark.parametrize(parameters, text_table(text))


def typed_options(line):
    """ReadOptions from a line as it is typed, such as `--unit g --columns i1=w1,i2=w2`."""
    values = {}
    for text in re.split("(?:^| )--", line)[1:]:  # 'unit g', and 'columns i1=w1,i2=w2'
        option, *words = shlex.split(text)
        name, value = option.replace("-", "_").removesuffix("_condition"), " ".join(words)
        if name in ("columns", "where"):
            value = parse_columns(value)
        if name == "intensity":
            value = float(value)
        if name in ("missed", "ignore"):
            value = [*values.get(name, []), value]
        values[name] = value or True  # such as --standard-first, which has no value
    return bt.ReadOptions(**values)


def typed_lines(stderr):
    """The options of each line that a refusal says to type, without the reasons.

    `type:  --second-code 2  if 2 is 'second'` gives ['--second-code 2'].
    """
    _, _, lines = stderr.partition("type:  ")
    return [line.strip().partition("  ")[0] for line in lines.splitlines()]


def read(text, options=""):
    """The study in a file study.csv with this text or these bytes, read with typed options."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "study.csv")
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return bt.read_study(path, typed_options(options))


def answers_in_order(subject):
    """A text for each row of a subject's answers in their order, such as 'block 2* 0.0 0.3 1/1'.

    It has the block, * where a session begins, both stimuli, and yes/trials.
    """
    answers, rows = subject.answers, []
    starts = np.where(answers.is_session_start, "*", "")
    for i, (s1, s2) in enumerate(answers.keys.tolist()):
        block = answers.blocks[answers.block[i]]
        rows.append(f"block {block}{starts[i]} {s1} {s2} {answers.n_yes[i]}/{answers.n_trials[i]}")
    return rows


def columns(rows):
    """The columns of numbers in rows that commas separate: '1 2, 3 4' gives [1, 3] and [2, 4]."""
    return np.array([row.split() for row in rows.split(",")], float).T


def made_subject(rows, name="S", task=SAME_DIFFERENT):
    """A subject from rows of s1, s2, n_yes, n_trials (and perhaps an interval), such as '0 .3 2 5'.

    n_yes are the answers that the task counts: 'equal', or 'second' in 'which was stronger'.
    """
    return bt.Subject(name, *columns(rows), task=task)


def subject_of_pairs(pairs, n_trials=10, name="S01", share_yes=0.4, **keywords):
    """A subject with so many trials of each pair (s1, s2), and a share of 'equal' (or 'second')."""
    s1, s2 = np.transpose(pairs)
    n_yes = int(share_yes * n_trials)
    return bt.Subject(name, s1, s2, [n_yes] * len(s1), [n_trials] * len(s1), **keywords)


def five_pairs(task=SAME_DIFFERENT, *, name="S", factor=1.0, shift=0.0, n_times=1):
    """A subject with five pairs of stimuli, which may be in another unit or have more trials.

    Stimuli are multiplied by `factor` and moved by `shift`, and all counts multiplied by `n_times`.
    """
    s1, s2, n_yes, n_trials = columns(
        "0 0 45 50, 0 0.5 20 50, 0.5 0 15 50, 0.25 0.375 30 40, 0.125 0.75 2 50"
    )
    stimuli = factor * s1 + shift, factor * s2 + shift
    return bt.Subject(name, *stimuli, n_times * n_yes, n_times * n_trials, task=task)


@pytest.fixture(scope="session")
def small_study():
    """Three ordinary observers of the paper's kinds A, B and C, who judge same or different.

    They have 50 trials of each of the 13 pairs of the reference design, 650 each, with rounded
    expected counts.
    """
    from bayes_toe.design.study_design import reference_design

    kinds = {
        # mu1, sigma_p, sigma_l, q0
        "A": (-0.7, 0.25, 0.17, 0.92),
        "B": (1.2, 0.25, 0.18, 0.9),
        "C": (0.25, 0.22, 0.15, 0.95),
    }
    design, subjects = reference_design(), []
    for name, parameters in kinds.items():
        p_equal = bt.model.equal_probability(design.s1, design.s2, *parameters)
        n_equal = np.rint(design.n_trials * p_equal).astype(int)
        subjects.append(design.answered(n_equal, name))
    return bt.Study(subjects, source="three kinds")


def quick_study(names):
    """A study of same or different that is quickly analysed: a subject for each of these names.

    All subjects have the same four pairs with 50 trials each, and different counts.
    """
    rows = "0 0 45 50, 0 0.3 {} 50, 0.3 0 15 50, 0.3 0.3 46 50"
    return bt.Study([made_subject(rows.format(20 - k), name) for k, name in enumerate(names)])


def hard_and_ordinary_subjects():
    """Subjects of the task same/different by name: the hard cases, and those of the example."""
    from reference.hard_cases import hard_cases

    subjects = hard_cases()
    for subject in bt.example_study("same/different"):
        subjects[subject.name] = subject
    return subjects


@pytest.fixture(scope="session")
def analysis(small_study):
    """The small study (A, B, C) analysed under the paper's prior, with 2,000 draws and more."""
    return bt.run(small_study, draws=2000, seed=5, prior="paper")


def expected_counts(name="S", c=0.0, p=0.0, n=100, noise=0.2, step=0.25, level=0.0):
    """Rounded expected counts of an observer of 2AFC with constant error c and contraction p.

    The ten pairs are neighbours among six levels, in both orders, with n trials each. `level` is
    the lowest level, and `step` the distance between neighbours. The lapse rate is .02.
    """
    from scipy.special import ndtr
    from serial_observers import STEP, neighbouring_pairs

    s1, s2 = level + step / STEP * neighbouring_pairs(WHICH_STRONGER).T
    p_second = 0.01 + 0.98 * ndtr((s2 - s1 - c + p * (s1 - s1.mean())) / noise)
    n_yes = np.rint(n * p_second).astype(int)
    return bt.Subject(name, s1, s2, n_yes, [n] * 10, task=WHICH_STRONGER)


@pytest.fixture(scope="session")
def stronger():
    """An analysis of two observers asked which was stronger: 'pulled' has a contraction of 35 %.

    'plain' has no order effect.
    """
    subjects = [expected_counts("pulled", p=0.35, n=60), expected_counts("plain", n=60)]
    return bt.run(bt.Study(subjects, source="which is stronger"), draws=500, seed=2)


def enlarged_table(table, size, pattern="S{}"):
    """An evidence table with `size` rows: those of a table again and again, under other names."""
    rows = []
    for i in range(size):
        row, name = table.rows[i % len(table)], pattern.format(i)
        rows.append(replace(row, subject=name, answer=replace(row.answer, subject=name)))
    return replace(table, rows=tuple(rows))


def leave_pictures_blank(patch):
    """Make figures of a results folder, but write 1,000 zero bytes as PNG instead of drawing."""
    for module in ("results_folder", "report"):
        patch.setattr(f"bayes_toe.cli.{module}.png", lambda figure, **_: b"\x89PNG" + bytes(1000))


@pytest.fixture
def blank_pictures(monkeypatch):
    """Figures of a results folder are made and not drawn, for tests of all that is around them."""
    leave_pictures_blank(monkeypatch)


@pytest.fixture(scope="module")
def browser():
    """One browser for all pages of a test file.

    The fixture has the scope of a module because Playwright's event loop runs while the browser is
    open, and no other loop, such as that of asyncio.run, can begin meanwhile.
    """
    with launched_browser() as open_browser:
        yield open_browser


@pytest.fixture(scope="session")
def vibrotactile(real_data):
    """A real study of 'same or different'; blocks that look swapped are not swapped."""
    path = real_data / "vibrotactile_rate" / "trials.csv"
    return bt.read_study(path, bt.ReadOptions(equal_code="1"))


@pytest.fixture(scope="session")
def real_data():
    """The folder of real studies; tests that need it are skipped where it is absent."""
    if not REAL.is_dir():
        pytest.skip("the folder of real studies is not here")
    return REAL


def s1_s2_yes_trials(subject):
    """The pairs of a subject: tuples of s1, s2, n_yes (answers that the task counts), n_trials."""
    columns = subject.s1, subject.s2, subject.n_yes, subject.n_trials
    return list(zip(*(column.tolist() for column in columns), strict=True))


def results_of(jobs, workers):
    """The results of jobs that have no names and whose progress is not reported, in their order."""
    from bayes_toe.workers import run_in_order

    return run_in_order(jobs, workers, progress=None, names=[()] * len(jobs))


def refused(message, error=bt.InputError):
    """A block that must be refused with an error whose text has this pattern."""
    return pytest.raises(error, match=message)


def problems(call, *arguments, **options):
    """The lines of the InputError with which a call must be refused."""
    with pytest.raises(bt.InputError) as refusal:
        call(*arguments, **options)
    return list(refusal.value.problems)


#: A letter for each word of an answer.
WORD_BY_LETTER = {
    "y": Word.YES,
    "p": Word.PROBABLY,
    "u": Word.UNDECIDED,
    "q": Word.PROBABLY_NOT,
    "n": Word.NO,
    "c": Word.CANNOT_BE_TOLD,
    "x": Word.NOT_INTERPRETABLE,
}


def order_answer(subject, words, **fields):
    """The answer of a subject with three words, for order effect, constant error and contraction.

    All fields that are not given have neutral values.
    """
    from bayes_toe.answers.order_effect import QUESTIONS, OrderEffect
    from bayes_toe.inference.order_evidence import MODEL_NAMES

    zeros = dict.fromkeys(MODEL_NAMES, 0.0)
    neutral_fields = {
        "direction": "contraction",
        "is_interpretable": Word.NOT_INTERPRETABLE not in words,
        "probabilities": dict.fromkeys(QUESTIONS, 0.5),
        "log_bayes_factors": dict.fromkeys(QUESTIONS, 0.0),
        "sizes": {},
        "upper_bounds": dict.fromkeys(QUESTIONS, 0.2),
        "best_model": "both",
        "fit_p": 0.5,
        "history_p": None,
        "moving_criterion_p": None,
        "log_evidence": zeros,
        "standard_error": zeros,
        "laplace": zeros,
    }
    words = dict(zip(QUESTIONS, words, strict=True))
    return OrderEffect(subject=subject, words=words, **neutral_fields | fields)


def write_counts(path, study):
    """Write a study as a file of counts, a row for each pair of a subject; return its path."""
    study.frame().drop(columns="synthetic", errors="ignore").to_csv(path, index=False)
    return path


@pytest.fixture
def study_csv(tmp_path, small_study):
    """The path of study.csv, which has the small study; nothing else is in its folder."""
    return write_counts(tmp_path / "study.csv", small_study)


os.environ.setdefault("COLUMNS", "140")
# Only tests that ask for workers have some. Any other worker would load all libraries for a job or
# two.
os.environ.setdefault("LOKY_MAX_CPU_COUNT", "1")
# With HYPOTHESIS_PROFILE=night, each night has other files, and many of them. Tests that set a
# number of files keep their number.
settings.register_profile("day", max_examples=60, deadline=None, derandomize=True, database=None)
settings.register_profile("night", max_examples=20_000, deadline=None)
