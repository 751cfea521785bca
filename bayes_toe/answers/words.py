"""The words of every answer, with their limits, in one place."""

from __future__ import annotations

from enum import StrEnum


class Word(StrEnum):
    """The word for a probability and a Bayes factor, as in files; the surest word first."""

    YES = "yes"
    PROBABLY = "probably"
    UNDECIDED = "undecided"
    PROBABLY_NOT = "probably not"
    NO = "no"
    CANNOT_BE_TOLD = "cannot be told"
    NOT_INTERPRETABLE = "not interpretable"

    @property
    def is_positive(self) -> bool:
        """Whether the word says that there is an effect, for sure or probably."""
        return self in (Word.YES, Word.PROBABLY)

    def __reduce_ex__(self, proto: object) -> tuple[type[Word], tuple[str]]:
        """How a word is pickled: as its text. Python 3.11.0 to 3.11.3 would pickle a function."""
        return Word, (self.value,)


#: Probabilities from which, and up to which, a word holds.
YES_FROM = 0.95
PROBABLY_FROM = 0.75
PROBABLY_NOT_UP_TO = 0.25
NO_UP_TO = 0.05
#: The largest log Bayes factor of 'probably not'. The prior probability of an effect may be 1/3,
#: and hardly any evidence takes it to 0.25. Only much evidence takes it to 0.05, so that 'no' needs
#: no such limit.
PROBABLY_NOT_LOG_BAYES_FACTOR = -1.0


def word_for(probability: float, log_bayes_factor: float) -> Word:
    """The word for an effect of this posterior probability and log Bayes factor, nats.

    Examples
    --------
    >>> str(word_for(0.97, 4.0)), str(word_for(0.2, -0.5)), str(word_for(0.2, -1.5))
    ('yes', 'undecided', 'probably not')
    """
    if probability >= YES_FROM:
        return Word.YES
    if probability >= PROBABLY_FROM:
        return Word.PROBABLY
    if probability <= NO_UP_TO:
        return Word.NO
    is_against = log_bayes_factor <= PROBABLY_NOT_LOG_BAYES_FACTOR
    if probability <= PROBABLY_NOT_UP_TO and is_against:
        return Word.PROBABLY_NOT
    return Word.UNDECIDED


def remains(word: Word, other: Word) -> bool:
    """Whether a sure word, `yes` or `no`, is still at least probable when it becomes `other`.

    Other words say less, and always remain.

    Examples
    --------
    >>> remains(Word.YES, Word.PROBABLY), remains(Word.NO, Word.UNDECIDED)
    (True, False)
    >>> remains(Word.PROBABLY, Word.UNDECIDED)  # not as sure a word
    True
    """
    if word is Word.YES:
        return other.is_positive
    if word is Word.NO:
        return other in (Word.NO, Word.PROBABLY_NOT)
    return True


def claim(word: Word, noun: str, verb: str, complement: str) -> str:
    """What a word says of a noun, a verb and its complement, without a full stop.

    Examples
    --------
    >>> claim(Word.PROBABLY_NOT, "the mean", "differ", "from 0")
    'the mean probably does not differ from 0'
    >>> claim(Word.UNDECIDED, "the mean", "differ", "from 0")
    'the data do not show whether the mean differs from 0'
    """
    positive = f"{noun} {verb}s {complement}"
    claims = {
        Word.YES: positive,
        Word.PROBABLY: f"{noun} probably {verb}s {complement}",
        Word.UNDECIDED: f"the data do not show whether {positive}",
        Word.PROBABLY_NOT: f"{noun} probably does not {verb} {complement}",
        Word.NO: f"{noun} does not {verb} {complement}",
    }
    # CANNOT_BE_TOLD is left.
    return claims.get(word, f"the design cannot show whether {positive}")
