"""How conclusions on parts move with the prior: re-weighted evidences against fresh ones, what is left alone, words and files."""

import numpy as np
import pytest

import bayes_toe as bt
from bayes_toe.comparison.model_comparison import STUDY, part_tables
from bayes_toe.comparison.parts_sensitivity import parts_sensitivity
from bayes_toe.errors import InputError
from bayes_toe.inference.subject import Wanted, infer
from bayes_toe.model.ladder import require_models
from bayes_toe.plots.sensitivity import parts_sensitivity_figure

MODELS = ["none", "constant error", "update", "none + sloped"]
FACTORS = (0.5, 1.0, 2.0)


@pytest.fixture(scope="module")
def two():
    return bt.example_study().select(["S01", "S05"])


@pytest.fixture(scope="module")
def table(two):
    return parts_sensitivity(two, MODELS, factors=FACTORS, seed=3, workers=1)


def test_what_some_model_uses_is_varied(table):
    assert table.varied == ("mu1_sd", "sigma_p_scale", "gamma_a", "gamma_b", "noise_slope_sd", "mu1_mean")
    assert table.subjects == ("S01", "S05", STUDY)
    assert len(table) == 3 * 6 * 3 * 5  # subjects, numbers, values, levels of order and noise


@pytest.mark.parametrize(("varied", "value"), [("mu1_sd", 5.0), ("gamma_a", 2.0), ("mu1_mean", 10.0), ("noise_slope_sd", 0.5)])
def test_probabilities_are_those_of_fresh_fits(table, two, varied, value):
    # The constant error's prior follows mu1 and gamma: its coordinate changes its meaning with them.
    prior = bt.Prior(**{varied: value})
    models = require_models(MODELS)
    fresh = [infer(model.posterior(two["S01"], prior), 8, Wanted(evidence_draws=20_000)).evidence.value for model in models]
    tables = part_tables(models, [fresh])
    expected = {(one.part, level): p for one in tables for level, p in zip(one.levels, one.probability[0], strict=True)}
    for (part, level), probability in expected.items():
        row = next(row for row in table.of("S01", varied, part)[level] if row.value == pytest.approx(value))
        # Errors of log evidences are below 0.01 nat each: 4.5 of them move a probability by at most a quarter of that.
        assert row.probability == pytest.approx(probability, abs=0.015)


def test_levels_add_up_and_unused_numbers_change_nothing(table):
    for subject in table.subjects:
        for varied in table.varied:
            rows = table.of(subject, varied, "order")
            assert np.sum([[row.probability for row in each] for each in rows.values()], axis=0) == pytest.approx(1.0)
    scanned = table.of("S01", "noise_slope_sd", "order")
    given = table.of("S01", "mu1_sd", "order")["update"][1].probability
    assert scanned["update"][1].probability == given


def test_lines_name_the_level_and_where_it_changes(table):
    lines = table.summary()
    assert [line.partition(":")[0] for line in lines] == ["S01", "S05", "study"]
    for subject, line in zip(table.subjects, lines, strict=True):
        assert table.turns(subject) == ("; " in line)
        assert ("at every value" in line) != table.turns(subject)


def test_factors_are_checked(two):
    for wrong in ((), (1.0,), (0.5, 2.0), (2.0, 1.0), (-1.0, 1.0, 2.0)):
        with pytest.raises(InputError, match="factors="):
            parts_sensitivity(two, MODELS, factors=wrong)


def test_figure_and_file(table, tmp_path):
    frame = table.frame()
    assert list(frame.columns) == ["subject", "varied", "factor", "value", "part", "level", "probability", "pareto_k", "sampled_anew"]
    figure = parts_sensitivity_figure(table)
    turning = sum(table.turns(name) for name in ("S01", "S05"))
    assert len(figure.axes) == len(table.varied) * (1 + (turning or 2))
    shifted = figure.axes[len(table.varied) * (1 + (turning or 2)) - len(table.varied) + table.varied.index("mu1_mean")]
    assert [label.get_text() for label in shifted.get_xticklabels()] == ["−10", "0", "10"]
    assert table.save(tmp_path / "sensitivity_parts.csv").exists()
