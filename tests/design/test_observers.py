"""Assumed observers: their answers, their sources, and what is refused."""

import numpy as np
import pandas as pd
import pytest
from conftest import BOTH_TASKS, problems, refused

import bayes_toe as bt
from bayes_toe.design.observers import KINDS, assume_observers, make_observer, read_ranges
from bayes_toe.design.study_design import StudyDesign, paper_study_design
from bayes_toe.model.models import OrderModel
from bayes_toe.model.parameters import ObserverPrior

PARAMETERS = {
    "noise": 0.22,
    "q0": 0.9,
    "lapse_rate": 0.07,
    "noise_slope": -0.3,
    "criterion_slope": 0.4,
    "constant_error": -0.12,
    "contraction": 0.27,
}

PAPER = paper_study_design()
PAPER_2AFC = paper_study_design(task="2afc")
OBSERVERS_OF_2AFC = assume_observers("both", size=1, seed=1, designs=[PAPER_2AFC])


@BOTH_TASKS
def test_observers_answer_as_the_model_both_predicts(task):
    """Numbers of trials differ between pairs, because they weight the mean first stimulus."""
    s1 = [0.0, 0.0, 0.4, 0.4, 0.7]
    s2 = [0.0, 0.4, 0.0, 0.7, 0.4]
    design = StudyDesign(s1, s2, [9, 3, 4, 5, 7], task=task)
    posterior = OrderModel("both").posterior(design.unanswered)
    parameters = {name: PARAMETERS[name] for name in posterior.coordinates}
    observer = make_observer("name", "kind", parameters, task)
    x = posterior.points({name: np.array([value]) for name, value in parameters.items()})
    expected = np.exp(posterior.log_answers(x)[0, 0])
    assert observer.p_design(design)[0] == pytest.approx(expected, rel=1e-12)


def test_an_observer_is_the_same_whoever_else_there_is():
    """One or three observers of each kind, with parameters in the ranges of the kind."""
    observers = assume_observers(None, size=1, seed=5, designs=[PAPER])
    all_observers = assume_observers(None, size=3, seed=5, designs=[PAPER])
    assert [observer.kind for observer in observers] == list(KINDS)
    for observer in observers:
        assert observer in all_observers
    for observer in all_observers:
        assert 0.15 <= observer.parameters["noise"] <= 0.25  # the range of all kinds
        for name, (low, high) in KINDS[observer.kind].items():
            assert low <= observer.parameters[name] <= high


def test_a_file_has_ranges_or_values_of_each_kind_of_observers(tmp_path):
    path = tmp_path / "people.toml"
    path.write_text('[weak]\ncontraction = 0.1\nnoise = [0.3, 0.4]\n["no effect"]\nq0 = 0.9\n')
    kinds = read_ranges(path)
    assert kinds["weak"]["contraction"] == (0.1, 0.1)
    observers = assume_observers(path, size=2, seed=1, designs=[PAPER])
    parameters = {observer.name: observer.parameters for observer in observers}
    assert list(parameters) == ["weak 1", "weak 2", "no effect 1", "no effect 2"]
    assert parameters["weak 1"]["contraction"] == 0.1
    assert 0.85 <= parameters["weak 1"]["q0"] <= 0.98  # the range of a kind without q0
    assert parameters["no effect 1"]["q0"] == 0.9


@pytest.mark.parametrize(
    "text, message",
    [
        ("", "found no kind of observers"),
        ("[a]\nluck = 1\n", "[a]: key 'luck': unknown, allowed: noise, q0, lapse_rate"),
        ("[a]\nnoise = 0\n", "[a]: noise: found 0, allowed: a number above 0"),
        # A range has the lower number first.
        ("[a]\ncontraction = [0.3, 0.1]\n", "[a]: contraction: found a list, allowed: a number"),
        ("noise = 0.2\n", "key 'noise': allowed: sections such as [contraction]"),
    ],
)
def test_a_wrong_file_is_refused_in_one_line(tmp_path, text, message):
    path = tmp_path / "people.toml"
    path.write_text(text)
    (line,) = problems(read_ranges, path)
    assert message in line
    assert "\n" not in line


def test_parameters_of_observers_of_the_prior_are_drawn_from_it():
    observers = assume_observers("prior", size=300, seed=1, designs=[PAPER], prior=ObserverPrior())
    kinds = [observer.kind for observer in observers]
    frame = pd.DataFrame([observer.parameters for observer in observers], index=kinds)
    assert (frame.loc["none", ["contraction", "constant_error"]] == 0).all(axis=None)
    # The prior SD of the contraction is .25, because in PAPER the first stimuli vary as much as all
    # stimuli. The SD of 300 draws has a standard error of 4 %, and the tolerance is 3.7 standard
    # errors.
    assert frame.loc["contraction", "contraction"].std() == pytest.approx(0.25, rel=0.15)


def test_draws_of_an_earlier_study_are_observers(tmp_path):
    subject = bt.example_study("same/different").select(["S01"])
    draws = bt.sample(subject, model="both", draws=300, seed=1)
    path = draws.save(tmp_path / "posterior.nc")
    observers = assume_observers(path, size=3, seed=1, designs=[PAPER])
    assert [observer.kind for observer in observers] == ["earlier study"] * 3 + ["none"] * 3
    values = draws.values("S01", "contraction").ravel()
    # Each draw is an observer, and another observer without effects, to count false positives.
    for observer, other_observer in zip(observers[:3], observers[3:], strict=True):
        parameters = observer.parameters
        assert np.isclose(values, parameters["contraction"], rtol=1e-9).any()
        assert other_observer.parameters == {
            **parameters,
            "contraction": 0.0,
            "constant_error": 0.0,
        }
    with refused("draws of the task 'same/different'"):
        assume_observers(path, size=1, seed=1, designs=[PAPER_2AFC])


FAR_APART = StudyDesign([0.0, 500.0], [500.0, 0.0], [10, 10])


@pytest.mark.parametrize(
    # The source of observers, their number of each kind, a design, and the refusal. The four
    # faults: an unknown kind, no observers, observers of the other task, and pairs that nobody
    # answers 'equal'.
    "observers, size, design, message",
    [
        ("nobody", 1, PAPER, "found 'nobody', allowed: none, small constant error"),
        (None, 0, PAPER, "data_sets: found 0"),
        (OBSERVERS_OF_2AFC, 1, PAPER, "allowed: 'same/different', the task of the design"),
        (None, 1, FAR_APART, "kind 'none' all practically never answer 'equal'"),
    ],
)
def test_unknown_and_unsuitable_observers_are_refused(observers, size, design, message):
    with refused(message):
        assume_observers(observers, size, seed=1, designs=[design])
