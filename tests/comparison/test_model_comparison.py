"""The comparison table: columns, probabilities, notes, files, order."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

import bayes_toe as bt
from bayes_toe.cli.app import app
from bayes_toe.cli.compare import say_comparison
from bayes_toe.cli.terminal import Terminal
from bayes_toe.comparison.model_comparison import COMPARE_COLUMNS, ModelComparison, compare, with_probabilities
from bayes_toe.comparison.model_row import Checks, ModelRow, with_differences
from bayes_toe.comparison.random_effects import random_effects
from bayes_toe.errors import InputError
from bayes_toe.model.free_frequencies import frequency_evidence
from bayes_toe.model.ladder import NAMES

FEW = ("free frequencies", "symmetric", "predictive update")


@pytest.fixture(scope="module")
def table(small_study):
    return compare(small_study.select(["A", "C"]), FEW, seed=5, prior="paper", workers=1)


def test_columns_and_order(table):
    frame = table.frame()
    assert tuple(frame.columns) == COMPARE_COLUMNS
    assert frame["subject"].tolist() == ["A"] * 3 + ["C"] * 3
    assert frame["model"].tolist() == list(FEW) * 2
    assert frame["parameters"].tolist() == [13, 2, 4] * 2
    assert frame.groupby("subject")["model_probability"].sum().to_numpy() == pytest.approx(1.0)
    assert frame["pareto_k"].isna().tolist() == [True, False, False] * 2


def test_h1_and_h0_are_those_of_the_evidence_table(table, analysis, small_study):
    for name in ("A", "C"):
        assert table[name, "predictive update"].log_evidence == analysis.evidence[name].log_evidence_h1  # same seed: same digits
        assert table[name, "free frequencies"].log_evidence == frequency_evidence(small_study[name])


def test_subjects_are_independent_of_company_and_workers(table, small_study):
    alone = compare(small_study.select(["C"]), ["symmetric"], seed=5, prior="paper", workers=1)
    assert alone["C", "symmetric"].log_evidence == table["C", "symmetric"].log_evidence
    assert alone["C", "symmetric"].checks == table["C", "symmetric"].checks
    shared = compare(small_study.select(["C", "A"]), FEW, seed=5, prior="paper", workers=2)
    assert [shared[name, model] for name in ("A", "C") for model in FEW] == list(table)


def test_a_model_that_misses_an_order_effect_is_seen_by_its_checks(table):
    assert table["A", "symmetric"].checks.p_predictive < 0.01 < table["A", "predictive update"].checks.p_predictive
    assert table["A", "symmetric"].model_probability < 1e-3
    assert table["A", "symmetric"].checks.elpd_loo_trial < table["A", "predictive update"].checks.elpd_loo_trial - 10


@pytest.mark.parametrize("unit", ["pair", "trial"])
def test_differences_to_the_best_model_have_paired_errors(table, unit):
    elpd, difference, error = f"elpd_loo_{unit}", f"elpd_loo_{unit}_diff", f"elpd_loo_{unit}_diff_se"
    frame, study = table.frame(), table.study_frame()
    units = []
    for name, rows in frame.groupby("subject"):
        best = rows.loc[rows[elpd].idxmax()]
        assert (best[difference], best[error]) == (0.0, 0.0)
        assert rows[difference].to_numpy() == pytest.approx((rows[elpd] - best[elpd]).to_numpy(), abs=1e-9)
        kept = [table[name, model].left_out[unit] for model in FEW]
        units.append([np.repeat(one.values[one.counts > 0], one.counts[one.counts > 0]) for one in kept])
        apart = np.array(units[-1]) - units[-1][FEW.index(best["model"])]
        assert rows[error].to_numpy() == pytest.approx(np.sqrt(apart.shape[1]) * apart.std(axis=1, ddof=1), abs=1e-9)
    total = [np.concatenate(each) for each in zip(*units, strict=True)]
    best = int(np.argmax([each.sum() for each in total]))
    for i, each in enumerate(total):
        apart = each - total[best]
        assert study[difference][i] == pytest.approx(apart.sum(), abs=1e-9)
        assert study[error][i] == pytest.approx(np.sqrt(len(apart)) * apart.std(ddof=1), abs=1e-9)
        assert study[difference][i] == pytest.approx(study[elpd][i] - study[elpd].max(), abs=1e-9)


def test_what_is_withheld_has_no_difference(table):
    first, second, third = table.rows[:3]
    pairs = first.left_out["pair"]
    none = replace(pairs, values=np.where(np.arange(len(pairs.values[0])) == 0, np.nan, pairs.values))
    rows = with_differences([replace(first, left_out={**first.left_out, "pair": none}), second, replace(third, left_out={})])
    assert [[row.cell(f"elpd_loo_pair_{name}") for name in ("diff", "diff_se")] for row in rows] == [[None] * 2, [0.0] * 2, [None] * 2]
    assert rows[0].cell("elpd_loo_trial_diff") == 0.0
    assert ModelComparison(tuple(rows), ("A",), FEW, 1, bt.Prior()).study_frame()["elpd_loo_trial_diff"].isna().all()


def test_study_table(table):
    frame = table.study_frame()
    assert frame["model"].tolist() == list(FEW)
    assert frame["best"].sum() == frame["subjects"].iloc[0] == 2
    assert frame["expected"].sum() == pytest.approx(1.0)
    assert frame["group_log_evidence"].to_numpy() == pytest.approx(table.log_evidence.sum(axis=0))


#: compare_models.csv: new columns come at the end.
MODEL_COLUMNS = [
    *("model", "subjects", "best", "expected", "exceedance", "protected", "omnibus_risk"),
    *("group_log_evidence", "elpd_loo_trial", "elpd_loo_pair"),
    *("expected_exact", "exceedance_exact", "protected_exact", "omnibus_risk_exact"),
    *("elpd_loo_trial_subjects", "elpd_loo_pair_subjects"),
    *("elpd_loo_pair_diff", "elpd_loo_pair_diff_se", "elpd_loo_trial_diff", "elpd_loo_trial_diff_se"),
    *("exact_how", "expected_exact_se", "exceedance_exact_se", "omnibus_risk_exact_se"),
]


def made(evidence, trial=None, pair=None):
    """A comparison with these log evidences and leave-one-out values (NaN: withheld), and nothing else in it."""
    evidence = np.asarray(evidence, float)
    given = [evidence, *(np.zeros(evidence.shape) if one is None else np.asarray(one, float) for one in (trial, pair))]
    subjects = tuple(f"P{i + 1}" for i in range(len(evidence)))
    rows = []
    for i, subject in enumerate(subjects):
        for j, model in enumerate(NAMES[: evidence.shape[1]]):
            values = [None if np.isnan(one[i, j]) else float(one[i, j]) for one in given]
            rows.append(ModelRow(subject, model, 2, values[0], 0.0, None, Checks(elpd_loo_trial=values[1], elpd_loo_pair=values[2])))
    return ModelComparison(tuple(rows), subjects, NAMES[: evidence.shape[1]], 1, bt.Prior())


def test_model_frequencies_over_the_study_are_by_random_effects_with_their_errors(capsys):
    evidence = np.random.default_rng(9).normal(size=(7, 3)) * 2
    evidence[2, 1] = np.nan  # does not count
    table = made(evidence)
    frame, found = table.study_frame(), random_effects(np.delete(evidence, 2, axis=0), seed=table.seed)
    assert list(frame) == MODEL_COLUMNS
    for name in ("expected", "exceedance", "protected", "omnibus_risk"):
        assert frame[name].to_numpy() == pytest.approx(np.broadcast_to(getattr(found, name), 3), rel=1e-12)
        assert np.array_equal(frame[name], frame[f"{name}_exact"])
    assert np.array_equal(frame["exceedance_exact_se"], found.exceedance_se)
    assert (frame[["expected_exact_se", "exceedance_exact_se", "omnibus_risk_exact_se"]] > 0).all(axis=None)
    assert set(frame["exact_how"]) == {"sampled"}
    say_comparison(Terminal(), table)
    said = capsys.readouterr().out
    assert "random effects (sampled)" in said
    assert f"all models equally frequent with probability {found.omnibus_risk:.3f} ± {found.omnibus_risk_se:.1g} (sampled)" in said
    assert "LOO by" not in said.split("all models")[1]  # every value is there: nothing to say


def test_sums_of_leave_one_out_go_over_subjects_with_a_value_under_every_model(capsys):
    trial = np.array([[-1.0, -2.0], [-4.0, np.nan], [-16.0, -32.0]])
    pair = np.full((3, 2), np.nan)
    table = made(np.zeros((3, 2)), trial, pair)
    frame = table.study_frame()
    assert frame["elpd_loo_trial"].tolist() == [-17.0, -34.0]
    assert frame["elpd_loo_trial_subjects"].tolist() == [2, 2]
    assert frame["elpd_loo_pair"].isna().all()
    assert frame["elpd_loo_pair_subjects"].tolist() == [0, 0]
    say_comparison(Terminal(), table)
    said = capsys.readouterr().out
    assert "LOO by trial: sums over 2 of 3 subjects, those with a value under every model" in said
    assert "LOO by pair: no sum, no subject has a value under every model" in said


def test_without_an_evidence_there_are_no_probabilities_and_the_note_says_so(table):
    rows = [replace(row, model_probability=None) for row in table.rows[:3]]
    rows[1] = replace(rows[1], log_evidence=None)
    withheld = with_probabilities(rows)
    assert all(row.model_probability is None and "no evidence of symmetric" in row.notes[-1] for row in withheld)
    assert ModelComparison(tuple(withheld), ("A",), FEW, 1, bt.Prior()).study_frame()["expected"].isna().all()


def test_a_model_without_weight_has_probability_0_and_takes_nobody_elses(table):
    rows = [replace(row, model_probability=None) for row in table.rows[:3]]
    rest = rows[0].log_evidence, rows[2].log_evidence
    behind = replace(rows[1], log_evidence=None, log_evidence_se=None, bound=min(rest) - 200.0)
    found = ModelComparison(tuple(with_probabilities([rows[0], behind, rows[2]])), ("A",), FEW, 1, bt.Prior())
    shares = [row.model_probability for row in found]
    assert shares[1] == 0.0
    assert sum(shares) == pytest.approx(1.0, abs=1e-12)
    assert np.log(shares[2] / shares[0]) == pytest.approx(rest[1] - rest[0], abs=1e-9)
    assert f"its log evidence is at most {behind.bound:.1f}" in found.rows[1].notes[-1]
    assert np.isnan(found.log_evidence[0, 1])
    study = found.study_frame()
    assert study["subjects"].tolist() == [1] * 3
    assert study["expected"].notna().all()
    assert study["group_log_evidence"].isna().tolist() == [False, True, False]
    order = {level: p for _, part, level, p, _ in found.parts_frame().itertuples(index=False) if part == "order"}
    assert order == {"none": 0.0, "update": 1.0}
    near = with_probabilities([rows[0], replace(behind, bound=max(rest) - 5.0), rows[2]])
    assert all(row.model_probability is None for row in near)


def test_refusals(small_study):
    with pytest.raises(InputError, match=r"'H9'; allowed, joined by .*; or: free frequencies"):
        compare(small_study, ["H9"], seed=1)
    with pytest.raises(InputError, match="draws=0"):
        compare(small_study, FEW, seed=1, draws=0)


def test_command(study_csv, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def call(*words):
        done = CliRunner().invoke(app, ["compare", str(study_csv), "-o", *words])
        return done.exit_code, done.output

    options = ("--seed", "1", "--workers", "1", "--model", "symmetric", "--model", "free frequencies")
    code, said = call("out.csv", *options)
    assert code == 0, said
    assert "out.csv, out_models.csv, out_parts.csv, out.png" in said
    assert (tmp_path / "out.png").read_bytes().startswith(b"\x89PNG")
    frame = pd.read_csv(tmp_path / "out.csv")
    assert tuple(frame.columns) == COMPARE_COLUMNS
    assert len(frame) == 6
    assert set(frame.prior) == {
        "every frequency ~ Uniform(0, 1)",
        "width ~ LogNormal(D, 1), q0 ~ Beta(4, 1); M mean and R sd of the stimuli, D rms step",
    }
    assert pd.read_csv(tmp_path / "out_models.csv")["model"].tolist() == list(NAMES[:2])
    assert frame.parts.dropna().unique().tolist() == [
        "order: none; noise: Weber; lapses: misses; curve: bell; peak: one peak; spread: binomial; history: static"
    ]
    assert pd.read_csv(tmp_path / "out_parts.csv").empty  # one composition: no part varies
    (tmp_path / "prior.toml").write_text("sigma_p_scale = 2.0\n")
    code, said = call("other.csv", *options, "--prior", "prior.toml")
    assert code == 0, said
    changed = pd.read_csv(tmp_path / "other.csv")
    assert "width ~ HalfNormal(2), q0 ~ Uniform(0, 1)" in set(changed.prior)
    assert (changed.log_evidence != frame.log_evidence).sum() == 3
    for name, there in (("out.csv", True), ("out_models.csv", False), ("out_parts.csv", False), ("out.png", False)):
        code, said = call("out.csv", *options)  # refused before any work
        assert (code, name in said, "exists" in said) == (2, True, True)
        assert (tmp_path / "out.csv").exists() == there
        (tmp_path / name).unlink()
    assert call("table.png")[0] == 2
    assert "name of the figure" in call("table.png")[1]
    assert "'H9'; allowed, joined by +: order: update" in call("new.csv", "--model", "H9")[1]
