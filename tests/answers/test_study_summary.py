"""The answer of a study: counts that add up, directions, how frequent an effect is."""

import re

import pytest
from conftest import WORD_BY_LETTER, order_answer

import bayes_toe as bt
from bayes_toe.analysis import _group
from bayes_toe.answers.order_effect import Size
from bayes_toe.answers.study_summary import (
    describe_meaning,
    study_lines,
)
from bayes_toe.answers.words import Word
from bayes_toe.cli.methods import _in_paper
from bayes_toe.inference.subject import Settings
from bayes_toe.model.prior import ParameterHyperprior


def answer(name, words, shift=5.0, **fields):
    """A subject's answer with words for its three questions; a shift above 0 is overestimation."""
    sizes = {
        "pse_shift_percent": Size(shift - 1.0, shift, shift + 1.0),
        "contraction_p": Size(0.1, 0.2, 0.3),
    }
    return order_answer(name, words, sizes=sizes, **fields)


#: Words for the order effect, the constant error and the contraction.
STUDY = [
    answer("A", (Word.YES, Word.YES, Word.YES)),
    answer("B", (Word.YES, Word.YES, Word.PROBABLY), shift=-5.0, direction="repulsion"),
    answer("C", (Word.PROBABLY, Word.UNDECIDED, Word.NO), fit_p=0.001),
    answer("D", (Word.NOT_INTERPRETABLE,) * 3, problems={"responses look swapped": None}),
]
ANSWER_A, _, _, SWAPPED = STUDY


#: For each subject the words for order effect, constant error and contraction, by the letters of
#: `WORD_BY_LETTER`. A `-` after a letter turns the effect around, and a `0` removes its direction.
#: Below stand the sentences on the meaning of these words.
MEANINGS = """
nnn nnn qqq
    In all 3 subjects the order probably does not change the response.

nnn nnn
    In both subjects the order does not change the response.

uuu uuu unn
    In all 3 subjects the data do not show whether the order changes the response.

nnn uuu uuu
    In most subjects (2 of 3) the data do not show whether the order changes the response. In 1
    of 3 subjects the order does not change the response.

ccc ccc
    In both subjects the design cannot show whether the order changes the response.

ccc nnn
    In 1 of 2 subjects the order does not change the response. In 1 of 2 subjects the design
    cannot show whether the order changes the response.

yyn yyn
    In both subjects the order changes the response. The first stimulus is overestimated in 2
    subjects.

yyn yyn yy-n yy-n
    In all 4 subjects the order changes the response. The first stimulus is overestimated in 2
    subjects and underestimated in 2.

yyn yy-n nnn nnn nnn nnn nnn
    In 2 of 7 subjects the order changes the response. In most subjects (5 of 7) the order does
    not change the response. The first stimulus is overestimated in 1 subject and underestimated
    in 1.

yny yny- uuu
    In most subjects (2 of 3) the order changes the response. The first stimulus is remembered
    as nearer to the mean in 1 subject and as farther from the mean in 1.

yny- yny-
    In both subjects the order changes the response. The first stimulus is remembered as farther
    from the mean in 2 subjects.

ppn puu uuu uuu
    In 2 of 4 subjects the order probably changes the response. The first stimulus is probably
    overestimated in 1 subject.

yp0n yun nnn
    In most subjects (2 of 3) the order changes the response.

yyy xxx
    A: The order changes the response: the first stimulus is overestimated and remembered as
    nearer to the mean.

yy-p-
    The order changes the response: the first stimulus is underestimated and probably remembered
    as farther from the mean.

puu
    The order probably changes the response. The data do not show by which effect.

uun
    The data do not show whether the order changes the response.

qqq
    The order probably does not change the response.

nnn
    The order does not change the response.

ccc
    The design cannot show whether the order changes the response.

yyc
    The order changes the response: the first stimulus is overestimated.

xxx xxx
    No subject can be interpreted.
"""


#: Words that a sentence in `methods.md` may not have, because it is in the past tense, and has
#: 'participants' in the place of 'subjects'.
PRESENT_TENSE = re.compile(r"\b(is|does|do|cannot|can|changes|differs?|subjects?)\b")


def answer_of(name, letters):
    """An answer by its letters; a '-' or '0' belongs to the letter before it."""
    # Words and signs of the order effect, the constant error and the contraction.
    words = []
    signs = []
    for letter in letters:
        if letter in WORD_BY_LETTER:
            words.append(WORD_BY_LETTER[letter])
            signs.append("+")
        else:
            signs[-1] = letter
    _, sign_of_error, sign_of_contraction = signs
    shift = {"+": 5.0, "-": -5.0, "0": 0.0}[sign_of_error]
    direction = "repulsion" if sign_of_contraction == "-" else "contraction"
    return answer(name, words, shift=shift, direction=direction, problems={"a reason": None})


@pytest.mark.parametrize("case", MEANINGS.split("\n\n"))
def test_the_answer_of_a_study_begins_with_what_its_words_mean(case):
    """A case has the words of each subject, and the text."""
    subjects, *lines = case.strip().splitlines()
    meaning = " ".join(map(str.strip, lines))
    # A name for each subject; there are seven at most.
    named_letters = zip("ABCDEFG", subjects.split(), strict=False)
    answers = [answer_of(name, letters) for name, letters in named_letters]
    assert describe_meaning(answers) == meaning
    # The private `_in_paper` makes the sentence of `methods.md`, which has more text around it.
    assert not PRESENT_TENSE.search(_in_paper(meaning))
    first_line, *_ = study_lines(answers)
    assert first_line == (f"A: {meaning}" if len(answers) == 1 else meaning)


def test_a_question_that_no_subject_can_answer_has_one_sentence():
    # The third question is about the contraction; subject D cannot be interpreted at all.
    words = (Word.YES, Word.YES, Word.CANNOT_BE_TOLD)
    *_, contraction = study_lines([answer("A", words), answer("B", words)])
    assert contraction == "Contraction: cannot be told in any subject."
    assert study_lines([SWAPPED, SWAPPED]) == ["No subject can be interpreted."]


def test_one_subject_is_described_in_full():
    _, line = study_lines([ANSWER_A])
    assert line.startswith("A: Order effect: yes (P = .50). Constant error: yes")
    assert study_lines([SWAPPED]) == ["D: Not interpreted: responses look swapped."]


def test_synthetic_subjects_are_called_so():
    # Subject D is not interpreted, and not counted.
    _, order_effect, *_ = study_lines(STUDY, synthetic=True)
    assert order_effect.startswith("Order effect: 2 of 3 synthetic subjects")


def test_run_fits_the_group_of_six_interpretable_subjects_and_no_fewer(monkeypatch):
    """The private `_group` is called, because `run` would take minutes for seven subjects.

    Groups are not fitted; the names of their subjects and the options are noted instead.
    """
    groups = []
    monkeypatch.setattr(
        "bayes_toe.analysis.population",
        lambda study, **options: groups.append((study.names, options)),
    )
    study = bt.example_study("same/different").select([f"S{i:02d}" for i in range(1, 8)])
    hyperprior = bt.Hyperprior(contraction=ParameterHyperprior(0.0, 0.6, 0.15))
    settings = Settings(seed=4, prior=bt.Prior(group=hyperprior))

    def group_without(*names):
        """The group of seven subjects, from which the subjects with these names are left out."""
        other_names = [name for name in study.names if name not in names]
        return _group(study, [answer(name, (Word.NO,) * 3) for name in other_names], settings)

    group_without("S01")  # Six subjects are left.
    assert groups == [(study.names[1:], {"seed": 4, "hyperprior": hyperprior})]
    assert group_without("S01", "S02") is None
    assert len(groups) == 1
