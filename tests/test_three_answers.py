"""Studies with the answers 'first', 'equal' and 'second': a subject's path from file to figure.

The likelihood itself is in tests/model/test_observer.py, with the other tasks.
"""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from commands import refusal_of
from conftest import read, refused
from legible import words_of
from numpy.random import default_rng

import bayes_toe as bt
from bayes_toe.answers.evidence_table import frequency_evidence
from bayes_toe.checks.answer_checks import check_answers
from bayes_toe.classical.frequencies import accuracy
from bayes_toe.data.tasks import SAME_DIFFERENT, THREE_ANSWERS, WHICH_STRONGER
from bayes_toe.inference.draws import load_draws
from bayes_toe.model.models import OrderModel
from bayes_toe.model.trial_history import TrialHistory, TrialHistoryPosterior

S1 = [0.0, 0.0, 0.3, 0.3]
S2 = [0.0, 0.3, 0.0, 0.3]
TRIALS = "subject,s1,s2,response"
COUNTS = "subject,s1,s2,n_first,n_equal,n_second"


@pytest.fixture(scope="module")
def study():
    """Simulated A, B and C with 40 trials of each pair; only B has a contraction, of .4."""
    observers = {}
    for name, contraction in (("A", 0.0), ("B", 0.4), ("C", 0.0)):
        observers[name] = {"noise": 0.15, "q0": 0.6, "contraction": contraction}
    return bt.simulate(observers, design="full", batches=40, seed=4, task="ternary").study


def csv(*lines):
    """The text of a file with these lines."""
    return "\n".join(lines)


# --- Reading --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "text, options",
    [
        (csv(TRIALS, *["a,0,1,equal"] * 2, "a,0,1,second", "a,0,1,1st", "a,1,0,s2"), ""),
        (
            csv(TRIALS, *["a,0,1,e"] * 2, "a,0,1,2", "a,0,1,1", "a,1,0,2"),
            "--equal-code e --second-code 2",
        ),
        (csv(COUNTS, "a,0,1,1,2,1", "a,1,0,0,0,1", "a,1,1,0,0,0"), ""),
    ],
)
def test_trials_codes_and_counts_say_the_same(text, options):
    # COUNTS has n_first, n_equal and n_second; the pair (1, 1) has no response and is left out.
    # Of four responses to (0, 1), two are 'equal', one is 'second' and one is 'first'. The only
    # response to (1, 0) is 'second'.
    (subject,) = read(text, options)
    assert subject.task == THREE_ANSWERS
    assert subject.n_yes.tolist() == [2, 0]
    assert subject.n_trials.tolist() == [4, 1]
    assert subject.n_second.tolist() == [1, 1]
    assert subject.n_first.tolist() == [1, 0]


def test_a_stray_word_in_a_study_of_two_answers_is_doubted():
    # 60 responses are 'second', 60 are 'first', and a single response is a word of another task.
    rows = ["a,0,1,second"] * 60 + ["a,1,0,first"] * 60 + ["a,0,1,equal"]
    (doubt,) = read(csv(TRIALS, *rows)).reading.doubts
    assert "only 1 of 121 responses are 'equal'" in doubt


def test_the_table_and_the_draws_file_of_a_study_have_its_three_counts(study, tmp_path):
    # The counts are those of 'equal', of 'second' and of all trials of each pair.
    draws = bt.sample(study, draws=20, seed=1)
    draws.save(tmp_path / "posterior.nc")
    loaded = load_draws(tmp_path / "posterior.nc").study
    for copy in (bt.read_study(study.frame()), loaded):
        for subject in copy:
            for count in THREE_ANSWERS.counts:
                assert np.array_equal(getattr(subject, count), getattr(study[subject.name], count))


@pytest.mark.parametrize(
    "counts, message",
    [
        ({}, "n_second must be given with the task 'three answers'"),
        ({"n_second": [0, 3, 1, 0]}, "every n_second must lie in 0..n_trials - n_yes"),
        ({"n_second": [0, 1]}, "n_second must be of one length"),
        ({"n_second": [0, 1, 1, 0], "task": SAME_DIFFERENT}, "and with no other"),
    ],
)
def test_counts_that_do_not_add_up_are_refused(counts, message):
    # Four pairs with 5 trials each, of which 4, 3, 3 and 4 are 'equal'. n_second is missing, too
    # large, too short, or not of this task.
    with refused(message):
        bt.Subject("a", S1, S2, [4, 3, 3, 4], [5] * 4, **{"task": THREE_ANSWERS, **counts})


@pytest.mark.parametrize(
    "command, message",
    [
        ("run --example ternary -o out", "'three answers', which has no example"),
        ("simulate -o s.csv --task ternary --observers paper", "of which it predicts only 'equal'"),
    ],
)
def test_commands_for_two_answers_refuse_three(command, message, tmp_path):
    # The example and the paper's model have no third answer.
    assert message in refusal_of(command, cwd=tmp_path, silent=False)


def test_a_session_takes_three_answers_and_is_resumed(tmp_path):
    pairs = list(product((0.0, 0.2, 0.4), repeat=2))
    # The next pair is chosen by what the answers so far leave open.
    session = bt.design.Adaptive(pairs, task="ternary", seed=1, draws=600)
    information = session.information()  # that each pair is expected to give
    assert (information > 0.0).all()
    for word in ("second", "equal", "first"):
        session.answer(session.next(), word)
    # True is the answer to a question of yes or no, which this task does not ask.
    with refused("allowed answers are equal, second, first"):
        session.answer(pairs[0], True)
    session.save(tmp_path / "session.json")
    resumed_session = bt.design.Adaptive.resume(tmp_path / "session.json")
    assert resumed_session.answers == session.answers
    assert resumed_session.probabilities == session.probabilities
    assert resumed_session.subject.n_second.sum() == 1  # One of three answers is 'second'.


def test_a_wrong_direction_is_no_correct_answer():
    # 8 of 10 answers to the equal pair are 'equal'. Of 10 answers to (0, 0.3), 3 are 'equal', 5 are
    # 'second' and 2 are 'first'.
    subject = bt.Subject(
        "a", [0.0, 0.0], [0.0, 0.3], [8, 3], [10, 10], n_second=[1, 5], task=THREE_ANSWERS
    )
    assert accuracy(subject) == pytest.approx((8 + 5) / 20)


# --- Responses that look wrong --------------------------------------------------------------------


def test_swapped_keys_exchange_first_and_second(study):
    # The key of 'equal' stays. The swap is found and undone by the same option.
    swapped_study = study.swap("A")
    assert np.array_equal(swapped_study["A"].n_second, study["A"].n_first)
    assert np.array_equal(swapped_study["A"].n_yes, study["A"].n_yes)
    (finding,) = check_answers(swapped_study)
    assert finding.code == "reversed_answers"
    assert finding.option == "--swap A"
    assert "'second'" in finding.message
    assert check_answers(study) == ()


@pytest.mark.parametrize(
    "n_equal, n_second, answer", [(10, 0, "equal"), (0, 10, "second"), (0, 4, "")]
)
def test_only_one_answer_of_three_is_a_fault(n_equal, n_second, answer):
    # All 10 responses to each pair are one answer. In the last case, 4 are 'second' and 6 'first'.
    counts = {"n_second": [n_second] * 2, "task": THREE_ANSWERS}
    subject = bt.Subject("a", [0.0, 0.3], [0.3, 0.0], [n_equal] * 2, [10] * 2, **counts)
    messages = [finding.message for finding in check_answers(bt.Study([subject]))]
    assert (f"Every response is {answer!r}." in messages) == bool(answer)


def test_a_study_whose_directions_are_all_reversed_is_refused(study):
    # The counts of 'first' and 'second' are exchanged in all subjects.
    frame = study.frame().rename(columns={"n_first": "n_second", "n_second": "n_first"})
    with refused("'second' less often the larger s2 - s1 is"):
        bt.read_study(frame)


# --- Numbers --------------------------------------------------------------------------------------


def test_the_second_question_leaves_h1_against_h0_and_the_scales_alone(study):
    # Three answers are two questions: 'equal' or not, and then 'second' or 'first'. The same study
    # without the second question is a study of same or different. H1 and H0 have the same
    # likelihood of the second question, which therefore does not change their Bayes factor.
    subjects = [
        replace(subject, task=SAME_DIFFERENT, n_second=None, answers=None) for subject in study
    ]
    same_different = bt.Study(subjects)
    evidence = bt.evidence(study, seed=1)
    first_question_evidence = bt.evidence(same_different, seed=1)
    for row, first_question_row, subject in zip(
        evidence.rows, first_question_evidence.rows, study, strict=True
    ):
        expected = first_question_row.log_bayes_factor
        assert row.log_bayes_factor == pytest.approx(expected, abs=1e-9)
        # The likelihood under H0 is the product of the likelihoods of both questions.
        which_stronger = subject.two_answers
        assert which_stronger.task == WHICH_STRONGER
        questions = same_different[subject.name], which_stronger
        expected = sum(map(frequency_evidence, questions))
        assert row.log_evidence_h0 == pytest.approx(expected, rel=1e-12)
    assert [subject.scales for subject in study] == [subject.scales for subject in subjects]
    assert evidence["B"].answer.words["contraction"] == "yes"  # The contraction of B is .4.


def test_log_likelihoods_of_pairs_add_up_to_the_trinomial(study):
    draws = bt.sample(study.select(["A"]), model="both", draws=100, seed=1)
    # The first chain is compared: (draws, pairs) and (draws, coordinates).
    log_likelihoods, *_ = draws.to_arviz()["log_likelihood"]["n_equal"].values
    points, *_ = draws.points("A")
    expected = draws.posterior("A").log_likelihood(points)
    assert log_likelihoods.sum(axis=1) == pytest.approx(expected, rel=1e-12)


def test_without_effects_a_history_is_the_observer_and_repetition_favours_the_same_answer(study):
    order = OrderModel("both")
    subject = study["B"]
    # The history has both effects: the carry-over rho, and kappa of the previous response.
    history = TrialHistory(order, has_previous_response=True, has_carry_over=True)
    posterior = TrialHistoryPosterior(subject, history)
    x = order.posterior(subject).sample_prior(default_rng(1), 20)
    # The last two coordinates are kappa and the probit of rho. Both effects are 0.
    without_effects = np.column_stack([x, np.zeros(20), np.full(20, -40.0)])
    expected = order.posterior(subject).log_likelihood(x)
    computed = posterior.array.likelihood.value(without_effects[None])[0]
    assert computed == pytest.approx(expected, rel=1e-10)

    # With a kappa above 0, the answer in the trial before becomes more probable.
    with_kappa = without_effects.copy()
    with_kappa[:, -2] = 1.0
    trials = posterior.rows.trials
    previous = trials.answer[trials.previous[1:]]  # before the first trial, there is none
    p_second = posterior.trial_probabilities  # (points, trials)
    change = (p_second(with_kappa) - p_second(without_effects))[:, 1:]
    # P('second') falls after 'first', stays after 'equal' and rises after 'second'.
    for sign in (-1.0, 0.0, 1.0):
        assert (np.sign(change[:, previous == sign]) == sign).all()


# --- Figures --------------------------------------------------------------------------------------


def test_curves_give_a_share_of_each_answer_and_name_it(study):
    analysis = bt.run(study, draws=200, seed=1)
    # P of each answer, (draws, 2), to the pairs (0, 0.15) and (0.15, 0).
    shares = analysis.curve("B").answers(*np.transpose([(0.0, 0.15), (0.15, 0.0)]))
    assert list(shares) == ["equal", "second", "first"]
    assert sum(shares.values()) == pytest.approx(np.ones_like(shares["equal"]))
    assert shares["second"][:, 0].mean() > shares["second"][:, 1].mean()
    figure = bt.plots.curves(analysis, "B")
    legend = words_of(figure.subfigs[0].legends[0].get_texts())
    for answer in ("'first'", "'equal'", "'second'"):
        assert answer in legend
