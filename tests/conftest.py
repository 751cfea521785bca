"""Small studies, an analysis of them, and the paths of the real data where they are present."""

import gc
import importlib
import os
import signal
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from browsers import launched
from hypothesis import settings

import bayes_toe as bt
from bayes_toe.analysis import Analysis
from bayes_toe.answers.order_effect import QUESTIONS, OrderEffect
from bayes_toe.answers.words import Word
from bayes_toe.data.tasks import SAME_DIFFERENT, WHICH_STRONGER
from bayes_toe.design.study_design import reference_design
from bayes_toe.inference.order_evidence import MODEL_NAMES

REAL = Path(__file__).resolve().parents[2] / "shared" / "data"


def pytest_configure(config):
    """Listen to interrupts, which processes started in the background ignore."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    import_arviz_once(config)


def import_arviz_once(config):
    """Import ArviZ in one process at a time.

    ArviZ 0.23 notes the day of its warning in a file at its first import. Two processes at once end
    in a FileNotFoundError.
    """
    if config.getoption("numprocesses", None) and not hasattr(config, "workerinput"):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            importlib.import_module("arviz")


def pytest_collection():
    """Do not look for garbage among libraries and tests, which all stay."""
    gc.disable()


def pytest_collection_finish():
    """From here on it is looked for among what tests make."""
    gc.freeze()
    gc.set_threshold(10_000)
    gc.enable()


def text_table(text):
    """The rows of a text, each with its cells between bars, as parameters of a test."""
    return [line.strip().split(" | ") for line in text.strip().splitlines()]


def columns(rows):
    """The columns of numbers in rows that commas separate."""
    return np.array([row.split() for row in rows.split(",")], float).T


def made_subject(rows, name="S", task=SAME_DIFFERENT):
    """A subject by rows of s1, s2, answers that the task counts, trials and perhaps an interval."""
    return bt.Subject(name, *columns(rows), task=task)


def observer_counts(mu1, sigma_p, sigma_l, q0, n=50):
    """Rounded expected counts in the paper's design."""
    design = reference_design()
    q = bt.model.equal_probability(design.s1, design.s2, mu1, sigma_p, sigma_l, q0)
    return design.s1, design.s2, np.rint(n * q).astype(int), np.full(len(q), n)


@pytest.fixture(scope="session")
def small_study():
    """Three ordinary observers of the paper's kinds A, B and C."""
    kinds = {
        "A": (-0.7, 0.25, 0.17, 0.92),
        "B": (1.2, 0.25, 0.18, 0.9),
        "C": (0.25, 0.22, 0.15, 0.95),
    }
    return bt.Study(
        [bt.Subject(name, *observer_counts(*kind)) for name, kind in kinds.items()],
        source="three kinds",
    )


def few_pairs(names):
    """A study that costs little: four pairs of every subject."""
    pairs = [0.0, 0.0, 0.3, 0.3], [0.0, 0.3, 0.0, 0.3]
    return bt.Study(
        [bt.Subject(name, *pairs, [45, 20 - k, 15, 46], [50] * 4) for k, name in enumerate(names)]
    )


def known_observers(names):
    """Bundled subjects under other names: a group of them is quickly sampled."""
    pairs = zip(names, bt.example_study("same/different"), strict=False)
    return bt.Study([replace(subject, name=name) for name, subject in pairs], synthetic=True)


@pytest.fixture(scope="session")
def analysis(small_study) -> Analysis:
    """Draws and evidence of the small study under the paper's prior, in this process."""
    return bt.run(small_study, draws=2000, seed=5, prior="paper", workers=1)


def stronger_counts(name, pull, mu1, n=60):
    """Rounded expected answers 'which is stronger' to neighbours of six levels in both orders."""
    levels = np.linspace(0.0, 1.25, 6)
    s1, s2 = np.r_[levels[:-1], levels[1:]], np.r_[levels[1:], levels[:-1]]
    design = bt.Subject(name, s1, s2, np.zeros(10, int), np.full(10, n), task=WHICH_STRONGER)
    target = bt.model.paper_posterior(design)
    sigma_l = 0.2 * pull**0.5 / (1.0 - pull)
    truth = {"mu1": mu1, "sigma_p": 0.2, "sigma_l": sigma_l, "lapse_rate": 0.04}
    log_yes = target.log_answers(target.points(truth)[None])[0][0]
    return replace(design, n_yes=np.rint(n * np.exp(log_yes)).astype(int))


@pytest.fixture(scope="session")
def stronger() -> Analysis:
    """Two observers who were asked which is stronger.

    One whose memory is pulled, and one whose is hardly.
    """
    study = bt.Study(
        [stronger_counts("pulled", 0.35, 0.4), stronger_counts("plain", 0.001, 0.6)],
        source="which is stronger",
    )
    return bt.run(study, draws=500, seed=2, workers=1)


def leave_pictures_blank(patch):
    """Make the figures of a results folder, and do not draw them."""
    for module in ("results_folder", "report"):
        patch.setattr(f"bayes_toe.cli.{module}.png", lambda figure, **_: b"\x89PNG" + bytes(1000))


@pytest.fixture
def blank_pictures(monkeypatch):
    """Figures of a results folder are made and not drawn: for what stands around them."""
    leave_pictures_blank(monkeypatch)


@pytest.fixture(scope="module")
def browser():
    """One browser for the pages of a file.

    While it is open an event loop runs, in which no other can begin.
    """
    with launched() as opened:
        yield opened


@pytest.fixture(scope="session")
def vibrotactile(real_data):
    """A real study of 'same or different', as it stands."""
    path = real_data / "vibrotactile_rate" / "trials.csv"
    return bt.read_study(path, bt.ReadOptions(equal_code="1"))


@pytest.fixture(scope="session")
def real_data():
    """The folder of real studies; tests that need it are skipped where it is absent."""
    if not REAL.is_dir():
        pytest.skip("the folder of real studies is not here")
    return REAL


def counts(subject):
    """The pairs of a subject, each with its counts."""
    columns = subject.s1, subject.s2, subject.n_yes, subject.n_trials
    return list(zip(*(column.tolist() for column in columns), strict=True))


def problems(call, *arguments):
    """The problems of a call that is refused."""
    with pytest.raises(bt.InputError) as refusal:
        call(*arguments)
    return list(refusal.value.problems)


def order_answer(subject, words, **fields):
    """The answer of a subject in which only the words and these fields say something."""
    unknown = dict.fromkeys(MODEL_NAMES, 0.0)
    neutral = {
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
        "log_evidence": unknown,
        "standard_error": unknown,
        "laplace": unknown,
    }
    words = dict(zip(QUESTIONS, words, strict=True))
    return OrderEffect(subject=subject, words=words, **neutral | fields)


def grouped_csv(path, study):
    """Write a study as counts."""
    lines = ["subject,s1,s2,n_equal,n_trials"]
    for subject in study:
        lines += [f"{subject.name},{s1!r},{s2!r},{k},{n}" for s1, s2, k, n in counts(subject)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


@pytest.fixture
def study_csv(tmp_path, small_study):
    """The small study as a file."""
    return grouped_csv(tmp_path / "study.csv", small_study)


os.environ.setdefault("COLUMNS", "140")
os.environ.setdefault(
    "LOKY_MAX_CPU_COUNT", "1"
)  # workers where a test asks for some: others would load all libraries for a job or two
# HYPOTHESIS_PROFILE=night: other files each night, and many of them; tests that set their own
# numbers keep these.
settings.register_profile("day", max_examples=60, deadline=None, derandomize=True, database=None)
settings.register_profile("night", max_examples=20_000, deadline=None)
