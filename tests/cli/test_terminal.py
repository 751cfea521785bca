"""What the terminal says: no digit that is not known; of very many subjects those first that need attention, and a count of the rest."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import bayes_toe as bt
from bayes_toe.answers.order_effect import MISFIT_FLAG
from bayes_toe.cli.answers import say_answers
from bayes_toe.cli.describe import say_fits
from bayes_toe.cli.headline import flagged, p_value, told
from bayes_toe.cli.infer import say_draws
from bayes_toe.cli.terminal import MOST_ROWS, Terminal, allowed, allowed_in_order, once
from bayes_toe.inference.predictive_checks import MISFIT


def rows_of(text, names):
    """Which of the names begin a row of a table, in their order."""
    first = [line.strip("│ ").split(" ")[0] for line in text.splitlines() if line.startswith("│")]
    return [one for one in first if one in names]


@pytest.fixture
def many(analysis):
    """Answers of a hundred subjects: the last does not fit, and one before has unlike blocks."""
    answers = [
        replace(analysis.answers[i % 3], subject=f"S{i}", notes=("the same note",))
        for i in range(100)
    ]
    answers[98] = replace(answers[98], flags=("unlike blocks",), options=("--exclude S98",))
    answers[99] = replace(answers[99], predictive_p=0.001, flags=(MISFIT_FLAG,))
    return answers


def test_tables_of_very_many_subjects_end_with_a_count_and_begin_with_those_that_need_action(
    analysis, many, capsys
):
    say_answers(Terminal(), many, analysis.study, "evidence.csv")
    text = capsys.readouterr().out
    # A name is cut at the first space, before its mark.
    shown = rows_of(text, {answer.subject for answer in many})
    assert shown == ["S98", "S99", *(f"S{i}" for i in range(MOST_ROWS - 2))]
    assert text.count("... and 50 more in evidence.csv") == 1
    assert "action S98: unlike blocks; run again with --exclude S98" in text
    assert "action S99: the model does not fit" in text
    assert "S0, S1, S2, S3, S4, ... and 95 more: the same note" in text
    assert text.index("action S98") < text.index("answer: Order effect: ")


def test_up_to_so_many_rows_all_are_there_in_their_order(analysis, many, capsys):
    few = [many[99], *many[: MOST_ROWS - 1]]
    say_answers(Terminal(), few, analysis.study)
    text = capsys.readouterr().out
    assert rows_of(text, {answer.subject for answer in few}) == [answer.subject for answer in few]
    assert "more in" not in text


def test_medians_of_many_are_of_those_first_that_did_not_converge(analysis, capsys, monkeypatch):
    monkeypatch.setattr("bayes_toe.cli.terminal.MOST_ROWS", 2)
    monkeypatch.setattr(bt.Draws, "not_converged", property(lambda _: {"C": "few draws"}))
    say_draws(Terminal(), analysis.draws, "summary.csv")
    said = capsys.readouterr().out
    assert rows_of(said, set("ABC")) == ["C", "A"]
    assert "... and 1 more in summary.csv" in said
    assert "not converged C: few draws" in said


def test_a_table_and_notes_that_are_cut_say_so(analysis, capsys):
    out = Terminal()
    out.table("title", [{"subject": f"S{i}"} for i in range(1100)])
    assert "... and 1,050 more in the output" in capsys.readouterr().out
    fit = replace(analysis.fits.rows[0], notes=tuple(f"note {i}" for i in range(25)))
    say_fits(out, replace(analysis.fits, rows=(fit,)))
    assert "... and 5 more in the output" in capsys.readouterr().out
    assert once([(f"S{i}", "short") for i in range(5)]) == ["S0, S1, S2, S3, S4: short"]


@pytest.mark.parametrize(
    ("value", "error", "most", "shown"),
    [
        (0.123456, 0.004, 6, "0.123"),
        (0.123456, 0.004, 2, "0.12"),  # never more than asked for
        (0.123456, 0.0096, 6, "0.12"),  # 0.01 to one digit
        (0.123456, 0.0094, 6, "0.123"),
        (-1.2345, 0.1, 3, "-1.2"),
        (9.96, 0.2, 3, "10.0"),
        (-0.03, 0.2, 3, "0.0"),  # no minus before nothing
        (12.6, 3.0, 3, "13"),
        (1234.5, 30.0, 3, "1230"),
        (-1.0e20, 1.0e18, 2, "-100000000000000000000"),
        (12.0, 300.0, 2, "0"),
        (1.5, math.nan, 3, "1.500"),
        (1.5, 0.0, 3, "1.500"),
        (1.5, math.inf, 3, "1.500"),
        (1.5, 1e-300, 3, "1.500"),
        (np.float64(0.98765), np.float64(0.02), 3, "0.99"),
        (math.nan, 0.1, 2, "nan"),
    ],
)
def test_digits_end_where_the_error_begins(value, error, most, shown):
    assert allowed(value, error, most) == shown


@pytest.mark.parametrize(
    ("values", "errors", "shown"),
    [
        (
            [0.12, 0.51, 2.34],
            [0.01, 0.002, 0.2],
            ["0.12", "0.51", "2.3"],
        ),  # each by its own error, in their order
        (
            [49.6, 40_213.0, 86_443.6],
            [20.0, 3e5, 0.004],
            ["0", "40000", "90000"],
        ),  # not 50, 0, 86443.60
        ([0.0, 77.3, 345_678.0], [3e4, 1.0, 9e4], ["0", "77", "350000"]),
        (
            [0.12, 0.123, 0.15],
            [0.1, 0.1, 0.01],
            ["0.12", "0.12", "0.15"],
        ),  # alike with all the decimals that there may be
        ([0.0, 0.0, 0.0], [math.nan] * 3, ["0.00"] * 3),
    ],
)
def test_a_median_is_shown_between_its_limits(values, errors, shown):
    assert allowed_in_order(values, errors, 2) == shown
    assert [float(text) for text in shown] == sorted(float(text) for text in shown)


LIMITS = (0.05, 0.25, 0.75, 0.95)


@given(
    st.one_of(
        st.floats(0.0, 1.0),
        st.builds(lambda limit, off: limit + off, st.sampled_from(LIMITS), st.floats(-1e-3, 1e-3)),
    )
)
def test_a_probability_is_printed_on_its_side_of_every_limit(p):
    shown = told(p)
    assert abs(float(shown) - p) <= 0.005 + 1e-12
    assert all((float(shown) > one) == (p > one) for one in LIMITS if abs(p - one) > 1e-14)


@pytest.mark.parametrize("value", [0.00951, 0.00999, 0.0099999, MISFIT, 0.01001, 0.0149])
def test_a_p_value_below_the_limit_of_a_misfit_looks_so(value):
    assert (float(p_value(value)) < MISFIT) == (value < MISFIT)


def test_who_must_be_looked_at_and_why(marked):
    assert flagged(marked.evidence) == {
        "A": ("poor fit",),
        "C": ("not interpreted",),
    }
    assert flagged(marked.evidence, {"B": "few draws"})["B"] == ("not converged",)
