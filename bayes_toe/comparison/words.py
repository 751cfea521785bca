"""The words of verdicts with their limits, and one scale of words for evidence, wherever the program uses words."""

from __future__ import annotations

#: What sentences call the levels of the order part that are effects.
KINDS = {"constant error": "constant error", "update": "pull"}
#: P(none) up to which an effect is said, and probably; the same from the other side; share of a kind from which it is named, and probably.
HAS, PROBABLY_HAS, PROBABLY_NONE, NONE = 0.05, 0.25, 0.75, 0.95
NAMED, PROBABLY_NAMED = 0.9, 0.75
#: A size, in just noticeable differences, up to which an effect is called small, and where nothing larger is left, negligible.
SMALL, SURELY = 0.2, 0.05
#: What an effect is, in a sentence about one subject.
EFFECTS = {
    "has": "has an order effect",
    "probably has": "probably has an order effect",
    "undecided": "is undecided",
    "negligible": "has at most a negligible order effect",
    "probably none": "probably has no order effect",
    "none": "has no order effect",
    "": "has no verdict",
}
#: Nats of a log Bayes factor from which its evidence has this name. Source: Kass and Raftery 1995, who state twice as much, 2 log B.
SCALE = ((5.0, "very strong"), (3.0, "strong"), (1.0, "positive"), (0.0, "weak"))
#: The scale as it is stated where it is used.
STATED = (
    "Evidence is called weak below 1 nat (P = 0.73 at equal prior odds), positive below 3 (0.95), strong below 5 (0.993), very strong "
    "above (Kass and Raftery 1995)"
)


def side(p_none: float) -> str:
    """What the probability of no effect says: 'has', 'probably has', 'undecided', 'probably none' or 'none'.

    Examples
    --------
    >>> [side(p) for p in (0.05, 0.1, 0.5, 0.8, 0.96)]
    ['has', 'probably has', 'undecided', 'probably none', 'none']
    """
    if p_none <= PROBABLY_HAS:
        return "has" if p_none <= HAS else "probably has"
    if p_none >= PROBABLY_NONE:
        return "none" if p_none >= NONE else "probably none"
    return "undecided"


def grade(nats: float) -> str:
    """The name of so much evidence, on either side.

    Examples
    --------
    >>> [grade(nats) for nats in (0.5, -1.0, 3.0, 40.0)]
    ['weak', 'positive', 'strong', 'very strong']
    """
    return next(word for least, word in SCALE if abs(nats) >= least)


def conclusion(log_bayes_factor: float | None, sides: tuple[str, str] = ("H1", "H0")) -> str:
    """What a log Bayes factor says, in words.

    Examples
    --------
    >>> conclusion(4.0), conclusion(-0.5), conclusion(None)
    ('strong for H1', 'weak for H0', 'no estimate')
    """
    return (
        "no estimate"
        if log_bayes_factor is None
        else f"{grade(log_bayes_factor)} for {sides[log_bayes_factor <= 0]}"
    )


def compared(p: float) -> str:
    """A probability with the sign before it, two digits.

    Examples
    --------
    >>> compared(0.914), compared(0.9999), compared(0.0)
    ('= 0.91', '> 0.99', '< 0.01')
    """
    return "> 0.99" if p > 0.995 else "< 0.01" if p < 0.005 else f"= {p:.2f}"
