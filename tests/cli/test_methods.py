"""methods.md: the paragraph of a paper, with what must be said, and citations of what it names."""

import re
from dataclasses import replace

import pytest
from commands import on_one_line
from populations import made_result

import bayes_toe as bt
from bayes_toe.answers.order_effect import PRIOR_FLAG, QUESTIONS, Problem
from bayes_toe.answers.words import Word
from bayes_toe.cli.methods import write_methods


def methods_text(analysis, folder, group=None):
    """The text of methods.md, with one space between two words."""
    write_methods(replace(analysis, group=group), folder / "methods.md")
    return on_one_line((folder / "methods.md").read_text(encoding="utf-8"))


def with_answers(analysis, *changes):
    """The analysis with changed fields in the answers of its first subjects."""
    rows = list(analysis.evidence.rows)
    for i, change in enumerate(changes):
        rows[i] = replace(rows[i], answer=replace(rows[i].answer, **change))
    return replace(analysis, evidence=replace(analysis.evidence, rows=tuple(rows)))


def test_the_text_has_data_models_criteria_results_and_limits(analysis, tmp_path):
    # Parts of the text: data, model, sampler, criteria, results, limits, prior and pairs.
    text = methods_text(analysis, tmp_path)
    sentences = [
        "Each of 3 participants reported whether two successive stimuli were equal or different "
        "(1,950 trials, 650 each; 13 ordered pairs of stimuli from 81 to 134 % of the geometric "
        "mean stimulus).",
        "modelled as λ (2Φ(k_m) − 1) + (1 − λ) [Φ(k_m − z) − Φ(−k_m − z)], with z",
        "models were 1/2, 1/6, 1/6 and 1/6.",
        f"with seed {analysis.draws.seed}, gave",
        "at least .95, and probably present ('probably') if P was at least .75. We called it",
        "and the BF at most 0.37 (ln BF ≤ -1). All other effects are undecided.",
        "An order effect was present in",
        "A constant error was present in",
        "These pairs cannot distinguish a contraction from noise",
        "The priors were `noise ~ LogNormal(1 D, 0.7)",
        "Pairs (s1, s2), % of the geometric mean stimulus: (81, 81), ",
    ]
    assert [sentence for sentence in sentences if sentence not in text] == []
    assert "A contraction was" not in text
    assert "(3 of 3)" not in text  # a limit of the design that holds for all needs no number
    # In the table, the contraction of each subject cannot be told, because of the design.
    for row in analysis.evidence:
        assert re.search(rf"\| {row.subject} \|[^|]+\|[^|]+\| cannot be told \|[^|]+\| \|", text)


@pytest.mark.parametrize("fixture", ["analysis", "stronger"])
def test_the_paragraphs_have_the_length_that_a_journal_prints(
    request, small_study, tmp_path, fixture
):
    # An analysis of same or different, or of which was stronger, with the result of a group.
    text = methods_text(request.getfixturevalue(fixture), tmp_path, made_result(small_study))
    paragraphs, *_ = text.partition("| participant")  # the table begins there
    assert 400 < len(paragraphs.split()) <= 760  # words


def test_all_that_the_text_cites_is_in_the_bibliography(analysis, tmp_path):
    # Entries of methods.bib begin with '@article{cornuet2012,', and the text cites with
    # '@cornuet2012'. All that is cited has an entry, and at least these three are cited.
    text = methods_text(analysis, tmp_path)
    entries = (tmp_path / "methods.bib").read_text(encoding="utf-8")
    keys = re.findall(r"^@\w+\{(\w+),", entries, flags=re.MULTILINE)
    cited_keys = set(re.findall(r"@(\w+)", text))
    assert cited_keys <= set(keys)
    assert {"avetta2026", "bayes_toe", "cornuet2012"} <= cited_keys
    assert f"Version {bt.__version__}" in entries


def test_poor_fits_and_subjects_that_are_not_interpreted_are_named(analysis, tmp_path):
    # A has a poor fit, B is not interpreted, and the fit of C cannot be tested.
    words = dict.fromkeys(QUESTIONS, Word.NOT_INTERPRETABLE)
    poor_fit = {"fit_p": 0.001}
    problems = {"keys look swapped": Problem("")}
    not_interpreted = {"words": words, "is_interpretable": False, "problems": problems}
    untestable_fit = {"fit_p": None}
    text = methods_text(with_answers(analysis, poor_fit, not_interpreted, untestable_fit), tmp_path)
    assert "The fit was poor for A (p = .0010)." in text
    assert "B was not interpreted: keys look swapped." in text
    assert "The fit was not testable for C." in text
    assert "of 2 participants" in text
    assert " ! marks a poor fit." in text

    # Now only A is interpreted, and its fit is good.
    good_fit = {"fit_p": 0.5}
    text = methods_text(
        with_answers(analysis, good_fit, not_interpreted, not_interpreted), tmp_path
    )
    assert "The order changed the response: the first stimulus was" in text
    assert "No fit was poor." in text
    assert " ! marks a poor fit." not in text


def test_words_are_counted_by_direction_and_trials_of_all_subjects(analysis, tmp_path):
    # All three effects are present in A, with a contraction, and in B, with a repulsion, but not in
    # C. A has one more trial of each of the 13 pairs than B and C, who have 650 trials.
    all_yes = dict.fromkeys(QUESTIONS, Word.YES)
    all_no = dict.fromkeys(QUESTIONS, Word.NO)
    changes = {"words": all_yes}, {"words": all_yes, "direction": "repulsion"}, {"words": all_no}
    subject_a, *other_subjects = analysis.study
    subject_a = replace(subject_a, n_trials=subject_a.n_trials + 1)
    study = replace(analysis.study, subjects=(subject_a, *other_subjects))
    text = methods_text(replace(with_answers(analysis, *changes), study=study), tmp_path)
    assert "An order effect was present in 2 of 3 participants and absent in 1." in text
    assert "A contraction was present in 1, reversed (repulsion) in 1 and absent in 1." in text
    assert "| yes, repulsion (" in text
    assert "(1,963 trials, 650 to 663 each;" in text


@pytest.mark.parametrize("n_divergent", [0, 10**6])
def test_the_group_has_its_prior_and_sampler_and_is_said_to_be_unreliable(
    analysis, small_study, tmp_path, n_divergent
):
    # The group's result is made without a sampler. A million divergent trajectories make it
    # unreliable.
    group = made_result(small_study, n_divergent=n_divergent)
    text = methods_text(analysis, tmp_path, group)
    assert "`constant error, D: mean ~ Student t, 3 df, centre 0, scale 0.5; SD between" in text
    assert "gave 1,600 draws in 8 chains" in text
    assert "In the group of 3, the mean PSE shift was " in text
    assert "The contraction could not be identified." in text
    assert ("NOT RELIABLE" in text) == bool(n_divergent)


def test_names_of_subjects_are_no_markup_in_methods(analysis, tmp_path):
    # The name of the first subject has signs of Markdown, and a sign that turns text around.
    changed_analysis = with_answers(analysis, {"subject": "*[x](y)\u202e"})
    assert r"| \*\[x\](y)\\u202e |" in methods_text(changed_analysis, tmp_path)


def test_answers_that_depend_on_the_prior_are_named_and_marked(analysis, tmp_path):
    # No subject has a problem. Then a flag says that another prior scale changes a word of A.
    without_problems = with_answers(analysis, *[{"problems": {}}] * 3)
    text = methods_text(without_problems, tmp_path)
    assert "no conclusion 'yes' or 'no' became undecided." in text
    flag = {f"{PRIOR_FLAG}: order effect": Problem("")}
    text = methods_text(with_answers(without_problems, {"problems": flag}), tmp_path)
    assert "a 'yes' or a 'no' became undecided for A." in text
    assert " ? marks a 'yes' or a 'no' that became undecided with another prior scale." in text
