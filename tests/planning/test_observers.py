"""Assumed observers: they depend on nobody else and on no zero of the stimuli; who would never say 'equal' is refused."""

from dataclasses import replace

import numpy as np
import pytest

import bayes_toe as bt
from bayes_toe.data.tasks import SAME_DIFFERENT
from bayes_toe.errors import InputError
from bayes_toe.planning.observers import (
    DEFAULT,
    SHARED,
    assumed,
    middle_of,
    observers_from,
    of_kind,
    prior_of,
    shares_from,
)
from bayes_toe.planning.optimal import (
    MOVED,
    OPTIMISED,
    PAPER,
    DesignGoal,
    grid,
    optimal_design,
    proposed,
    reasons_for,
)
from bayes_toe.planning.power import power
from bayes_toe.planning.study_design import StudyDesign, all_pairs, each_once, paper_study_design

PAIRS = StudyDesign(
    [0.0, 0.0, 0.4, 0.4, 0.2, 0.2, 0.5], [0.0, 0.4, 0.0, 0.4, 0.2, 0.5, 0.2], [10] * 7
)
WIDER = StudyDesign([-0.5, 1.0, 1.0], [-0.25, 1.0, 0.75], [10, 20, 30])
FAR = 4.0


@pytest.fixture
def people_from(tmp_path):
    """A file of observers with this text."""

    def written(text):
        (tmp_path / "people.toml").write_text(text, encoding="utf-8")
        return tmp_path / "people.toml"

    return written


def test_p_equal_is_the_closed_form_and_the_same_in_every_design_whoever_else_there_is():
    few, many = (observers_from(None, size, seed=5) for size in (1, 3))
    one = few[-1]
    assert one == of_kind(many, "update")[0]
    wide = each_once([-1.0, 0.0, 3.0], [-1.0, 0.2, 3.0])
    given = [one.quantities[name] for name in ("mu1", "sigma_p", "sigma_l", "q0")]
    assert one.p_yes(wide) == pytest.approx(
        bt.model.equal_probability(wide.s1, wide.s2, *given), rel=1e-12
    )
    for other in many:
        assert other.p_yes(wide)[1] == pytest.approx(
            other.p_yes(each_once([0.0], [0.2]))[0], rel=1e-12
        )


def test_defaults_lie_in_their_ranges():
    for one in of_kind(observers_from(None, 20, seed=1), "update"):
        target = one.target(paper_study_design().unanswered)
        found = {
            key: float(values[0]) for key, values in target.quantities(one.point(target)).items()
        }
        for name, (low, high) in {**DEFAULT["update"], **SHARED[SAME_DIFFERENT]}.items():
            assert low - 1e-12 <= found[name] <= high + 1e-12
        assert abs(found["mu1"] - 0.25) * found["pull"] == pytest.approx(found["offset"])


def test_a_file_may_ask_for_noise_and_lapses(people_from):
    file = people_from(
        "at = 0.5\n['constant error']\noffset = -0.1\nwidth = 0.3\nq0 = 0.9\nlapse_rate = 0.1\nnoise_slope = -0.5\n"
    )
    [one] = observers_from(file, 1, seed=1)
    found = one.p_yes(each_once([0.5, 2.5], [0.4, 9.0]))
    z = (-0.1 - -0.1) / (0.3 * np.exp(-0.5 * (0.45 - 0.5)))
    assert found == pytest.approx([0.09 + 0.81 * 2 ** -(z**2), 0.09], rel=1e-9)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[none]\nwidth = 0.3\n", "[none]: q0 is missing"),
        (
            "[update]\npull = 0.5\noffset = 0\nwidth = 1\nq0 = 0.9\n",
            "[update]: pull: found 0.5, allowed: a number above 0 and below 0.38",
        ),
        (
            "[none]\nwidth = [2, 1]\nq0 = 0.9\n",
            "[none]: width: found a list, allowed: a number above 0, or [LOWEST, HIGHEST]",
        ),
        (
            "[some]\nwidth = 1\n",
            "key 'some': allowed: at, and the sections [none], [constant error], [update]",
        ),
        (
            "[none]\nwidth = 1\nq0 = 0.9\npull = 0.3\n",
            "[none]: key 'pull': unknown, allowed: lapse_rate, noise_slope, q0, share, width",
        ),
        ("at = true\n[none]\nwidth = 1\nq0 = 0.9\n", "key at: allowed: a finite number"),
        ("", "found no kind of observers"),
        (
            "[none]\nwidth = 1\nq0 = 0.9\nshare = 0\n",
            "[none]: share: found 0, allowed: a number above 0",
        ),
        (
            "[none]\nwidth = 1\nq0 = 0.9\nshare = [1, 2]\n",
            "share: allowed: a number in every section, one of which is the largest",
        ),
    ],
)
def test_a_wrong_file_is_refused_in_one_line(people_from, text, said):
    with pytest.raises(InputError) as caught:
        observers_from(people_from(text), 1, seed=1)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)
    with pytest.raises(InputError, match="found 'people', allowed: prior, a"):
        observers_from("people", 1, seed=1)


def test_shares_change_no_observer(people_from):
    ranges = "width = [0.2, 0.4]\nq0 = [0.8, 0.9]\n"
    text, found = f"[none]\n{{}}{ranges}[update]\n{{}}pull = [0.1, 0.3]\noffset = 0\n{ranges}", []
    for shares, expected in (
        (("", ""), {}),
        (("share = 1\n", "share = 3\n"), {"none": 0.25, "update": 0.75}),
    ):
        file = people_from(text.format(*shares))
        assert shares_from(file) == expected
        found.append(observers_from(file, 2, seed=1))
    assert found[0] == found[1]
    assert shares_from(None) == shares_from("prior") == {}


def test_draws_of_an_earlier_study_are_observers_and_their_likes_without_an_order_effect(tmp_path):
    subject = bt.Subject(
        "S1", [0.0, 0.0, 0.3, 0.3], [0.0, 0.3, 0.0, 0.3], [45, 30, 12, 47], [50, 50, 50, 50]
    )
    bt.sample(bt.Study((subject,)), model="paper", draws=100, seed=1, workers=1).save(
        tmp_path / "posterior.nc"
    )
    observers = observers_from(tmp_path / "posterior.nc", 2, seed=1)
    assert [one.model for one in observers[::2]] == [
        "symmetric",
        "constant bias",
        "predictive update",
    ]
    both_orders = each_once([0.0, 0.3], [0.3, 0.0])
    first, second = of_kind(observers, "none")[0].p_yes(both_orders)
    assert first == pytest.approx(second, rel=1e-12)
    assert np.ptp(of_kind(observers, "update")[0].p_yes(both_orders)) > 0.0


# --- Amid what is shown ---------------------------------------------------------------------------


def test_a_constant_added_to_every_stimulus_changes_no_number_of_power(three_models):
    known, designs = (
        {"data_sets": 1, "seed": 1, "prior": "default", "workers": 1},
        (PAIRS, PAIRS.moved(FAR)),
    )
    here, there = (power(one, [280], "prior", **known) for one in designs)
    assert (
        [one.observer for one in there]
        == [one.observer for one in here]
        == ["none 1", "constant error 1", "update 1"]
    )
    for one, other in zip(here.rows, there.rows, strict=True):
        assert other.judgement.log_evidence == pytest.approx(
            one.judgement.log_evidence, abs=0.05
        )  # draws are the same
        if one.judgement.widths is not None:
            assert np.log(other.judgement.widths) == pytest.approx(
                np.log(one.judgement.widths), abs=0.1
            )
    assert any(np.ptp(row.judgement.log_evidence) > 1.0 for row in there)  # they tell something


def test_a_constant_added_to_the_range_changes_no_chosen_pair():
    """A range of 1.2 near ln 40, of a vibration's rate in Hz, was once refused as too narrow."""
    made = []
    for low in (-0.35, 3.3):
        levels = grid(low, low + 1.2, 0.4)
        people = assumed(None, {"all": all_pairs(levels)}, 4, 1, "default")
        made.append(
            (proposed(levels, 280, DesignGoal(max_pairs=6), people, 1, "default")[0], people)
        )
    (here, _), (there, people) = made
    assert (there[OPTIMISED].design.moved(-3.65)).frame().to_numpy() == pytest.approx(
        here[OPTIMISED].design.frame().to_numpy()
    )
    assert there[MOVED].design.s1 == pytest.approx(paper_study_design().s1 + 3.65)
    utilities = [[one.utility for one in designs.values()] for designs in (here, there)]
    assert utilities[1] == pytest.approx(utilities[0], rel=1e-6)
    assert (list(here)[1], list(there)[1]) == (PAPER, MOVED)
    assert any(
        "from 3.65 to 4.16, amid what can be shown" in line
        for line in reasons_for(there, people, "update")
    )


def test_all_designs_share_one_middle_and_the_papers_stays_where_it_is_amid_them():
    assert middle_of([paper_study_design(), WIDER]) == 0.25
    assert middle_of([PAIRS.moved(FAR)]) == 4.25
    assert (
        middle_of([StudyDesign([0.2], [6.0], [1])]) == 3.1
    )  # 0.25 is within the range, at its edge
    people = assumed(None, {"narrow": PAIRS.moved(FAR), "wider": WIDER.moved(FAR)}, 2, 1, None)
    assert {one.centre for one in people} == {4.25}
    assert assumed(None, {"paper": paper_study_design()}, 2, 1, None) == observers_from(
        None, 2, seed=1
    )


def test_quantities_hold_over_the_designs_own_interval():
    """One interval only, however long, changes nothing: it is the unit."""
    timed = StudyDesign(PAIRS.s1, PAIRS.s2, PAIRS.n_trials, np.full(7, 0.3))
    for observers in (None, "prior"):
        with_, without = (
            assumed(observers, {"d": one}, 1, 1, "default")[-1] for one in (timed, PAIRS)
        )
        assert (with_.interval, without.interval) == (0.3, 1.0)
        assert with_.p_yes(timed) == pytest.approx(without.p_yes(PAIRS), rel=1e-12)
    assert prior_of([timed, PAIRS], None).reference_interval == 0.3
    assert prior_of([timed, WIDER], None) == replace(
        prior_of([PAIRS, WIDER], "default"), reference_interval=0.3
    )


STATED = "[none]\nwidth = 0.3\nq0 = 0.9\n[update]\npull = 0.35\nwidth = 0.3\nq0 = 0.9\n{}\n"


def test_stated_observers_stay_as_stated_and_what_is_not_stated_is_amid(people_from):
    for text, mu1 in (("mu1 = 3.0", 3.0), ("offset = 0", 4.25)):
        people = assumed(people_from(STATED.format(text)), {"d": PAIRS.moved(FAR)}, 1, 1, None)
        assert people[-1].quantities["mu1"] == pytest.approx(mu1)


@pytest.mark.parametrize("lapses", ["", "lapse_rate = 0.1"])
def test_who_would_find_identical_stimuli_different_is_refused(people_from, lapses):
    file, designs = (
        people_from(STATED.format("mu1 = 0.4\n" + lapses)),
        {"near": PAIRS, "far": PAIRS.moved(FAR)},
    )
    said = r"with far, stimuli from 4 to 4.5, P\(equal\) of all observers of the kind 'update' is below 0.01"
    for given in (file, observers_from(file, 2, 1)):
        with pytest.raises(InputError, match=said):
            assumed(given, designs, 2, 1, None)
    with pytest.raises(
        InputError,
        match=r"with near, stimuli from 0 to 0\.5, .*; allowed: designs of neighbouring stimuli",
    ):
        assumed(None, {"near": PAIRS, "far": PAIRS.moved(9.0)}, 2, 1, None)
    few = StudyDesign(
        [0.0, 3.0], [3.0, 0.0], [10, 10]
    )  # of which nothing is told either, but by the pairs' fault
    assert assumed(file, {"near": PAIRS, "few": few}, 1, 1, None)
    with pytest.raises(
        InputError, match=r"with the pairs that can be shown, stimuli from 3\.3 to 4\.5, P"
    ):
        optimal_design(
            grid(3.3, 4.5, 0.2),
            70,
            observers=people_from(STATED.format("mu1 = -9\n" + lapses)),
            seed=1,
            workers=1,
        )


def test_a_session_takes_a_prior_of_the_stimuli():
    session = bt.planning.Adaptive(PAIRS.moved(FAR), prior="default", seed=1, draws=512)
    assert session.prior.mu1_mean == pytest.approx(FAR + np.mean([PAIRS.s1, PAIRS.s2]))
