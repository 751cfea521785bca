"""One scale of words for evidence, wherever the program uses words, and what it calls the order effect of a subject."""

from __future__ import annotations

import math
from collections.abc import Sequence

#: Nats of a log Bayes factor from which its evidence has this name. Source: Kass and Raftery 1995, who state twice as much, 2 log B.
SCALE = ((5.0, "very strong"), (3.0, "strong"), (1.0, "positive"), (0.0, "weak"))
POSITIVE, STRONG = 1.0, 3.0
#: The scale as it is stated where it is used.
STATED = (
    "Evidence is called weak below 1 nat (P = 0.73 at equal prior odds), positive below 3 (0.95), strong below 5 (0.993), very strong "
    "above (Kass and Raftery 1995)"
)
#: The kinds of order effect, in the order of their probabilities.
KINDS = ("no order effect", "constant error", "update")


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
    return "no estimate" if log_bayes_factor is None else f"{grade(log_bayes_factor)} for {sides[log_bayes_factor <= 0]}"


def order_effect(log_evidence: Sequence[float] | None) -> str:
    """Which order effect a subject has, in a word of :data:`KINDS`, 'some order effect', 'undecided' or 'no estimate'.

    A kind is named where its evidence is positive against each other one; 'some order effect' is said where both kinds of it
    have positive evidence against none, but not against each other.

    Parameters
    ----------
    log_evidence : sequence of 3 floats, optional
        Of the models without order effect, with a constant error, with the update, nats.

    Examples
    --------
    >>> [order_effect(found) for found in ((0.0, -3.0, -2.0), (-9.0, -3.0, -2.5), (0.0, -0.5, -2.0), None)]
    ['no order effect', 'some order effect', 'undecided', 'no estimate']
    """
    if log_evidence is None:
        return "no estimate"
    order = sorted(range(len(KINDS)), key=lambda kind: -log_evidence[kind])
    ahead = [log_evidence[order[0]] - log_evidence[kind] for kind in order[1:]]
    if ahead[0] >= POSITIVE:
        return KINDS[order[0]]
    none_is_last = order[-1] == 0 and log_evidence[order[1]] - log_evidence[0] >= POSITIVE
    return "some order effect" if none_is_last else "undecided"


def order_effect_and_probability(log_evidence: Sequence[float] | None) -> str:
    """The same with its probability; where it is undecided, with the likeliest kind and that one's.

    Examples
    --------
    >>> for found in ((0.0, 4.0, 1.0), (-9.0, -3.0, -2.5), (0.0, -0.5, -2.0)):
    ...     order_effect_and_probability(found)
    'constant error (P = 0.94)'
    'some order effect (P > 0.99)'
    'undecided, likeliest no order effect (P = 0.57)'
    """
    word = order_effect(log_evidence)
    if log_evidence is None:
        return word
    p = probabilities(log_evidence)
    best = max(range(len(p)), key=p.__getitem__)
    value = 1.0 - p[0] if word == "some order effect" else p[best]
    return f"{f'undecided, likeliest {KINDS[best]}' if word == 'undecided' else word} (P {compared(value)})"


def compared(p: float) -> str:
    """A probability with the sign before it, two digits.

    Examples
    --------
    >>> compared(0.914), compared(0.9999), compared(0.0)
    ('= 0.91', '> 0.99', '< 0.01')
    """
    return "> 0.99" if p > 0.995 else "< 0.01" if p < 0.005 else f"= {p:.2f}"


def probabilities(log_evidence: Sequence[float]) -> tuple[float, ...]:
    """Posterior probabilities of models with these log evidences (nats) and equal prior odds.

    Examples
    --------
    >>> [round(p, 3) for p in probabilities((0.0, 0.0, -800.0))]
    [0.5, 0.5, 0.0]
    """
    top = max(log_evidence)
    weights = [math.exp(value - top) for value in log_evidence]
    return tuple(weight / math.fsum(weights) for weight in weights)
