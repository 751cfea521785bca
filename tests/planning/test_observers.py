"""Assumed observers: what they answer does not depend on who else is there, nor on the design's own mean."""

import numpy as np
import pytest

import bayes_toe as bt
from bayes_toe.errors import InputError
from bayes_toe.planning.observers import DEFAULT, observers_from, of_kind, shares_from
from bayes_toe.planning.study_design import StudyDesign, paper_study_design


def test_p_equal_is_the_closed_form():
    [one] = of_kind(observers_from(None, 1, seed=3), "update")
    design = StudyDesign([0.0, 0.7, -0.3], [0.2, 0.6, -0.3], [1, 1, 1])
    given = [one.quantities[name] for name in ("mu1", "sigma_p", "sigma_l", "q0")]
    assert one.equal(design) == pytest.approx(bt.model.equal_probability(design.s1, design.s2, *given), rel=1e-12)


def test_an_observer_is_the_same_in_every_design():
    wide = StudyDesign([-1.0, 0.0, 3.0], [-1.0, 0.2, 3.0], [1, 1, 1])
    alone = StudyDesign([0.0], [0.2], [1])
    for one in observers_from(None, 2, seed=5):
        assert one.equal(wide)[1] == pytest.approx(one.equal(alone)[0], rel=1e-12)


def test_more_observers_leave_the_first_ones_as_they_are():
    few, many = (observers_from(None, size, seed=5) for size in (1, 3))
    assert few[-1] == of_kind(many, "update")[0]


def test_defaults_lie_in_their_ranges():
    for one in of_kind(observers_from(None, 20, seed=1), "update"):
        target = one.target(paper_study_design().unanswered)
        found = {key: float(values[0]) for key, values in target.quantities(one.point(target)).items()}
        for name, (low, high) in DEFAULT["update"].items():
            assert low - 1e-12 <= found[name] <= high + 1e-12
        assert abs(found["mu1"] - 0.25) * found["pull"] == pytest.approx(found["offset"])


def test_a_file_may_ask_for_noise_and_lapses(tmp_path):
    text = "at = 0.5\n['constant error']\noffset = -0.1\nwidth = 0.3\nq0 = 0.9\nlapse_rate = 0.1\nnoise_slope = -0.5\n"
    (tmp_path / "people.toml").write_text(text, encoding="utf-8")
    [one] = observers_from(tmp_path / "people.toml", 1, seed=1)
    found = one.equal(StudyDesign([0.5, 2.5], [0.4, 9.0], [1, 1]))
    width = 0.3 * np.exp(-0.5 * (0.45 - 0.5))
    z = (-0.1 - -0.1) / width
    assert found == pytest.approx([0.09 + 0.81 * 2 ** -(z**2), 0.09], rel=1e-9)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[none]\nwidth = 0.3\n", "[none]: q0 is missing"),
        ("[update]\npull = 0.5\noffset = 0\nwidth = 1\nq0 = 0.9\n", "[update]: pull: found 0.5, allowed: a number above 0 and below 0.38"),
        ("[none]\nwidth = [2, 1]\nq0 = 0.9\n", "[none]: width: found a list, allowed: a number above 0, or [LOWEST, HIGHEST]"),
        ("[some]\nwidth = 1\n", "key 'some': allowed: at, and the sections [none], [constant error], [update]"),
        ("[none]\nwidth = 1\nq0 = 0.9\npull = 0.3\n", "[none]: key 'pull': unknown, allowed: lapse_rate, noise_slope, q0, share, width"),
        ("at = true\n[none]\nwidth = 1\nq0 = 0.9\n", "key at: allowed: a finite number"),
        ("", "found no kind of observers"),
        ("[none]\nwidth = 1\nq0 = 0.9\nshare = 0\n", "[none]: share: found 0, allowed: a number above 0"),
        ("[none]\nwidth = 1\nq0 = 0.9\nshare = [1, 2]\n", "share: allowed: a number in every section, one of which is the largest"),
    ],
)
def test_a_wrong_file_is_refused_in_one_line(tmp_path, text, said):
    (tmp_path / "people.toml").write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as caught:
        observers_from(tmp_path / "people.toml", 1, seed=1)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_shares_change_no_observer(tmp_path):
    ranges = "width = [0.2, 0.4]\nq0 = [0.8, 0.9]\n"
    text = f"[none]\n{{}}{ranges}[update]\n{{}}pull = [0.1, 0.3]\noffset = 0\n{ranges}"
    for name, shares in (("plain", ("", "")), ("mixed", ("share = 1\n", "share = 3\n"))):
        (tmp_path / f"{name}.toml").write_text(text.format(*shares), encoding="utf-8")
    plain, mixed = (observers_from(tmp_path / f"{name}.toml", 2, seed=1) for name in ("plain", "mixed"))
    assert plain == mixed
    assert shares_from(tmp_path / "mixed.toml") == {"none": 0.25, "update": 0.75}
    assert shares_from(tmp_path / "plain.toml") == shares_from(None) == shares_from("prior") == {}


def test_other_words_are_refused():
    with pytest.raises(InputError, match="found 'people', allowed: prior, a"):
        observers_from("people", 1, seed=1)


def test_draws_of_an_earlier_study_are_observers_and_their_likes_without_an_order_effect(tmp_path):
    subject = bt.Subject("S1", [0.0, 0.0, 0.3, 0.3], [0.0, 0.3, 0.0, 0.3], [45, 30, 12, 47], [50, 50, 50, 50])
    draws = bt.sample(bt.Study((subject,)), model="update + both ways", draws=500, seed=1, workers=1)
    draws.save(tmp_path / "posterior.nc")
    observers = observers_from(tmp_path / "posterior.nc", 2, seed=1)
    assert [one.model for one in observers[::2]] == [
        f"{kind} + Weber + both ways + bell + binomial" for kind in ("none", "constant error", "update")
    ]
    of_update = np.stack([one.equal(paper_study_design()) for one in of_kind(observers, "update")])
    assert of_update.shape == (2, 13)
    assert np.all(of_kind(observers, "none")[0].equal(StudyDesign([0.0, 0.3], [0.3, 0.0], [1, 1])) > 0.0)
    swapped = of_kind(observers, "none")[0].equal(StudyDesign([0.0, 0.3], [0.3, 0.0], [1, 1]))
    assert swapped[0] == pytest.approx(swapped[1], rel=1e-12)
