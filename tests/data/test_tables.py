"""Tables of results as CSV, and names of files that are safe on every system."""

import re

import numpy as np
import pandas as pd
import pytest
from conftest import text_table
from hypothesis import given, settings
from hypothesis import strategies as st

from bayes_toe.data.read_study import read_study
from bayes_toe.data.tables import file_stems, write_table

FUZZ = settings(max_examples=100, deadline=None, derandomize=True, database=None)


def test_tables_are_plain_csv(tmp_path):
    # Numbers have all their digits, missing values are empty cells, quotes are doubled, and the
    # index is left out. The folder is made.
    frame = pd.DataFrame(
        {
            "subject": ["01", "NA", 'Zoë, "x"'],
            "q0": [0.1 + 0.2, np.nan, -1e-300],
            "n": [1, 2, 3],
            "note": ["", None, "a"],
        },
        index=[7, 8, 9],
    )
    expected = """\
subject,q0,n,note
01,0.30000000000000004,1,
NA,,2,
"Zoë, ""x\""",-1e-300,3,a
"""
    path = write_table(frame, tmp_path / "new/t.csv")
    assert path == tmp_path / "new/t.csv"
    assert path.read_text(encoding="utf-8") == expected


def test_formulas_get_an_apostrophe_and_our_reader_takes_it_off(tmp_path):
    names = ["=1+1", "+a", "-2", "@x", "-b c", "'q"]  # -2 is a number and no formula
    frame = pd.DataFrame(
        {"subject": names, "s1": 0.0, "s2": [-0.5] * 6, "n_equal": 1, "n_trials": 2}
    )
    file = write_table(frame, tmp_path / "safe.csv")
    first_cells = [line.split(",")[0] for line in file.read_text().splitlines()[1:]]
    assert first_cells == ["'=1+1", "'+a", "-2", "'@x", "'-b c", "'q"]
    assert read_study(file).names == tuple(names)
    # If a study has the subjects '=1+1 and =1+1, the first name keeps its apostrophe.
    both_names = pd.concat([frame, frame.assign(subject=["'=1+1", *"abcde"])])
    assert "'=1+1" in read_study(write_table(both_names, tmp_path / "both.csv")).names


# --- Names of files -------------------------------------------------------------------------------


#: Names, and how their files begin.
STEMS = """
    Zoë | Zo_-
    被験者 | _-
    ../up | _up-
    a/b | a_b-
    ... | _-
    .hidden | _hidden-
    end. | end_-
    con | con-
    CON.txt | CON_txt-
    Lpt9 | Lpt9-
"""


@pytest.mark.parametrize(
    "name, start", [*text_table(STEMS), ("a\nb", "a_b-"), ("b" * 61, "b" * 51 + "-")]
)
def test_names_that_are_not_plain_carry_their_hash(name, start):
    # Such as 'con', which is a device on Windows: its files begin with 'con-', and eight digits of
    # a hash follow. A name of 61 characters is too long, and is cut to 51.
    assert re.fullmatch(re.escape(start) + "[0-9a-f]{8}", file_stems([name])[name])


def test_plain_names_are_their_stems():
    # Names that are only similar to devices, con and nul, and a name of the greatest length, 60.
    names = ["S01", "a.b", "x-1_y", "CONtrol", "nul1", "0", "a" * 60]
    assert file_stems([*names, "S01"]) == dict(zip(names, names, strict=True))
    # A name with a space has the hash of `printf 'a b' | sha256sum`.
    assert file_stems(["a b"]) == {"a b": "a_b-c8687a08"}


@FUZZ
@given(
    st.lists(
        st.one_of(
            st.text(max_size=80), st.sampled_from(["a", "A", "a ", "con", "CON", "aux.x", "\ud800"])
        )
    )
)
def test_stems_are_safe_and_distinct(names):
    # Stems must be safe on systems that do not distinguish capitals, and on which names of devices,
    # such as aux with any ending, are no files. A stem has at most 60 characters.
    stems = file_stems(names)
    assert set(stems) == set(names)
    assert len({stem.lower() for stem in stems.values()}) == len(set(names))
    for stem in stems.values():
        assert re.fullmatch(r"[A-Za-z0-9_-][A-Za-z0-9._-]{0,59}", stem)
        assert not stem.endswith(".")
        assert not re.match(r"(con|prn|aux|nul|com\d)($|\.)", stem.lower())
