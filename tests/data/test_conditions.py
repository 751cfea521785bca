"""Conditions within subjects: units, their scales, the design of levels, and what is refused."""

import numpy as np
import pandas as pd
import pytest

import bayes_toe as bt
from bayes_toe.data.conditions import Conditions
from bayes_toe.data.study import stimuli_of
from bayes_toe.data.tables import write_table

ROWS = "subject,s1,s2,response,condition,isi\n" + "".join(
    f"{who},{s1},{s2},{answer},{level},{isi}\n"
    for who in ("a", "b")
    for level, isi, far in (("right", 2, 0.0), ("left", "1.0", 1.0))
    for s1, s2, answer in (
        (far, far, "equal"),
        (far, 0.3 + far, "different"),
        (0.3 + far, far, "equal"),
    )
)


@pytest.fixture
def read(tmp_path):
    def read(text=ROWS, **options):
        path = tmp_path / "study.csv"
        path.write_text(text, encoding="utf-8")
        return bt.read_study(path, bt.ReadOptions(**options))

    return read


@pytest.mark.parametrize("levels", [("a", "b"), ("a", "b", "c"), tuple("abcde"), ("1", "4", "2")])
def test_any_two_levels_differ_alike_and_effects_sum_to_nothing(levels):
    x = Conditions("c", levels).design()
    assert x.shape == (len(levels), len(levels) - 1)
    np.testing.assert_allclose(x.sum(axis=0), 0.0, atol=1e-14)
    apart = np.square(x[:, None] - x[None]).sum(axis=-1)
    np.testing.assert_allclose(apart, 1.0 - np.eye(len(levels)), atol=1e-14)


def test_numbers_have_a_slope_over_their_range():
    found = Conditions("delay", ("4", "2", "8"), numeric=True)
    assert found.comparisons == (("8", "2"),)
    np.testing.assert_allclose(found.design()[:, 0], (np.array([4, 2, 8]) - 14 / 3) / 6)
    np.testing.assert_allclose(found.design(("8", "2"))[:, 0] @ [1.0, -1.0], 1.0)


def test_units_have_the_scales_of_their_subject(read):
    found, whole = read(), read(ignore="condition")
    assert found.names == ("a@left", "a@right", "b@left", "b@right")
    assert [(one.person, one.condition) for one in found][:2] == [("a", "left"), ("a", "right")]
    assert found.conditions == Conditions("condition", ("left", "right"))
    for one in found:
        assert one.felt == stimuli_of(one) == pytest.approx(stimuli_of(whole[one.person]))
        own, of_whole = bt.model.paper_posterior(one), bt.model.paper_posterior(whole[one.person])
        assert (
            own.sbar
            == pytest.approx(of_whole.sbar)
            != pytest.approx(np.average(one.s1, weights=one.n_trials))
        )
        assert own.prior.mu1_mean == pytest.approx(of_whole.prior.mu1_mean)
    assert found.swap("a@left")["a@left"].felt == found["a@left"].felt
    again = bt.read_study(found.frame())
    assert (again.names, again.conditions) == (found.names, found.conditions)
    assert read(reference="right").conditions.comparisons == (("left", "right"),)


def test_intervals_may_be_levels(read):
    found = read(condition="isi")
    assert found.intervals == ()
    assert found.names[:2] == ("a@1", "a@2")
    assert found.conditions.numeric
    assert not read(condition="isi", categorical=True).conditions.numeric


def test_what_does_not_differ_within_subjects_is_no_condition(read):
    between = ROWS.replace("left", "right").splitlines()
    text = "\n".join(
        line.replace("right", "left") if line.startswith("b,") else line for line in between
    )
    found = read(text)
    assert found.names == ("a", "b")
    assert found.conditions is None
    assert any("no condition within" in note for note in found.notes)
    assert all(one.answers is not None for one in found)
    with pytest.raises(bt.InputError, match="every subject at one level"):
        read(text, condition="condition")


@pytest.mark.parametrize("name", ["{0}-{1}", "{2}"])
def test_names_of_pairs_or_of_their_order_are_no_condition_unless_asked_for(read, name):
    pairs = [(0.0, 0.3, "up"), (0.3, 0.0, "down"), (0.0, 0.6, "up"), (0.6, 0.0, "down")] * 4
    rows = [
        f"a,{i},{s1},{s2},equal,{name.format(s1, s2, order)}"
        for i, (s1, s2, order) in enumerate(pairs)
    ]
    text = "\n".join(["subject,trial,s1,s2,response,condition", *rows[:3], *rows[4:]])
    found = read(text)
    assert (found.names, found.conditions) == (("a",), None)
    assert "found no pair at two of its levels" in found.notes[-1]
    assert not any("as --ignore has it" in note for note in found.notes)
    asked = read(text, condition="condition")
    assert len(asked) == len({row.rpartition(",")[2] for row in rows})
    assert any("trial numbers are missing (a 1)" in note for note in asked.notes)
    assert read(text + "\na,16,0.0,0.3,equal,other").conditions is not None  # a pair at two levels


def test_check_warns_where_no_pair_is_in_two_conditions(read):
    rows = [
        f"a,{s1},{s2},equal,{order}" for s1, s2, order in [(0.0, 0.3, "up"), (0.3, 0.0, "down")] * 6
    ]
    found = bt.check(
        read("\n".join(["subject,s1,s2,response,condition", *rows]), condition="condition")
    )
    assert [one.message for one in found if one.code == "stimuli_by_condition"] == [
        "No pair was presented in two conditions. A difference between conditions may be an effect "
        "of the pairs."
    ]


@pytest.mark.parametrize(
    ("text", "options", "said"),
    [
        (
            ROWS.replace("left", "l@ft"),
            {},
            "row 5, column condition: found 'l@ft', allowed: a name without @",
        ),
        (
            ROWS.replace("left", ""),
            {},
            "row 5, column condition: found '', allowed: a text that is not empty",
        ),
        (ROWS, {"reference": "up"}, "--reference: found 'up', allowed: left, right"),
        (ROWS, {"condition": "hand"}, "there is no column hand"),
    ],
)
def test_what_is_refused(read, text, options, said):
    with pytest.raises(bt.InputError, match=said):
        read(text, **options)


def test_tables_have_subject_and_condition_and_are_read_back_as_units(tmp_path):
    frame = pd.DataFrame({"model": ["m", "m"], "subject": ["a@left", "*"], "value": [1.0, 2.0]})
    path = write_table(frame, tmp_path / "table.csv", units=True)
    assert pd.read_csv(path, keep_default_na=False).columns.tolist() == [
        "model",
        "subject",
        "condition",
        "value",
    ]


def test_check_warns_of_time_stimuli_and_missing_levels(read):
    found = {(one.subject, one.code): one.message for one in bt.check(read())}
    assert "by 1.9 standard deviations" in found["a", "stimuli_by_condition"]
    assert "right, left, for 2 subjects" in found["", "conditions_in_order"]
    assert ("a", "missing_condition") not in found
    lines = ROWS.splitlines()
    mixed = read("\n".join([lines[0], *lines[1:7:2], *lines[2:7:2], *lines[7:10]]))
    codes = {(one.subject, one.code): one.message for one in bt.check(mixed)}
    assert ("", "conditions_in_order") not in codes
    assert "No trials in condition left" in codes["b", "missing_condition"]


def test_files_have_the_condition_all_or_none(tmp_path):
    (tmp_path / "one.csv").write_text(ROWS, encoding="utf-8")
    (tmp_path / "other.csv").write_text(
        ROWS.replace("condition", "hand").replace("a,", "c,"), encoding="utf-8"
    )
    with pytest.raises(bt.InputError, match="found column condition in some files only"):
        bt.read_study([tmp_path / "one.csv", tmp_path / "other.csv"])
    (tmp_path / "other.csv").write_text(ROWS.replace("a,", "c,"), encoding="utf-8")
    together = bt.read_study([tmp_path / "one.csv", tmp_path / "other.csv"])
    assert together.names == ("a@left", "a@right", "b@left", "b@right", "c@left", "c@right")
    assert together["b@left"].felt == pytest.approx(together["a@left"].felt)
