"""What a person sees at a prompt and in a notebook: short, escaped, and what to do next where something else was meant."""

import pytest

import bayes_toe as bt
from bayes_toe.data.tables import Table


def subclasses(kind):
    return {kind, *(below for one in kind.__subclasses__() for below in subclasses(one))}


def test_everything_fits_on_a_line(analysis):
    table = bt.asymmetry(analysis.study)
    for one in (
        analysis,
        analysis.study,
        analysis.study["A"],
        analysis.draws,
        analysis.evidence,
        analysis.fits,
        table,
    ):
        assert len(repr(one)) < 220
        assert "\n" not in repr(one)
    assert repr(analysis.study) == "<Study 'three kinds': 3 subjects ('A', 'B', 'C'), 1,950 trials>"
    assert repr(analysis.draws).startswith(
        "<Draws of 'predictive update': 3 subjects ('A', 'B', 'C'), "
    )
    assert (
        repr(analysis.evidence)
        == "<EvidenceTable: 3 rows of 'A', 'B', 'C'; frame() gives them to pandas>"
    )
    assert all(kind.__repr__ is Table.__repr__ for kind in subclasses(Table))


def test_notebooks_show_small_tables_and_run_nothing():
    wild = bt.Study([bt.Subject("<script>", [0.0, 0.3], [0.3, 0.0], [3, 1], [5, 5])], source="<b>")
    draws = bt.sample(wild, draws=100, seed=1, workers=1)
    for one in (wild, draws, bt.asymmetry(wild)):
        assert "<table" in one._repr_html_()
        assert "<script>" not in one._repr_html_()
        assert "&lt;script&gt;" in one._repr_html_()
    many = bt.Study([bt.Subject(f"S{i}", [0.0], [0.3], [3], [5]) for i in range(50)])
    assert many._repr_html_().count("<tr") == 21
    assert "and 30 more rows" in many._repr_html_()


def test_a_subject_is_found_by_the_number_that_its_name_is(small_study):
    named = [
        bt.Subject(name, one.s1, one.s2, one.n_yes, one.n_trials)
        for name, one in zip(("1008", "01"), small_study, strict=False)
    ]
    study = bt.Study(named)
    draws = bt.sample(study, draws=100, seed=1, workers=1)
    assert (draws[1008].names, draws.subject(1008).name, draws.values(1008, "gain").size > 99) == (
        ("1008",),
        "1008",
        True,
    )
    assert study.select(1008).names == study.select([1008]).names == ("1008",)
    assert bt.asymmetry(study)[1008].subject == "1008"
    with pytest.raises(bt.InputError, match=r"no subject 1 .*there are: '1008', '01'"):
        study[1]  # which of 1, 01 and 001 would that be?


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("x.csv", r"found 'x.csv', allowed: a Study, such as bt.read_study\('x.csv'\)"),
        (
            bt.Subject("x", [0.0], [0.3], [1], [2]),
            r"found Subject, allowed: a Study, such as bt.Study\(\[subject\]\)",
        ),
        ([], r"found list, allowed: a Study, such as bt.Study\(subjects\)"),
        (3, r"found int, allowed: a Study, such as bt.read_study\(path or DataFrame\)"),
    ],
    ids=["path", "subject", "list", "number"],
)
def test_every_verb_says_what_a_study_is(given, said):
    verbs = (
        bt.run,
        bt.sample,
        bt.evidence,
        bt.fit,
        bt.asymmetry,
        bt.population,
    )
    for verb in (*verbs, bt.check):
        with pytest.raises(bt.InputError, match=said):
            verb(given)


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (
            lambda study, _: bt.run(study, prior=3),
            "prior: found 3, allowed: 'default', 'paper', a TOML file",
        ),
        (
            lambda study, _: bt.run(study, prior="papre"),
            "prior 'papre': no such preset or file, allowed: 'default', 'paper'",
        ),
        (
            lambda study, _: bt.evidence(study, draws=2.5),
            "draws: found 2.5, allowed: a whole number from 1",
        ),
        (lambda study, _: bt.sample(study, seed="1"), "seed='1': allowed is a whole number"),
        (
            lambda study, _: bt.run(study, workers="all"),
            "workers='all': allowed is a number of processes",
        ),
        (lambda study, _: bt.run(study, keep=3), "keep: found 3, allowed: the path of a folder"),
        (
            lambda study, _: bt.sample(study, model=3),
            "model: found 3, allowed: one of: none, constant-error",
        ),
        (
            lambda study, _: bt.fit(study, level="x"),
            "level: found 'x', allowed: a number between 0 and 1",
        ),
        (
            lambda study, _: bt.fit(study, replicates=1.5),
            "replicates: found 1.5, allowed: a whole number from 1",
        ),
        (
            lambda study, _: bt.population(study, hyperprior=3),
            "hyperprior: found 3, allowed: a Hyperprior, or the path",
        ),
        (
            lambda study, _: bt.population(study, covariates=3),
            "found 'int', allowed: the path of a file",
        ),
        (
            lambda study, _: bt.predict(study, "A", 0.0, 0.3),
            "draws: found Study, allowed: Draws, such as bt.sample",
        ),
        (lambda study, _: bt.explore(study), "draws: found Study, allowed: Draws"),
        (
            lambda *_: bt.plots.corner("posterior.nc", "A"),
            "draws: found 'posterior.nc', allowed: Draws, such as .*bt.load",
        ),
        (
            lambda *_: bt.load(5),
            "file: found 5, allowed: the path of a posterior.nc or population.nc",
        ),
        (
            lambda *_: bt.read_study(5),
            "found 'int', allowed: the path of a file, or a pandas or polars DataFrame",
        ),
        (
            lambda _, path: bt.read_study(path, {"subject": "who"}),
            "options: found dict, allowed: a ReadOptions",
        ),
        (lambda *_: bt.Study("S01"), "Study: found 'S', allowed: Subjects, in a list"),
        (lambda *_: bt.Prior(mu1_sd="x"), "prior: mu1_sd=x, allowed: a positive finite number"),
    ],
)
def test_what_is_of_a_wrong_kind_is_refused_in_a_line_that_says_what_is_allowed(
    small_study, study_csv, call, said
):
    with pytest.raises(bt.InputError, match=said):
        call(small_study, study_csv)


def test_the_file_of_a_prior_is_taken_where_a_prior_is(small_study, tmp_path):
    file = tmp_path / "prior.toml"
    file.write_text("[paper]\nmu1_sd = 2.5", encoding="utf-8")
    assert bt.sample(
        small_study.select(["A"]), draws=100, prior=str(file), seed=1, workers=1
    ).prior == bt.Prior(mu1_sd=2.5)
    assert bt.check(small_study, prior=str(file)) == bt.check(
        small_study, prior=bt.Prior(mu1_sd=2.5)
    )
