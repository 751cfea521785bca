"""The command population: files, an answer in words, exit codes, and what is refused."""

import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from commands import on_one_line, refusal_of, run_command, run_ok
from conftest import each_row, quick_study, write_counts
from populations import independent_draws, made_result, simulated_group, two_conditions

import bayes_toe as bt
from bayes_toe.answers.group_answer import group_answer, group_tables
from bayes_toe.answers.order_effect import (
    Size,
    format_share,
    format_signed,
)

OPTIONS = "--seed 1 --draws 1600"
PEOPLE = """subject,site,age
P000,0,20
P001,1,30
P002,0,25
P003,1,33
P004,0,28
P005,1,
"""


def draws_with_divergences(posterior, n_draws, rng):
    """Draws in the place of the sampler's, as if two trajectories had diverged."""
    draws = independent_draws(posterior, n_draws, rng)
    return replace(draws, n_divergent=2)


@pytest.fixture(scope="module")
def group_folder(tmp_path_factory):
    # A folder with a study of six subjects, their covariates (P005 has no age), and a hyperprior.
    folder = tmp_path_factory.mktemp("population")
    write_counts(folder / "study.csv", simulated_group(1, n_subjects=6))
    (folder / "people.csv").write_text(PEOPLE)
    (folder / "wide.toml").write_text("[contraction]\nsd_scale = 0.5\n")
    return folder


@pytest.fixture(scope="module")
def screen(group_folder):
    # The screen of `population`, which writes group.nc and the files beside it, with draws that
    # need no sampler.
    options = "--covariates people.csv --categorical site --hyperprior wide.toml"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("bayes_toe.groups.population.sample_group", independent_draws)
        return run_ok(f"population study.csv -o group.nc {options} {OPTIONS}", cwd=group_folder)


def test_the_command_writes_four_files_and_answers_with_mean_and_sd(screen, group_folder):
    files = "group.csv group.nc group.png group_subjects.csv"
    assert sorted(path.name for path in group_folder.glob("group*")) == files.split()
    text = on_one_line(screen)
    assert "Answer In the group of 5 (site 0, age mean), the mean PSE shift is " in text
    assert re.search(
        r"and the SD between subjects is .*\. [\w ]+ differs? from 0 \(BF .*\)\.", text
    )
    assert "Effects of covariates" in text
    # P005 is named once, as the subject without an age.
    assert text.count("P005") == text.count("! Subjects left out: 'P005' (no age)") == 1
    assert text.endswith("Written: group.nc, group.csv, group_subjects.csv, group.png. Seed 1.")


def test_files_of_a_group_have_the_numbers_of_the_screen(screen, group_folder):
    result = bt.load(group_folder / "group.nc")
    text = on_one_line(screen)
    shift = format_signed(Size(*result.table.row("mean", "pse_shift_percent").interval), "%")
    contraction = format_share(Size(*result.table.row("mean", "contraction").interval))
    assert f"mean PSE shift is {shift}" in text
    assert f"mean contraction is {contraction}" in text
    table = pd.read_csv(group_folder / "group.csv")
    assert np.array_equal(table["q50"], result.summary()["q50"])


def test_the_file_of_a_group_has_its_hyperprior_and_no_subject_without_age(screen, group_folder):
    # P005 has no age. The hyperprior is that of wide.toml, which the fixture `group_folder` writes.
    result = bt.load(group_folder / "group.nc")
    assert result.subjects == ("P000", "P001", "P002", "P003", "P004")
    assert result.settings.hyperprior.contraction.sd_scale == 0.5


#: Options of `population` in a folder that has group.nc, and a part of the refusal. With
#: `-o study.nc`, the table of the group would replace study.csv.
REFUSED = """
    -o other.csv | other.csv: the ending is '.csv'. Draws need .nc
    --categorical site | --categorical site needs --covariates FILE.csv
    --hyperprior none.toml | none.toml: cannot be read (No such file
    --covariates people.csv --categorical size | categorical: found 'size', allowed: 'site', 'age'
    -o group.nc | overwrite
    -o study.nc --overwrite | study.csv: this command reads that file
    --draws 5 | draws: found 5, allowed: a whole number from 100
"""


@each_row("options, words", REFUSED)
def test_options_of_a_group_that_cannot_be_used_are_refused(screen, group_folder, options, words):
    # Such as '-o group.nc', a file that exists, so that --overwrite is needed.
    assert words in refusal_of(
        f"population study.csv {OPTIONS} {options}", cwd=group_folder, silent=False
    )


def test_a_group_with_divergent_trajectories_is_not_reliable(tmp_path, monkeypatch):
    # Two divergent trajectories make the group's result unreliable, and the exit code is 3. The
    # four pairs of the study cannot show a contraction.
    write_counts(tmp_path / "study.csv", quick_study("ABC"))
    monkeypatch.setattr("bayes_toe.groups.population.sample_group", draws_with_divergences)
    process = run_command(f"population study.csv {OPTIONS}", cwd=tmp_path)
    assert process.returncode == 3
    text = on_one_line(process.stdout)
    assert "NOT RELIABLE: In the group of 3, the mean PSE shift is" in text
    assert "! The group's result is not reliable: 2 of 1600 trajectories diverged" in text
    assert "contraction cannot be told" in text
    result = bt.load(tmp_path / "population.nc")
    assert result.study.task.yes == "equal"
    assert result.names == ("constant_error", "contraction", "noise", "q0")


def test_an_sd_near_zero_is_given_as_a_bound():
    # The draws of two SDs between subjects are set. The SD of the constant error is 1 D, where D is
    # the unit of its prior. The SD of the contraction is .001 to .021: the upper bound is 2 %.
    group = made_result(simulated_group(seed=1, n_subjects=6))
    sd = group.draws.sd.copy()  # (chains, draws, coefficients)
    sd[..., group.index("constant_error")] = 1.0
    sd[..., group.index("contraction")] = np.random.default_rng(1).uniform(
        0.001, 0.021, sd.shape[:2]
    )
    [line] = group_answer(replace(group, draws=replace(group.draws, sd=sd)))
    shift, _, contraction = line.partition("contraction")
    assert "], and the SD between subjects is at most 2 %. " in contraction
    assert "at most" not in shift


def test_conditions_of_a_group_have_a_line_and_a_table():
    result = made_result(two_conditions(seed=1, n_subjects=4))
    _, line = group_answer(result)
    assert line.startswith("Difference right - left in the group: PSE shift ")
    assert line.count("BF") == 3  # of constant error, contraction and JND
    (title, _, differences), (group, _, rows) = group_tables(result)
    assert title == "Differences between conditions"
    assert group == "4 subjects, median [95 % interval]"
    assert [row[0] for row in rows] == ["constant error", "contraction", "JND"]

    # The last row is that of the JND. Its difference is a ratio, exp(difference of the log noise).
    *_, (_, label, difference_of_jnd, *_) = differences
    assert label == "JND (ratio)"
    [log_ratio] = result.table.select("difference", "noise")
    low, median, high = np.exp([log_ratio.q025, log_ratio.q50, log_ratio.q975])
    assert difference_of_jnd == f"{median:.2f} [{low:.2f}, {high:.2f}]"
