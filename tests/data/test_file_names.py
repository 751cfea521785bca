"""File names: safe and distinct on every system."""

from __future__ import annotations

import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bayes_toe.data.tables import file_stems

FUZZ = settings(max_examples=200, deadline=None, derandomize=True, database=None)


def test_plain_names_stay() -> None:
    names = ["S01", "a.b", "x-1_y", "CONtrol", "nul1", "0", "a" * 60]
    assert file_stems(names) == {name: name for name in names}


@pytest.mark.parametrize(
    ("name", "start"),
    [
        ("Zoë", "Zo_-"),
        ("被験者", "_-"),
        ("../up", "_up-"),
        ("a/b", "a_b-"),
        ("a b", "a_b-"),
        ("...", "_-"),
        (".hidden", "hidden-"),
        ("end.", "end.-"),
        ("con", "_con-"),
        ("CON.txt", "_CON.txt-"),
        ("Lpt9", "_Lpt9-"),
        ("a\nb", "a_b-"),
        ("b" * 61, "b" * 51 + "-"),
    ],
)
def test_other_names_carry_their_hash(name: str, start: str) -> None:
    stem = file_stems([name])[name]
    assert re.fullmatch(re.escape(start) + "[0-9a-f]{8}", stem)


def test_the_hash_is_of_the_name() -> None:
    # printf 'a b' | sha256sum
    assert file_stems(["a b"]) == {"a b": "a_b-c8687a08"}


def test_names_that_differ_in_case_are_told_apart() -> None:
    stems = file_stems(["s01", "S01", "S02"])
    assert stems["S02"] == "S02"
    assert len({stem.lower() for stem in stems.values()}) == 3
    assert stems["s01"].startswith("s01-")
    assert stems["S01"].startswith("S01-")


def test_a_name_that_looks_like_another_ones_stem() -> None:
    imitation = file_stems(["a b"])["a b"]
    stems = file_stems([imitation, "a b", imitation.upper()])
    assert stems["a b"] == imitation
    assert len({stem.lower() for stem in stems.values()}) == 3


def test_one_name_twice_is_one_name() -> None:
    assert file_stems(["S01", "S01"]) == {"S01": "S01"}


@FUZZ
@given(st.lists(st.one_of(st.text(max_size=80), st.sampled_from(["a", "A", "a ", "con", "CON", "aux.x", "\ud800"]))))
def test_stems_are_safe_and_distinct(names: list[str]) -> None:
    stems = file_stems(names)
    assert set(stems) == set(names)
    assert len({stem.lower() for stem in stems.values()}) == len(set(names))
    for stem in stems.values():
        assert re.fullmatch(r"[A-Za-z0-9_-][A-Za-z0-9._-]{0,59}", stem)
        assert not stem.endswith(".")
        assert stem.split(".")[0].lower() not in {"con", "prn", "aux", "nul", *(f"com{i}" for i in range(10))}
