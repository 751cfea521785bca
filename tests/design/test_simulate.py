"""Simulated studies: populations, observers of one's own, seeds, conditions, bundled examples."""

import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from commands import run_ok
from conftest import refused
from scipy.special import ndtri

import bayes_toe as bt
from bayes_toe.data import read_study
from bayes_toe.data.tasks import WHICH_STRONGER
from bayes_toe.design.simulate import draw_population, read_differences
from bayes_toe.design.study_design import reference_design
from bayes_toe.model.models import OrderModel
from bayes_toe.model.trial_history import TrialHistory, TrialHistoryPosterior
from bayes_toe.seeds import generator

PAPER = {"mu1": -0.7, "sigma_p": 0.2, "sigma_l": 0.1, "q0": 0.95}
PAPER_2AFC = {"mu1": -0.7, "sigma_p": 0.2, "sigma_l": 0.1, "lapse_rate": 0.1}
OBSERVER = {"noise": 0.25, "q0": 0.9, "lapse_rate": 0.05, "constant_error": 0.1, "contraction": 0.3}
OBSERVER_2AFC = {"noise": 0.25, "lapse_rate": 0.05, "constant_error": 0.1, "contraction": 0.3}


def simulated_study(names):
    """Observers of the paper's model in 20 batches of its 13 pairs."""
    return bt.simulate(dict.fromkeys(names, PAPER), batches=20, seed=1).study


def test_every_batch_holds_every_pair_once_in_random_order():
    batches = simulated_study("A")["A"].answers.keys.reshape(20, 13, 2)  # (batches, pairs, stimuli)
    orders = {tuple(map(tuple, pairs)) for pairs in batches.tolist()}
    assert len(orders) == 20  # no two batches have the same order
    for order in orders:
        assert len(set(order)) == 13


def test_an_observer_answers_alike_whoever_else_there_is():
    subject = simulated_study("AB")["B"]
    expected = simulated_study("B")["B"]
    assert np.array_equal(subject.answers.n_yes, expected.answers.n_yes)


@pytest.mark.parametrize("command", read_study.COMMANDS)
def test_the_bundled_studies_are_what_their_commands_write(tmp_path, command):
    data = Path(read_study.__file__).parent
    _, *words = command.split()  # without `bayes-toe`
    for name in ("example_pairs.csv", "example_truth.csv"):
        if name in words:  # the command reads this file
            shutil.copy(data / name, tmp_path)
    run_ok(*words, cwd=tmp_path)
    for file in tmp_path.iterdir():
        assert file.read_text() == (data / file.name).read_text()


def test_expectations_of_trials_are_those_of_serial_dependence():
    """The model's probabilities with the simulation's random numbers give the same answers."""
    options = {"task": "2afc", "design": "full", "batches": 20, "seed": 1}
    study, parameters = bt.simulate({"A": OBSERVER_2AFC}, carry_over=0.7, **options)
    assert parameters["A"]["carry_over"] == 0.7
    subject = study["A"]
    history = TrialHistory(OrderModel("both"), has_previous_response=False, has_carry_over=True)
    posterior = TrialHistoryPosterior(subject, history)
    values = {name: np.array([value]) for name, value in parameters["A"].items()}
    # The last coordinate is the probit of the carry-over.
    x = np.column_stack([posterior.observer.points(values), ndtri([0.7])])
    p_second = posterior.trial_probabilities(x)[0]  # (trials,)
    rng = generator(1, "A", "trials")
    rng.uniform(size=(20, subject.n_pairs))  # the order of the pairs in each batch comes first
    is_second = rng.uniform(size=len(p_second)) < p_second
    assert is_second.tolist() == (subject.answers.n_yes == 1).tolist()


def test_conditions_differ_by_the_sizes_asked_for():
    # The contraction of OBSERVER, .3, lies in the middle of both conditions, which lie half the
    # difference below and above it. A difference of the noise is a difference of its logarithm.
    sizes = {"contraction": 0.2, "noise": np.log(2.0)}
    study, truth = bt.simulate(
        {"A": OBSERVER}, conditions=("left", "right"), differ=sizes, batches=2, seed=1
    )
    assert study.conditions.levels == ("left", "right")
    at_left = truth["A@left"]
    at_right = truth["A@right"]
    assert (at_left["contraction"], at_right["contraction"]) == pytest.approx((0.2, 0.4))
    assert at_right["noise"] / at_left["noise"] == pytest.approx(2.0)
    assert at_left["constant_error"] == at_right["constant_error"] == OBSERVER["constant_error"]


def test_a_named_population_has_contractions_in_its_range():
    _, truth = bt.simulate(3, population="repulsion", batches=2, seed=1)
    for parameters in truth.values():
        assert -0.35 <= parameters["contraction"] <= -0.2  # the range of 'repulsion'


def test_a_population_of_a_file_has_the_files_observers(tmp_path):
    def only_observer(text):
        """The only observer in a file with this text, though 99 are asked for."""
        path = tmp_path / "population.csv"
        path.write_text(text)
        (observer,) = draw_population(str(path), 99, seed=1, design=reference_design())
        return observer

    # An observer of the paper's model, and then an observer of the four models.
    observer = only_observer("subject,mu1,sigma_p,sigma_l,q0\nx,0,0.3,0.1,0.9\n")
    assert (observer.name, observer.parameters["q0"]) == ("x", 0.9)
    observer = only_observer("subject,noise,q0,contraction\ny,0.2,0.9,0.25\n")
    assert observer.parameters["contraction"] == 0.25
    assert observer.parameters["lapse_rate"] == 0.0  # The file has no lapse rate.


CONDITIONS = {"conditions": ("a", "b")}
#: Options of `bt.simulate`, and a part of the refusal.
REFUSED = [
    ({"population": "negative.csv"}, "sigma_p must be finite and positive"),
    ({"population": "mine"}, "allowed: paper, none, small constant error"),
    ({"observers": {"A": {"mu1": 0.0}}}, "found mu1, allowed: mu1, sigma_p, sigma_l, q0"),
    ({"observers": {"A": {**PAPER, "q0": 1.5}}}, "observers: q0 must lie in 0..1"),
    (
        {"observers": {"A": {**PAPER_2AFC, "lapse_rate": 2}}, "task": "2afc"},
        "observers: lapse_rate must lie in 0..1",
    ),
    ({"observers": {"A": {"q0": 0.9}}}, "observer 'A': noise is missing"),
    ({"observers": {"A": {**OBSERVER, "contraction": 1.0}}}, "above -1 and below 1"),
    ({"observers": {}}, "found none"),
    ({"observers": 0}, "allowed: a whole number from 1"),
    ({"design": "mine"}, "--design"),
    ({"conditions": "ab"}, "conditions: found the text 'ab', allowed: a list of levels"),
    ({"carry_over": 1.0}, "--carry-over: found 1.0, allowed: a number from 0"),
    ({"conditions": ("a", "a")}, "--conditions: found 'a,a', allowed: two levels"),
    ({"differ": {"noise": 1.0}}, "--differ: allowed with --conditions"),
    ({**CONDITIONS, "differ": {"noise": 1.0}}, "--differ: allowed with observers of the four"),
    ({**CONDITIONS, "differ": {"gain": 1.0}}, "--differ: found 'gain=1', allowed: QUANTITY=SIZE"),
]


@pytest.mark.parametrize("options, message", REFUSED)
def test_what_cannot_be_simulated_is_refused(tmp_path, monkeypatch, options, message):
    monkeypatch.chdir(tmp_path)
    Path("negative.csv").write_text("subject,mu1,sigma_p,sigma_l,q0\nx,0,-1,0.1,0.9\n")
    with refused(message):
        bt.simulate(**options)


def test_the_command_writes_conditions_and_the_truth(tmp_path):
    run_ok(
        "simulate -o s.csv --truth t.csv --observers both --subjects 2 --task 2afc --trials 39 "
        "--conditions 2,6 --differ contraction=0.2 --seed 1",
        cwd=tmp_path,
    )
    # A row for each of two subjects in each of the conditions 2 and 6.
    truth = pd.read_csv(tmp_path / "t.csv")
    assert truth["subject"].tolist() == ["S01@2", "S01@6", "S02@2", "S02@6"]
    study = bt.read_study(tmp_path / "s.csv")
    assert (study.task, study.conditions.levels) == (WHICH_STRONGER, ("2", "6"))


def test_observers_of_three_answers_are_those_of_the_model_that_predicts_them():
    assert "contraction" in bt.simulate(1, task="ternary", seed=1).truth["S01"]


def test_a_difference_is_given_once():
    with refused("--differ: found contraction twice, allowed: once"):
        read_differences("contraction=0.2,contraction=0.5")
