"""The group in a results folder and its report, with draws that are made up: what is said first, and where it cannot be believed."""

import re

from commands import inside
from conftest import few_pairs, grouped_csv
from populations import made_population, ordinary

from bayes_toe.cli.report import Group
from bayes_toe.cli.results_folder import GROUP_PRODUCTS, Drawn, write_results
from bayes_toe.groups.predictive_check import PredictiveCheck, Statistic
from bayes_toe.groups.regressors import Regressor

WRONG = Statistic("spread", "accuracy", 0.3, 0.1, 0.15, 0.2, 0.004, above=True)


def section(folder):
    text = " ".join((folder / "report.html").read_text(encoding="utf-8").split())
    return text[text.index('<h2 id="group">') : text.index('<h2 id="appendix-c">')]


def test_warnings_come_before_the_answer_and_that_before_figure_and_tables(analysis, tmp_path):
    columns = [Regressor("group", "<b>", "group <b> against a", reference="a")]
    found = made_population(ordinary(4), columns=columns, x=[[0.0], [1.0], [0.0], [1.0]], reason="few draws")
    group = Group(found, PredictiveCheck((WRONG,), "normal", 500))
    write_results(analysis, tmp_path / "out", pictures=Drawn("none"), workers=1, group=group)
    said = section(tmp_path / "out")
    order = [
        "not converged</span>",
        "chains did not converge: few draws.",
        "the spread of the accuracy between subjects is larger than a normal population has it (0.3, 0.1 to 0.2 expected, p = 0.004); try",
        'class="lead">',
        "Order effect</a> of the population: ",
        "Group &lt;b&gt; - a: ",
        "data:image/png;base64,",
        "<th>sd between subjects",
        "<th>further subject",
        "<th>BF no difference",
        "Hyperprior: mu1: ",
    ]
    numbers = re.sub(r"base64,[^\"]*|Hyperprior.*", "", said)
    assert "−" in numbers
    assert not re.search(r"[ (>]-\d", numbers)
    places = [said.index(words) for words in order]
    assert places == sorted(places)
    assert all((tmp_path / "out" / name).stat().st_size > 500 for name in GROUP_PRODUCTS)


def test_without_a_group_there_is_no_section_and_files_of_one_before_go(analysis, tmp_path):
    out = tmp_path / "out"
    group = Group(made_population(ordinary(3)), PredictiveCheck((), "normal", 500))
    write_results(analysis, out, pictures=Drawn("none"), workers=1, group=group)
    write_results(analysis, out, pictures=Drawn("none"), workers=1, overwrite=True)
    assert 'id="group"' not in (out / "report.html").read_text(encoding="utf-8")
    assert not any((out / name).exists() for name in GROUP_PRODUCTS)


def test_run_computes_the_group_from_its_own_draws_and_leaves_with_3_where_it_did_not_converge(analysis, tmp_path, monkeypatch):
    asked = {}

    def population(study, **options):
        asked.update(options, names=study.names)
        return made_population(ordinary(3), reason="few draws")

    monkeypatch.setattr("bayes_toe.population", population)
    monkeypatch.setattr("bayes_toe.run", lambda *_, **__: analysis)
    file = grouped_csv(tmp_path / "study.csv", analysis.study)
    done = inside("run", file, "-o", tmp_path / "out", "--population", "--pictures", "none", "--seed", 5, "--workers", 1)
    assert (done.returncode, asked["names"]) == (3, analysis.study.names)
    assert asked["posterior"] is analysis.draws  # whose prior and seed are the group's
    assert "order effect of the population: " in done.stdout
    assert "attention the group's chains did not converge: few draws" in done.stdout
    assert "population.csv, population_subjects.csv, population.png, population.nc" in done.stdout
    assert "few draws" in section(tmp_path / "out")


def test_a_group_of_one_is_refused_before_the_work(tmp_path):
    done = inside("run", grouped_csv(tmp_path / "one.csv", few_pairs("A")), "-o", tmp_path / "out", "--population")
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "--population: found 1 subject, allowed: 2 and more" in done.stderr
    assert not (tmp_path / "out").exists()
