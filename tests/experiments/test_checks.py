"""What a study can tell: each finding where it holds, and where it holds only."""

import itertools

import numpy as np
import pandas as pd
import pytest
from definitions import natural
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import logit

from bayes_toe.data.findings import Finding
from bayes_toe.data.study import Study, Subject
from bayes_toe.experiments.checks import check_study, described, doubts
from bayes_toe.model.closed_form import MAX_PULL, normalised_distance
from bayes_toe.model.prior import Prior
from bayes_toe.model.study_prior import prior_for

FUZZ = settings(max_examples=200, deadline=None, derandomize=True, database=None)


def subject(pairs, n_equal=4, name="S01"):
    counts = [n_equal] * len(pairs) if isinstance(n_equal, int) else n_equal
    return Subject(name, [a for a, _ in pairs], [b for _, b in pairs], counts, [10] * len(pairs))


def check_subject(one):
    return check_study(Study((one,)))


def codes(pairs, n_equal=4):
    return [finding.code for finding in check_subject(subject(pairs, n_equal))]


GRID = list(itertools.product([-0.3, 0.0, 0.4], repeat=2))


OFF_DIAGONAL = [pair for pair in GRID if pair[0] != pair[1]]
POOR = [
    "few_pairs",
    "all_equal",
    "no_equal_pairs",
    "one_first_stimulus",
    "one_order",
    "design_rank",
]


@pytest.mark.parametrize(
    ("pairs", "n_equal", "expected"),
    [
        (GRID, [9, 2, 3, 1, 8, 4, 5, 6, 10], []),
        (GRID, 10, ["all_equal"]),
        (GRID, 0, ["all_different"]),
        (GRID, [10] * 8 + [9], []),
        (GRID, [0] * 8 + [1], []),
        (
            [(value, value) for value in (-0.3, 0.0, 0.1, 0.4)],
            4,
            ["only_equal_pairs", "design_rank"],
        ),
        (OFF_DIAGONAL, 4, ["no_equal_pairs"]),
        ([*OFF_DIAGONAL, (0.4, 0.4)], 4, []),
        ([(0.0, 0.3)], 10, POOR),
    ],
)
def test_each_finding_where_it_holds_in_a_fixed_order(pairs, n_equal, expected):
    assert codes(pairs, n_equal) == expected


def test_one_trial_in_very_many_is_not_overlooked():
    # 1 - 1/2**53 rounds to 1 in a share, not in the counts
    almost = Subject(
        "S01", [0, 0, 1, 1], [0, 1, 0, 1], [2**51, 2**51, 2**51, 2**51 - 1], [2**51] * 4
    )
    assert check_subject(almost) == ()


@pytest.mark.parametrize(("count", "expected"), [(1, 3), (2, 2), (3, 1), (4, None)])
def test_fewer_pairs_than_parameters(count, expected):
    pairs = [(0.0, 0.0), (0.3, 0.0), (0.0, 0.3), (0.3, 0.3)][:count]
    messages = [
        finding.message for finding in check_subject(subject(pairs)) if finding.code == "few_pairs"
    ]
    if expected is None:
        assert messages == []
    else:
        plural = "" if count == 1 else "s"
        start = f"Only {count} distinct pair{plural} for 4 parameters: at least {expected} of them cannot be told"
        assert messages[0].startswith(start)


def test_one_first_stimulus():
    pairs = [(0.25, value) for value in (-0.3, 0.0, 0.25, 0.4)]
    findings = check_subject(subject(pairs))
    assert [finding.code for finding in findings] == [
        "one_first_stimulus",
        "one_order",
        "design_rank",
    ]
    assert findings[0].message.startswith(
        "All pairs have the first stimulus 0.25: the pull does not enter"
    )
    assert "one_first_stimulus" not in codes([(second, first) for first, second in pairs])


def test_one_order():
    both = [(0.0, 0.0), (0.0, 0.3), (0.3, 0.0), (0.3, 0.3)]
    assert codes(both) == []
    (finding,) = check_subject(subject([*both, (0.0, 0.5)]))
    assert finding == Finding(
        "S01",
        "one_order",
        "1 pair was presented in one order only, (0, 0.5): the order effect there is not observed but predicted by the model.",
    )
    (finding,) = check_subject(subject([*both, (0.0, 0.5), (0.0, 0.6), (0.7, 0.0)]))
    assert finding.message.startswith(
        "3 pairs were presented in one order only, (0, 0.5), (0, 0.6), (0.7, 0): the"
    )
    (finding,) = check_subject(subject([*both, (0.0, 0.5), (0.0, 0.6), (0.7, 0.0), (0.8, 0.0)]))
    start = "4 pairs were presented in one order only, (0, 0.5), (0, 0.6), (0.7, 0) and 1 more:"
    assert finding.message.startswith(start)


def test_messages_are_one_sentence_that_concludes():
    poor = [subject([(0.0, 0.3)], 10), subject([(0.0, 0.0)], 0), subject([(0.0, 0.0), (1.0, 1.0)])]
    for finding in itertools.chain.from_iterable(check_subject(one) for one in poor):
        assert finding.message.endswith(".")
        assert "\n" not in finding.message
        assert ". " not in finding.message
        assert any(word in finding.message for word in ("prior", "predicted by the model"))


def test_stimuli_of_another_unit_than_the_prior_are_told():
    def said(step, prior="paper"):
        study = Study((subject([(0.0, 0.0), (0.0, step), (step, 0.0), (7.0, 7.0)]),))
        found = doubts(study, prior_for(study, prior))
        assert set(found) <= set(check_study(study, prior_for(study, prior)))
        return "".join(finding.message for finding in found)

    # P(0.1 step < sigma_p < 10 step) is 0.1 at steps of 0.0127 and 16.4 for a half-normal sigma_p of scale 1.
    assert [said(step) for step in (0.013, 0.3, 1.0, 16.0)] == ["", "", "", ""]
    assert said(0.012).startswith(
        "The prior is far too wide for these stimuli, sigma_p ~ HalfNormal(1) with steps of 0.012 ("
    )
    assert said(17.0).startswith(
        "The prior is far too narrow for these stimuli, sigma_p ~ HalfNormal(1) with steps of 17 ("
    )
    assert "the default prior takes its scales from them" in said(17.0)
    assert said(0.3, Prior(sigma_p_scale=0.01)).startswith("The prior is far too narrow")
    assert [said(step, "default") for step in (1e-4, 0.3, 1e6)] == ["", "", ""]
    assert check_study(Study((subject(GRID, [9, 2, 3, 1, 8, 4, 5, 6, 10]),))) == (), (
        "without a prior nothing is said of it"
    )
    only_equal = Study((subject([(0.0, 0.0), (9e9, 9e9)]),))
    assert doubts(only_equal, Prior()) == (), "without different stimuli there is no step"


def test_stimuli_that_differ_by_rounding_only_are_told():
    noisy = [
        (0.0, 0.0),
        (0.0, 0.3),
        (1e-16, 0.3),
        (0.3, 1e-16),
        (0.1 + 0.2, 0.0),
        (0.3, 0.3),
        (0.5, 0.5),
    ]
    (told,) = [
        finding for finding in doubts(Study((subject(noisy),))) if finding.code == "rounding"
    ]
    assert told in check_subject(subject(noisy))
    assert told.message.startswith(
        "Stimuli 0.0 and 1e-16 and 1 more differ by rounding only (by less than 1e-06 of their range), so that 7 "
    )
    assert "7 pairs are told apart where 5 were meant" in told.message
    scaled = [(7e-9 * first, 7e-9 * second) for first, second in GRID]
    assert doubts(Study((subject(scaled),))) == (), "the range is the measure"
    values = np.random.default_rng(1).random(
        20_000
    )  # each met once: two that are near are so by chance
    assert (
        doubts(Study((Subject("S", values[::2], values[1::2], [1] * 10_000, [1] * 10_000),))) == ()
    )
    single = np.float32([0.1, 0.3]).tolist()
    at = [
        (a, b, isi)
        for isi in (1.0, 2.0)
        for a, b in itertools.product([0.0, 0.1, 0.3, *single], repeat=2)
    ]
    timed = Subject("S", *np.transpose(at)[:2], [4] * 50, [9] * 50, np.transpose(at)[2])
    assert "50 pairs are told apart where 18 were meant" in doubts(Study((timed,)))[0].message


def test_names_that_differ_in_case_concern_the_study():
    counts = [9, 2, 3, 1, 8, 4, 5, 6, 10]
    study = Study(
        tuple(subject(GRID, counts, name) for name in ("vp1", "VP2", "Vp1", "VP1", "vp3"))
    )
    assert check_study(study) == (
        Finding(
            "",
            "names_differ_in_case",
            "Subjects 'vp1', 'Vp1', 'VP1' differ in case only: if they are one person, join them under one name.",
        ),
    )


def test_names_that_look_alike_and_names_that_are_formulas_concern_the_study():
    counts = [9, 2, 3, 1, 8, 4, 5, 6, 10]
    names = ("\u00e4", "a\u0308", "S01", "S\u200b01", "s01\ufe0f", "=1+1", "-1")
    found = check_study(Study(tuple(subject(GRID, counts, name) for name in names)))
    assert [finding.code for finding in found] == [
        "names_look_alike",
        "names_look_alike",
        "names_are_formulas",
    ]
    assert (
        found[0].message
        == "Subjects '\\xe4', 'a\\u0308' look alike: if they are one person, join them under one name."
    )
    assert found[1].message.startswith("Subjects 'S01', 'S\\u200b01', 's01\\ufe0f' look alike")
    assert "formulas: '=1+1'; write tables with --spreadsheet-safe" in found[2].message


def test_findings_of_a_study_follow_its_subjects():
    study = Study((subject(GRID, 10, "b"), subject(GRID, 4, "c"), subject(GRID, 0, "a")))
    found = [(finding.subject, finding.code) for finding in check_study(study)]
    assert found == [("b", "all_equal"), ("a", "all_different")]


def test_describe():
    first = subject(
        [(0.0, 0.0), (0.0, 0.3), (0.3, 0.0), (0.5, 0.0), (0.1, 0.6)], [1, 2, 3, 4, 5], "01"
    )
    second = Subject("NA", [0.0], [0.0], [1], [4])
    table = pd.DataFrame([described(first), described(second)])
    expected = pd.DataFrame(
        {
            "subject": ["01", "NA"],
            "n_pairs": [5, 1],
            "n_trials": [50, 4],
            "n_both_orders": [1, 0],
            "n_one_order": [2, 0],
            "n_equal_pairs": [1, 1],
            "fraction_equal": [0.3, 0.25],
        }
    )
    pd.testing.assert_frame_equal(table, expected)


_pairs = st.lists(
    st.tuples(st.sampled_from([-1.0, 0.0, 0.5, 2.0]), st.sampled_from([-1.0, 0.0, 0.5, 2.0])),
    min_size=1,
)


@FUZZ
@given(_pairs)
def test_pairs_are_counted_once_each(presented):
    one = Subject.from_trials("S01", *np.array(presented).T, np.zeros(len(presented)))
    row = described(one)
    assert row["n_pairs"] == 2 * row["n_both_orders"] + row["n_one_order"] + row["n_equal_pairs"]
    unordered = {frozenset(pair) for pair in presented}
    assert row["n_both_orders"] + row["n_one_order"] + row["n_equal_pairs"] == len(unordered)


@FUZZ
@given(_pairs)
def test_swapping_stimuli_keeps_what_does_not_depend_on_order(presented):
    stimuli = np.array(presented).T
    straight = Subject.from_trials("S01", *stimuli, np.zeros(len(presented)))
    swapped = Subject.from_trials("S01", *stimuli[::-1], np.zeros(len(presented)))
    assert described(straight) == described(swapped)
    kinds = [
        {finding.code for finding in check_subject(one)} - {"one_first_stimulus"}
        for one in (straight, swapped)
    ]
    assert kinds[0] == kinds[1]


def distances(s1, s2, offset, pull, width):
    """The model's z at identified coordinates; sbar is the plain mean, as every pair has as many trials."""
    x = [offset, logit(pull / MAX_PULL), np.log(width), 0.0]
    theta = natural(x, sbar=float(np.mean(s1)))
    return normalised_distance(s1, s2, theta.mu1, theta.sigma_p, theta.sigma_l)


@FUZZ
@given(st.floats(-1, 1), st.floats(0.05, 0.15), st.floats(0.1, 2), st.floats(0.5, 2))
def test_what_the_messages_say_holds_for_the_model(offset, pull, width, factor):
    constant, grid = [0.25] * 4, [-0.3, 0.0, 0.25, 0.4]
    for s1, s2, invisible in (
        (constant, grid, (offset, factor * pull, width)),  # one_first_stimulus
        (grid, grid, (factor * offset, factor * pull, factor * width)),  # only_equal_pairs
    ):
        assert len(check_subject(subject(list(zip(s1, s2, strict=True))))) > 0
        assert np.allclose(
            distances(s1, s2, offset, pull, width),
            distances(s1, s2, *invisible),
            rtol=1e-9,
            atol=1e-12,
        )


@pytest.mark.parametrize(
    "change", [(0.3, 0.1, 0.5), (0.2, 0.15, 0.5), (0.2, 0.1, 0.6), (0.4, 0.2, 1.0)]
)
def test_a_full_design_sees_every_such_change(change):
    s1, s2 = zip(*GRID, strict=True)
    assert not np.allclose(
        distances(s1, s2, 0.2, 0.1, 0.5) ** 2, distances(s1, s2, *change) ** 2, rtol=1e-3
    )
