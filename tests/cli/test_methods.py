"""What is said of an analysis in a paper: by `run` and from its files alike, what did not converge or fit too, no file of another one."""

import json
import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from commands import good, refused
from populations import made_result

import bayes_toe as bt
from bayes_toe.answers.study_summary import frequency_line, study_lines
from bayes_toe.answers.words import Word
from bayes_toe.cli.methods import of_analysis, write_text
from bayes_toe.cli.supplement import templates
from bayes_toe.inference.draws import Draws

FILES = {
    "m.md",
    "m.bib",
    "m_parameters.csv",
    "m_parameters.tex",
    "m_order_effect.csv",
    "m_order_effect.tex",
}


@pytest.fixture(scope="module")
def results(analysis, tmp_path_factory):
    folder = tmp_path_factory.mktemp("results")
    analysis.draws.save(folder / "posterior.nc")
    analysis.evidence.save(folder / "evidence.csv")
    return folder


def copied(results, folder, *others):
    """The files of the results in another folder."""
    for path in (*results.glob("*.nc"), *results.glob("*.csv"), *others):
        (folder / path.name).write_bytes(path.read_bytes())


def document(folder, *words, name="m.md"):
    """The text with its lines joined, and what the command printed."""
    said = good("methods", ".", "-o", f"text/{name}", "--overwrite", *words, cwd=folder)
    return joined(folder / "text" / name), " ".join(said.split())


def joined(path):
    return " ".join(path.read_text(encoding="utf-8").split())


def with_stats(draws, **changes):
    """The same draws with other statistics of the first subject."""
    tree = draws.tree.copy()
    stats = tree["sample_stats"].to_dataset().load()
    for name, value in changes.items():
        values = stats[name].values.astype(object)
        values[0] = value
        stats[name] = (
            stats[name].dims,
            values.astype(str if isinstance(value, str) else stats[name].dtype),
        )
    tree["sample_stats"] = stats
    return Draws(tree)


def test_the_text_says_what_was_done_and_what_came_out(results, analysis):
    text, _ = document(results)
    draws, versions = analysis.draws, json.loads(analysis.draws.attrs["versions"])
    stats, factors = draws.group("sample_stats"), analysis.evidence.frame()["log_bayes_factor"]
    said = [
        "3 subjects gave 1,950 judgements (650 each)",
        "no order effect, constant error, contraction, both.",
        "`noise ~ LogNormal(1 D, 0.7), q0 ~ Beta(4, 1)",
        "yes from a posterior probability of 0.95 on, probably from 0.75",
        *study_lines(analysis.answers),
        frequency_line(analysis.answers),
        "Limits of the design: these pairs cannot show a contraction",
        f"(median {factors.median():.1f}, from {factors.min():.1f} to {factors.max():.1f})",
        "does not test for an order effect",
        f"emcee {versions['emcee']} [@emcee]",
        f"root seed {draws.seed}",
        f"at least {draws.sampler.required:,}",
        f"effective sample sizes of {float(stats['min_ess'].min()):,.0f} and more",
        f"R-hat up to {float(stats['max_r_hat'].max()):.4f}",
        "All draws met these criteria.",
        "The paper's model fits 3 of 3 subjects.",
        f"NumPy {versions['numpy']}",
    ]
    assert [one for one in said if one not in text] == []
    assert "synthetic" not in text
    lines = (results / "text" / "m.md").read_text(encoding="utf-8").splitlines()
    assert all(line.count("$") % 2 == 0 for line in lines), "no line ends within a formula"
    assert {path.name for path in (results / "text").iterdir()} >= FILES


def test_run_writes_what_the_command_does(results, analysis, tmp_path):
    write_text(of_analysis(analysis, None, figures=False), tmp_path / "m.md")
    assert joined(tmp_path / "m.md") == document(results)[0]


def test_one_subject_under_the_default_prior_after_something_was_done_to_the_data(
    small_study, tmp_path
):
    study = replace(
        small_study.select(["A"]), notes=("trial rows", "3 trials without a response dropped: A 3")
    )
    one = bt.run(study, draws=200, seed=1, workers=1)
    write_text(of_analysis(one, None, figures=False), tmp_path / "m.md")
    text = joined(tmp_path / "m.md")
    assert "Prior: `mu1 ~ Normal(M, 2.5 R), width ~ LogNormal(D, 1)" in text
    assert "1 subject gave 650 judgements of pairs" in text
    assert "Before the analysis: 3 trials without a response dropped: A 3." in text
    assert "**Results.** A: order effect: " in text
    assert "Expected share" not in text
    assert (
        f"log Bayes factor of H1 against H0 is {one.evidence.rows[0].log_bayes_factor:.1f} by"
        in text
    )


def test_citations_are_those_of_the_text(results, tmp_path):
    copied(results, tmp_path)
    for figures in (set(), {"corner", "matplotlib"}):
        if figures:
            (tmp_path / "corner").mkdir()
        text, _ = document(tmp_path)
        entries = (tmp_path / "text" / "m.bib").read_text(encoding="utf-8")
        keys = {*re.findall(r"^@\w+\{(\w+),", entries, flags=re.MULTILINE)}
        assert (
            keys
            == {*re.findall(r"@(\w+)", text)}
            >= {"avetta2026", "emcee", "arviz", "numpy", "scipy"} | figures
        )
        assert keys & {"corner", "matplotlib"} == figures
        assert f"Version {bt.__version__}" in entries


def test_tables_have_the_numbers_of_the_files(results, analysis):
    document(results)
    parameters, order = (
        pd.read_csv(results / "text" / f"m_{name}.csv") for name in ("parameters", "order_effect")
    )
    summary = analysis.draws.summary().set_index(["subject", "parameter"])
    for row in parameters.itertuples():
        for key in ("mu1", "sigma_p", "sigma_l", "q0", "gain"):
            wanted = summary.loc[(row.subject, key)]
            found = [getattr(row, f"{key}_{part}") for part in ("median", "q05", "q95")]
            assert found == wanted[["q50", "q05", "q95"]].tolist()
            assert (key in str(row.prior_dominated)) == (wanted.contraction < 0.5)
    evidence = pd.read_csv(results / "evidence.csv")
    pd.testing.assert_frame_equal(order, evidence[[*order.columns]])


def test_what_did_not_converge_or_fit_is_said(results, analysis, tmp_path):
    wrong = with_stats(
        analysis.draws,
        converged=0,
        shortfall="12 effective draws of mu1",
        predictive_p=0.001,
        min_ess=12.0,
    )
    wrong.tree.attrs["failed"] = '{"D": "its process was killed"}'
    wrong.save(tmp_path / "posterior.nc")
    first, *others = analysis.evidence.rows
    words = dict.fromkeys(first.answer.words, Word.NOT_INTERPRETABLE)
    swapped = replace(first.answer, words=words, is_interpretable=False, flags=("swapped blocks",))
    poor = replace(others[0].answer, predictive_p=0.0)
    first = replace(first, log_evidence_h1=None, answer=swapped)
    others[0] = replace(others[0], answer=poor)
    replace(analysis.evidence, rows=(first, *others), failed={"D": "killed"}).save(
        tmp_path / "evidence.csv"
    )
    text, _ = document(tmp_path)
    said = [
        "effective sample sizes of 12 and more (smallest: A)",
        "did not converge for A (12 effective draws of mu1); numbers of these subjects are not to be relied on",
        "There are no results of D (its process was killed)",
        "The paper's model fits 2 of 3 subjects; elsewhere its parameters mean little: A (p = 0.001",
        "The model does not fit 1: B.",
        "Not interpreted: A.",
        "It is not reported for A.",
    ]
    assert [one for one in said if one not in text] == []
    assert "met these criteria" not in text
    assert re.search(r"\| A \| 650 \|( not interpreted \|){3} -- \| -- \| -- \| -- \|", text)
    assert re.search(r"\| B \| 650 \| \w+ ! ", text)
    assert pd.read_csv(tmp_path / "text" / "m_parameters.csv").converged.tolist() == [
        "no",
        "yes",
        "yes",
    ]


def test_draws_of_another_model_are_refused(small_study, tmp_path):
    drawn = bt.sample(small_study.select(["A"]), model="both", draws=100, seed=1, workers=1)
    drawn.save(tmp_path / "posterior.nc")
    said = refused("methods", ".", "-o", "m.md", cwd=tmp_path)
    assert "found draws of the model 'both', allowed: the paper's" in said


def test_a_group_is_told_of_where_its_draws_are(results, small_study, tmp_path):
    copied(results, tmp_path)
    (tmp_path / "population.csv").write_text("parameter\n", encoding="utf-8")
    text, printed = document(tmp_path)
    assert "analysed together" not in text
    assert "population.csv: left out" in printed
    found = made_result(small_study)
    found.save(tmp_path / "population.nc")
    text, printed = document(tmp_path)
    assert "left out" not in printed
    assert "3 subjects were also analysed together (root seed 1)" in text
    assert "1,600 draws of 8 chains" in text
    rows = pd.read_csv(tmp_path / "text" / "m_population.csv")
    assert np.array_equal(rows["q50"], found.summary()["q50"])
    table = (tmp_path / "text" / "m_population.tex").read_text(encoding="utf-8")
    assert "ln BF of 0" in table
    for name in ("constant_error", "contraction"):
        assert f"& {found.effect(name).zero_mean.words} &" in table
    other = bt.Study(
        [*small_study.subjects[:2], replace(small_study["C"], n_yes=small_study["C"].n_yes - 1)]
    )
    made_result(other).save(tmp_path / "population.nc", overwrite=True)
    assert "population.nc: found other answers than the draws have of C" in refused(
        "methods", ".", "-o", "n.md", cwd=tmp_path
    )


@pytest.mark.parametrize(
    ("name", "old", "new", "said"),
    [
        ("evidence.csv", "0.5 D", "0.4 D", 'evidence.csv, column prior: found "noise ~ LogNormal'),
        (
            "evidence.csv",
            "(A,.*,13,650,[^,]*,[^,]*),-",
            r"\1,-1",
            "evidence.csv: found other answers than the draws have of 'A'",
        ),
        (
            "evidence.csv",
            "p_order_effect",
            "none",
            "evidence.csv: row 1, column p_order_effect: missing, found",
        ),
    ],
)
def test_a_table_of_another_analysis_is_one_line(results, tmp_path, name, old, new, said):
    copied(results, tmp_path)
    text = (tmp_path / name).read_text(encoding="utf-8")
    assert re.search(old, text)
    (tmp_path / name).write_text(re.sub(old, new, text), encoding="utf-8")
    assert said in refused("methods", ".", "-o", "m.md", cwd=tmp_path)


def test_other_refusals_are_one_line(results, tmp_path):
    copied(results, tmp_path)
    assert "m.txt: found the ending '.txt', allowed: .md, .tex" in refused(
        "methods", ".", "-o", "m.txt", cwd=tmp_path
    )
    (tmp_path / "m.bib").write_text("mine")
    assert "m.bib: exists" in refused("methods", ".", "-o", "m.md", cwd=tmp_path)
    (tmp_path / "posterior.nc").unlink()
    said = "found no posterior.nc, allowed: a folder that"
    assert said in refused("methods", ".", "-o", "n.md", cwd=tmp_path)


# --- Two markups ------------------------------------------------------------------------------------------------------------------


def test_no_name_is_read_as_markup():
    name = r"a_b & 5%$#{}~^\|<i>[x](y)*"
    latex, markdown = (
        templates(language).from_string("{{ name }}").render(name=name)
        for language in ("tex", "md")
    )
    left = re.sub(r"\\(text\w+\{\}|[&%$#_{}])", "", latex)
    assert not re.search(r"[&%$#_{}~^\\|<>]", left)
    assert re.sub(r"\\(.)", r"\1", markdown) == name
    assert not re.search(r"(?<!\\)[*_`|<>\[]", markdown)


def test_a_row_that_begins_with_a_bracket_is_none_of_the_line_break_before_it():
    table = (
        templates("tex")
        .globals["m"]
        .table(["subject", "x"], [["a", "1"], ["[b", "2"], ["*c", "3"]], "caption", "t")
    )
    assert not re.search(r"\\\\\s*[\[*]", table)
    assert table.count("{") == table.count("}")


def test_latex_has_its_tables_in_files(results):
    text, _ = document(results, name="m.tex")
    assert text.startswith("% Needs the packages")
    named = re.findall(r"\\input\{([^}]+)\}", text)
    assert named == ["m_parameters.tex", "m_order_effect.tex"]
    assert all((results / "text" / name).exists() for name in named)
    assert r"Prior: $\mu_1$ $\sim$ Normal(0, 10), $\sigma_p$ $\sim$ " in text
    assert text.count("{") == text.count("}")
    assert not re.search(r"(?<!\\)%(?! Needs)", text)
