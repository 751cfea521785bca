"""Values at a prompt and in a notebook: short, escaped, and errors with what to do next."""

from dataclasses import replace

import pytest
from conftest import each_row, made_subject, refused
from numpy.ma import masked_array

import bayes_toe as bt


def test_the_text_of_a_value_at_a_prompt_is_one_line(analysis):
    table = bt.asymmetry(analysis.study)
    subject = analysis.study["A"]
    values = analysis, analysis.study, subject, analysis.draws, analysis.evidence, table
    for value in values:
        assert len(repr(value)) < 220
        assert "\n" not in repr(value)
    names = "3 subjects ('A', 'B', 'C'), "
    assert repr(analysis.study) == f"<Study 'three kinds': {names}1,950 trials>"
    assert repr(analysis.draws).startswith(f"<Draws of paper's model: {names}")
    text = "<EvidenceTable: 3 rows of 'A', 'B', 'C'; frame() gives them to pandas>"
    assert repr(analysis.evidence) == text


def test_the_short_frame_of_an_evidence_table_is_the_answer(analysis):
    table = analysis.evidence
    frame = table.frame()
    assert list(frame) == ["subject", "order effect", "constant error", "contraction"]
    assert max(map(len, str(frame).splitlines())) <= 80
    # A mark ' ?' may follow the word of a subject whose answer depends on the prior.
    words = [str(answer.words["order_effect"]) for answer in table.answers]
    assert [text.partition(" ?")[0] for text in frame["order effect"]] == words


def test_notebooks_run_no_markup_in_names():
    # A subject named <script>, with rows of s1, s2, 'equal' and trials.
    study_with_markup = bt.Study([made_subject("0 0.3 3 5, 0.3 0 1 5", "<script>")], source="<b>")
    # Notebooks call a private method of each value.
    for value in (study_with_markup, bt.asymmetry(study_with_markup)):
        html = value._repr_html_()
        assert "<table" in html
        assert "<script>" not in html
        assert "&lt;script&gt;" in html


def test_notebooks_show_20_rows_of_a_table_at_most():
    study_of_50 = bt.Study([made_subject("0 0.3 3 5", f"S{i}") for i in range(50)])
    html = study_of_50._repr_html_()  # a private method that notebooks call
    assert html.count("<tr") == 22  # a header, 20 of 50 rows, and dots


def test_a_subject_is_found_by_the_number_that_its_name_is(small_study):
    subject_a, subject_b, _ = small_study
    study = bt.Study([replace(subject_a, name="1008"), replace(subject_b, name="01")])
    draws = bt.sample(study, draws=100, seed=1)
    assert draws[1008].names == study.select(1008).names == study.select([1008]).names == ("1008",)
    assert draws.subject(1008).name == bt.asymmetry(study)[1008].subject == "1008"
    assert draws.values(1008, "gain").size > 99
    with refused(r"no subject 1 .*there are: '1008', '01'"):
        study[1]  # The number 1 could mean 1, 01 or 001.


@pytest.mark.parametrize("argument", ["x.csv", made_subject("0 0.3 1 2"), [], 3])
def test_every_verb_says_what_a_study_is(argument):
    # The name of a file, a subject, an empty list and a number are no study.
    verbs = (bt.run, bt.sample, bt.evidence, bt.fit, bt.asymmetry, bt.population, bt.check)
    for verb in verbs:
        with refused(r"study: found .*, allowed: a Study, such as bt"):
            verb(argument)


#: A call that is typed at a prompt, and a part of the refusal.
REFUSED = """
    bt.run(study, prior=3) | prior: found 3, allowed: 'default', 'paper', a TOML file
    bt.run(study, prior='papre') | no such preset or file, allowed: 'default', 'paper'
    bt.run(study, workers='all') | workers='all': allowed is a number of processes
    bt.run(study, keep=3) | keep: found 3, allowed: the path of a folder
    bt.evidence(study, draws=2.5) | draws: found 2.5, allowed: a whole number from 1
    bt.sample(study, model=3) | model: found 3, allowed: one of: none, constant-error
    bt.fit(study, replicates=1.5) | replicates: found 1.5, allowed: a whole number from 1
    bt.fit(study, replicates=0) | replicates: found 0, allowed: a whole number from 1
    bt.population(study, hyperprior=3) | hyperprior: found 3, allowed: a Hyperprior, or the path
    bt.population(study, covariates=3) | found 'int', allowed: the path of a file
    bt.explore(study, truths=None) | draws: found Study, allowed: Draws
    bt.predict('S', 'A', 0.0, 0.3) | draws: found 'S', allowed: Draws, such as bt.sample
    bt.predict(bt.sample(study, draws=99), 'A', [0, 1], [0, 1, 2]) | s1, s2: allowed are as many
    bt.predict(bt.sample(study, draws=99), 'A', 'x', 0.0) | s1 must be numbers, none of them masked
    bt.predict(bt.sample(study, draws=99), 'A', masked_array([0], [True]), 0) | s1 must be
    bt.design.Adaptive([(0.0, 0.3)], seed=1).answer(None, True) | pair None: allowed are s1 and s2
    bt.plots.corner('posterior.nc', 'A') | draws: found 'posterior.nc', allowed: Draws
    bt.load(5) | file: found 5, allowed: the path of a posterior.nc or population.nc
    bt.read_study(5) | allowed: the path of a file, or a pandas or polars DataFrame
    bt.read_study('x.csv', {}) | options: found dict, allowed: a ReadOptions
    bt.Study('S01') | Study: found 'S', allowed: Subjects, in a list
    bt.Study(study['A']) | Study: found Subject, allowed: Subjects, in a list
    study.swap(None) | names: found NoneType, allowed: a name of a subject or block, or several
    bt.explore(bt.sample(study, draws=99), subjects='ZZ') | no subject 'ZZ' among the draws
    bt.design.optimal_design(['x'], 40) | design: s1 must be numbers
    bt.Prior('x') | prior: mu1_mean: found 'x', allowed:
    bt.Hyperprior(3) | hyperprior: constant_error: found 3, allowed: a ParameterHyper
    bt.design.power('full') | design: found 'full', allowed: a StudyDesign, or several by their
    bt.design.power(None, [float('inf')]) | trials: found inf, allowed: a whole number
    bt.model.evolved_mean(0.0, 0.3, -1.0) | gamma must be finite and not negative
    bt.model.normalised_distance(0.0, 0.3, 0.0, -1.0, 0.1) | sigma_p must be finite
"""


@each_row("call, message", REFUSED)
def test_an_argument_of_a_wrong_kind_is_refused(small_study, call, message):
    # Such as 'bt.run(study, keep=3)', with the message that the path of a folder is allowed.
    with pytest.raises(bt.BayesToeError) as refusal:
        eval(call, {"bt": bt, "study": small_study, "masked_array": masked_array})
    assert message in str(refusal.value)
