"""Serial dependence: recovered where it exists, and not stated elsewhere."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from commands import run_command, run_ok
from conftest import refused
from legible import marks_of, titles_of
from scipy.stats import norm
from serial_observers import answered

import bayes_toe as bt
from bayes_toe.answers.serial_dependence import HISTORY_COLUMNS
from bayes_toe.data.tasks import SAME_DIFFERENT
from bayes_toe.errors import NumericalError

#: Options of simulated observers.
KINDS = {
    "none": {},
    "carries": {"carry_over": 0.9},
    "repeats": {"share_repeated": 0.2},
    "alternates": {"share_repeated": -0.2},
}


def observer(kind, seed, **options):
    """An observer with a contraction, and one of the kinds of serial dependence."""
    subject = answered(seed, repeats=64, p=0.35, **KINDS[kind], **options)
    return replace(subject, name=kind)


@pytest.fixture(scope="module")
def study():
    """An observer of each kind, under its name."""
    return bt.Study([observer(kind, 20 + i) for i, kind in enumerate(KINDS)], synthetic=True)


@pytest.fixture(scope="module")
def table(study):
    return bt.serial_dependence(study, seed=1)


def test_words_name_the_true_serial_dependence_and_no_other(table):
    carry_over = {row.subject: row.word("carry_over") for row in table}
    response = {row.subject: row.word("previous_response") for row in table}
    assert carry_over["carries"] == "yes"
    assert response["repeats"] == "yes (repetition)"
    assert response["alternates"] == "yes (alternation)"
    claims = "yes", "probably ("  # and not 'probably not'
    for kind in ("none", "repeats", "alternates"):
        assert not carry_over[kind].startswith(claims)
    for kind in ("none", "carries"):
        assert not response[kind].startswith(claims)


def test_intervals_hold_the_true_sizes(table):
    """rho is the share that is carried over, kappa the effect of the previous response."""
    low, median, high = table["carries"].rho
    assert low < 0.9 < high
    assert median > 0.5
    low_kappa_of_repetition, *_ = table["repeats"].kappa
    *_, high_kappa_of_alternation = table["alternates"].kappa
    assert low_kappa_of_repetition > 0.0 > high_kappa_of_alternation


@pytest.mark.parametrize("kind", ["none", "repeats"])
def test_the_evidence_of_a_previous_response_is_an_integral_over_kappa(table, study, kind):
    """The integral is over the mean likelihood ratio of the table's draws of the static model.

    The score of kappa has a normal prior.
    """
    row = table[kind]
    posterior = table.posterior(row, "previous_response")
    static_draws, *_ = row.draws  # (draws, coordinates)
    static_log_likelihood = posterior.observer.log_likelihood(static_draws)
    scores = np.linspace(-1.5, 1.5, 301)  # beyond, the likelihood is negligible
    ratio = np.zeros(len(scores))
    for i, score in enumerate(scores):
        with_kappa = np.column_stack([static_draws, np.full(len(static_draws), score)])
        log_likelihood = posterior.array.likelihood.value(with_kappa[None])[0]
        ratio[i] = np.exp(log_likelihood - static_log_likelihood).mean()
    expected = np.log(np.trapezoid(ratio * norm.pdf(scores), scores))
    static, previous_response, *_ = row.log_evidence
    # The tolerance is the Monte Carlo error of the mean ratio, which a few draws dominate.
    assert previous_response - static == pytest.approx(expected, abs=0.25)


def test_same_or_different_has_both_effects_too():
    # One observer for each effect. Only a contraction lets the trial before have a carry-over.
    carries = answered(31, SAME_DIFFERENT, repeats=40, p=0.35, carry_over=0.9)
    repeats = answered(32, SAME_DIFFERENT, repeats=20, share_repeated=0.3)
    study = bt.Study([replace(carries, name="carries"), replace(repeats, name="repeats")])
    table = bt.serial_dependence(study, seed=1)
    assert table["carries"].word("carry_over") in ("yes", "probably")
    assert table["repeats"].word("previous_response") == "yes (repetition)"


def test_the_file_of_a_table_has_its_columns_words_and_numbers(table, tmp_path):
    table.save(tmp_path / "history.csv")
    frame = pd.read_csv(tmp_path / "history.csv")
    assert tuple(frame.columns) == (*HISTORY_COLUMNS, "seed")
    assert set(frame.seed) == {table.seed}
    row = table["carries"]
    cells = frame.set_index("subject").loc["carries"]
    assert cells.carry_over == row.word("carry_over")
    _, median_rho, _ = row.rho
    numbers = [row.log_bayes_factor("carry_over"), median_rho, row.screen.joint_p]
    assert cells[["ln_bf_carry_over", "rho_q50", "history_p"]].tolist() == pytest.approx(numbers)


def test_a_seed_gives_the_same_numbers_whoever_else_is_in_the_study(table, study):
    row = bt.serial_dependence(bt.Study([study["carries"]]), seed=1)["carries"]
    assert row.log_evidence.tolist() == table["carries"].log_evidence.tolist()
    assert row.rho == table["carries"].rho


def test_an_unknown_order_is_refused_in_a_line(study):
    study_without_order = bt.Study([replace(study["none"], answers=None)])
    with refused("needs the order of trials"):
        bt.serial_dependence(study_without_order, seed=1)


def test_the_command_writes_the_table_and_the_figure(tmp_path):
    options = "-o trials.csv --task 2afc --observers contraction --subjects 1"
    run_ok(f"simulate {options} --carry-over 0.9 --seed 1", cwd=tmp_path)
    screen = run_ok("history trials.csv -o serial.csv --seed 1", cwd=tmp_path)
    assert "Previous response: " in screen
    (row,) = pd.read_csv(tmp_path / "serial.csv").itertuples()
    assert 0.0 < row.rho_q025 < row.rho_q50 < row.rho_q975
    assert (tmp_path / "serial.png").stat().st_size > 10_000  # a blank picture has some 3,000 bytes


def test_the_command_ends_with_code_3_if_a_subject_has_no_result(tmp_path, monkeypatch):
    def checked(evidence):
        """The analysis of the first of two subjects fails."""
        if evidence.subject.name == "S01":
            raise NumericalError("no maximum")
        return evidence

    monkeypatch.setattr("bayes_toe.inference.order_evidence.OrderEvidence.checked", checked)
    run_ok("simulate -o trials.csv --task 2afc --subjects 2 --trials 65 --seed 1", cwd=tmp_path)
    result = run_command("history trials.csv --seed 1 --workers 1", cwd=tmp_path)
    assert result.returncode == 3
    assert "S01  No result: no maximum" in result.stdout


def test_the_figure_shows_every_subject(table):
    titles = titles_of(bt.plots.serial(table).axes)
    assert len(titles) == 8  # two panels for each of four subjects
    assert any(title.startswith("carries, carry-over: yes\nrho") for title in titles)
    assert sum("previous response: yes (alternation)" in title for title in titles) == 1


def test_a_point_of_the_figure_is_the_residual_of_the_static_model_after_one_response(table):
    """After 'second', a subject who repeats responses gives 'second' more often than predicted."""
    _, right_panel = bt.plots.serial(table, "repeats").axes
    row = table["repeats"]
    posterior = table.posterior(row, "static")
    trials = posterior.rows.trials
    static_draws, *_ = row.draws
    p_second = posterior.trial_probabilities(static_draws).mean(axis=0)  # (trials,)
    is_second = trials.answer > 0
    is_after_second = np.r_[False, is_second[:-1]] & ~trials.is_session_start
    residual = (is_second - p_second)[is_after_second].mean()
    (points,) = marks_of(right_panel, "o")
    _, after_second = points.get_ydata()
    assert after_second == pytest.approx(residual)
    assert residual > 0.03  # so that the point is not 0 by itself


def test_two_real_listeners_carry_over_as_in_an_earlier_analysis(real_data):
    """Log Bayes factors are those of an earlier analysis, to its Monte Carlo error."""
    study = bt.read_study(real_data / "auditory_pwm" / "trials.csv")
    sub_01 = "Sub01_Bimodal_l2"
    sub_a = "SubA_Bimodal_l2"
    table = bt.serial_dependence(study.select([sub_01, sub_a]), seed=1)
    assert table[sub_01].log_bayes_factor("carry_over") == pytest.approx(17.8, abs=1.0)
    static, _, carry_over, _ = table[sub_a].log_evidence
    assert carry_over - static == pytest.approx(3.2, abs=0.3)
