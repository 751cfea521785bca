"""The answer of one subject: words, sizes, prior sensitivity, what stands against it, files."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import BOTH_TASKS, columns, each_row, expected_counts, made_subject
from populations import two_conditions

import bayes_toe as bt
from bayes_toe.answers.order_effect import (
    ANSWER_COLUMNS,
    MISFIT_FLAG,
    PREVIOUS_TRIAL_FLAG,
    PRIOR_FLAG,
    QUESTIONS,
    WANDERING_FLAG,
    answer_subject,
    order_effect,
)
from bayes_toe.answers.words import Word, word_for
from bayes_toe.checks.answer_checks import Finding
from bayes_toe.checks.identification import IMITATION, Identification
from bayes_toe.data.options import changed
from bayes_toe.data.tasks import WHICH_STRONGER
from bayes_toe.inference.model_set import ModelSet
from bayes_toe.inference.order_evidence import (
    MODEL_NAMES,
    PRIOR_PROBABILITIES,
    order_evidence,
)
from bayes_toe.model.parameters import CONSTANT_ERROR, CONTRACTION, ObserverPrior

ALL_IDENTIFIABLE = Identification({})


@pytest.fixture(scope="module")
def answers():
    """The answer of an observer of each kind, by its name."""
    cases = {
        "none": expected_counts(),
        "positive error": expected_counts(c=0.15),
        "negative error": expected_counts(c=-0.15),
        "contraction": expected_counts(p=0.4),
        "repulsion": expected_counts(p=-0.4),
    }
    return {name: answer_subject(subject, seed=1)[0] for name, subject in cases.items()}


@pytest.fixture(scope="module")
def evidence():
    """The evidences of the four models for an observer with a clear constant error."""
    (subject_evidence,) = order_evidence([expected_counts(c=0.15)], seed=1)
    return subject_evidence


@pytest.mark.parametrize(
    # An observer, the question that has a word, and whether the first stimulus is overestimated,
    # which only a constant error says.
    "name, question, word, is_overestimated",
    [
        ("positive error", "constant_error", "yes", True),
        ("negative error", "constant_error", "yes", False),
        ("contraction", "contraction", "yes (contraction)", None),
        ("repulsion", "contraction", "yes (repulsion)", None),
    ],
)
def test_effects_have_their_words_and_directions(answers, name, question, word, is_overestimated):
    assert answers[name].word("order_effect") == "yes"
    assert answers[name].word(question) == word
    assert answers[name].first_is_overestimated is is_overestimated


def test_a_subject_without_effect_is_not_told_that_there_is_one(answers):
    assert answers["none"].words["constant_error"] in (Word.NO, Word.PROBABLY_NOT)
    assert answers["none"].first_is_overestimated is None


def test_probabilities_follow_from_the_evidences(answers):
    """Prior probabilities are 1/2 for no effect and 1/6 for each other model, which is 3 to 1."""
    answer = answers["none"]
    log_evidence = np.array([answer.log_evidence[name] for name in MODEL_NAMES])
    # Evidences divided by the evidence of the model without effects.
    none, error, contraction, joint = np.exp(log_evidence - log_evidence[0])
    total = 3.0 * none + error + contraction + joint
    assert answer.probabilities["order_effect"] == pytest.approx(1.0 - 3.0 * none / total)
    assert answer.probabilities["contraction"] == pytest.approx((contraction + joint) / total)
    # The mean evidence of the models with the effect over that of the models without the effect.
    log_factor = np.log((error + contraction + joint) / (3.0 * none))
    assert answer.log_bayes_factors["order_effect"] == pytest.approx(log_factor)
    log_factor = np.log((error + joint) / (none + contraction))
    assert answer.log_bayes_factors["constant_error"] == pytest.approx(log_factor)


#: Probability of an effect, log Bayes factor for it, word. 'Yes' and 'no' begin at .95 and .05, and
#: 'probably' at .75 and .25, where 'probably not' needs a log Bayes factor of -1, too.
LIMITS = """
    0.95 | 3.0 | YES
    0.94 | 3.0 | PROBABLY
    0.75 | 1.0 | PROBABLY
    0.74 | 1.0 | UNDECIDED
    0.25 | -1.0 | PROBABLY_NOT
    0.25 | -0.9 | UNDECIDED
    0.26 | -2.0 | UNDECIDED
    0.05 | -2.0 | NO
"""


@each_row("probability, log_bayes_factor, word", LIMITS)
def test_words_follow_probability_and_bayes_factor(probability, log_bayes_factor, word):
    assert word_for(float(probability), float(log_bayes_factor)) is Word[word]


def test_reweighting_is_a_fresh_run_with_another_scale():
    (evidence,) = order_evidence([expected_counts(c=0.05, p=0.1, n=20)], seed=1)
    # The scales of the default prior are .5 and .25.
    cases = {
        (CONSTANT_ERROR, 0.5): ObserverPrior(constant_error_scale=0.25),
        (CONSTANT_ERROR, 2.0): ObserverPrior(constant_error_scale=1.0),
        (CONTRACTION, 0.5): ObserverPrior(contraction_sd=0.125),
        (CONTRACTION, 2.0): ObserverPrior(contraction_sd=0.5),
    }
    for (effect, factor), prior in cases.items():
        reweighted = evidence.with_prior_scale(effect, factor)
        (recomputed,) = order_evidence([evidence.subject], seed=2, prior=prior)
        difference = recomputed.log_evidence - reweighted.log_evidence
        assert np.abs(difference).max() < 0.15  # five standard errors of .03 nat


def test_a_yes_that_a_wider_prior_changes_is_marked(evidence, monkeypatch):
    # Log evidences: each model with an effect is 5 nats below the model without effects.
    no_effect = ModelSet(np.array([0.0, -5.0, -5.0, -5.0]), PRIOR_PROBABILITIES)

    def rescaled(self, effect, factor):
        """No effect if the prior of the constant error is twice as wide, otherwise no change."""
        if (effect, factor) == (CONSTANT_ERROR, 2.0):
            return no_effect
        return self

    monkeypatch.setattr(type(evidence), "with_prior_scale", rescaled)
    answer = order_effect(evidence, ALL_IDENTIFIABLE)
    marks = {question: line.marks for question, line in answer.lines.items()}
    assert (marks["constant_error"], marks["contraction"]) == (" ?", "")
    (problem,) = answer.problems.values()
    message = (
        "A prior of the constant error twice as wide changes order effect from 'yes' to 'no' and "
        "constant error from 'yes' to 'no'."
    )
    assert problem.message == message


def test_a_study_of_more_subjects_has_a_smaller_limit(answers):
    """A flag needs a p-value below .05 divided by the number of subjects."""
    p_values = {"fit_p": 0.0008, "history_p": 0.01, "moving_criterion_p": 0.0042}
    answer = replace(answers["none"], **p_values).in_study(1)
    assert (MISFIT_FLAG in answer.flags, answer.fits) == (True, False)
    assert {PREVIOUS_TRIAL_FLAG, WANDERING_FLAG}.issubset(answer.flags)
    answer = answer.in_study(12)  # .05/12 is .00417, just below .0042
    assert answer.flags == (*answers["none"].flags, MISFIT_FLAG)
    message = "The model does not fit: test p = .00080, below .05/12."
    assert answer.problems[MISFIT_FLAG].message == message
    assert answer.in_study(200).fits is True  # .05/200 is .00025
    assert answer.cells["interpretable"] == "yes"


@BOTH_TASKS
def test_a_criterion_that_wanders_may_be_the_constant_error_of_2afc(task):
    subject = replace(expected_counts(), task=task)
    answer, _ = answer_subject(subject, seed=1)
    # A p-value below the limit of a study of one subject, .05.
    answer = replace(answer, moving_criterion_p=0.001).in_study(n_subjects=1)
    sentence = answer.problems[WANDERING_FLAG].message
    start = "The preference for a response wanders over the trials (test p = .0010, below .05)."
    assert sentence.startswith(start)
    is_2afc = task == WHICH_STRONGER
    assert sentence.endswith(" A constant error may be due to it.") == is_2afc


def test_an_imitated_contraction_has_no_word_and_the_other_questions_keep_theirs(evidence):
    # The identification says that the pairs cannot distinguish a contraction from noise that
    # changes with intensity.
    identification = Identification({"contraction": IMITATION})
    answer = order_effect(evidence, identification)
    assert answer.word("contraction") == "cannot be told"
    assert answer.probabilities == order_effect(evidence, ALL_IDENTIFIABLE).probabilities
    assert f"because {IMITATION}." in answer.describe()


def test_a_flag_that_forbids_interpretation_comes_before_every_word(evidence):
    # Subject, code, message, and the option that removes the fault.
    flag = Finding("S", "swapped_blocks", "In block 2.", "--swap S:2")
    answer = order_effect(evidence, ALL_IDENTIFIABLE, [flag])
    assert {answer.word(question) for question in QUESTIONS} == {"not interpretable"}
    assert answer.cells["interpretable"] == "no"
    assert answer.describe() == "Not interpreted: responses look swapped."
    assert answer.options == ("--swap S:2",)


def test_a_shift_beyond_all_pairs_is_named():
    """Few responses to a pair are 'second', of 40, even where the second stimulus is stronger."""
    subject = replace(expected_counts(n=40), n_yes=[2, 0, 3, 0, 2, 0, 3, 0, 2, 0])
    answer, _ = answer_subject(subject, seed=1)
    assert any(flag.startswith("the PSE lies outside the pairs") for flag in answer.flags)


def test_the_cells_of_the_file_are_what_the_answer_has(answers):
    answer = answers["positive error"]
    cells = answer.cells
    assert set(cells) == set(ANSWER_COLUMNS)
    assert [cells[question] for question in QUESTIONS] == list(map(answer.word, QUESTIONS))
    expected = {
        "p_contraction": answer.probabilities["contraction"],
        "ln_bf_constant_error": answer.log_bayes_factors["constant_error"],
        "log_evidence_constant_error": answer.log_evidence["constant error"],
        "log_evidence_both_se": answer.standard_error["both"],
        "log_evidence_none_laplace": answer.laplace["none"],
        "jnd_percent_q975": answer.sizes["jnd_percent"].q975,
        "zone_percent_q50": None,  # only 'same or different' has a zone
    }
    assert {name: cells[name] for name in expected} == expected


# --- Public studies: what they must show ----------------------------------------------------------


#: Subject, and its probabilities of none, constant error, contraction and both, as two independent
#: prototypes of the four models computed them.
MEASURED = """
    1008 | 0.00 0.00 0.02 0.97
    976 | 0.00 0.35 0.00 0.65
    888 | 0.30 0.50 0.07 0.13
    1009 | 0.61 0.14 0.13 0.11
    1032 | 0.80 0.07 0.07 0.06
    865 | 0.78 0.04 0.15 0.03
    946 | 0.85 0.03 0.11 0.01
    979 | 0.90 0.03 0.06 0.01
"""


@each_row("name, probabilities", MEASURED)
def test_vibrotactile_subjects_are_as_measured(vibrotactile, name, probabilities):
    """The tolerances are the Monte Carlo errors of the prototypes; swapped blocks are turned."""
    study = changed(vibrotactile, ("946:2,4,6", "865:2"))
    answer, evidence = answer_subject(study[name], seed=1)
    assert evidence.probabilities == pytest.approx(columns(probabilities).ravel(), abs=0.04)
    if name == "1008":  # the subject whose effects are sure; sizes are of the prototypes, too
        assert answer.sizes["pse_shift_percent"] == pytest.approx((2.5, 5.6, 8.3), abs=0.4)
        assert answer.sizes["contraction_p"] == pytest.approx((0.10, 0.16, 0.22), abs=0.02)


def test_dots_have_a_constant_error_and_a_misfit(real_data):
    (dots,) = bt.read_study(real_data / "morse_rothkopf_1957" / "dots.csv")
    answer, _ = answer_subject(dots, seed=1)
    # Order effect, constant error and contraction, as in an earlier analysis.
    assert [answer.word(question) for question in QUESTIONS] == ["yes", "yes", "probably not"]
    assert answer.fits is False


def test_with_one_first_stimulus_the_order_effect_is_the_constant_error():
    """Only s1 = 0 was shown, so that no contraction can be told."""
    # s1, s2, number of 'second', trials
    rows = "0 -0.3 5 40, 0 -0.2 5 40, 0 -0.1 17 40, 0 0.1 33 40, 0 0.2 39 40, 0 0.3 40 40"
    subject = made_subject(rows, task=WHICH_STRONGER)
    answer, _ = answer_subject(subject, seed=1)
    assert answer.word("contraction") == "cannot be told"
    assert answer.probabilities["order_effect"] == answer.probabilities["constant_error"]
    # A prior of another width changes the word of neither question, so that there is no flag.
    assert answer.words["order_effect"] is answer.words["constant_error"] is Word.UNDECIDED
    assert not any(flag.startswith(PRIOR_FLAG) for flag in answer.flags)


def test_a_bound_of_a_condition_counts_its_distance_from_the_mean_of_all():
    """The upper bound of an order effect is the 95 % quantile of its size in JND."""
    for unit in two_conditions(1, n_subjects=1):
        answer, evidence = answer_subject(unit, seed=1)
        draws = evidence.averaged()
        c = draws.quantities["constant_error"]
        p = draws.quantities["contraction"]
        # `sbar` is the mean first stimulus of both conditions. PSE shifts are (draws, pairs).
        shifts = c[:, None] - p[:, None] * (unit.s1 - unit.scales.sbar)
        size = np.sqrt(np.mean(np.square(shifts), axis=1)) / draws.quantities["jnd"]
        (bound,) = draws.quantiles(size, [0.95])
        assert answer.upper_bounds["order_effect"] == pytest.approx(bound)
