"""Screens: fixed tables, only known digits, of many subjects only those that need action."""

import re
from dataclasses import replace

import numpy as np
import pytest
from conftest import each_row

import bayes_toe as bt
from bayes_toe.answers.order_effect import MISFIT_FLAG, Problem, format_draws
from bayes_toe.answers.serial_dependence import EFFECT_MODELS, SerialDependence, SubjectDependence
from bayes_toe.cli.answer_screen import flagged, print_subjects, without_decision
from bayes_toe.cli.group_screen import print_history
from bayes_toe.cli.inference_commands import print_draws
from bayes_toe.cli.terminal import (
    WIDTH,
    Terminal,
    cell_width,
    command_lines,
    format_table,
    wrap_line,
)


@pytest.fixture
def hundred_answers(analysis):
    """Answers of a hundred subjects S0 to S99: the blocks of S98 differ, and S99 does not fit."""
    # The hundred subjects have the answers of A, B and C by turns.
    answers = [replace(analysis.answers[i % 3], subject=f"S{i}", problems={}) for i in range(100)]
    problem_of_98 = Problem("Block 3 differs from the others (p < .001).", "--exclude S98:3")
    problem_of_99 = Problem("The model does not fit.", "--exclude S99")
    answers[98] = replace(answers[98], problems={"blocks differ": problem_of_98})
    answers[99] = replace(answers[99], fit_p=0.0001, problems={MISFIT_FLAG: problem_of_99})
    return answers


def test_of_many_subjects_the_table_has_those_that_need_action(
    hundred_answers, capsys, monkeypatch
):
    # The typed option for block 2 of S99 gives way to the proposed option for all of S99.
    monkeypatch.setattr(
        "bayes_toe.cli.terminal.TYPED_WORDS", ["run", "study.csv", "--exclude", "S99:2"]
    )
    print_subjects(Terminal(), hundred_answers, "evidence.csv")
    text = capsys.readouterr().out
    assert re.findall(r"^(S\d+) ", text, re.MULTILINE) == ["S98", "S99"]
    assert "The other 98 subjects need no action. All 100 subjects: evidence.csv" in text
    assert "! S98  Block 3 differs from the others (p < .001).\n" in text
    assert "       type: --exclude S98:3\n" in text
    command = "bayes-toe run study.csv --overwrite --exclude S98:3 --exclude S99"
    assert text.endswith(f"To apply all of these, type:\n  {command}\n")


def test_it_is_said_that_no_subject_needs_a_decision_only_if_none_does(hundred_answers):
    # The sentence is missing if a subject has a problem, as S98 and S99 have, or if draws did not
    # converge.
    without_problems = hundred_answers[:98]
    all_converged = {}
    sentence = ["No subject needs a decision."]
    assert without_decision(without_problems, all_converged) == sentence
    assert without_decision(without_problems, {"S3": "R-hat 1.2"}) == []
    assert without_decision(hundred_answers, all_converged) == []


def test_an_effect_that_is_probably_absent_has_no_size(small_study, capsys):
    sizes = {"rho": (0.1, 0.3, 0.5), "kappa": (0.2, 0.4, 0.6)}
    # The Bayes factor of carry-over is exp(-1.5) = .22, 'probably not'. That of the previous
    # response is 1, 'undecided': with and without the previous response, one model has carry-over
    # and one has not, so the evidences are the same.
    log_evidence = np.where(EFFECT_MODELS["carry_over"], -1.5, 0.0)
    row = SubjectDependence("A", ("none", "contraction"), log_evidence, **sizes)
    table = SerialDependence((row,), small_study, seed=1, prior=bt.Prior())
    print_history(Terminal(), table, "history.csv")
    text = capsys.readouterr().out
    # Carry-over, whose size is rho, is probably absent and has no size. The size of the previous
    # response is kappa.
    assert re.search(r"^A +probably not +- +undecided +\.40 \[\.20, \.60\]$", text, re.MULTILINE)


def test_many_draws_are_shown_if_they_did_not_converge(analysis, capsys, monkeypatch):
    # Here, two subjects are many already. The draws of C did not converge.
    monkeypatch.setattr("bayes_toe.cli.terminal.MANY_SUBJECTS", 2)
    monkeypatch.setattr(bt.Draws, "not_converged", property(lambda _: {"C": "few draws"}))
    print_draws(Terminal(), analysis.draws)
    text = capsys.readouterr().out
    assert re.findall(r"^[ABC] ", text, re.MULTILINE) == ["C "]
    assert "The draws of 2 other subjects converged." in text
    assert "! C  The draws did not converge: few draws." in text


def test_of_25_notes_20_are_printed_and_the_others_counted(capsys):
    # A note has a subject, a text and an option.
    Terminal().notes([("", f"note {i}", "") for i in range(25)])
    text = capsys.readouterr().out
    assert text.count("note ") == 20
    assert "... and 5 more in the output" in text


@pytest.mark.parametrize(
    "headings, rows, expected",
    [
        (
            # A name that is too long is cut in its middle.
            ["subject", "1", "words"],
            [["a_very_long_name_of_a_subject_17", "2", "word " * 11 + "word"]],
            [
                "subject            1 words",
                "a_very_lon...ct_17 2 " + "word " * 11 + "word",
            ],
        ),
        (
            # Columns that do not fit follow below.
            ["subject", "1", "left", "right"],
            [["A", "2", "l" * 40, "r" * 40]],
            [
                "subject  1  left",
                "A        2  " + "l" * 40,
                "",
                "subject  right",
                "A        " + "r" * 40,
            ],
        ),
        # Each of three Chinese characters takes two columns.
        (["subject", "1"], [["\u88ab\u9a13\u8005", "2"]], ["subject  1", "\u88ab\u9a13\u8005   2"]),
    ],
)
def test_tables_have_fixed_columns_and_fit_the_screen(headings, rows, expected):
    # The second column has numbers, which are aligned to the right.
    lines = format_table(headings, rows, numeric=[1])
    assert lines == expected
    assert max(map(cell_width, lines)) <= WIDTH


def test_an_estimate_stays_on_one_line_with_its_interval():
    # 13 words of 5 characters leave 15 columns of 80: 'PSE shift' stays, and the estimate begins a
    # new line.
    text = "word " * 13 + "PSE shift +0.2 % [-6.6, +7.5], contraction p = .19 [.10, .27]."
    _, second_line = wrap_line(text)
    assert second_line == "+0.2 % [-6.6, +7.5], contraction p = .19 [.10, .27]."


def test_an_option_stays_on_one_line_with_its_value():
    command = "bayes-toe run " + "study.csv " * 5 + "--swap A08:2,4 --exclude A09"
    assert command_lines(command, "  ") == [
        "  bayes-toe run " + "study.csv " * 5 + "\\",
        "    --swap A08:2,4 --exclude A09",
    ]
    # A name with spaces is not broken, although it is longer than a line.
    name = "a long name of a file/" * 3 + "study of 2024.csv"
    assert f"'{name}'" in "\n".join(command_lines(f"bayes-toe run '{name}'", "  "))


#: The largest draw (the smallest is 0), how many draws are effective, the largest number of
#: decimals, and the text.
DIGITS = """
    2 | 201 | 3 | 1.00 [0.05, 1.95]
    2 | 201 | 1 | 1.0 [0.1, 1.9]
    1000 | 201 | 3 | 500 [20, 980]
    1e6 | 20 | 2 | 500000 [0, 1000000]
    0 | 201 | 2 | 0.00 [0.00, 0.00]
    1 | nan | 3 | 0.500 [0.025, 0.975]
"""


@each_row("largest, n_effective, decimals, expected", DIGITS)
def test_digits_end_where_the_error_begins(largest, n_effective, decimals, expected):
    # 201 draws are spread evenly from 0 to `largest`, so the median is half of `largest`. The 95 %
    # interval follows it. With few effective draws, the errors of these numbers are large, and
    # fewer digits are known. No number has more than `decimals` decimals.
    draws = np.linspace(0.0, float(largest), 201)
    assert format_draws(draws, float(n_effective), int(decimals)) == expected


def test_subjects_that_need_action_are_flagged(analysis_with_problems):
    # A does not fit, C is not interpreted, and the draws of B did not converge.
    answers = analysis_with_problems.answers
    assert flagged(answers) == ["A", "C"]
    assert flagged(answers, {"B": "few draws"}) == ["A", "B", "C"]
