"""The results folder of a study: figures, one report or an index with pages, explorer, group."""

import os
import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from commands import on_one_line, refusal_of
from populations import made_result, simulated_group, two_conditions

import bayes_toe as bt
from bayes_toe.cli import report, results_folder
from bayes_toe.cli.results_folder import write_results
from bayes_toe.cli.run_context import RunContext
from bayes_toe.explorer.page import Explorer
from bayes_toe.groups.predictive_check import Statistic
from bayes_toe.groups.regressors import Regressor, Regressors

pytestmark = pytest.mark.usefixtures("blank_pictures")
NO_FIGURES = {"figures": "none"}
#: The context of a command that writes into a folder that does not exist.
NEW = RunContext()
#: The context of a command that replaces earlier results.
OVERWRITE = RunContext(overwrite=True)


def text_of(folder, name="report.html"):
    """The text of a file of the folder, with one space between two words."""
    return on_one_line((folder / name).read_text(encoding="utf-8"))


@pytest.mark.parametrize(
    "choice, subjects_with_figures, note",
    [
        ("flagged", "AC", "Figures are drawn for subjects that need action (poor fit"),
        ("none", "", "To draw figures of single subjects, type <code>--figures all"),
    ],
)
def test_figures_are_of_the_flagged_or_of_none_and_the_report_says_so(
    analysis_with_problems, tmp_path, choice, subjects_with_figures, note
):
    # Of the subjects A, B and C, A does not fit and C is not interpreted: both are flagged.
    out = write_results(analysis_with_problems, tmp_path / "out", NEW, figures=choice)
    assert sorted(file.stem for file in out.glob("corner/*")) == list(subjects_with_figures)
    assert (out / "corner").exists() == bool(subjects_with_figures)
    assert set(os.listdir(out)) <= set(results_folder.PRODUCTS)
    text = text_of(out)
    # Each subject has two pictures, or a line on how to draw them.
    counts = text.count("data:image/png"), text.count("To draw the corner plot")
    assert counts == (2 * len(subjects_with_figures), 3 - len(subjects_with_figures))
    assert note in text
    badges = re.findall(r'<span class="badge (?:wrong|bad)">([^<]*)', text)
    assert badges == ["poor fit", "not interpreted"]
    require_sentences_and_small_figures(text)


def require_sentences_and_small_figures(text):
    """Paragraphs and definitions of a report end with one point, and its figures load at once."""
    sentences = re.findall(r'(?:<p class="lead">|<dd>)(.*?)</(?:p|dd)>', text)
    assert len(sentences) > 8
    assert [words for words in sentences if not re.search(r"[^.]\.$", words)] == []
    figures = re.findall(r"<svg.*?</svg>", text)
    assert len(figures) == 3
    assert max(map(len, figures)) < 90_000  # characters


def test_of_very_many_subjects_the_report_is_an_index_with_a_page_for_each(
    analysis_with_problems, tmp_path, monkeypatch
):
    # Three subjects are too many for one page if it may have two: A and C are flagged.
    monkeypatch.setattr(report, "MAX_SUBJECTS", 2)
    out = write_results(analysis_with_problems, tmp_path / "out", NEW, figures="flagged")
    index = text_of(out)
    links = re.findall(r'href="subjects/([^"]+).html"', index)
    assert links[:3] == ["A", "C", "B"]  # flagged subjects first
    assert "data:image/png" not in index
    assert '<details class="subject' not in index
    assert "2 of 3 subjects need action" in index

    # A does not fit one pair, B has no problem, and C is not interpreted.
    pages = [text_of(out / "subjects", f"{name}.html") for name in "ABC"]
    assert [text.count("data:image/png") for text in pages] == [2, 0, 2]
    for text in pages:
        assert 'href="../report.html#read"' in text
    page_of_a, _, page_of_c = pages
    misfit = "For (s1, s2) = (0, 0.3), 90 % of the responses are &#39;equal&#39;, and the model"
    assert misfit in page_of_a
    assert 'href="../corner/A.png"' in page_of_a
    assert "Not interpreted: responses look swapped" in page_of_c
    assert "<code>--swap C:2</code>" in page_of_c

    # If one page may have three subjects, there are no further pages, and old pages are removed.
    monkeypatch.setattr(report, "MAX_SUBJECTS", 3)
    write_results(analysis_with_problems, out, OVERWRITE, **NO_FIGURES)
    assert not [*out.glob("corner*"), *out.glob("subjects*")]


def test_a_group_stands_in_the_report_and_goes_if_there_is_none(analysis_with_problems, tmp_path):
    """The section of the group has what contradicts it, and then its answer, figure and tables."""
    study = simulated_group(1, n_subjects=4)
    column = Regressor("group", "<b>", "group <b> against a", reference="a")
    covariates = Regressors(study.names, np.array([[0.0], [1.0], [0.0], [1.0]]), (column,))
    group = made_result(study, covariates, n_divergent=2)

    large_spread = Statistic(
        "spread", "accuracy", observed=0.3, q05=0.1, q95=0.2, p_value=0.004, is_above=True
    )
    out = write_results(
        replace(analysis_with_problems, group=group),
        tmp_path / "out",
        NEW,
        (large_spread.warning,),
        **NO_FIGURES,
    )
    _, _, text_from_group_on = text_of(out).partition('<summary id="group">')
    section, _, _ = text_from_group_on.partition('id="subjects"')
    texts_in_order = [
        "not reliable</span>",
        "the group&#39;s result is not reliable: 2 of 1600 trajectories diverged",
        "the spread of the accuracy between subjects is larger than in a normal group",
        "data:image/png;base64,",
        ">covariate</th>",
        ">group mean</th>",
        ">SD between subjects</th>",
        ">new subject</th>",
        "<li>constant error, D: mean ~ Student t",
    ]
    positions = [section.index(words) for words in texts_in_order]
    assert positions == sorted(positions)

    # Draws, two tables and a figure, none of which is empty.
    group_files = list(out.glob("population*"))
    assert len(group_files) == 4
    assert min(path.stat().st_size for path in group_files) > 500

    write_results(analysis_with_problems, out, OVERWRITE, **NO_FIGURES)
    assert 'id="group"' not in text_of(out)
    assert not list(out.glob("population*"))


def test_an_explorer_stands_beside_the_report_if_asked_for(
    analysis_with_problems, tmp_path, monkeypatch
):
    explored_draws = []

    def explore(draws):
        # This text takes the place of the page of the draws, which takes long to make.
        explored_draws.append(draws)
        return Explorer("explored")

    monkeypatch.setattr(results_folder, "explore", explore)
    out = write_results(
        analysis_with_problems, tmp_path / "out", NEW, has_explorer=True, **NO_FIGURES
    )
    assert text_of(out, "explorer.html") == "explored"
    assert explored_draws == [analysis_with_problems.draws]
    assert text_of(out).count('href="explorer.html"') == 2
    assert "bayes-toe explore" not in text_of(out)


def test_an_explorer_that_cannot_be_is_refused_before_the_work(study_csv, tmp_path, monkeypatch):
    monkeypatch.setattr("bayes_toe.explorer.page.MOST_ENTRIES", 2)
    command = f"run {study_csv} -o out --explore"
    message = "explore: found 3 subjects, allowed: 1 to 2 in a page"
    assert message in refusal_of(command, cwd=tmp_path, silent=False)
    # As if bokeh, with which the page is made, were not installed.
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert "pip install 'bayes_toe[explore]'" in refusal_of(command, cwd=tmp_path)


def test_a_report_on_which_is_stronger_speaks_of_it_alone(stronger, tmp_path):
    # Words that only one of the two tasks has: the words of same/different must be absent.
    out = write_results(stronger, tmp_path / "out", NEW)
    methods = text_of(out, "methods.md")
    limit = "a constant error and a response bias predict the same responses"
    assert limit in methods
    assert limit in text_of(out)
    report_without_figures = re.sub(r"data:image[^\"]*", "", text_of(out))
    text = report_without_figures + methods
    words_of_same_different = ("'equal'", "called equal", "P(equal)", "q0", "half-width")
    assert [words for words in words_of_same_different if words in text] == []
    words_of_2afc = ("Just noticeable difference", "lapse_rate", "% 'second'")
    assert [words for words in words_of_2afc if words not in text] == []


@pytest.fixture(scope="module")
def study_with_conditions():
    """One subject with the conditions left and right, whose constant errors differ by 2 D.

    There are 60 trials of each of 10 pairs in each condition.
    """
    return two_conditions(1, n_subjects=1, n_each=60, difference=2.0)


@pytest.fixture(scope="module")
def folder_with_conditions(study_with_conditions, tmp_path_factory):
    """The results folder of the study with conditions, as if a subject P9 were left out."""
    analysis = bt.run(study_with_conditions, draws=100, seed=1)
    analysis.contrast.left_out["P9"] = "at left only"
    return write_results(analysis, tmp_path_factory.mktemp("hands") / "out", NEW, **NO_FIGURES)


def test_tables_of_a_run_name_its_conditions(folder_with_conditions):
    contrast = pd.read_csv(folder_with_conditions / "contrast.csv")
    assert contrast[contrast.quantity == "constant error"].word.tolist() == ["yes"]
    assert contrast.seed.unique().tolist() == [1]
    for name in ("evidence.csv", "summary.csv"):
        table = pd.read_csv(folder_with_conditions / name)
        units = table[["subject", "condition", "seed"]].drop_duplicates()
        assert units.to_numpy().tolist() == [["P000", "left", 1], ["P000", "right", 1]]


def test_draws_of_a_run_with_conditions_have_its_study(
    folder_with_conditions, study_with_conditions
):
    draws = bt.load(folder_with_conditions / "posterior.nc")
    assert draws.study.conditions == study_with_conditions.conditions
    unit = study_with_conditions["P000@left"]
    assert draws.subject("P000@left").shared_scales == unit.shared_scales


def test_report_and_methods_of_a_run_with_conditions_name_them(folder_with_conditions):
    report = text_of(folder_with_conditions)
    for words in (
        'id="conditions"',
        "1 subject in 2 conditions, 1,200 trials, which was stronger (2AFC), 10 pairs · seed",
        "Order effect: 2 of 2 conditions of 1 subject yes.",
        "Constant error differs: 1 of 1 subject yes.",
        "Differences (right − left) are medians",
        "Not compared: P9 (at left only).",
    ):
        assert words in report, words
    # The difference with its interval and its word: '>82 % [61, 104] ... yes (BF > 100)'.
    assert re.search(r">\d+(\.\d)? % \[.*<span class=\"soft\">yes \(BF ", report)
    methods = text_of(folder_with_conditions, "methods.md")
    for words in (
        "An order effect was present in 2 of 2 conditions of 1 participant",
        "joint fits of all conditions of a participant",
        "was stronger (1,200 trials;",
    ):
        assert words in methods, words


def test_the_report_of_one_subject_has_no_search(analysis, tmp_path):
    only_b = replace(
        analysis,
        study=analysis.study.select(["B"]),
        draws=analysis.draws["B"],
        evidence=replace(analysis.evidence, rows=(analysis.evidence["B"],)),
    )
    text = text_of(write_results(only_b, tmp_path / "out", NEW, **NO_FIGURES))
    assert 'type="search"' not in text
    assert "1 subject, 650 trials, same-different task, 13 pairs" in text
