"""Stimuli in decibels and in grams: the numbers are those of natural logs, shown in the unit."""

import re

import numpy as np
import pandas as pd
import pytest
from commands import run_ok
from conftest import columns, each_row, expected_counts, typed_options
from legible import texts_of, words_of

import bayes_toe as bt
from bayes_toe.answers.order_effect import Size, format_difference
from bayes_toe.checks.answer_checks import check_answers
from bayes_toe.data.stimulus_unit import StimulusUnit

#: Decibels of a factor of e: a natural log of 1.
DECIBELS_OF_E = 20.0 / np.log(10.0)


@pytest.fixture(scope="module")
def study_in_logs():
    """S01 and S06 of the example, whose stimuli are natural logs."""
    return bt.example_study().select(["S01", "S06"])


@pytest.fixture(scope="module")
def study_in_decibels(study_in_logs):
    """The same study in decibels; the reference is at 60 dB."""
    return study_read_in_unit(
        study_in_logs, 60.0 + DECIBELS_OF_E * study_in_logs.frame()[["s1", "s2"]], "dB"
    )


def study_read_in_unit(study, stimuli, unit, reference=None):
    """The study as it is read from a table with these stimuli in a unit."""
    table = study.frame().drop(columns=["s1", "s2", "synthetic"])
    names = ["s1", "s2"] if unit == "dB" else ["i1", "i2"]
    table[names] = stimuli
    return bt.read_study(table, bt.ReadOptions(unit=unit, intensity=reference))


@pytest.fixture(scope="module")
def evidence_in_decibels(study_in_decibels):
    return bt.evidence(study_in_decibels, seed=1)


def test_decibels_change_what_is_shown_and_no_number(
    study_in_logs, study_in_decibels, evidence_in_decibels
):
    answers_in_logs = bt.evidence(study_in_logs, seed=1).answers
    for answer, answer_in_logs in zip(evidence_in_decibels.answers, answers_in_logs, strict=True):
        percent = answer_in_logs.sizes["pse_shift_percent"].q50
        size = answer.sizes["pse_shift_percent"]
        assert size.q50 == pytest.approx(percent, rel=1e-5)
        # A shift of 26 % is a factor of 1.26, which is 2 dB.
        shift = DECIBELS_OF_E * np.log1p(percent / 100.0)
        _, median, _ = answer.unit.from_percent(size)
        assert median == pytest.approx(shift, rel=1e-5)
    answer = evidence_in_decibels["S01"].answer
    assert " dB [" in answer.describe()
    assert "%" not in answer.format_size("jnd_percent")


def test_a_file_of_draws_has_the_unit(study_in_decibels, tmp_path):
    # The axes of figures from a loaded file are in dB, and a first stimulus is the reference, 60
    # dB.
    bt.sample(study_in_decibels.select("S01"), draws=100, seed=1).save(tmp_path / "posterior.nc")
    draws = bt.load(tmp_path / "posterior.nc")
    assert draws.study.unit == study_in_decibels.unit
    corner = bt.plots.corner(draws, "S01", coordinates=["pse_shift"])
    assert "PSE shift, dB" in words_of(texts_of(corner))
    words = words_of(texts_of(bt.plots.curves(draws, "S01")))
    assert "second minus first\nstimulus, dB" in words
    assert "first stimulus 60 dB" in words


def test_figures_and_tables_name_the_unit(study_in_decibels, evidence_in_decibels):
    # A natural log of 0 is a difference of 0 dB.
    words = words_of(texts_of(bt.plots.order_effect(evidence_in_decibels)))
    assert "PSE shift (dB)\nabove 0: first stimulus overestimated" in words
    assert bt.asymmetry(study_in_decibels).unit.describe(0.0) == "0 dB"


def test_screens_have_the_unit(study_in_decibels, tmp_path):
    # The frame has natural logs, and the file gets decibels.
    table = study_in_decibels.frame()
    table[["s1", "s2"]] *= DECIBELS_OF_E
    table.to_csv(tmp_path / "levels.csv", index=False)
    screen = run_ok("evidence levels.csv --unit dB -o evidence.csv --seed 1", cwd=tmp_path)
    assert "PSE shift, dB" in screen
    assert "PSE shift, %" not in screen


@pytest.mark.parametrize("digits", [2, 3, 6])
@pytest.mark.parametrize("task", ["which is stronger", "same/different"])
def test_rounded_intensities_are_judged_as_exact_ones(task, digits):
    study = bt.example_study(task)
    # Stimuli in grams with so many significant digits. Rounding must not look as if the task were
    # another one, or as if the answers were reversed.
    grams = 10.0 * np.exp(study.frame()[["s1", "s2"]])
    rounded_study = study_read_in_unit(
        study, grams.map(lambda value: float(f"{value:.{digits}g}")), "g", 10.0
    )
    codes = {finding.code for finding in check_answers(rounded_study)}
    assert "other_task" not in codes
    assert "reversed_answers" not in codes


@pytest.mark.parametrize("mean", [850.0, -850.0])
def test_a_mean_beyond_all_exponentials_has_per_cent(mean):
    # exp(850) is no float, and exp(-850) is 0. Stimuli are in per cent of the mean.
    unit = bt.example_study().unit.or_percent_of(mean)
    assert unit.to_stimuli([mean, mean + np.log(1.2)]) == pytest.approx([100.0, 120.0])


GRAMS = "740 905, 905 740, 1105 1350, 1350 1105"


def table_of_trials(pairs, names="s1,s2"):
    """A table of trials with pairs such as `740 905, 905 740`.

    The responses are 'second' and 'first' by turns.
    """
    rows = [pair.split() for pair in pairs.split(", ")]
    table = pd.DataFrame(rows, columns=names.split(","))
    return table.assign(subject="A", response=["second", "first"] * (len(rows) // 2))


@pytest.mark.parametrize("scale", [1.0, 0.01])
@pytest.mark.parametrize("shift", [0.0, 5.0, 20.72])
def test_natural_logs_need_no_unit_whatever_their_reference(scale, shift):
    # Natural logs of grams relative to 740 g, and to smaller references; a scale of .01 is for
    # stimuli that differ little.
    s1, s2 = scale * np.log(columns(GRAMS) / 740) + shift
    table = table_of_trials(GRAMS).assign(s1=s1, s2=s2)
    assert bt.read_study(table).unit.name == ""


def test_natural_logs_may_differ_by_three():
    # A difference of 3 is a factor of 20, which is large for a study.
    assert bt.read_study(table_of_trials("0 3, 3 0")).unit.name == ""


#: Pairs, among whose stimuli two differ by rounding; options; and the end of the doubt.
ROUNDED = """
    .3 .30000001, .3 .5, .5 .3, .30000001 .5, .5 .3, .3 .5 |  | 0.3
    30 30.000001, 30 50, 50 30, 30.000001 50, 50 30, 30 50 | --unit um | 30 um
"""


@each_row("pairs, options, end", ROUNDED)
def test_stimuli_that_differ_by_rounding_are_merged_and_said(pairs, options, end):
    # Such as '.3 .30000001, .3 .5, .5 .3': two stimuli make three pairs.
    study = bt.read_study(table_of_trials(pairs), typed_options(options))
    assert len(np.unique(study["A"].stimuli)) == 2
    assert study["A"].n_pairs == 3  # One of the pairs has equal stimuli.
    doubt = study.reading.doubts[0]
    assert "stimuli in 2 rows differ by rounding only, and are read as one: " in doubt
    assert doubt.endswith(end)


def test_one_mistyped_stimulus_merges_no_others():
    # Beside 2.9 the difference of 1e-4 is small, but all other trials have it.
    study = bt.read_study(table_of_trials("0 1e-4, 1e-4 0, " * 30 + "0 2.9, 2.9 0"))
    assert study["A"].n_pairs == 4
    assert "rounding" not in " ".join(study.reading.doubts)


#: Low, middle and high quantile of a difference in per cent, the unit of the stimuli, and the text.
SIZES = """
    2 5 9 | um | +5.0 % [+2.0, +9.0]
    -40 5 999 |  | +5 % [-40, +999]
    -40 5 1001 |  | +0.05 ln [-0.5, +2.4]
    -99 -5 3 |  | -0.1 ln [-4.6, +0.03]
    230315 3.4e7 9.95e9 | um | +13 ln [+8, +18]
    3 inf inf |  | > 700 ln [+0.030, > 700]
    -100 -50 10 |  | -0.69 ln [< -30, +0.10]
    0.0021 0.0030 0.0042 |  | +0.0030 % [+0.0021, +0.0042]
    19.9981 20 20.0019 |  | +20.000 % [+19.998, +20.002]
    900 2000 3000 | dB | +26 dB [+20, +30]
"""


@each_row("quantiles, unit, expected", SIZES)
def test_sizes_beyond_1000_percent_are_logs_and_small_ones_have_their_digits(
    quantiles, unit, expected
):
    # Such as the quantiles '2 5 9': '+5.0 % [+2.0, +9.0]'. In decibels 900 % is 20 dB.
    size = Size(*map(float, quantiles.split()))
    assert format_difference(size, StimulusUnit(unit)) == expected


def observers_with_errors(step, level):
    """A study of 'up', who overestimates the first stimulus, and 'down', who underestimates it.

    Their pairs are neighbouring levels, `step` apart; `level` is the lowest level.
    """
    options = {"n": 60, "noise": step, "step": step, "level": level}
    error = 0.9 * step
    up = expected_counts("up", error, **options)
    down = expected_counts("down", -error, **options)
    return bt.Study([up, down])


#: Infinite numbers, an interval that rounds to 0, and per cents from 1000 on.
FORBIDDEN = re.compile(r"\b(inf|nan)\b|0\.0+ % \[[+-]?0\.0+,|[1-9]\d{3,}(\.\d+)? %")


#: Steps of a factor of 400, which are shown as logs.
WIDE_STEPS = {"step": 6.0, "level": 0.0}
#: Steps of 2e-5 above 20.72.
FINE_STEPS = {"step": 2e-5, "level": 20.72}


@pytest.mark.parametrize(
    "levels, unit, is_in_logs",
    [(WIDE_STEPS, "--unit ln", True), (FINE_STEPS, "", False)],
    ids=["wide", "fine"],
)
def test_nothing_shows_an_infinite_a_huge_or_an_empty_size(levels, unit, is_in_logs, tmp_path):
    study = observers_with_errors(**levels)
    study.frame().to_csv(tmp_path / "study.csv", index=False)
    line = f"run study.csv {unit} -o results --seed 1 --draws 100 --figures none"
    screen = run_ok(line, cwd=tmp_path)
    assert (" ln [" in screen) == is_in_logs

    results = tmp_path / "results"
    report = (results / "report.html").read_text(encoding="utf-8")
    # The texts of the screen, of the report without figures and tags, and of the methods.
    report_without_figures = re.sub("base64,[^\"']+", "", report)
    texts = [screen, re.sub("<[^>]+>", " ", report_without_figures)]
    texts += [path.read_text(encoding="utf-8") for path in results.glob("*.md")]
    for text in texts:
        assert FORBIDDEN.search(text) is None, FORBIDDEN.search(text)
    table = pd.read_csv(results / "evidence.csv")
    assert not np.isinf(table.select_dtypes("number")).any().any()

    figure = bt.plots.order_effect(bt.evidence(study.select("up"), seed=1))
    assert ("PSE shift (ln)" in " ".join(words_of(texts_of(figure)))) == is_in_logs
