"""A model is a composition of parts, each at one of its levels: order, noise, lapses, curve, peak, spread.

P(equal) = f + (q0 - f) psi(z), f = lambda q0, z = ((s2 - s1) - c + p (s1 - sbar)) / w(s1, s2). The order part says what the first stimulus
becomes (c, p), the noise part how the width depends on the stimuli, the lapses which answers do not depend on them (q0, lambda), the curve
is psi, the peak how q0 depends on the stimuli, the spread says how counts scatter. Each level is a declaration; every combination is a
model, and nothing else knows parts by name.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np

from bayes_toe.errors import InputError
from bayes_toe.model.closed_form import MAX_PULL
from bayes_toe.model.distributions import Uniform
from bayes_toe.model.intervals import MEAN_REVERSION, RANDOM_WALK, Propagator
from bayes_toe.model.links import BELL, DIFFERENCING, EXPONENT, Lapsing, Link
from bayes_toe.model.memory import Memory, Update
from bayes_toe.model.parameters import NOISE_SLOPE, OFFSET, PEAK_SLOPE, WIDTH, Block, Log, Logit, Single
from bayes_toe.model.posterior import Model, Pull
from bayes_toe.model.spread import BETA_BINOMIAL, BINOMIAL, Spread

#: q0, or the peak of the differencing model.
PEAK = Single("q0", Logit())
#: Weight of the first stimulus, from none to twice that of the second, around "no effect" at 1 without preference.
GAIN = Single("gain", Logit(2.0), fixed=Uniform(2.0), starts=(-0.8, 0.4))
_OF_UPDATE = Pull("logit_pull", 0.0, MAX_PULL, centre="mu1")


@dataclass(frozen=True)
class Level:
    """What one level of a part adds to a model.

    Parameters
    ----------
    name : str
        The word for it, unique among the levels of all parts.
    about : str
        What it says of the observer, in a few words.
    free : tuple of Block
        The parameters it brings.
    also : tuple of str
        Other words that are understood.
    pull, propagator, link, spread
        What it sets of the record; see :class:`bayes_toe.model.posterior.Model`.
    lapsing : callable
        What lapses make of the curve's link.
    """

    name: str
    about: str
    free: tuple[Block, ...] = ()
    also: tuple[str, ...] = ()
    pull: Pull | None = None
    propagator: Propagator | None = None
    link: Link = BELL
    lapsing: Callable[[Link], Link | Lapsing] = lambda link: link
    spread: Spread = BINOMIAL


#: Levels of every part; the first one of each is the paper's, which a text form need not name.
PARTS: Mapping[str, tuple[Level, ...]] = {
    "order": (
        Level(
            "update",
            "memory is updated by a prior and diffuses",
            (Update(),),
            ("predictive update",),
            _OF_UPDATE,
            RANDOM_WALK,
        ),
        Level("none", "no order effect", (WIDTH,), ("symmetric",)),
        Level("constant error", "the second stimulus is judged with a constant error", (OFFSET, WIDTH), ("constant bias",)),
        Level(
            "free weighting",
            "Hellstrom's sensation weighting: any gain, any constant error",
            (OFFSET, GAIN, WIDTH),
            pull=Pull("logit_gain", 1.0, -2.0),  # p = 1 - K, K = 2 expit
        ),
        Level(
            "mean-reverting",
            "memory decays toward the prior mean (Ornstein-Uhlenbeck)",
            (Memory(),),
            ("mean-reverting memory",),
            Pull("logit_pull", 0.0, 1.0, centre="mu1"),
            MEAN_REVERSION,
        ),
    ),
    "noise": (
        Level("Weber", "the same noise at every intensity"),
        Level("sloped", "noise that departs from Weber's law", (NOISE_SLOPE,)),
    ),
    "lapses": (
        Level("misses", "equal pairs are sometimes called different", (PEAK,)),
        Level("no lapses", "q0 = 1"),
        Level(
            "both ways",
            "a share of the answers does not depend on the stimuli",
            (PEAK, Single("lapse_rate", Logit(), starts=(-3.0, -0.5))),
            lapsing=Lapsing,
        ),
    ),
    "curve": (
        Level("bell", "2^(-z^2), the paper's"),
        # The peak is 2 Phi(k) - 1 with the criterion k; the width is the noise of the difference.
        Level("differencing", "signal detection: the difference against a criterion", link=DIFFERENCING),
        Level(
            "exponent",
            "2^(-abs(z)^nu) with a free exponent",
            (Single("exponent", Log(), starts=(float(np.log(2.0)), float(np.log(1.2)))),),
            link=EXPONENT,
        ),
    ),
    "peak": (
        Level("one peak", "equal pairs are called equal alike at every intensity"),
        Level(
            "sloped peak",
            "equal pairs are called equal more often at some intensities",
            (PEAK_SLOPE,),
        ),
    ),
    "spread": (
        Level("binomial", "answers are independent"),
        Level(
            "beta-binomial",
            "blocks or days differ: answers to a pair go together",
            (Single("icc", Logit(), starts=(-3.0,)),),
            spread=BETA_BINOMIAL,
        ),
    ),
}
#: Combinations that have a name of their own, and what they say.
NAMED: Mapping[str, tuple[str, str]] = {
    "none": ("symmetric", "no order effect"),
    "constant error": ("constant bias", "the second stimulus is judged with a constant error"),
    "constant error + differencing": ("differencing", "signal detection: the difference against a criterion, with bias"),
    "update + no lapses": ("no lapses", "H1 with q0 = 1"),
    "update": ("predictive update", "H1: memory is updated by a prior and diffuses"),
    "free weighting": ("free weighting", "Hellstrom's sensation weighting: any gain, any constant error"),
    "mean-reverting": ("mean-reverting memory", "memory decays toward the prior mean (Ornstein-Uhlenbeck)"),
}


def compose(**levels: str) -> Model:
    """The model with these levels of parts; of a part that is not named, the paper's level.

    Raises
    ------
    InputError
        If a part or level is unknown, or two exclude each other.

    Examples
    --------
    >>> compose(order="constant error", lapses="both ways").coordinates
    ('offset', 'log_width', 'logit_q0', 'logit_lapse_rate')
    """
    unknown = [part for part in levels if part not in PARTS]
    if unknown:
        raise InputError(f"part {unknown[0]!r}; allowed: {', '.join(PARTS)}")
    chosen = {part: level_named(part, levels[part]) if part in levels else of[0] for part, of in PARTS.items()}
    order, lapses, curve = chosen["order"], chosen["lapses"], chosen["curve"]
    if curve.link is DIFFERENCING and PEAK not in lapses.free:
        raise InputError(f"model '{curve.name} + {lapses.name}': where every equal pair is called equal the criterion has no end")
    if chosen["peak"].free and PEAK not in lapses.free:
        raise InputError(f"model '{chosen['peak'].name} + {lapses.name}': where every equal pair is called equal no peak has a slope")
    departures = [level for part, level in chosen.items() if part == "order" or level is not PARTS[part][0]]
    text = " + ".join(level.name for level in departures)
    name, about = NAMED.get(text, (text, "; ".join(level.about for level in departures)))
    return Model(
        name,
        about,
        tuple(block for part in ("order", "lapses", "noise", "curve", "peak", "spread") for block in chosen[part].free),
        order.pull,
        lapses.lapsing(curve.link),
        chosen["spread"].spread,
        order.propagator,
        tuple((part, level.name) for part, level in chosen.items()),
    )


def level_named(part: str, word: str) -> Level:
    """The level of a part that a word means.

    Raises
    ------
    InputError
        If there is none.
    """
    for level in PARTS[part]:
        if word.casefold() in (known.casefold() for known in (level.name, *level.also)):
            return level
    raise InputError(f"{part}: {word!r}; allowed: {', '.join(level.name for level in PARTS[part])}")


def composition(text: str) -> Model:
    """The model of a text like 'update + sloped + both ways': levels in any order, at most one of each part.

    Raises
    ------
    InputError
        With the words that are allowed, if one is unknown or two are of the same part.

    Examples
    --------
    >>> composition("both ways + none").name, composition("update").name
    ('none + both ways', 'predictive update')
    """
    levels: dict[str, str] = {}
    for word in (part.strip() for part in text.split("+")):
        found = [
            part for part, of in PARTS.items() if word.casefold() in {known.casefold() for one in of for known in (one.name, *one.also)}
        ]
        if not found:
            raise InputError(f"model {text!r}: {word!r}; allowed, joined by +: {allowed_words()}")
        if found[0] in levels:
            raise InputError(f"model {text!r}: {levels[found[0]]!r} and {word!r} are both of the part {found[0]}; allowed is one of them")
        levels[found[0]] = word
    return compose(**levels)


def allowed_words() -> str:
    """The levels of all parts in one line."""
    return "; ".join(f"{part}: {', '.join(level.name for level in levels)}" for part, levels in PARTS.items())


def compositions(**levels: tuple[str, ...]) -> tuple[Model, ...]:
    """Every combination of these levels, the first part varying slowest.

    Examples
    --------
    >>> [model.name for model in compositions(order=("none", "update"), noise=("Weber", "sloped"))]
    ['symmetric', 'none + sloped', 'predictive update', 'update + sloped']
    """
    return tuple(compose(**dict(zip(levels, words, strict=True))) for words in product(*levels.values()))
