"""methods.md: the paragraph of a paper, with what must be said, and citations of what it names."""

import re
from dataclasses import replace

import pytest
from populations import made_result

import bayes_toe as bt
from bayes_toe.answers.evidence_table import EvidenceTable
from bayes_toe.answers.order_effect import PRIOR_FLAG
from bayes_toe.answers.words import Word
from bayes_toe.cli.methods import write_methods


def text_of(analysis, folder, group=None):
    write_methods(replace(analysis, group=group), folder / "methods.md")
    return " ".join((folder / "methods.md").read_text(encoding="utf-8").split())


def with_answers(analysis, *changes):
    """The analysis with other answers of its first subjects."""
    rows = list(analysis.evidence.rows)
    for i, change in enumerate(changes):
        rows[i] = replace(rows[i], answer=replace(rows[i].answer, **change))
    return replace(analysis, evidence=EvidenceTable(tuple(rows), analysis.evidence.seed))


def test_the_paragraph_has_data_models_criteria_results_and_limits(analysis, tmp_path):
    text = text_of(analysis, tmp_path)
    expected_names = [
        "3 participants reported whether two successive stimuli were equal or different "
        "(1,950 trials, 650 each).",
        "no order effect (prior probability 1/2), constant error, contraction, and both",
        f"seed {analysis.draws.seed}.",
        "at least .95, 'probably' from .75, 'no' up to .05",
        "with a Bayes factor (BF) of at most .37; otherwise 'undecided'.",
        "An order effect was present in",
        "A constant error was present in",
        "The design cannot identify contraction, because these pairs cannot distinguish",
        "Priors: `noise ~ LogNormal(1 D, 0.7)",
    ]
    assert [sentence for sentence in expected_names if sentence not in text] == []
    assert "A contraction was present" not in text
    assert "(3 of 3)" not in text  # of a limit of the design that holds for all
    for row in analysis.evidence:
        assert re.search(rf"\| {row.subject} \|[^|]+\|[^|]+\| cannot be told \|[^|]+\| \|", text)


@pytest.mark.parametrize(
    "task, parameters",
    [
        ("analysis", "noise, indecision zone, their slopes over intensity, and lapse rate"),
        ("stronger", "noise, noise slope over intensity, and lapse rate"),
    ],
)
def test_the_paragraph_has_the_length_that_a_journal_prints(
    request, small_study, tmp_path, task, parameters
):
    group = made_result(small_study)
    text = text_of(request.getfixturevalue(task), tmp_path, group)
    paragraph = text.removeprefix("# Methods and results ").partition("| participant")[0]
    assert 150 < len(paragraph.split()) <= 300
    assert f"all with free {parameters}." in paragraph


def test_citations_are_those_of_the_text(analysis, tmp_path):
    text = text_of(analysis, tmp_path)
    entries = (tmp_path / "methods.bib").read_text(encoding="utf-8")
    keys = re.findall(r"^@\w+\{(\w+),", entries, flags=re.MULTILINE)
    cited = set(re.findall(r"@(\w+)", text))
    assert set(keys) == cited >= {"avetta2026", "bayes_toe", "cornuet2012"}
    assert f"Version {bt.__version__}" in entries


def test_what_must_not_be_used_as_it_stands_is_named(analysis, tmp_path):
    words = dict.fromkeys(analysis.answers[0].words, Word.NOT_INTERPRETABLE)
    poor = {"fit_p": 0.001}
    excluded = {"words": words, "is_interpretable": False}
    untestable = {"fit_p": None}
    text = text_of(with_answers(analysis, poor, excluded, untestable), tmp_path)
    first, second, third = analysis.draws.names
    assert f"The model does not fit {first} with test p .0010." in text
    assert f"The fit is not testable for {third}." in text
    assert f"Not interpreted: {second}." in text
    assert "of 2 participants" in text
    assert " !: the model does not fit." in text
    assert "The model does not fit any participant." in text_of(
        with_answers(analysis, poor, poor, poor), tmp_path
    )
    single = with_answers(analysis, {"fit_p": 0.5}, excluded, excluded)
    text = text_of(single, tmp_path)
    assert single.answers[0].describe() in text
    assert " !: the model does not fit." not in text


def test_effects_and_unequal_numbers_of_trials_are_counted(analysis, tmp_path):
    words = analysis.answers[0].words
    changes = [{"words": {**words, "order_effect": word}} for word in (Word.YES, Word.YES, Word.NO)]
    first, *remaining = analysis.study.subjects
    longer = replace(first, n_trials=first.n_trials + 1)
    study = replace(analysis.study, subjects=(longer, *remaining))
    text = text_of(replace(with_answers(analysis, *changes), study=study), tmp_path)
    assert "An order effect was present in 2 of 3 participants" in text
    assert "; the others: 1 no." in text
    assert f"({1950 + first.n_pairs:,} trials, 650 to {650 + first.n_pairs} each)" in text


@pytest.mark.parametrize("log_bf, factor", [(-20.0, "> 100"), (-2.9, "18"), (9.0, "< 1/100")])
def test_the_group_has_its_means_with_intervals_and_bayes_factors(
    analysis, small_study, tmp_path, monkeypatch, log_bf, factor
):
    group = made_result(small_study)
    rows = tuple(row._replace(ln_bf_zero=log_bf) for row in group.table)
    monkeypatch.setattr(type(group), "identified", {"constant_error", "contraction"})
    monkeypatch.setitem(vars(group), "table", replace(group.table, rows=rows))
    shift = r"mean PSE shift of [+-]\S+ % \[\S+, \S+\] \(Bayes factor against 0: ([^)]+)\)"
    share = r" and a mean contraction of \S+ % \[\S+, \S+\] \(Bayes factor against 0: ([^)]+)\)\."
    match = re.search(shift + share, text_of(analysis, tmp_path, group))
    assert match.groups() == (factor, factor)


def test_a_group_that_is_not_reliable_is_said_to_be_so(analysis, small_study, tmp_path):
    group = made_result(small_study)
    assert "NOT RELIABLE" not in text_of(analysis, tmp_path, group)
    diverged = replace(group, draws=replace(group.draws, n_divergent=10**6))
    assert "The draws of the group are NOT RELIABLE: " in text_of(analysis, tmp_path, diverged)


def test_a_mean_that_no_pairs_can_show_is_not_reported(analysis, small_study, tmp_path):
    group = made_result(small_study)
    assert group.identified == {"constant_error", "noise", "q0"}
    text = text_of(analysis, tmp_path, group)
    assert "the group had a mean PSE shift of" in text
    assert "mean contraction" not in text


def test_names_are_no_markup(analysis, tmp_path):
    changed = with_answers(analysis, {"subject": "*[x](y)\u202e"})
    assert r"| \*\[x\](y)\\u202e |" in text_of(changed, tmp_path)


def test_answers_that_depend_on_the_prior_are_counted_and_marked(analysis, tmp_path):
    sentence = "a prior half or twice as wide leaves a 'yes' or a 'no' undecided."
    plain, dependent = {"flags": ()}, {"flags": (f"{PRIOR_FLAG}: order effect",)}
    assert sentence not in text_of(with_answers(analysis, plain, plain, plain), tmp_path)
    with_dependent = with_answers(analysis, dependent, plain, plain)
    text = text_of(with_dependent, tmp_path)
    assert f"For 1 of 3, {sentence}" in text
    assert " ?: undecided with a prior half or twice as wide." in text
