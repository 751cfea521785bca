"""The comparison: rows and their probabilities, sums over the study, parts of compositions, files and words."""

import itertools
from dataclasses import replace
from math import factorial

import numpy as np
import pandas as pd
import pytest
from commands import good, refused
from conftest import few_pairs

import bayes_toe as bt
from bayes_toe.cli.compare import say_comparison
from bayes_toe.cli.terminal import Terminal
from bayes_toe.comparison.model_comparison import (
    COMPARE_COLUMNS,
    PARTS_COLUMNS,
    ModelComparison,
    compare,
    part_tables,
    with_probabilities,
)
from bayes_toe.comparison.model_row import Checks, ModelRow, with_differences
from bayes_toe.comparison.random_effects import random_effects
from bayes_toe.data.tasks import SAME_DIFFERENT
from bayes_toe.errors import InputError
from bayes_toe.inference.subject import Wanted, infer
from bayes_toe.model.free_frequencies import frequency_evidence
from bayes_toe.model.ladder import MODELS, NAMES, model_named, models_of, require_models

FEW = ("free frequencies", "symmetric", "predictive update")
#: Free frequencies and the 48 compositions; log evidences of three subjects.
WHOLE = models_of(SAME_DIFFERENT).compared
EVIDENCE = np.random.default_rng(4).normal(size=(3, len(WHOLE))) * 2 - 300


@pytest.fixture(scope="module")
def table(small_study):
    return compare(small_study.select(["A", "C"]), FEW, seed=5, prior="paper", workers=1)


def made(evidence, models=NAMES, trial=None, pair=None):
    """A comparison with these log evidences and leave-one-out values (NaN: withheld), and nothing else in it."""
    evidence = np.asarray(evidence, float)
    given = np.stack(
        [evidence, *(np.zeros(evidence.shape) if one is None else one for one in (trial, pair))],
        axis=-1,
    )
    subjects, models = (
        tuple(f"P{i + 1}" for i in range(len(evidence))),
        tuple(models[: evidence.shape[1]]),
    )
    rows = []
    for (subject, model), cells in zip(
        itertools.product(subjects, models), given.reshape(-1, 3).tolist(), strict=True
    ):
        value, one, other = (None if np.isnan(cell) else cell for cell in cells)
        rows.append(
            ModelRow(
                subject, model, 2, value, 0.0, None, Checks(elpd_loo_trial=one, elpd_loo_pair=other)
            )
        )
    return ModelComparison(tuple(rows), subjects, models, 1, bt.Prior())


def test_rows_are_subjects_under_models(table, analysis, small_study):
    frame = table.frame()
    assert frame[["subject", "model", "parameters"]].to_numpy().tolist() == [
        [s, *of] for s in "AC" for of in zip(FEW, (13, 2, 4), strict=True)
    ]
    assert frame.groupby("subject")["model_probability"].sum().to_numpy() == pytest.approx(1.0)
    assert frame["pareto_k"].isna().tolist() == [True, False, False] * 2
    for name in ("A", "C"):  # H1 and H0 of the evidence table: same seed, same digits
        assert (
            table[name, "predictive update"].log_evidence == analysis.evidence[name].log_evidence_h1
        )
        assert table[name, "free frequencies"].log_evidence == frequency_evidence(small_study[name])


def test_subjects_are_independent_of_company_and_workers(table, small_study):
    (alone,) = compare(small_study.select(["C"]), ["symmetric"], seed=5, prior="paper", workers=1)
    assert (alone.log_evidence, alone.checks) == (
        table["C", "symmetric"].log_evidence,
        table["C", "symmetric"].checks,
    )
    shared = compare(small_study.select(["C", "A"]), FEW, seed=5, prior="paper", workers=2)
    assert [shared[name, model] for name in ("A", "C") for model in FEW] == list(table)


def test_the_space_of_verdicts_has_the_values_of_each_of_its_models_and_the_verdict(three_models):
    """What `compare` does by default, over three models: rows from the verdict's draws agree with those of each model asked for by name."""
    study = few_pairs(["A"])
    whole = compare(study, draws=300, seed=5, prior="paper", workers=1)
    assert (
        whole.verdicts[0].p_none
        == bt.evidence(study, seed=5, prior="paper", workers=1)["A"].verdict.p_none
    )
    near = [row for row in whole if row.pareto_k is not None]
    assert len(near) > 1
    for row, other in zip(
        near,
        compare(study, [row.model for row in near], draws=300, seed=6, prior="paper", workers=1),
        strict=True,
    ):
        assert row.parameters == other.parameters
        assert abs(row.log_evidence - other.log_evidence) < 5.0 * np.hypot(
            row.log_evidence_se, other.log_evidence_se
        )
        assert row.checks.p_predictive == pytest.approx(other.checks.p_predictive, abs=0.06)
        assert row.checks.elpd_loo_trial == pytest.approx(other.checks.elpd_loo_trial, abs=0.2)


def test_a_model_that_misses_an_order_effect_is_seen_by_its_checks(table):
    misses, update = table["A", "symmetric"], table["A", "predictive update"]
    assert misses.checks.p_predictive < 0.01 < update.checks.p_predictive
    assert misses.model_probability < 1e-3
    assert misses.checks.elpd_loo_trial < update.checks.elpd_loo_trial - 10


@pytest.mark.parametrize("unit", ["pair", "trial"])
def test_differences_to_the_best_model_have_paired_errors(table, unit):
    """Of each subject, and of the study, whose units are those of all subjects."""
    elpd, columns = f"elpd_loo_{unit}", [f"elpd_loo_{unit}_diff", f"elpd_loo_{unit}_diff_se"]
    units = {}
    for name in ("A", "C"):
        kept = [table[name, model].left_out[unit] for model in FEW]
        units[name] = np.array(
            [np.repeat(one.values[one.counts > 0], one.counts[one.counts > 0]) for one in kept]
        )
    frames = {name: rows for name, rows in table.frame().groupby("subject")} | {
        "*": table.study_frame()
    }
    for name, rows in frames.items():
        each = np.concatenate([*units.values()], axis=1) if name == "*" else units[name]
        apart = each - each[each.sum(axis=1).argmax()]
        expected = np.stack(
            [apart.sum(axis=1), np.sqrt(apart.shape[1]) * apart.std(axis=1, ddof=1)], axis=1
        )
        assert rows[columns].to_numpy() == pytest.approx(expected, abs=1e-9)
        assert rows[columns[0]].to_numpy() == pytest.approx(rows[elpd] - rows[elpd].max(), abs=1e-9)


def test_what_is_withheld_has_no_difference(table):
    first, second, third = table.rows[:3]
    pairs = first.left_out["pair"]
    none = replace(
        pairs, values=np.where(np.arange(len(pairs.values[0])) == 0, np.nan, pairs.values)
    )
    rows = with_differences(
        [
            replace(first, left_out={**first.left_out, "pair": none}),
            second,
            replace(third, left_out={}),
        ]
    )
    assert [
        [row.cell(f"elpd_loo_pair_{name}") for name in ("diff", "diff_se")] for row in rows
    ] == [[None] * 2, [0.0] * 2, [None] * 2]
    assert rows[0].cell("elpd_loo_trial_diff") == 0.0
    assert (
        ModelComparison(tuple(rows), ("A",), FEW, 1, bt.Prior())
        .study_frame()["elpd_loo_trial_diff"]
        .isna()
        .all()
    )
    left = ModelComparison((*rows, *table.rows[3:]), ("A", "C"), FEW, 1, bt.Prior()).study_frame()[
        "elpd_loo_pair_diff"
    ]
    assert left.tolist() == [
        row.differences["elpd_loo_pair_diff"] for row in table.rows[3:]
    ]  # of the other subject alone


# --- the study ----------------------------------------------------------------------------------------------------------------------

#: compare_models.csv: new columns come at the end.
MODEL_COLUMNS = [
    *("model", "subjects", "best", "expected", "exceedance", "protected", "omnibus_risk"),
    *("group_log_evidence", "elpd_loo_trial", "elpd_loo_pair"),
    *("expected_exact", "exceedance_exact", "protected_exact", "omnibus_risk_exact"),
    *("elpd_loo_trial_subjects", "elpd_loo_pair_subjects"),
    *(
        "elpd_loo_pair_diff",
        "elpd_loo_pair_diff_se",
        "elpd_loo_trial_diff",
        "elpd_loo_trial_diff_se",
    ),
    *("exact_how", "expected_exact_se", "exceedance_exact_se", "omnibus_risk_exact_se"),
]


def test_model_frequencies_over_the_study_are_by_random_effects_with_their_errors(capsys):
    evidence = np.random.default_rng(9).normal(size=(7, 3)) * 2
    evidence[2, 1] = np.nan  # does not count
    table, counted = made(evidence), np.delete(evidence, 2, axis=0)
    frame, found = table.study_frame(), random_effects(counted, seed=table.seed)
    assert list(frame) == MODEL_COLUMNS
    for name in ("expected", "exceedance", "protected", "omnibus_risk"):
        assert frame[name].to_numpy() == pytest.approx(
            np.broadcast_to(getattr(found, name), 3), rel=1e-12
        )
        assert np.array_equal(frame[name], frame[f"{name}_exact"])
        if name != "protected":
            assert (frame[f"{name}_exact_se"] == getattr(found, f"{name}_se")).all()
    assert (frame["best"].tolist(), set(frame["subjects"])) == (
        np.bincount(counted.argmax(axis=1), minlength=3).tolist(),
        {6},
    )
    assert frame["group_log_evidence"].to_numpy() == pytest.approx(counted.sum(axis=0))
    assert set(frame["exact_how"]) == {"sampled"}
    say_comparison(Terminal(), table)
    said = capsys.readouterr().out
    assert "random effects (sampled)" in said
    assert (
        f"all models equally frequent with probability {found.omnibus_risk:.3f} ± {found.omnibus_risk_se:.1g} (sampled)"
        in said
    )
    assert "LOO by" not in said.split("all models")[1]  # every value is there: nothing to say


def test_sums_of_leave_one_out_go_over_subjects_with_a_value_under_every_model(capsys):
    trial, pair = np.array([[-1.0, -2.0], [-4.0, np.nan], [-16.0, -32.0]]), np.full((3, 2), np.nan)
    table = made(np.zeros((3, 2)), trial=trial, pair=pair)
    sums = table.study_frame()[
        ["elpd_loo_trial", "elpd_loo_trial_subjects", "elpd_loo_pair", "elpd_loo_pair_subjects"]
    ]
    assert sums.to_numpy() == pytest.approx(
        np.array([[-17.0, 2, np.nan, 0], [-34.0, 2, np.nan, 0]]), nan_ok=True
    )
    say_comparison(Terminal(), table)
    said = capsys.readouterr().out
    assert "LOO by trial: sums over 2 of 3 subjects, those with a value under every model" in said
    assert "LOO by pair: no sum, no subject has a value under every model" in said


def test_without_an_evidence_there_are_no_probabilities_and_the_note_says_so():
    table = made([[-3.0, np.nan, -1.0]])
    withheld = with_probabilities(table.rows)
    assert all(
        row.model_probability is None and "no evidence of symmetric" in row.notes[-1]
        for row in withheld
    )
    assert table.study_frame()["expected"].isna().all()


def test_a_model_without_weight_has_probability_0_and_takes_nobody_elses():
    first, behind, last = made([[-3.0, np.nan, -1.0]], FEW).rows
    found = with_probabilities([first, replace(behind, bound=-203.0), last])
    assert [row.model_probability for row in found] == pytest.approx(
        [1 / (1 + np.exp(2)), 0.0, 1 / (1 + np.exp(-2))], rel=1e-12
    )
    assert "its log evidence is at most -203.0" in found[1].notes[-1]
    whole = ModelComparison(tuple(found), ("P1",), FEW, 1, bt.Prior())
    study = whole.study_frame()
    assert study["subjects"].tolist() == [1] * 3
    assert study["expected"].notna().all()
    assert study["group_log_evidence"].isna().tolist() == [False, True, False]
    order = {
        level: p
        for _, part, level, p, _ in whole.parts_frame().itertuples(index=False)
        if part == "order"
    }
    assert order == {"none": 0.0, "update": 1.0}
    assert all(
        row.model_probability is None
        for row in with_probabilities([first, replace(behind, bound=-6.0), last])
    )


# --- parts of compositions ----------------------------------------------------------------------------------------------------------


def test_in_the_default_space_a_level_has_the_sum_of_its_models():
    found = {part.part: part for part in part_tables(WHOLE, EVIDENCE)}
    assert {name: part.levels for name, part in found.items()} == {
        "order": ("none", "constant error", "update"),
        "noise": ("Weber", "sloped"),
        "lapses": ("misses", "both ways"),
        "curve": ("bell", "differencing"),
        "peak": ("one peak", "sloped peak"),
    }
    weights = np.exp(EVIDENCE[:, 1:] + 300)  # without free frequencies
    weights /= weights.sum(axis=1, keepdims=True)
    for name, part in found.items():
        for k, level in enumerate(part.levels):
            p = weights[:, [dict(model.levels)[name] == level for model in WHOLE[1:]]].sum(axis=1)
            assert part.probability[:, k] == pytest.approx(p, rel=1e-12)
            assert part.log_inclusion[:, k] == pytest.approx(
                np.log(p / (1 - p) * (len(part.levels) - 1)), rel=1e-9, abs=1e-12
            )


def test_levels_of_few_and_of_many_models_start_even_and_keep_their_digits_beyond_the_range_of_floats():
    assert all(
        part.probability == pytest.approx(1 / len(part.levels))
        for part in part_tables(MODELS, np.zeros((1, 8)))
    )
    order = part_tables(MODELS, np.log([[9.0, 1.0, 2.0, 4.0, 1.0, 7.0, 1.0, 3.0]]))[0]
    assert order.levels == ("none", "constant error", "update", "free weighting", "mean-reverting")
    assert order.probability[0] == pytest.approx(np.array([1, 3, 4, 1, 3]) / 12)
    order = part_tables(require_models(["none", "update"]), [[0.0, 5000.0]])[0]
    assert (order.log_inclusion.tolist(), order.probability.tolist()) == (
        [[-5000.0, 5000.0]],
        [[0.0, 1.0]],
    )


def test_the_study_is_the_sum_over_all_assignments_of_families():
    order = part_tables(WHOLE, EVIDENCE)[0]
    levels = np.array([order.levels.index(dict(model.levels)["order"]) for model in WHOLE[1:]])
    family = np.stack(
        [np.exp(EVIDENCE[:, 1:] + 300)[:, levels == k].mean(axis=1) for k in range(3)], axis=1
    )
    total, mean = 0.0, np.zeros(3)
    for assignment in itertools.product(range(3), repeat=3):
        counts = np.bincount(assignment, minlength=3)
        weight = family[np.arange(3), assignment].prod() * np.prod([factorial(n) for n in counts])
        total, mean = total + weight, mean + weight * (counts + 1) / 6
    assert order.study == pytest.approx(
        mean / total, abs=0.01
    )  # sampled: standard errors below 0.002
    assert order.study_log_inclusion == pytest.approx(
        np.log(order.study / (1 - order.study) * 2), rel=1e-12
    )


def test_rows_of_parts_and_what_is_withheld():
    evidence, names = EVIDENCE.copy(), [model.name for model in WHOLE]
    evidence[1, 4] = np.nan
    table = made(evidence, names)
    frame = table.parts_frame()
    assert tuple(frame.columns) == PARTS_COLUMNS
    parts = ["order"] * 3 + [
        part for part in ("noise", "lapses", "curve", "peak") for _ in range(2)
    ]
    assert frame[["subject", "part"]].to_numpy().tolist() == [
        [name, part] for name in ("P1", "P2", "P3", "*") for part in parts
    ]
    known = frame["subject"] != "P2"
    assert frame[~known][["probability", "log_inclusion_bayes_factor"]].isna().all(axis=None)
    assert frame[known].groupby(["subject", "part"])[
        "probability"
    ].sum().to_numpy() == pytest.approx(1.0)
    assert table.parts[0].counted == 2
    assert table.parts[0].study == pytest.approx(
        part_tables(WHOLE, EVIDENCE[[0, 2]], seed=1)[0].study
    )
    assert set(made(EVIDENCE[:1], names).parts_frame()["subject"]) == {"P1"}


def test_the_best_composition_and_its_evidence_against_free_frequencies():
    evidence, names = (
        np.array([[1.0, 3.0, 2.0], [1.0, np.nan, -4.0], [0.0, np.nan, np.nan], [np.nan, 3.0, 2.0]]),
        [one.name for one in WHOLE],
    )
    best = {
        name: (row.model, against)
        for name, (row, against) in made(evidence, names).best_compositions().items()
    }
    assert best == {
        "P1": ("symmetric", 2.0),
        "P2": ("none + sloped peak", -5.0),
        "P4": ("symmetric", None),
    }
    assert made(evidence[:1, 1:], names[1:]).best_compositions()["P1"][1] is None


#: Best evidence of models with a bell of one peak less that of free frequencies, nats, measured apart from the package.
MARGINS = {
    "update + sloped": {"1008": 6.3},
    "symmetric": {"1009": 20.6, "1011": 10.6, "873": 8.3},
    "none + sloped": {"1012": 0.2, "1032": 8.1, "865": 8.2, "979": 12.1},
    "none + sloped + both ways": {"888": 2.7},
    "none + both ways": {"946": 19.7},
}


@pytest.mark.parametrize("model", MARGINS)
def test_a_composition_describes_every_real_subject_better_than_free_frequencies(real_data, model):
    """The best one suffices: the others are no better."""
    study = bt.read_study(
        real_data / "vibrotactile_rate" / "trials.csv", bt.ReadOptions(equal_code="1")
    ).select([*MARGINS[model]])
    prior = bt.Prior(noise_slope_sd=1.0, lapse_rate_b=1.0)
    best = {
        one.name: infer(
            model_named(model).posterior(one, prior), 1, Wanted(evidence_draws=10_000)
        ).evidence
        for one in study
    }
    assert max(one.se for one in best.values()) < 0.03
    assert {
        name: one.value - frequency_evidence(study[name]) for name, one in best.items()
    } == pytest.approx(MARGINS[model], abs=0.15)


# --- the command --------------------------------------------------------------------------------------------------------------------


def test_refusals(small_study):
    with pytest.raises(InputError, match=r"'H9'; allowed, joined by .*; or: free frequencies"):
        compare(small_study, ["H9"], seed=1)
    with pytest.raises(InputError, match="draws=0"):
        compare(small_study, FEW, seed=1, draws=0)


def test_command(study_csv, tmp_path):
    asked = (
        "compare",
        study_csv,
        "--seed",
        1,
        "--workers",
        1,
        "--model",
        "symmetric",
        "--model",
        "free frequencies",
        "-o",
    )
    assert "out.csv, out_models.csv, out_parts.csv, out.png" in good(
        *asked, "out.csv", cwd=tmp_path
    )
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
    good(*asked, "other.csv", "--prior", "prior.toml", cwd=tmp_path)
    changed = pd.read_csv(tmp_path / "other.csv")
    assert "width ~ HalfNormal(2), q0 ~ Uniform(0, 1)" in set(changed.prior)
    assert (changed.log_evidence != frame.log_evidence).sum() == 3
    for name in ("out.csv", "out_models.csv", "out_parts.csv", "out.png"):
        assert f"{name}: exists" in refused(*asked, "out.csv", cwd=tmp_path)
        (tmp_path / name).unlink()
    assert "name of the figure" in refused(*asked, "table.png", cwd=tmp_path)
    assert "'H9'; allowed, joined by +: order: update" in refused(
        *asked, "new.csv", "--model", "H9", cwd=tmp_path, silent=False
    )
