"""Unsuitable files are refused with a line for each problem, and with no other exception.

With HYPOTHESIS_PROFILE=night, each kind has 20,000 files.
"""

import os

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import bayes_toe as bt
from bayes_toe.data.covariates import read_covariates
from bayes_toe.data.tasks import SAME_DIFFERENT
from bayes_toe.data.validation import read_numbers
from bayes_toe.errors import InputError
from bayes_toe.model.prior_file import hyperprior_from

FUZZ = settings(settings.get_profile(os.environ.get("HYPOTHESIS_PROFILE", "day")))

TEXTS = {
    "trials": "subject,s1,s2,response,isi,block\nA,0,0.3,equal,0.5,1\nA,0.3,0,different,0.5,1\n",
    "counts": "subject;s1;s2;n_equal;n_trials\nA;0;0,3;4;5\nB;0,3;0;2;5\n",
    "pairs": "s1,s2,n\n0,0.25,0.5\n0.5,-0.125,2\n",
    "covariates": "subject,age,gender\nA,20.5,f\nB,30.25,m\n",
    "prior": "[noise]\nsd = 0.5\n[paper]\ngamma_a = 1.5\n[group.q0]\nmean = -0.5\n",
    "hyperprior": "[noise]\nsd_scale = 0.5\n[q0]\nmean = -0.5\n",
}
READERS = {
    "trials": lambda path: bt.check(bt.read_study(path)),
    "counts": lambda path: bt.check(bt.read_study(path)),
    "pairs": lambda path: read_numbers(path, ("s1", "s2"), optional=("n",)),
    "covariates": read_covariates,
    "prior": lambda path: bt.model.read_prior(path).describe(),
    "hyperprior": lambda path: hyperprior_from(path).describe(SAME_DIFFERENT),
}
#: Words that may break readers: unusual numbers, formulas, beginnings of comments and lists.
_WORDS = b"""nan inf 1e999 -1e-999 =1+1 '=1 [ # 1_0 subject s1 response n_trials synthetic trial
mu1_sd stimuli True 1979-05-27"""
#: Bytes that may break readers: delimiters, line ends, marks of encodings, escapes.
_MARKS = [
    b",",
    b";",
    b"\t",
    b"\n",
    b"\r",
    b"\0",
    b"\xff\xfe",
    b"\xef\xbb\xbf",
    b"\x1b[2J",
    "\u202e\u2028\x85".encode(),
    b"\xf0\x9f",
]
#: Long numbers, and brackets and names without an end.
_LONG = [b"9" * 400, b"9" * 5000, b"0x" + b"f" * 5000, b"[" * 2000, b"{a=" * 2000, b"a." * 2000]
PIECES = st.sampled_from([b'"', *_MARKS, *_LONG, *_WORDS.split()])


@st.composite
def damaged_texts(draw, data):
    """The bytes of a file, in which up to 12 bytes are replaced, up to 4 times."""
    for _ in range(draw(st.integers(0, 4))):
        start = draw(st.integers(0, len(data)))
        data = (
            data[:start]
            + draw(PIECES | st.binary(max_size=8))
            + data[start + draw(st.integers(0, 12)) :]
        )
    return data


def result_or_none(read, path):
    """The result of reading, or None where an InputError has 1 to 11 short, printable lines."""
    try:
        return read(path)
    except InputError as error:
        problems = error.problems
    assert 0 < len(problems) <= 11
    for line in problems:
        assert line.isprintable()
        assert len(line) < 2000
    return None


@pytest.mark.parametrize("kind", TEXTS)
def test_small_files_are_read_or_refused_in_lines(kind, tmp_path):
    # First files that are damaged, or that have any bytes, and then the whole file, which is read.
    path = tmp_path / "file"

    @FUZZ
    @given(damaged_texts(TEXTS[kind].encode()) | st.binary(max_size=60))
    def require_read_or_refused(data):
        path.write_bytes(data)
        result_or_none(READERS[kind], path)

    require_read_or_refused()
    path.write_text(TEXTS[kind], encoding="utf-8")
    assert result_or_none(READERS[kind], path) is not None
