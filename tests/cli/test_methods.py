"""What is said of an analysis in a paper: everything from its files, what did not converge or fit too, and no file of another one."""

import json
import re
from collections import Counter
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from commands import inside
from populations import made_up

import bayes_toe as bt
from bayes_toe.cli.headline import in_short
from bayes_toe.cli.methods_of_models import compared_facts
from bayes_toe.cli.supplement import templates
from bayes_toe.comparison.saved_tables import ComparisonFile
from bayes_toe.comparison.words import compared
from bayes_toe.comparison.words import order_effect as evidence_words
from bayes_toe.inference.draws import Draws
from bayes_toe.model.ladder import SYMMETRIC

FILES = {"m.md", "m.bib", "m_parameters.csv", "m_parameters.tex", "m_order_effect.csv", "m_order_effect.tex"}


@pytest.fixture(scope="module")
def results(analysis, tmp_path_factory):
    folder = tmp_path_factory.mktemp("results")
    analysis.draws.save(folder / "posterior.nc")
    analysis.evidence.save(folder / "evidence.csv")
    return folder


def document(folder, *words, name="m.md"):
    """The text with its lines joined, and what the command printed."""
    done = inside("methods", folder, "-o", folder / "text" / name, "--overwrite", *words)
    assert (done.returncode, done.stderr) == (0, "")
    return " ".join((folder / "text" / name).read_text(encoding="utf-8").split()), " ".join(done.stdout.split())


def with_stats(draws, **changes):
    """The same draws with other statistics of the first subject."""
    tree = draws.tree.copy()
    stats = tree["sample_stats"].to_dataset().load()
    for name, value in changes.items():
        values = stats[name].values.astype(object)
        values[0] = value
        stats[name] = (stats[name].dims, values.astype(str if isinstance(value, str) else stats[name].dtype))
    tree["sample_stats"] = stats
    return Draws(tree)


def test_the_text_says_what_was_done(results, analysis):
    text, _ = document(results)
    draws, versions = analysis.draws, json.loads(analysis.draws.attrs["versions"])
    stats = draws.group("sample_stats")
    said = [
        "3 subjects gave 1,950 judgements (650 each)",
        f"`{draws.described_prior()}`",
        "the first two have, beside the priors above, `width ~ HalfNormal(1), offset ~ Normal(0, D/2)`",
        f"emcee {versions['emcee']} [@emcee]",
        f"root seed {draws.seed}",
        f"at least {draws.sampler.required:,}",
        f"effective sample sizes of {float(stats['min_ess'].min()):,.0f} and more",
        f"R-hat up to {float(stats['max_r_hat'].max()):.4f}",
        "Draws of all subjects met these criteria.",
        "The model describes the answers of all of these.",
        f"In short: {in_short(analysis.evidence)}.",
        f"NumPy {versions['numpy']}",
    ]
    assert [one for one in said if one not in text] == []
    assert "synthetic" not in text
    assert {path.name for path in (results / "text").iterdir()} >= FILES


@pytest.mark.parametrize("figures", [False, True])
def test_citations_are_those_of_the_text(results, figures, tmp_path):
    for file in ("posterior.nc", "evidence.csv"):
        (tmp_path / file).write_bytes((results / file).read_bytes())
    if figures:
        (tmp_path / "corner").mkdir()
    text, _ = document(tmp_path)
    entries = (tmp_path / "text" / "m.bib").read_text(encoding="utf-8")
    keys = re.findall(r"^@\w+\{(\w+),", entries, flags=re.MULTILINE)
    assert set(keys) == set(re.findall(r"@(\w+)", text)) - {"VERSION"}
    assert ("corner" in keys) == ("matplotlib" in keys) == figures
    assert {"avetta2026", "emcee", "arviz", "numpy", "scipy"} <= set(keys)
    assert entries.count("{") == entries.count("}")
    assert f"Version {bt.__version__}" in entries


def test_tables_have_the_numbers_of_the_files(results, analysis):
    document(results)
    parameters, order = (pd.read_csv(results / "text" / f"m_{name}.csv") for name in ("parameters", "order_effect"))
    summary = analysis.draws.summary().set_index(["subject", "parameter"])
    for row in parameters.itertuples():
        for key in ("mu1", "sigma_p", "sigma_l", "q0", "gain"):
            wanted = summary.loc[(row.subject, key)]
            found = [getattr(row, f"{key}_{part}") for part in ("median", "q05", "q95")]
            assert found == wanted[["q50", "q05", "q95"]].tolist()
            assert (key in str(row.prior_dominated)) == (wanted.contraction < 0.5)
    evidence = analysis.evidence.frame()
    for name in ("p_none", "p_constant_error", "p_update", "predictive_p", "log_bayes_factor", "pareto_k"):
        np.testing.assert_allclose(order[name], evidence[name].astype(float), rtol=1e-12)
    assert set(order.fits) == {"yes"}


def test_what_did_not_converge_or_fit_is_said(results, analysis, tmp_path):
    wrong = with_stats(analysis.draws, converged=0, shortfall="12 effective draws of mu1", predictive_p=0.001, min_ess=12.0)
    wrong.tree.attrs["failed"] = '{"D": "its process was killed"}'
    wrong.save(tmp_path / "posterior.nc")
    rows = (replace(analysis.evidence.rows[0], log_evidence_h1=None, log_evidence_h1_se=None), *analysis.evidence.rows[1:])
    replace(analysis.evidence, rows=rows, failed={"D": "killed"}).save(tmp_path / "evidence.csv")
    text, _ = document(tmp_path)
    said = [
        "effective sample sizes of 12 and more (smallest: A)",
        "did not converge for A (12 effective draws of mu1); numbers of these subjects are not to be relied on",
        "There are no draws of D (its process was killed)",
        "The model does not describe the answers of 1: A (predictive p = 0.001",
        "Evidence was withheld for A.",
        "no estimate for 1 of 3 subjects",
    ]
    assert [one for one in said if one not in text] == []
    assert "met these criteria" not in text
    assert re.search(r"\| A \| 650 \| no estimate \| -- \| -- \| -- \| 0.001 \|[^|]*\| no \| -- \|", text)
    assert pd.read_csv(tmp_path / "text" / "m_parameters.csv").converged.tolist() == ["no", "yes", "yes"]


def test_of_no_more_pairs_than_parameters_no_fit_is_told(analysis, tmp_path):
    with_stats(analysis.draws, degrees_of_freedom=0, deviance_p=np.nan).save(tmp_path / "posterior.nc")
    text, _ = document(tmp_path)
    assert "of 2 of 3 subjects; a misfit" in text
    assert "Whether it describes the answers of A cannot be told" in text
    assert pd.read_csv(tmp_path / "text" / "m_fit.csv").fits.fillna("").tolist() == ["", "yes", "yes"]


def test_of_the_best_model_of_a_comparison_neither():
    few = SimpleNamespace(
        prior=bt.Prior(), model="predictive update", subject=lambda name: SimpleNamespace(n_pairs=2 if name == "a" else 3)
    )
    shape = np.zeros((2, 1))
    table = ComparisonFile(("a", "b"), (SYMMETRIC,), shape - 9.0, shape, shape, shape + 0.5)
    facts = compared_facts(table, few)
    assert (facts["untold"], facts["judged"]) == ("a", True)


def test_evidence_under_another_prior_of_the_constant_error_is_that_of_another_prior(analysis, tmp_path):
    analysis.draws.save(tmp_path / "posterior.nc")
    replace(analysis.evidence, prior=replace(analysis.draws.prior, offset_sd=0.05)).save(tmp_path / "evidence.csv")
    assert set(pd.read_csv(tmp_path / "evidence.csv").prior.str.partition("q0 ~ ")[2]) == {
        "Uniform(0, 1), offset of a constant error ~ Normal(0, 0.05)"
    }
    done = inside("methods", tmp_path, "-o", tmp_path / "m.md")
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "evidence.csv, column prior: found" in done.stderr


def test_draws_alone_of_another_model(small_study, tmp_path):
    bt.sample(small_study.select(["A"]), model="free weighting", draws=300, seed=1, workers=1).save(tmp_path / "posterior.nc")
    done = inside("methods", "posterior.nc", "-o", "m.md", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    text = " ".join((tmp_path / "m.md").read_text(encoding="utf-8").split())
    assert "under the model free weighting (" in text
    assert "Order effect" not in text
    assert list(pd.read_csv(tmp_path / "m_fit.csv")) == ["subject", "n_pairs", "n_trials", "predictive_p", "p_deviance", "fits"]


def test_a_group_is_told_of_where_its_draws_are(results, small_study, tmp_path):
    for name in ("posterior.nc", "evidence.csv"):
        (tmp_path / name).write_bytes((results / name).read_bytes())
    found = made_up(small_study)
    (tmp_path / "population.csv").write_text("parameter\n", encoding="utf-8")
    text, printed = document(tmp_path)
    assert "Population" not in text
    assert "population.csv: left out" in printed
    found.save(tmp_path / "population.nc")
    text, printed = document(tmp_path)
    assert "left out" not in printed
    assert "3 subjects were also analysed together (model: predictive update; root seed 0)" in text
    assert "without correlations between parameters" in text
    rows = pd.read_csv(tmp_path / "text" / "m_population.csv")
    assert np.array_equal(rows["q50"], found.summary()["q50"])
    other = bt.Study([*small_study.subjects[:2], replace(small_study["C"], n_equal=small_study["C"].n_equal - 1)])
    made_up(other).save(tmp_path / "population.nc", overwrite=True)
    done = inside("methods", tmp_path, "-o", tmp_path / "n.md")
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "population.nc: found other answers than the draws have of C" in done.stderr


@pytest.fixture(scope="module")
def tables(small_study, tmp_path_factory):
    """A folder with the tables of a comparison of few models, and of three values of each number of the prior."""
    folder, models = tmp_path_factory.mktemp("tables"), ["free frequencies", "symmetric", "constant bias", "predictive update"]
    found = bt.compare(small_study, models, draws=200, seed=1, prior="paper", workers=1)
    found.save(folder / "compare.csv")
    varied = bt.sensitivity(small_study, steps=3, seed=5, prior="paper", workers=1)
    varied.save(folder / "sensitivity.csv")
    return folder, found, varied


def test_a_comparison_and_a_sensitivity_are_told_of(results, tables):
    folder, found, varied = tables
    text, _ = document(results, "--compare", folder, "--sensitivity", folder / "sensitivity.csv")
    (order,), best = found.parts, Counter(row.model for row, _ in found.best_compositions().values())
    kinds = Counter(evidence_words(np.log(order.probability[i])) for i in range(3))
    said = [
        "3 models, the combinations of the parts order (none, constant error, update), and free frequencies (H0) were compared",
        "(beside those above: `width ~ HalfNormal(1), offset ~ Normal(0, D/2)`)",
        f"largest Pareto k-hat {max(row.pareto_k for row in found if row.pareto_k is not None):.2f}",
        *(f"{word} for {count}" for word, count in kinds.items()),
        f"P(update) {compared(order.study[2])}",
        f"The model with the highest evidence: {', '.join(f'{name} for {count}' for name, count in best.most_common())}.",
        "It describes the answers of all (no posterior predictive p-value below 0.01).",
        f"of {len(varied.rows)} values by draws that were made anew",
        "mu1\\_sd 2.5 to 40",
    ]
    assert [one for one in said if one not in text] == []
    turning = [name for name in varied.names if any(varied.turns(name, number) for number in varied.varied)]
    assert (f"Its sign turns within this range for {len(turning) or 'none'} of 3 subjects") in text
    assert "@penny2010" in text
    assert "penny2010" in (results / "text" / "m.bib").read_text(encoding="utf-8")
    assert "Comparison of models" not in document(results)[0]


def test_tables_beside_the_draws_are_found_and_what_they_lack_is_said(results, tables, tmp_path):
    for path in (*results.glob("*.nc"), *tables[0].iterdir()):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    frame = pd.read_csv(tmp_path / "compare.csv")
    frame.loc[(frame.subject == "A") & (frame.model == "symmetric"), ["log_evidence", "log_evidence_se"]] = np.nan
    frame.loc[frame.subject == "B", "p_predictive"] = 0.001
    frame.to_csv(tmp_path / "compare.csv", index=False)
    text, _ = document(tmp_path)
    assert "Some evidence was withheld for A." in text
    assert "no estimate for 1 of 3 subjects" in text
    assert re.search(r"Even this one does not describe the answers of B \(p = 0.001\)", text)
    assert "Sensitivity to the prior" in text


@pytest.mark.parametrize(
    ("name", "old", "new", "said"),
    [
        ("compare.csv", "Normal(0, 10)", "Normal(0, 9)", "compare.csv, column prior: found"),
        ("compare.csv", "A,free frequencies,13,-", "A,free frequencies,13,-1", "found other answers than the draws have of 'A'"),
        ("compare.csv", "C,symmetric", "D,symmetric", "compare.csv: found other subjects than the draws have, 'D'"),
        ("compare.csv", "C,symmetric", "C,other", "compare.csv: no row of subject 'A' with model 'other'"),
        ("sensitivity.csv", "Normal(0, 40)", "Normal(0, 41)", "sensitivity.csv, column prior: found"),
    ],
)
def test_tables_of_another_analysis_are_one_line(results, tables, tmp_path, name, old, new, said):
    for path in tables[0].iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    text = (tmp_path / name).read_text(encoding="utf-8")
    assert old in text
    (tmp_path / name).write_text(text.replace(old, new), encoding="utf-8")
    done = inside("methods", results, "-o", tmp_path / "m.md", "--compare", tmp_path, "--sensitivity", tmp_path)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert said in done.stderr


@pytest.mark.parametrize(
    ("name", "old", "new", "said"),
    [
        ("m.txt", "", "", "m.txt: found the ending '.txt', allowed: .md, .tex"),
        ("m.md", "posterior.nc", None, "found no posterior.nc and no posterior.zarr, allowed: a folder that"),
        ("m.md", "m.bib", None, "m.bib: exists"),
        ("m.md", "Normal(0, 10)", "Normal(0, 9)", "evidence.csv, column prior: found 'mu1 ~ Normal(0, 9)"),
        ("m.md", "A,13,650", "A,13,651", "evidence.csv: found other answers than the draws have of 'A'"),
        ("m.md", "p_none", "none", "evidence.csv: row 1, column p_none: missing, found"),
    ],
    ids=["ending", "no draws", "exists", "prior", "counts", "column"],
)
def test_what_does_not_belong_together_is_one_line(name, old, new, said, results, tmp_path):
    for file in ("posterior.nc", "evidence.csv"):
        (tmp_path / file).write_bytes((results / file).read_bytes())
    if new is None:  # a file that is missing, or there already
        (tmp_path / old).unlink() if (tmp_path / old).exists() else (tmp_path / old).write_text("mine")
    else:
        text = (tmp_path / "evidence.csv").read_text(encoding="utf-8")
        assert old in text
        (tmp_path / "evidence.csv").write_text(text.replace(old, new), encoding="utf-8")
    before = {path.name for path in tmp_path.iterdir()}
    done = inside("methods", ".", "-o", name, cwd=tmp_path)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert said in done.stderr
    assert {path.name for path in tmp_path.iterdir()} == before


# --- Two markups ------------------------------------------------------------------------------------------------------------------


def test_no_name_is_read_as_markup():
    name = r"a_b & 5%$#{}~^\|<i>[x](y)*"
    latex, markdown = (templates(language).from_string("{{ name }}").render(name=name) for language in ("tex", "md"))
    left = re.sub(r"\\(text\w+\{\}|[&%$#_{}])", "", latex)
    assert not re.search(r"[&%$#_{}~^\\|<>]", left)
    assert re.sub(r"\\(.)", r"\1", markdown) == name
    assert not re.search(r"(?<!\\)[*_`|<>\[]", markdown)


def test_a_row_that_begins_with_a_bracket_is_none_of_the_line_break_before_it():
    table = templates("tex").globals["m"].table(["subject", "x"], [["a", "1"], ["[b", "2"], ["*c", "3"]], "caption", "t")
    assert not re.search(r"\\\\\s*[\[*]", table)
    assert table.count("{") == table.count("}")


def test_latex_has_its_tables_in_files(results):
    text, _ = document(results, name="m.tex")
    assert text.startswith("% Needs the packages")
    named = re.findall(r"\\input\{([^}]+)\}", text)
    assert named == ["m_parameters.tex", "m_order_effect.tex"]
    assert all((results / "text" / name).exists() for name in named)
    assert r"$\sigma_p$ $\sim$ HalfNormal(1)" in text
    assert text.count("{") == text.count("}")
    assert not re.search(r"(?<!\\)%(?! Needs)", text)
