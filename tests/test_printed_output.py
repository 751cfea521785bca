"""README and tutorial print what the program prints, and agree with the truth of the example."""

import re
from contextlib import chdir

import numpy as np
import pandas as pd
import printed_output
import pytest

import bayes_toe as bt
from bayes_toe.answers.words import Word

#: What costs time and changes no printed number.
CHEAP = {
    "run": ["--draws", "100", "--figures", "none", "--workers", "1"],
    "evidence": ["--workers", "1"],
}
NUMBER = re.compile(r"([-+]?\d*\.?\d+)")


@pytest.fixture(scope="module")
def example():
    """The bundled example, analysed as the documents do."""
    return bt.run(bt.example_study(), draws=100, seed=1)


@pytest.fixture
def known_analyses(monkeypatch, example):
    """Studies with the trials of the example are not analysed again."""
    evidence = bt.evidence

    def run(study, **_):
        assert study.names == example.study.names
        return example

    def known_evidence(study, **options):
        is_example = study.frame().equals(example.study.frame())
        return example.evidence if is_example else evidence(study, **options)

    monkeypatch.setattr(bt, "run", run)
    monkeypatch.setattr(bt, "evidence", known_evidence)


def cheap_call(words):
    program, command, *options = words
    extra = CHEAP.get(command, []) if program == "bayes-toe" else []
    return printed_output.call([program, command, *options, *extra])


def require_same(stated, printed):
    """The same words; numbers may differ in their last digits on another processor."""
    old, new = (NUMBER.split(" ".join(text.split())) for text in (stated, printed))
    assert old[::2] == new[::2]
    for old_number, new_number in zip(old[1::2], new[1::2], strict=True):
        tolerance = 0.0
        if "." in old_number:
            n_decimals = len(old_number.partition(".")[2])
            tolerance = 1.01 * 10.0**-n_decimals
        assert float(old_number) == pytest.approx(float(new_number), rel=0.1, abs=tolerance)


@pytest.mark.parametrize("document", printed_output.DOCUMENTS, ids=lambda path: path.name)
def test_documents_print_what_the_program_prints(tmp_path, document, known_analyses):
    printed_output.copy_studies(tmp_path)
    text = document.read_text(encoding="utf-8")
    if document.name == "README.md":
        text = text.replace("bt.sample(study,", 'bt.sample(study.select(["S01"]),')
    with chdir(tmp_path):
        outputs = list(printed_output.outputs(text, cheap_call))
    for output in outputs:
        require_same(output.stated, output.printed)
    assert outputs
    # Intervals in the prose are among those that are printed.
    printed = " ".join(output.stated for output in outputs)
    stated = set(re.findall(r"\[[-+.\d]+, [-+.\d]+\]", text))
    assert [interval for interval in stated if interval not in printed] == []


# --- The example's truth --------------------------------------------------------------------------

SIZES = {"constant_error": "pse_shift_percent", "contraction": "contraction_p"}


@pytest.fixture(scope="module")
def truth():
    """True effects in the unit of the answers, a row per subject."""
    effects = pd.DataFrame(bt.example_truth()).T[list(SIZES)]
    return effects.assign(constant_error=100.0 * np.expm1(effects["constant_error"]))


@pytest.mark.parametrize("effect", SIZES)
def test_words_and_sizes_of_the_example_agree_with_its_truth(example, truth, effect):
    n_covered = 0
    for answer in example.answers:
        true = truth[effect][answer.subject]
        size, word = answer.sizes[SIZES[effect]], answer.words[effect]
        if true == 0.0:
            assert not word.is_positive, answer.subject
        else:
            assert word is Word.UNDECIDED or word.is_positive, answer.subject
            assert word is Word.UNDECIDED or size.q50 * true > 0.0, answer.subject
        n_covered += size.q025 <= true <= size.q975
    # Each is a 95 % interval: of 12, one may miss.
    assert n_covered >= 11
