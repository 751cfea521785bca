"""README and tutorial print what the program prints, and agree with the truth of the example."""

import re
from contextlib import chdir

import numpy as np
import pandas as pd
import printed_output
import pytest
from commands import on_one_line

import bayes_toe as bt
from bayes_toe.answers.words import Word

#: Options by command that save time and change no printed number.
CHEAP_OPTIONS = {
    "run": ["--draws", "100", "--figures", "none", "--workers", "1"],
    "evidence": ["--workers", "1"],
}
NUMBER = re.compile(r"([-+]?\d*\.?\d+)")


@pytest.fixture(scope="module")
def example_analysis():
    """The analysis of the bundled example of 12 subjects, with the seed of the documents."""
    return bt.run(bt.example_study(), draws=100, seed=1)


@pytest.fixture
def known_analyses(monkeypatch, example_analysis):
    """Studies with the trials of the example are not analysed again, as that takes long."""
    evidence = bt.evidence

    def run(study, **_):
        assert study.names == example_analysis.study.names
        return example_analysis

    def known_evidence(study, **options):
        is_example = study.frame().equals(example_analysis.study.frame())
        return example_analysis.evidence if is_example else evidence(study, **options)

    monkeypatch.setattr(bt, "run", run)
    monkeypatch.setattr(bt, "evidence", known_evidence)


def cheap_call(words):
    """The screen of a command with its CHEAP_OPTIONS."""
    program, command, *options = words
    cheap_options = CHEAP_OPTIONS.get(command, []) if program == "bayes-toe" else []
    return printed_output.call([program, command, *options, *cheap_options])


def require_same(stated, printed):
    """Both texts have the same words, and the same numbers up to the digits of a processor.

    Split at its numbers, a text has words and numbers by turns.
    """
    stated_parts, printed_parts = (NUMBER.split(on_one_line(text)) for text in (stated, printed))
    assert stated_parts[::2] == printed_parts[::2]
    for stated_number, number in zip(stated_parts[1::2], printed_parts[1::2], strict=True):
        tolerance = 0.0
        if "." in stated_number:
            n_decimals = len(stated_number.partition(".")[2])
            tolerance = 1.01 * 10.0**-n_decimals  # one unit of the last decimal, but for rounding
        assert float(stated_number) == pytest.approx(float(number), rel=0.1, abs=tolerance)


@pytest.mark.parametrize("document", printed_output.DOCUMENTS, ids=lambda path: path.name)
def test_documents_print_what_the_program_prints(tmp_path, document, known_analyses):
    printed_output.copy_studies(tmp_path)
    text = document.read_text(encoding="utf-8")
    # The README samples all subjects, for which there is no time.
    if document.name == "README.md":
        text = text.replace("bt.sample(study,", 'bt.sample(study.select(["S01"]),')
    with chdir(tmp_path):
        outputs = list(printed_output.outputs(text, cheap_call))
    for output in outputs:
        require_same(output.stated, output.printed)
    assert outputs  # Each of these documents has printed text.
    # Intervals in the prose, such as [-1.2, +3.4], are among the intervals that are printed.
    printed_text = " ".join(output.stated for output in outputs)
    intervals = set(re.findall(r"\[[-+.\d]+, [-+.\d]+\]", text))
    assert [interval for interval in intervals if interval not in printed_text] == []


# --- The example's truth --------------------------------------------------------------------------

#: The size of each effect.
SIZES = {"constant_error": "pse_shift_percent", "contraction": "contraction_p"}


@pytest.fixture(scope="module")
def true_effects():
    """True effects in the unit of the answers, per cent and p, with a row for each subject."""
    effects = pd.DataFrame(bt.example_truth()).T[list(SIZES)]
    return effects.assign(constant_error=100.0 * np.expm1(effects["constant_error"]))


@pytest.mark.parametrize("effect", SIZES)
def test_words_and_sizes_of_the_example_agree_with_its_truth(
    example_analysis, true_effects, effect
):
    n_covered = 0
    for answer in example_analysis.answers:
        true_size = true_effects[effect][answer.subject]
        size = answer.sizes[SIZES[effect]]
        word = answer.words[effect]
        # No word says that an absent effect is present, and 'undecided' is never wrong. If a word
        # says that an effect is present, the median has the sign of the true size.
        if true_size == 0.0:
            assert not word.is_positive, answer.subject
        else:
            assert word is Word.UNDECIDED or word.is_positive, answer.subject
            assert word is Word.UNDECIDED or size.q50 * true_size > 0.0, answer.subject
        n_covered += size.q025 <= true_size <= size.q975
    # Of twelve 95 % intervals, one may miss the true size.
    assert n_covered >= 11
