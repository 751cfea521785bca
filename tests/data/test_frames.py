"""Data frames are read as files are: the same study, the same strictness, refusals that name row and column of the frame."""

import numpy as np
import pandas as pd
import pytest

import bayes_toe as bt

TRIALS = {"subject": ["01", "01", "7"], "s1": [0, 0.3, 0.0], "s2": [0.3, 0, 0.0], "response": ["equal", "different", "same"]}


def as_pandas(columns):
    return pd.DataFrame(columns)


def as_polars(columns):
    return pytest.importorskip("polars").DataFrame(columns, strict=False)


@pytest.mark.parametrize("made", [as_pandas, as_polars])
def test_a_frame_is_read_as_its_file_is(made, tmp_path):
    pd.DataFrame(TRIALS).to_csv(tmp_path / "s.csv", index=False)
    file, frame = bt.read_study(tmp_path / "s.csv"), bt.read_study(made(TRIALS))
    pd.testing.assert_frame_equal(frame.frame(), file.frame())
    assert frame.source == f"{made.__name__[3:]} DataFrame"
    assert frame.notes[0].startswith(f"trial rows, {frame.source}, responses 'equal', 'same' as equal (2)")


@pytest.mark.parametrize("made", [as_pandas, as_polars])
@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"s1": [0.0, None, 0.0]}, "row 1, column s1: found '', allowed: a finite number"),
        ({"response": ["equal", "different", "maybe"]}, "other codes by ReadOptions(equal_code=..., different_code=...)"),
        ({"s2": [0.3, 0.0, float("inf")]}, "row 2, column s2: found 'inf', allowed: a finite number"),
        ({"subject": ["1", None, "7"]}, "row 1, column subject: found '', allowed: a text that is not empty"),
        ({"subject": ["1", "a\0b", "7"]}, "allowed: text without NUL characters"),
        ({"s1": ["0", "0,3", "0"]}, "row 1, column s1: found '0,3', allowed: a finite number"),
    ],
    ids=["missing", "answer", "infinite", "name", "nul", "comma"],
)
def test_what_cannot_be_used_is_refused_by_row_and_column(made, change, said):
    with pytest.raises(bt.InputError) as refused:
        bt.read_study(made({**TRIALS, **change}))
    assert said in str(refused.value)
    assert str(refused.value).startswith(f"{made.__name__[3:]} DataFrame: row ")


def test_what_a_frame_lacks_is_said_in_words_of_python():
    frame = pd.DataFrame(TRIALS).rename(columns={"subject": "participant"})
    with pytest.raises(bt.InputError, match=r"or ReadOptions\(columns=\{'subject': 'participant'\}\)"):
        bt.read_study(frame)
    assert bt.read_study(frame, bt.ReadOptions(columns={"subject": "participant"})).names == ("01", "7")
    with pytest.raises(bt.InputError, match="found no row"):
        bt.read_study(frame.rename(columns={"participant": "subject"}).iloc[:0])
    with pytest.raises(bt.InputError, match="found '2020-01-01 00:00:00' of type Timestamp, allowed: text, numbers or truth values"):
        bt.read_study(pd.DataFrame({**TRIALS, "s1": pd.Timestamp("2020-01-01")}))
    with pytest.raises(bt.InputError, match="found 'dict', allowed: the path of a file, or a pandas or polars DataFrame"):
        bt.read_study(TRIALS)
    with pytest.raises(bt.InputError, match="found 'int', allowed"):
        bt.read_study(3)


def test_lazy_frames_are_collected_by_their_owner():
    lazy = pytest.importorskip("polars").DataFrame(TRIALS, strict=False).lazy()
    with pytest.raises(bt.InputError, match=r"found a lazy frame, allowed: a frame, which its collect\(\) gives"):
        bt.read_study(lazy)


def test_whole_numbers_keep_their_digits_whatever_pandas_made_of_them():
    frame = pd.DataFrame({"subject": [1008.0, 1008.0, np.nan], "s1": [0, 0, 0], "s2": [0, 1, 0], "response": [1.0, 0.0, np.nan]})
    study = bt.read_study(frame)
    assert study.names == ("1008",)
    assert study[1008] is study["1008"] is study[np.int64(1008)]
    answers = pd.DataFrame({"subject": pd.Categorical(["x"] * 2), "s1": 0, "s2": [0, 1], "response": pd.array([True, False], "boolean")})
    assert bt.read_study(answers)["x"].n_equal.tolist() == [1, 0]


@pytest.mark.parametrize("isi", [None, [0.5, 2.0]])
def test_a_study_gives_the_frame_that_it_is_read_from(isi):
    study = bt.simulate(2, batches=3, isi=isi, seed=1).study
    again = bt.read_study(study.frame())
    assert again.synthetic
    for one in study:
        for key in ("s1", "s2", "n_equal", "n_trials") + (("isi",) if isi else ()):
            assert np.array_equal(getattr(one, key), getattr(again[one.name], key))


def test_covariates_come_as_a_frame_too():
    people = pd.DataFrame({"subject": ["a", "b"], "age": [31, 42]})
    assert bt.read_covariates(people).values == {"age": {"a": 31.0, "b": 42.0}}
