"""Findings about the design of a study: each is reported where it holds, and only there."""

import itertools

import numpy as np
import pytest
from conftest import subject_of_pairs

import bayes_toe as bt
from bayes_toe.checks.answer_checks import Finding
from bayes_toe.checks.design_checks import check_design
from bayes_toe.data.answers import Reading
from bayes_toe.data.stimulus_unit import StimulusUnit
from bayes_toe.data.study import Study, Subject
from bayes_toe.data.tasks import WHICH_STRONGER

GRID = list(itertools.product([-0.3, 0.0, 0.4], repeat=2))


def two_scales(subjects):
    """Findings of stimuli that seem to have two units."""
    return [finding for finding in check_design(Study(subjects)) if finding.code == "two_scales"]


def messages(*subjects, **keywords):
    """The message of each finding, by its code."""
    findings = check_design(Study(subjects, **keywords))
    return {finding.code: finding.message for finding in findings}


def test_effects_that_the_pairs_cannot_show_are_named():
    assert messages(subject_of_pairs(GRID)) == {}
    # The first study has only equal pairs. The second has only one first stimulus, so that a
    # contraction looks like a constant error.
    pairs_by_effects = {
        "Order effect, constant error and contraction": [(-0.3, -0.3), (0.0, 0.0)],
        "Contraction": [(0.25, s2) for s2 in (-0.3, 0.0, 0.25, 0.4)],
    }
    for effects, pairs in pairs_by_effects.items():
        ((code, message),) = messages(subject_of_pairs(pairs)).items()
        assert code == "not_identified"
        assert message.startswith(f"{effects} cannot be told, because ")


def test_in_2afc_a_preference_for_a_response_may_be_the_constant_error():
    texts = messages(subject_of_pairs(GRID, task=WHICH_STRONGER))
    assert list(texts) == ["criterion"]
    assert texts["criterion"].startswith("In 2AFC, a constant error and a response bias")


def test_pairs_in_one_order_are_named_the_first_three_of_them():
    # The grid has all its pairs in both orders.
    pairs = [*GRID, (0.0, 0.5)]
    message = "1 pair was presented in one order only: (0, 0.5)."
    assert messages(subject_of_pairs(pairs)) == {"one_order": message}
    pairs += [(0.0, 0.6), (0.7, 0.0), (0.8, 0.0)]
    message = (
        "4 pairs were presented in one order only: (0, 0.5), (0, 0.6), (0.7, 0), ... and 1 more."
    )
    assert messages(subject_of_pairs(pairs)) == {"one_order": message}


@pytest.mark.parametrize(
    "shift, scale, is_raw",
    [(0, 1, False), (9.0, 1, False), (20.7, 1e-4, False), (0, 10, True)],
    ids=["near 0", "far from 0", "narrow and farther from 0", "whole numbers from -3 to 4"],
)
def test_stimuli_that_look_raw_are_named(shift, scale, is_raw):
    """Stimuli may be natural logs if they are not whole and lie close together, even far from 0.

    Stimuli near 20.7, for example, are the logs of intensities near a billion.
    """
    subject = subject_of_pairs([(shift + scale * s1, shift + scale * s2) for s1, s2 in GRID])
    assert ("raw_stimuli" in messages(subject)) == is_raw
    # Stimuli that were read as intensities are logs for sure.
    texts = messages(subject, reading=Reading(read=("i1", "i2")))
    assert "raw_stimuli" not in texts


def test_stimuli_on_two_scales_are_named():
    # The same intensities in g and in kg.
    logs = np.log([740, 905, 1.105, 1.350]).tolist()
    texts = messages(subject_of_pairs(list(itertools.product(logs, repeat=2))))
    sentence = (
        "Stimuli lie in two groups, 0.09985 to 0.3001 and 6.607 to 6.808, a factor of 550 apart."
    )
    assert texts["two_scales"].startswith(sentence)
    grams = StimulusUnit("g")
    subject = subject_of_pairs(list(itertools.product(logs, repeat=2)), name="S 1", unit=grams)
    (finding,) = two_scales([subject])
    assert "1.105 to 1.35 g and 740 to 905 g" in finding.message
    assert finding.option == "--exclude 'S 1'", "a fault of recording needs a decision"


def test_subjects_whose_stimuli_have_another_unit_are_named():
    # Each name has the subject's lower stimulus. S1.1 is the median. A factor of 10 from the median
    # (S3.4026), or of more than 100 (S7), may be due to another unit, but not a factor of 18 (S4).
    shifts = (0.8, 0.9, 1, 1.1, 3.4026, 4, 7)
    subjects = [subject_of_pairs([(shift, shift + 0.1)], name=f"S{shift}") for shift in shifts]
    (finding,) = two_scales(subjects)
    sentence = "The stimuli of S3.4026, S7 are 3.403 to 7.1, those of other subjects 0.8 to 4.1."
    assert finding.message.startswith(sentence)
    assert two_scales(subjects[:2]) == []


def test_a_lone_stimulus_far_from_the_others_is_named():
    pairs = [*itertools.product([0.0, 0.1, 0.3], repeat=2), (3.0, 3.0)]
    n_trials = [40] * 9 + [1]  # a single trial of the last pair
    subject = Subject("S01", *np.transpose(pairs), [0] * 10, n_trials)
    sentence = "In 1 trial of 361, a stimulus (3) lies a factor of 15 from all others (0 to 0.3)."
    assert messages(subject)["two_scales"] == f"{sentence} Check its decimal point."


@pytest.mark.parametrize(
    "names, message",
    [
        (("vp1", "Vp1", "VP1", "vp3"), "Subjects 'vp1', 'Vp1', 'VP1' look alike. If they are one"),
        (("\u00e4", "a\u0308"), "Subjects '\\xe4', 'a\\u0308' look alike. If"),  # both print as ä
        (("007", "7", "17"), "Subjects '007', '7' look alike. If"),
        (("7", "17", "a", "b"), ""),
    ],
)
def test_names_that_may_be_of_one_subject_are_listed(names, message):
    texts = messages(*(subject_of_pairs(GRID, name=name) for name in names))
    assert texts.get("names_look_alike", "").startswith(message)
    assert len(texts) == bool(message)  # There is no other finding.


def test_findings_of_subjects_follow_those_of_the_study():
    # b always responds 'equal'; B has 10 trials of one pair.
    subjects = [
        subject_of_pairs(GRID, share_yes=1.0, name="b"),
        subject_of_pairs([(0.0, 0.3)], name="B"),
    ]
    study_finding, *subject_findings = bt.check(Study(subjects))
    message = "Subjects 'b', 'B' look alike. If they are one subject, give them one name."
    assert study_finding == Finding("", "names_look_alike", message)
    assert [(finding.subject, finding.code) for finding in subject_findings] == [
        ("B", "not_identified"),
        ("b", "one_answer"),
        ("B", "few_trials"),
    ]
