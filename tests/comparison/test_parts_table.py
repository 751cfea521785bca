"""Parts of compositions: sums over models, families of uneven size, the study by every assignment of families to subjects."""

import itertools
from math import factorial

import numpy as np
import pandas as pd
import pytest

import bayes_toe as bt
from bayes_toe.comparison.model_comparison import PARTS_COLUMNS, ModelComparison, part_tables
from bayes_toe.comparison.model_row import Checks, ModelRow
from bayes_toe.data.tasks import SAME_DIFFERENT
from bayes_toe.inference.subject import Wanted, infer
from bayes_toe.model.free_frequencies import frequency_evidence
from bayes_toe.model.ladder import MODELS, model_named, models_of, require_models

EVIDENCE = np.random.default_rng(4).normal(size=(3, len(models_of(SAME_DIFFERENT).compared))) * 2 - 300


def made(evidence, models):
    """A comparison with these log evidences, and nothing else in it."""
    subjects = tuple(f"P{i + 1}" for i in range(len(evidence)))
    rows = [
        ModelRow(subject, model.name, 2, None if np.isnan(value) else float(value), 0.0, None, Checks())
        for subject, values in zip(subjects, evidence, strict=True)
        for model, value in zip(models, values, strict=True)
    ]
    return ModelComparison(tuple(rows), subjects, tuple(model.name for model in models), 1, bt.Prior())


def test_in_the_default_space_a_level_has_the_sum_of_its_models():
    found = {part.part: part for part in part_tables(models_of(SAME_DIFFERENT).compared, EVIDENCE)}
    assert [(name, part.levels) for name, part in found.items()] == [
        ("order", ("none", "constant error", "update")),
        ("noise", ("Weber", "sloped")),
        ("lapses", ("misses", "both ways")),
        ("curve", ("bell", "differencing")),
        ("peak", ("one peak", "sloped peak")),
    ]
    weights = np.exp(EVIDENCE[:, 1:] + 300)  # without free frequencies
    weights /= weights.sum(axis=1, keepdims=True)
    for name, part in found.items():
        for k, level in enumerate(part.levels):
            p = weights[:, [dict(model.levels)[name] == level for model in models_of(SAME_DIFFERENT).compared[1:]]].sum(axis=1)
            assert part.probability[:, k] == pytest.approx(p, rel=1e-12)
            odds = p / (1 - p) * (len(part.levels) - 1)
            assert part.log_inclusion[:, k] == pytest.approx(np.log(odds), rel=1e-9, abs=1e-12)


def test_levels_of_few_and_of_many_models_start_even():
    assert all(part.probability == pytest.approx(1 / len(part.levels)) for part in part_tables(MODELS, np.zeros((1, 8))))
    order = part_tables(MODELS, np.log([[9.0, 1.0, 2.0, 4.0, 1.0, 7.0, 1.0, 3.0]]))[0]
    assert order.levels == ("none", "constant error", "update", "free weighting", "mean-reverting")
    assert order.probability[0] == pytest.approx(np.array([1, 3, 4, 1, 3]) / 12)


def test_far_beyond_the_range_of_floats_odds_keep_their_digits():
    order = part_tables(require_models(["none", "update"]), [[0.0, 5000.0]])[0]
    assert order.log_inclusion.tolist() == [[-5000.0, 5000.0]]
    assert order.probability.tolist() == [[0.0, 1.0]]


def test_the_study_is_the_sum_over_all_assignments_of_families():
    order = part_tables(models_of(SAME_DIFFERENT).compared, EVIDENCE)[0]
    levels = np.array([order.levels.index(dict(model.levels)["order"]) for model in models_of(SAME_DIFFERENT).compared[1:]])
    family = np.stack([np.exp(EVIDENCE[:, 1:] + 300)[:, levels == k].mean(axis=1) for k in range(3)], axis=1)
    total, mean = 0.0, np.zeros(3)
    for assignment in itertools.product(range(3), repeat=3):
        counts = np.bincount(assignment, minlength=3)
        weight = family[np.arange(3), assignment].prod() * np.prod([factorial(n) for n in counts])
        total, mean = total + weight, mean + weight * (counts + 1) / 6
    assert order.study == pytest.approx(mean / total, abs=0.01)  # sampled: standard errors below 0.002
    assert order.study_log_inclusion == pytest.approx(np.log(order.study / (1 - order.study) * 2), rel=1e-12)


def test_rows_columns_and_what_is_withheld(tmp_path):
    evidence = EVIDENCE.copy()
    evidence[1, 4] = np.nan
    table = made(evidence, models_of(SAME_DIFFERENT).compared)
    table.save(tmp_path / "compare.csv")
    frame = pd.read_csv(tmp_path / "compare_parts.csv")
    assert tuple(frame.columns) == PARTS_COLUMNS
    assert frame["subject"].tolist() == [name for name in ("P1", "P2", "P3", "*") for _ in range(11)]
    assert frame["part"].tolist()[:11] == ["order"] * 3 + [part for part in ("noise", "lapses", "curve", "peak") for _ in range(2)]
    known = frame["subject"] != "P2"
    assert frame[~known][["probability", "log_inclusion_bayes_factor"]].isna().all(axis=None)
    assert frame[known].groupby(["subject", "part"])["probability"].sum().to_numpy() == pytest.approx(1.0)
    assert table.parts[0].counted == 2
    assert table.parts[0].study == pytest.approx(part_tables(models_of(SAME_DIFFERENT).compared, EVIDENCE[[0, 2]], seed=1)[0].study)
    alone = made(EVIDENCE[:1], models_of(SAME_DIFFERENT).compared).parts_frame()
    assert set(alone["subject"]) == {"P1"}
    assert made(EVIDENCE[:, :2], models_of(SAME_DIFFERENT).compared[:2]).parts_frame().empty  # one composition: no part varies


def test_the_best_composition_and_its_evidence_against_free_frequencies():
    evidence = np.array([[1.0, 3.0, 2.0], [1.0, np.nan, -4.0], [0.0, np.nan, np.nan], [np.nan, 3.0, 2.0]])
    best = made(evidence, models_of(SAME_DIFFERENT).compared[:3]).best_compositions()
    assert {name: (row.model, against) for name, (row, against) in best.items()} == {
        "P1": ("symmetric", 2.0),
        "P2": ("none + sloped peak", -5.0),
        "P4": ("symmetric", None),
    }
    assert made(evidence[:1, 1:], models_of(SAME_DIFFERENT).compared[1:3]).best_compositions()["P1"][1] is None


#: Best evidence of models with a bell of one peak less that of free frequencies, nats, measured apart from the package.
MARGINS = {"1008": 6.3, "1009": 20.6, "1011": 10.6, "1012": 0.2, "1032": 8.1, "865": 8.2, "873": 8.3, "888": 2.7, "946": 19.7, "979": 12.1}
BEST = {
    "update + sloped": ["1008"],
    "symmetric": ["1009", "1011", "873"],
    "none + sloped": ["1012", "1032", "865", "979"],
    "none + sloped + both ways": ["888"],
    "none + both ways": ["946"],
}


def test_a_composition_describes_every_real_subject_better_than_free_frequencies(real_data):
    vibrotactile = bt.read_study(real_data / "vibrotactile_rate" / "trials.csv", bt.ReadOptions(equal_code="1"))
    prior, found = bt.Prior(noise_slope_sd=1.0, lapse_rate_b=1.0), {}
    for model, names in BEST.items():  # the best one suffices: the others are no better
        for name in names:
            subject = vibrotactile[name]
            best = infer(model_named(model).posterior(subject, prior), 1, Wanted(evidence_draws=10_000)).evidence
            assert best.se < 0.03
            found[name] = best.value - frequency_evidence(subject)
    assert found == pytest.approx(MARGINS, abs=0.15)
    assert min(found.values()) > 0
