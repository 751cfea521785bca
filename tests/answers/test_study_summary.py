"""The answer of a study: counts that add up, directions, how frequent an effect is."""

import pytest
from conftest import order_answer

import bayes_toe as bt
from bayes_toe.analysis import _group
from bayes_toe.answers.order_effect import Size
from bayes_toe.answers.study_summary import (
    FALSE_ALARMS,
    effect_frequency,
    few_subjects_lines,
    study_lines,
)
from bayes_toe.answers.words import Word


def answer(name, words, shift=5.0, **fields):
    sizes = {
        "pse_shift_percent": Size(shift - 1.0, shift, shift + 1.0),
        "contraction_p": Size(0.1, 0.2, 0.3),
    }
    return order_answer(name, words, sizes=sizes, **fields)


STUDY = [
    answer("A", (Word.YES, Word.YES, Word.YES)),
    answer("B", (Word.YES, Word.YES, Word.PROBABLY), shift=-5.0, direction="repulsion"),
    answer("C", (Word.PROBABLY, Word.UNDECIDED, Word.NO), fit_p=0.001),
    answer("D", (Word.NOT_INTERPRETABLE,) * 3, flags=("responses look swapped",)),
]


def test_directions_and_exceptions_are_named():
    assert study_lines(STUDY) == [
        "Order effect: 2 of 3 subjects yes, 1 probably.",
        "Constant error: 2 yes (1 overestimates the first stimulus, 1 underestimates it), "
        "1 undecided.",
        "Contraction: 1 yes, 1 probably (1 repulsion), 1 no.",
        f"The model does not fit 1 subject: C. {FALSE_ALARMS}",
        "Without C, yes or probably: order effect 2 of 2.",
    ]


def test_a_question_that_no_subject_can_answer_has_one_sentence():
    words = (Word.YES, Word.YES, Word.CANNOT_BE_TOLD)
    *_, contraction = study_lines([answer("A", words), answer("B", words)])
    assert contraction == "Contraction: cannot be told in any subject."
    assert study_lines([STUDY[3]] * 2) == ["No subject can be interpreted."]


def test_one_subject_is_described_in_full_and_synthetic_ones_are_called_so():
    (line,) = study_lines(STUDY[:1])
    assert line.startswith("A: Order effect: yes (P = .50). Constant error: yes")
    assert "of 3 synthetic subjects" in study_lines(STUDY, synthetic=True)[0]


def test_frequency_is_that_of_the_beta_binomial_where_every_answer_is_certain():
    answers = []
    for i, log_odds in enumerate((300.0, 300.0, 300.0, -300.0)):
        evidence = {"none": 0.0, "contraction": 0.0, "constant error": log_odds, "both": log_odds}
        answers.append(answer(str(i), (Word.YES,) * 3, log_evidence=evidence))
    expected = {"constant_error": (3 + 1) / (4 + 2), "contraction": 0.5}
    frequencies = {name: effect_frequency(answers, name) for name in expected}
    assert frequencies == pytest.approx(expected, abs=1e-3)


def test_frequency_needs_two_interpretable_subjects():
    assert few_subjects_lines(STUDY[:1]) == few_subjects_lines([STUDY[0], STUDY[3]]) == []
    assert few_subjects_lines(STUDY[:1] * 6) == []
    (line,) = few_subjects_lines(STUDY[:3])
    assert "These shares do not say how large" in line


def test_frequency_names_no_effect_that_the_design_cannot_show():
    words = (Word.YES, Word.YES, Word.CANNOT_BE_TOLD)
    answers = [answer("S01", words), answer("S02", words)]
    (line,) = few_subjects_lines(answers)
    assert "constant error" in line
    assert "contraction" not in line


def test_run_fits_the_group_of_six_interpretable_subjects_and_no_fewer(monkeypatch):
    fitted = []
    monkeypatch.setattr(
        "bayes_toe.analysis.population",
        lambda study, **options: fitted.append((study.names, options)),
    )
    study = bt.example_study("same/different").select([f"S{i:02d}" for i in range(1, 8)])

    def group_without(*names):
        return _group(study, [answer(name, (Word.NO,) * 3) for name in names], seed=4)

    group_without("S01")
    assert fitted == [(study.names[1:], {"seed": 4})]
    assert group_without("S01", "S02") is None
    assert len(fitted) == 1
