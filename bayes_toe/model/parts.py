"""A model is a composition of parts, each at one of its levels: order, noise, lapses, curve, peak, spread.

P(equal) = f + (q0 - f) psi(z), f = lambda q0, or P(second) = lambda g + (1 - lambda) F(z), with z = ((s2 - s1) - c + p (s1 - sbar)) /
w(s1, s2). The order part says what the first stimulus becomes (c, p), the noise part how the width depends on the stimuli, the lapses which
answers do not depend on them (q0, lambda, g), the curve is psi or F, the peak how q0 depends on the stimuli, the spread says how counts
scatter. Each level is a declaration; every combination of levels of one
task is a model, and nothing else knows parts by name.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, partial
from itertools import product

import numpy as np

from bayes_toe.data.tasks import SAME_DIFFERENT, TASKS, WHICH_STRONGER, Task
from bayes_toe.errors import InputError
from bayes_toe.model.blocks import (
    NOISE_SLOPE,
    OFFSET,
    PEAK_SLOPE,
    WIDTH,
    Log,
    Logit,
    Single,
)
from bayes_toe.model.closed_form import MAX_PULL
from bayes_toe.model.distributions import Uniform
from bayes_toe.model.intervals import (
    OF_EQUAL,
    OF_SECOND,
    CurveScale,
    Propagator,
    mean_reversion,
    random_walk,
)
from bayes_toe.model.links import BELL, DIFFERENCING, EXPONENT, LOGISTIC, PROBIT, Lapsing, Link
from bayes_toe.model.memory import Block, Memory, Update
from bayes_toe.model.record import Model, Pull
from bayes_toe.model.spread import BETA_BINOMIAL, BINOMIAL, Spread

#: q0, or the peak of the differencing model.
PEAK = Single("q0", Logit())
#: Share by which the first stimulus is drawn to the middle of them.
CONTRACTION = Single("pull", Logit(), fixed=Uniform(1.0), starts=(-1.5, 0.5))
#: Weight of the first stimulus, from none to twice that of the second, around "no effect" at 1 without preference.
GAIN = Single("gain", Logit(2.0), fixed=Uniform(2.0), starts=(-0.8, 0.4))
#: Share of answers given without regard to the stimuli.
LAPSE_RATE = Single("lapse_rate", Logit(), starts=(-3.0, -0.5))
#: What the width of each task's curve is.
CURVE_SCALES: Mapping[Task, CurveScale] = {SAME_DIFFERENT: OF_EQUAL, WHICH_STRONGER: OF_SECOND}


@dataclass(frozen=True)
class Level:
    """What one level of a part adds to a model.

    It has a name, unique among the levels of all parts of a task, and other words that are understood (`also`), brings free parameters and
    sets pull, propagator, link and spread of the :class:`bayes_toe.model.record.Model`; `lapsing` is what lapses make of the
    curve's link, and `task` the only one that has it.
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
    task: Task | None = None

    @property
    def words(self) -> frozenset[str]:
        """Those for it, in lower case."""
        return frozenset(word.casefold() for word in (self.name, *self.also))


#: Levels of every part; the first one of each that a task has is its default, which a text form need not name: of 'same or different' the
#: paper's.
PARTS: Mapping[str, tuple[Level, ...]] = {
    "order": (
        *(
            Level(
                "update",
                "memory is updated by a prior and diffuses",
                (Update(scale),),
                ("predictive update",),
                Pull("logit_pull", 0.0, MAX_PULL, centre="mu1"),
                random_walk(scale),
                task=task,
            )
            for task, scale in CURVE_SCALES.items()
        ),
        Level("none", "no order effect", (WIDTH,), ("symmetric",)),
        Level(
            "constant error",
            "the second stimulus is judged with a constant error",
            (OFFSET, WIDTH),
            ("constant bias",),
        ),
        Level(
            "free weighting",
            "Hellstrom's sensation weighting: any gain, any constant error",
            (OFFSET, GAIN, WIDTH),
            pull=Pull("logit_gain", 1.0, -2.0),  # p = 1 - K, K = 2 expit
        ),
        *(
            Level(
                "mean-reverting",
                "memory decays toward the prior mean (Ornstein-Uhlenbeck)",
                (Memory(scale),),
                ("mean-reverting memory",),
                Pull("logit_pull", 0.0, 1.0, centre="mu1"),
                mean_reversion(scale),
                task=task,
            )
            for task, scale in CURVE_SCALES.items()
        ),
        Level(
            "contraction",
            "memory is drawn to the middle of the stimuli, with a constant error",
            (OFFSET, CONTRACTION, WIDTH),
            pull=Pull("logit_pull", 0.0, 1.0),
        ),
    ),
    "noise": (
        Level("Weber", "the same noise at every intensity"),
        Level("sloped", "noise that departs from Weber's law", (NOISE_SLOPE,)),
    ),
    "lapses": (
        Level("misses", "equal pairs are sometimes called different", (PEAK,), task=SAME_DIFFERENT),
        Level(
            "guesses",
            "a share of the answers is guessed, either one as often",
            (LAPSE_RATE,),
            lapsing=Lapsing,
            task=WHICH_STRONGER,
        ),
        Level("no lapses", "every answer depends on the stimuli"),
        Level(
            "both ways",
            "a share of the answers does not depend on the stimuli",
            (PEAK, LAPSE_RATE),
            lapsing=partial(Lapsing, guess="logit_q0"),
            task=SAME_DIFFERENT,
        ),
        Level(
            "biased guesses",
            "a share of the answers is guessed, one more often than the other",
            (Single("guess_second", Logit(), fixed=Uniform(1.0), starts=(0.0,)), LAPSE_RATE),
            lapsing=partial(Lapsing, guess="logit_guess_second"),
            task=WHICH_STRONGER,
        ),
    ),
    "curve": (
        Level("bell", "2^(-z^2), the paper's", task=SAME_DIFFERENT),
        Level(
            "probit", "the second stimulus as memory predicts it", link=PROBIT, task=WHICH_STRONGER
        ),
        Level("logit", "a logistic curve, with heavier tails", link=LOGISTIC, task=WHICH_STRONGER),
        # The peak is 2 Phi(k) - 1 with the criterion k; the width is the noise of the difference.
        Level(
            "differencing",
            "signal detection: the difference against a criterion",
            link=DIFFERENCING,
            task=SAME_DIFFERENT,
        ),
        Level(
            "exponent",
            "2^(-abs(z)^nu) with a free exponent",
            (Single("exponent", Log(), starts=(float(np.log(2.0)), float(np.log(1.2)))),),
            link=EXPONENT,
            task=SAME_DIFFERENT,
        ),
    ),
    "peak": (
        Level(
            "one peak", "equal pairs are called equal alike at every intensity", task=SAME_DIFFERENT
        ),
        Level(
            "sloped peak",
            "equal pairs are called equal more often at some intensities",
            (PEAK_SLOPE,),
            task=SAME_DIFFERENT,
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
#: The parts in the order in which their parameters are a model's.
_WRITTEN = ("order", "lapses", "noise", "curve", "peak", "spread")
#: Combinations that have a name of their own, and what they say.
NAMED: Mapping[str, tuple[str, str]] = {
    "none": ("symmetric", "no order effect"),
    "constant error": ("constant bias", "the second stimulus is judged with a constant error"),
    "constant error + differencing": (
        "differencing",
        "signal detection: the difference against a criterion, with bias",
    ),
    "update + no lapses": ("no lapses", "H1 without lapses"),
    "update": ("predictive update", "H1: memory is updated by a prior and diffuses"),
    "free weighting": (
        "free weighting",
        "Hellstrom's sensation weighting: any gain, any constant error",
    ),
    "mean-reverting": (
        "mean-reverting memory",
        "memory decays toward the prior mean (Ornstein-Uhlenbeck)",
    ),
}


@cache
def parts_of(task: Task) -> Mapping[str, tuple[Level, ...]]:
    """The parts that a task has, and their levels.

    Examples
    --------
    >>> [level.name for level in parts_of(WHICH_STRONGER)["lapses"]], "peak" in parts_of(WHICH_STRONGER)
    (['guesses', 'no lapses', 'biased guesses'], False)
    """
    found = {
        part: tuple(level for level in levels if level.task in (None, task))
        for part, levels in PARTS.items()
    }
    return {part: levels for part, levels in found.items() if levels}


def compose(task: Task = SAME_DIFFERENT, **levels: str) -> Model:
    """The model with these levels of parts; of a part that is not named, the task's default.

    Examples
    --------
    >>> compose(order="constant error", lapses="both ways").coordinates
    ('offset', 'log_width', 'logit_q0', 'logit_lapse_rate')
    >>> compose(WHICH_STRONGER, order="constant error").coordinates
    ('offset', 'log_width', 'logit_lapse_rate')
    """
    parts = parts_of(task)
    unknown = [part for part in levels if part not in parts]
    if unknown:
        raise InputError(f"part {unknown[0]!r}; allowed: {', '.join(parts)}")
    chosen = {
        part: level_named(part, levels[part], task) if part in levels else of[0]
        for part, of in parts.items()
    }
    order, lapses, curve = chosen["order"], chosen["lapses"], chosen["curve"]
    free = tuple(block for part in _WRITTEN if part in chosen for block in chosen[part].free)
    if curve.link is DIFFERENCING and PEAK not in free:
        raise InputError(
            f"model '{curve.name} + {lapses.name}': where every equal pair is called equal the criterion has no end"
        )
    if PEAK_SLOPE in free and PEAK not in free:
        raise InputError(
            f"model '{chosen['peak'].name} + {lapses.name}': where every equal pair is called equal no peak has a slope"
        )
    departures = [
        level for part, level in chosen.items() if part == "order" or level is not parts[part][0]
    ]
    text = " + ".join(level.name for level in departures)
    name, about = NAMED.get(text, (text, "; ".join(level.about for level in departures)))
    return Model(
        name,
        about,
        free,
        order.pull,
        lapses.lapsing(curve.link),
        chosen["spread"].spread,
        order.propagator,
        tuple((part, level.name) for part, level in chosen.items()),
        task,
    )


def level_named(part: str, word: str, task: Task = SAME_DIFFERENT) -> Level:
    """The level of a part that a word means."""
    for level in parts_of(task)[part]:
        if word.casefold() in level.words:
            return level
    raise InputError(
        f"{part}: {word!r}; allowed: {', '.join(level.name for level in parts_of(task)[part])}"
    )


def composition(text: str, task: Task = SAME_DIFFERENT) -> Model:
    """The model of a text like 'update + sloped + both ways': levels in any order, at most one of each part.

    Examples
    --------
    >>> composition("both ways + none").name, composition("update").name
    ('none + both ways', 'predictive update')
    """
    levels: dict[str, str] = {}
    for word in (part.strip() for part in text.split("+")):
        known = {
            of: [
                part
                for part, some in parts_of(of).items()
                if any(word.casefold() in one.words for one in some)
            ]
            for of in TASKS
        }
        others = [of.name for of, parts in known.items() if parts]
        if not known[task]:
            found = (
                f"{word!r} is of the task '{others[0]}', and asked was '{task.name}'"
                if others
                else repr(word)
            )
            raise InputError(
                f"model {text!r}: {found}; allowed, joined by +: {allowed_words(task)}"
            )
        part = known[task][0]
        if part in levels:
            raise InputError(
                f"model {text!r}: {levels[part]!r} and {word!r} are both of the part {part}; allowed is one of them"
            )
        levels[part] = word
    return compose(task, **levels)


def allowed_words(task: Task = SAME_DIFFERENT) -> str:
    """The levels of all parts in one line."""
    return "; ".join(
        f"{part}: {', '.join(level.name for level in levels)}"
        for part, levels in parts_of(task).items()
    )


def compositions(task: Task = SAME_DIFFERENT, **levels: tuple[str, ...]) -> tuple[Model, ...]:
    """Every combination of these levels, the first part varying slowest.

    Examples
    --------
    >>> [model.name for model in compositions(order=("none", "update"), noise=("Weber", "sloped"))]
    ['symmetric', 'none + sloped', 'predictive update', 'update + sloped']
    """
    return tuple(
        compose(task, **dict(zip(levels, words, strict=True)))
        for words in product(*levels.values())
    )
