"""The screens as texts: a table of subjects with all its marks, and no line over 80 columns."""

import re

import numpy as np
import pandas as pd
import pytest
from commands import inside
from populations import independent_draws

import bayes_toe as bt
from bayes_toe.answers.order_effect import (
    MISFIT_FLAG,
    PRIOR_FLAG,
    QUESTIONS,
    OrderEffect,
    Problem,
    Size,
)
from bayes_toe.answers.words import Word
from bayes_toe.checks.identification import ONE_FIRST_STIMULUS
from bayes_toe.cli.answers import print_answer, print_subjects
from bayes_toe.cli.check_screen import describe_pairs
from bayes_toe.cli.terminal import WIDTH, Terminal, cell_width
from bayes_toe.inference.order_evidence import MODEL_NAMES

YES, PROBABLY, UNDECIDED = Word.YES, Word.PROBABLY, Word.UNDECIDED
PROBABLY_NOT, NO, CANNOT = Word.PROBABLY_NOT, Word.NO, Word.CANNOT_BE_TOLD


def conclusion(name, words, shift=(0, 0, 0), p=(0, 0, 0), *, flag="", problem="", option=""):
    """A conclusion with these words, sizes and one flag."""
    problems = (Problem(problem, option),) if problem else ()
    is_interpretable = Word.NOT_INTERPRETABLE not in words
    reasons = {"contraction": ONE_FIRST_STIMULUS} if words[2] is CANNOT else {}
    return OrderEffect(
        subject=name,
        words=dict(zip(QUESTIONS, words, strict=True)),
        direction="contraction" if p[1] >= 0 else "repulsion",
        is_interpretable=is_interpretable,
        flags=(flag,) if flag else (),
        probabilities=dict.fromkeys(QUESTIONS, 0.97),
        log_bayes_factors=dict.fromkeys(QUESTIONS, 3.0),
        sizes={"pse_shift_percent": Size(*shift), "contraction_p": Size(*p)},
        upper_bounds=dict.fromkeys(QUESTIONS, 0.2),
        best_model="both",
        predictive_p=0.001 if flag == MISFIT_FLAG else 0.5,
        deviance_p=0.5,
        history_p=None,
        log_evidence=dict.fromkeys(MODEL_NAMES, 0.0),
        standard_error=dict.fromkeys(MODEL_NAMES, 0.02),
        laplace=dict.fromkeys(MODEL_NAMES, 0.0),
        reasons=reasons,
        problems=problems,
    )


STUDY = [
    conclusion("A01", (YES, YES, YES), (8.2, 11.7, 16.1), (0.2, 0.29, 0.36)),
    conclusion("A02", (YES, YES, NO), (18, 23, 29)),
    conclusion("A03", (YES, NO, YES), p=(-0.38, -0.35, -0.28)),
    conclusion("A04", (YES, YES, PROBABLY), (-14, -9.4, -5.2), (0.03, 0.17, 0.3)),
    conclusion("A05", (PROBABLY, UNDECIDED, CANNOT), (-1.1, 4.0, 8.4)),
    conclusion(
        "A06",
        (UNDECIDED, UNDECIDED, UNDECIDED),
        (-3.1, 2.9, 9.3),
        (-0.001, 0.1, 0.24),
        flag=f"{PRIOR_FLAG}: contraction",
        problem="A prior twice as wide changes contraction from 'undecided' to 'probably not'.",
    ),
    conclusion("A07", (PROBABLY_NOT, PROBABLY_NOT, PROBABLY_NOT)),
    conclusion(
        "A08",
        (Word.NOT_INTERPRETABLE,) * 3,
        flag="responses look swapped",
        problem="Responses look swapped in blocks 2 and 4.",
        option="--swap A08:2,4",
    ),
]
SCREEN = """
        order        constant                  PSE shift, %     contraction p
subject effect       error        contraction  [95 % interval]  [95 % int.]
A01     yes          yes          yes          +12 [+8,+16]     .29 [.20,.36]
A02     yes          yes          no           +23 [+18,+29]    -
A03     yes          no           yes          -                -.35 [-.38,-.28]
A04     yes          yes          probably     -9 [-14,-5]      .17 [.03,.30]
A05     probably     undecided    (a)          +4.0 [-1.1,+8.4] -
A06 ?   undecided    undecided    undecided    +2.9 [-3.1,+9.3] .10 [.00,.24]
A07     probably not probably not probably not -                -
A08 !   not interpreted: responses look swapped
(a) Cannot be told, because the first stimulus is always the same, so a
    contraction looks like a constant error.

! A08  Responses look swapped in blocks 2 and 4.
       type: bayes-toe run study.csv -o results --swap A08:2,4

? A06  A prior twice as wide changes contraction from 'undecided' to 'probably
       not'.

Answer
Order effect: 4 of 7 subjects yes, 1 probably, 1 undecided, 1 probably not.
Constant error: 3 yes (2 overestimate the first stimulus, 1 underestimates it),
2 undecided, 1 probably not, 1 no.
Contraction: 2 yes (1 contraction, 1 repulsion), 1 probably, 1 undecided, 1
probably not, 1 no, 1 cannot be told.
Group of 7: PSE shift +5 % [-3, +13], SD 9 %, BF 0.4 (undecided); contraction
p = .19 [.08, .30], SD .12, BF 18 (probably).
A08 is not counted. Start with results/report.html. Seed 1.
"""


def test_the_screen_of_run_is_this_text(capsys, monkeypatch):
    typed = ["run", "study.csv", "-o", "results"]
    monkeypatch.setattr("bayes_toe.cli.terminal.TYPED", typed)
    study = bt.Study([bt.Subject("A01", [0.0], [0.3], [2], [5])])
    out = Terminal()
    print_subjects(out, STUDY, "results/report.html")
    group = (
        "Group of 7: PSE shift +5 % [-3, +13], SD 9 %, BF 0.4 (undecided); contraction p = "
        ".19 [.08, .30], SD .12, BF 18 (probably)."
    )
    print_answer(out, STUDY, study, [group], ["Start with results/report.html.", "Seed 1."])
    assert capsys.readouterr().out == SCREEN


@pytest.mark.parametrize(
    ("pairs", "text"),
    [
        ([(0, 0), (0, 1), (1, 0)], "1 equal one, and 1 different one, in both orders"),
        ([(0, 0), (1, 1), (0, 1)], "2 equal ones, and 1 different one in one order only"),
        (
            [(0, 1), (1, 0), (0, 2), (2, 0), (1, 2)],
            "2 different ones, each in both orders, and 1 different one in one order only",
        ),
    ],
)
def test_pairs_are_counted_whatever_their_order(pairs, text):
    for shown in (pairs, pairs[::-1]):
        s1, s2 = zip(*shown, strict=True)
        subject = bt.Subject("A", s1, s2, [2] * len(shown), [4] * len(shown))
        assert describe_pairs(bt.Study([subject])) == f"Pairs: {text}"


# --- Every command --------------------------------------------------------------------------------

PAIRS = [(0.0, 0.3), (0.3, 0.0), (0.3, 0.6), (0.6, 0.3), (0.6, 0.9), (0.9, 0.6)]
SEED = ("--seed", 1, "--workers", 1)
DESIGN = ("--lowest", 0, "--highest", 1, "--step", 0.25, "--observers", "both", "--data-sets", 1)
LONG = "subject with a rather long name"
ONE = ("--exclude", LONG)
#: Each screen: the words that are typed, without `bayes-toe`.
COMMANDS = {
    "check": ("check", "trials.csv"),
    "check --prior": ("check", "trials.csv", "--prior", "default"),
    "run": ("run", "trials.csv", "-o", "out", "--draws", 200, "--figures", "none", *SEED),
    "evidence": ("evidence", "trials.csv", "-o", "evidence.csv", *SEED),
    "sample": ("sample", "trials.csv", "-o", "draws.nc", "--draws", 200, *ONE, *SEED),
    "fit": ("fit", "trials.csv", "-o", "fit.csv", "--replicates", 5, *SEED),
    "population": ("population", "trials.csv", "--draws", 4000, "-o", "group.nc", "--seed", 1),
    "contrast": ("contrast", "trials.csv", "--condition", "hand", "-o", "hands.csv", *SEED),
    "history": ("history", "trials.csv", "-o", "history.csv", *SEED),
    "power": ("power", "--trials", 130, "--data-sets", 1, "--observers", "both", *SEED),
    "design": ("design", *DESIGN, "--trials", 100, "--list", "list.csv", *SEED),
    "simulate": ("simulate", "-o", "made.csv", "--subjects", 2, "--batches", 2, "--seed", 1),
}
#: Words that are not those of the field.
FORBIDDEN = (
    r"\bpull(s|ed)?\b|\b(?<!cannot be )(told|tells?)\b|\bkept\b|\bpictures?\b|kind (is )?open|"
    r"P\(none\)|is said|has a say|not described|\brobust\b|\bverdicts?\b|free frequenc|both ways|"
    r"one peak|sloped|less H0|in the light of|(subjects?|fit) alone|\b(those|for|of) who\b|"
    r"\b0\.00\b|left out|\banswered\b"
)


@pytest.fixture(scope="module")
def screens(tmp_path_factory):
    """What each command prints of two subjects, one with a long name and swapped responses."""
    folder = tmp_path_factory.mktemp("screens")
    rng = np.random.default_rng(4)
    rows = []
    for name, shift in (("S1", 0.1), (LONG, 0.0)):
        for trial in range(240):
            s1, s2 = PAIRS[rng.integers(len(PAIRS))]
            block = trial // 48
            is_second = (s2 - s1 - shift + rng.normal(0.0, 0.2) > 0) ^ (name == LONG and block == 1)
            response = "second" if is_second else "first"
            hand = ("left", "right")[trial % 2]
            rows.append((name, block, trial, s1, s2, response, hand))
    columns = ["subject", "block", "trial", "s1", "s2", "response", "hand"]
    pd.DataFrame(rows, columns=columns).to_csv(folder / "trials.csv", index=False)
    texts = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("bayes_toe.groups.population.sample_group", independent_draws)
        for name, words in COMMANDS.items():
            done = inside(*words, cwd=folder)
            assert done.returncode in (0, 3), (name, done.stderr)
            texts[name] = done.stdout
    return texts


@pytest.mark.parametrize("name", COMMANDS)
def test_no_line_is_longer_than_80_columns(screens, name):
    lines = screens[name].splitlines()
    assert lines
    assert [line for line in lines if cell_width(line) > WIDTH] == []


@pytest.mark.parametrize("name", COMMANDS)
def test_screens_have_the_words_of_the_field(screens, name):
    text = " ".join(screens[name].split())
    assert re.findall(rf".{{20}}(?:{FORBIDDEN})", text) == []


@pytest.mark.parametrize("name", ["check", "run", "evidence", "population", "history"])
def test_swapped_responses_are_named_with_what_to_type(screens, name):
    text = " ".join(screens[name].split())
    assert f"--swap '{LONG}:1'" in text
    assert text.index("swapped") < text.index("Answer")
