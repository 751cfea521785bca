"""Assumed observers: whom a study is planned for. From ranges in a file, from draws of an earlier study, or from the prior.

Offsets, and slopes of the noise, count from an intensity that is the observer's own. What is not stated is assumed in relation to the
stimuli that are to be shown, and is the same in all designs that are compared. So nothing here knows zero: with a constant added to every
stimulus observers move along, and a study of ln(rate / 1 Hz) near 3.4 is planned as one of amplitudes near its reference is.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.data.messages import quoted
from bayes_toe.data.study import Study, Subject
from bayes_toe.data.tasks import SAME_DIFFERENT, WHICH_STRONGER, Task
from bayes_toe.errors import InputError
from bayes_toe.experiments.conditions import of_update
from bayes_toe.model.closed_form import MAX_PULL
from bayes_toe.model.coordinates import NATURAL
from bayes_toe.model.ladder import ORDERS, model_named
from bayes_toe.model.parts import compose, parts_of
from bayes_toe.model.posterior import Posterior
from bayes_toe.model.prior import Prior
from bayes_toe.model.prior_fields import real, shown, toml_table
from bayes_toe.model.record import Model
from bayes_toe.model.study_prior import prior_for
from bayes_toe.planning.study_design import StudyDesign, each_once, nobody
from bayes_toe.seeds import generator

#: Kinds of observers by the word for them in files.
NONE, CONSTANT_ERROR, UPDATE = ORDERS
#: Middle of the paper's stimuli, natural-log intensity: from where default offsets count where these are amid those shown.
MIDDLE = 0.25
#: Ranges of those who are assumed where nothing is said, beside those of their task. Pulls and widths are those of clear order effects.
DEFAULT: Mapping[str, Mapping[str, tuple[float, float]]] = {
    NONE: {},
    CONSTANT_ERROR: {"offset": (0.05, 0.15)},
    UPDATE: {"pull": (0.30, 0.38), "offset": (0.0, 0.15)},
}
SHARED: Mapping[Task, Mapping[str, tuple[float, float]]] = {
    SAME_DIFFERENT: {"width": (0.25, 0.35), "q0": (0.85, 0.98)},
    WHICH_STRONGER: {"width": (0.15, 0.30), "lapse_rate": (0.02, 0.10)},
}
_SECOND = 1.0  # reference interval where nothing has intervals, seconds
PRIOR = "prior"  # the source of observers that is no file
MIXED, _SHARE = "mixed", "share"
_FINITE, _POSITIVE, _PART = (
    (-np.inf, np.inf, "finite"),
    (0.0, np.inf, "above 0"),
    (0.0, 1.0, "above 0 and below 1"),
)
_RANGES = {
    "pull": (0.0, MAX_PULL, f"above 0 and below {MAX_PULL:.6f}"),
    **dict.fromkeys(("offset", "mu1", "noise_slope"), _FINITE),
    **dict.fromkeys(("width", _SHARE), _POSITIVE),
    **dict.fromkeys(("q0", "lapse_rate"), _PART),
}
_LINES = "at = NUMBER and sections [none], ['constant error'], [update] of NAME = NUMBER or NAME = [LOWEST, HIGHEST]; share = NUMBER"
_NEVER = 0.01  # probability of an answer below which the other one is practically certain
_NO_LAPSES = 1e-12
#: What helps where nobody ever says 'equal': with observers who are stated, and with those who are assumed amid all designs.
_STATED = "observers stated for such stimuli (at, mu1, offset), or those who are assumed amid them where --observers is left out"
_AMID_ALL = "designs of neighbouring stimuli, amid which these observers are assumed; each of the others by itself"


@dataclass(frozen=True)
class Observer:
    """One assumed observer, of the kind "none", "constant error" or "update"; random streams are keyed by the name, which is unique.

    Answers are given by the rules of the model, which may have more parts than the plain one of the kind, with these quantities. Offset and
    slope of the noise count from the centre (natural-log intensity); the interval (seconds) is that of the quantities.
    """

    name: str
    kind: str
    model: str
    quantities: Mapping[str, float]
    centre: float
    interval: float = _SECOND
    task: Task = SAME_DIFFERENT

    def target(self, pairs: Subject) -> Posterior:
        """The model by which pairs are answered."""
        record = model_named(self.model, self.task)
        assert isinstance(record, Model)  # free frequencies are refused where observers are made
        return Posterior(
            pairs, record, Prior(reference_interval=self.interval), self.centre, self.interval
        )

    def point(self, target: Posterior) -> FloatArray:
        """The observer in the coordinates of the model, shape (1, k)."""
        return target.points({name: np.array([value]) for name, value in self.quantities.items()})

    def p_yes(self, design: StudyDesign) -> FloatArray:
        """Probability of the answer that the task counts, for every pair, shape (pairs,)."""
        target = self.target(design.unanswered)
        return np.asarray(np.exp(target.log_answers(self.point(target))[0][0]))

    def answers(self, design: StudyDesign, rng: np.random.Generator) -> Subject:
        """Simulated counts."""
        target = self.target(design.unanswered)
        x = self.point(target)
        q = np.exp(target.realised_answers(rng, x, target.log_answers(x))[0][0])
        return design.answered(rng.binomial(design.n_trials, q), self.name)


def observers_from(
    source: str | Path | None,
    size: int,
    seed: int,
    *,
    prior: Prior | None = None,
    middle: float = MIDDLE,
    task: Task = SAME_DIFFERENT,
) -> tuple[Observer, ...]:
    """Assumed observers, `size` of each kind that the source has.

    The source is a TOML file of ranges, see :func:`read_ranges`; draws written by `run` or `sample`; 'prior', in numbers; by default
    :data:`DEFAULT` and :data:`SHARED`. Offsets that no file says count from the middle (natural-log intensity), and the prior's reference
    interval is that of all but an earlier study's.

    Examples
    --------
    >>> [one.kind for one in observers_from(None, 2, seed=1)]
    ['none', 'none', 'constant error', 'constant error', 'update', 'update']
    """
    numbers = Prior() if prior is None else prior
    interval = _SECOND if numbers.reference_interval is None else numbers.reference_interval
    if source is None:
        return tuple(
            _in_ranges(
                {kind: {**some, **SHARED[task]} for kind, some in DEFAULT.items()},
                middle,
                interval,
                size,
                seed,
                task,
            )
        )
    if str(source) == PRIOR:
        return tuple(_of_prior(numbers, middle, interval, size, seed, task))
    if Path(source).suffix in (".nc", ".zarr"):  # the latter is refused where it is read
        return tuple(_of_draws(Path(source), size, seed, task))
    if Path(source).suffix == ".toml":
        return tuple(_in_ranges(*read_ranges(source, middle, task), interval, size, seed, task))
    raise InputError(
        f"--observers: found {str(source)!r}, allowed: prior, a .toml file of ranges, or draws (posterior.nc)"
    )


# --- Ranges -----------------------------------------------------------------------------------------


def read_ranges(
    path: str | Path, middle: float = MIDDLE, task: Task = SAME_DIFFERENT
) -> tuple[dict[str, dict[str, tuple[float, float]]], float]:
    """Ranges of each kind from a TOML file, and the intensity from which offsets count, else the middle; observers are uniform.

    A number is a range of one; a file that is not allowed is refused in one line a problem.
    """
    found = dict(toml_table(path, _LINES))
    at, problems = real(found.pop("at", middle)), []
    if not np.isfinite(at):
        problems.append("key at: allowed: a finite number, the intensity from which offsets count")
    if not found:
        problems.append(f"found no kind of observers, allowed: {_LINES}")
    for kind, ranges in found.items():
        problems += _kind_problems(kind, ranges, task)
    shares = [] if problems else [ranges[_SHARE] for ranges in found.values() if _SHARE in ranges]
    if shares and (
        len(shares) < len(found)
        or any(isinstance(one, list) for one in shares)
        or shares.count(max(shares)) > 1
    ):
        problems.append(
            "share: allowed: a number in every section, one of which is the largest, or in none"
        )
    if problems:
        raise InputError([f"{path}: {line}" for line in problems])
    return {
        kind: {name: _range(value) for name, value in ranges.items()}
        for kind, ranges in found.items()
    }, at


def _kind_problems(kind: str, ranges: object, task: Task) -> Iterator[str]:
    if kind not in ORDERS or not isinstance(ranges, Mapping):
        yield f"key {quoted(kind)}: allowed: at, and the sections [{'], ['.join(ORDERS)}]"
        return
    needed = [*DEFAULT[kind], "width", *({task.lapses} - {"lapse_rate"})]
    allowed = {*needed, "noise_slope", "lapse_rate", _SHARE, *(("mu1",) if kind == UPDATE else ())}
    yield from (
        f"[{kind}]: {name} is missing"
        for name in needed
        if name not in ranges and not (name == "offset" and "mu1" in ranges)
    )
    if "mu1" in ranges and "offset" in ranges:
        yield f"[{kind}]: offset and mu1 say the same, allowed: one of them"
    for name, value in ranges.items():
        if name not in allowed:
            yield f"[{kind}]: key {quoted(name)}: unknown, allowed: {', '.join(sorted(allowed))}"
            continue
        low, high = _range(value)
        least, most, said = _RANGES[name]
        if not (least < low <= high < most):
            yield f"[{kind}]: {name}: found {shown(value)}, allowed: a number {said}, or [LOWEST, HIGHEST] of such"


def shares_from(source: str | Path | None, task: Task = SAME_DIFFERENT) -> dict[str, float]:
    """Shares of the kinds in a mixed population, from a TOML file that says them; empty where nothing does."""
    ranges = (
        read_ranges(source, task=task)[0]
        if source is not None and Path(source).suffix == ".toml"
        else {}
    )
    shares = {kind: ranges[kind][_SHARE][0] for kind in ORDERS if _SHARE in ranges.get(kind, {})}
    return {kind: share / sum(shares.values()) for kind, share in shares.items()}


def mixture(shares: Mapping[str, float], size: int, seed: int) -> Iterator[list[tuple[str, int]]]:
    """Studies of so many subjects of a mixed population, without end: kind and number of each, no subject in two studies.

    Examples
    --------
    >>> next(mixture({"none": 0.25, "update": 0.75}, 4, seed=1))
    [('none', 0), ('update', 0), ('none', 1), ('update', 1)]
    """
    rng, met = generator(seed, "mixed studies", size), {kind: count() for kind in shares}
    while True:
        kinds = rng.choice(list(shares), size, p=list(shares.values())).tolist()
        yield [(kind, next(met[kind])) for kind in kinds]


def _range(value: Any) -> tuple[float, float]:
    """Lowest and highest; NaN where a value is neither a number nor two."""
    if isinstance(value, list):
        return (real(value[0]), real(value[1])) if len(value) == 2 else (np.nan, np.nan)
    return real(value), real(value)


def _in_ranges(
    ranges: Mapping[str, Mapping[str, tuple[float, float]]],
    at: float,
    interval: float,
    size: int,
    seed: int,
    task: Task,
) -> Iterator[Observer]:
    for kind in (kind for kind in ORDERS if kind in ranges):
        model = model_of(task, kind, ranges[kind])
        for name in (f"{kind} {number + 1}" for number in range(size)):
            rng = generator(seed, name, "observer")
            values = {
                key: float(rng.uniform(low, high))
                for key, (low, high) in ranges[kind].items()
                if key != _SHARE
            }
            yield Observer(name, kind, model.name, natural_of(values, at, task), at, interval, task)


def model_of(task: Task, kind: str, quantities: Collection[str]) -> Model:
    """That of a kind of observers of whom these are told, beside pull, offset and width."""
    given = {"q0", "lapse_rate"}.intersection(quantities)
    lapses = next(
        level.name
        for level in parts_of(task)["lapses"]
        if {block.names.natural[0] for block in level.free} == given
    )
    return compose(
        task, order=kind, lapses=lapses, noise="sloped" if "noise_slope" in quantities else "Weber"
    )


def natural_of(values: Mapping[str, float], at: float, task: Task) -> dict[str, float]:
    """What a model is written in, from what a file says."""
    rest = dict(values)
    if "pull" not in rest:
        return rest
    told = of_update(rest.pop("offset", 0.0), rest.pop("pull"), rest.pop("width"), at, task)
    return {**dict(zip(NATURAL, map(float, told), strict=False)), **rest}


# --- Prior and draws --------------------------------------------------------------------------------


def _of_prior(
    prior: Prior, middle: float, interval: float, size: int, seed: int, task: Task
) -> Iterator[Observer]:
    for kind in ORDERS:
        model = model_of(task, kind, (task.lapses,))
        target = Posterior(nobody(task), model, prior, middle)
        for name in (f"{kind} {number + 1}" for number in range(size)):
            x = target.sample_prior(generator(seed, name, "observer"), 1)
            yield Observer(
                name, kind, model.name, _needed(target, x, target), middle, interval, task
            )


def _of_draws(path: Path, size: int, seed: int, task: Task) -> Iterator[Observer]:
    """Single draws of subjects taken at random; of those with an order effect also their likes without it, pull or error taken away."""
    from bayes_toe.inference.draws import load_draws

    draws = load_draws(path)
    if draws.task != task:
        raise InputError(
            f"{path}: draws of the task '{draws.task.name}', allowed: those of '{task.name}'"
        )
    record = model_named(draws.model, task)
    if not isinstance(record, Model):
        raise InputError(
            f"{path}: draws of {draws.model!r}, which has no parameters of an observer; allowed: those of another model"
        )
    order, rest = (
        dict(record.levels)["order"],
        {part: word for part, word in record.levels if part != "order"},
    )
    kind = order if order in ORDERS else UPDATE
    for like in ORDERS[: ORDERS.index(kind) + 1]:
        model = compose(task, order=order if like == kind else like, **rest)
        for name in (f"{like} {number + 1}" for number in range(size)):
            rng = generator(seed, name, "observer")
            target = draws.posterior(draws.names[int(rng.integers(len(draws.names)))])
            assert isinstance(target, Posterior)
            points = draws.points(target.subject.name).reshape(-1, len(target.coordinates))
            x = points[[int(rng.integers(len(points)))]]
            kept = Posterior(target.subject, model, target.prior, target.sbar)
            yield Observer(
                name,
                like,
                model.name,
                _needed(target, x, kept),
                target.sbar,
                target.reference,
                task,
            )


def _needed(target: Posterior, x: FloatArray, of: Posterior) -> dict[str, float]:
    """Of a point of the target, (1, k), the quantities that a model with fewer parts, or the same, is written in."""
    found = target.quantities(x)
    return {name: float(found[name][0]) for name in of.names.natural}


def of_kind(observers: Sequence[Observer], kind: str) -> list[Observer]:
    """Those of one kind."""
    return [one for one in observers if one.kind == kind]


# --- Amid what is shown ---------------------------------------------------------------------------


def assumed(
    given: str | Path | Sequence[Observer] | None,
    designs: Mapping[str, StudyDesign],
    size: int,
    seed: int,
    prior: Prior | str | None,
) -> Sequence[Observer]:
    """The observers given, or so many of each kind of a source, the same ones for all designs.

    Refused where all of a kind would practically always answer alike in a design.
    """
    if size < 1:
        raise InputError(f"data_sets={size}: allowed is at least 1")
    people: Sequence[Observer] = () if given is None or isinstance(given, str | Path) else given
    if given is None or isinstance(given, str | Path):
        shown = list(designs.values())
        people = observers_from(
            given,
            size,
            seed,
            prior=prior_of(shown, prior),
            middle=middle_of(shown),
            task=shown[0].task,
        )
    if given != PRIOR:  # of whom some are so
        for name, one in designs.items():
            _require_answers(people, name, one, _AMID_ALL if given is None else _STATED)
    return people


def middle_of(shown: Iterable[StudyDesign]) -> float:
    """From where default offsets count: the middle of all stimuli, or that of the paper's where it lies in the middle half of them.

    So the paper's own numbers stand, and those of wider ranges about it.

    Examples
    --------
    >>> middle_of([StudyDesign([0.0], [0.51], [1])]), middle_of([StudyDesign([4.0], [4.5], [1]), StudyDesign([3.5], [3.5], [1])])
    (0.25, 4.0)
    """
    stimuli = np.concatenate([values for one in shown for values in (one.s1, one.s2)])
    lowest, highest = float(stimuli.min()), float(stimuli.max())
    middle = 0.5 * (lowest + highest)
    return MIDDLE if abs(middle - MIDDLE) <= 0.25 * (highest - lowest) else middle


def prior_of(shown: Sequence[StudyDesign], prior: Prior | str | None) -> Prior:
    """The prior in numbers, for the stimuli and intervals of all designs together; of some without intervals, those of the others."""
    subjects = [replace(one.unanswered, name=str(number)) for number, one in enumerate(shown)]
    timed, rest = (
        [one for one in subjects if (one.isi is not None) == has] for has in (True, False)
    )
    if not (timed and rest):
        return prior_for(Study(tuple(subjects)), prior).at(*subjects)
    untimed = tuple(
        Subject.from_counts(one.name, one.s1, one.s2, one.n_yes, one.n_trials, task=one.task)
        for one in subjects
    )
    interval = prior_for(Study(tuple(timed)), prior).reference_interval
    return replace(prior_for(Study(untimed), prior), reference_interval=interval).at(*untimed)


def _require_answers(
    people: Sequence[Observer], name: str, design: StudyDesign, allowed: str
) -> None:
    """Refuse a design to all pairs of which, and even to identical stimuli, all observers of a kind give one answer, but for lapses."""
    s1, s2, *isi = design.columns
    twice = np.hstack(
        [np.stack([first, second, *isi]) for first, second in ((s1, s2), (s1, s1), (s2, s2))]
    )
    pairs, task = each_once(*np.unique(twice, axis=1), task=design.task), design.task
    for kind in dict.fromkeys(one.kind for one in people):
        known = (
            (
                one,
                {
                    key: _NO_LAPSES if key == "lapse_rate" else value
                    for key, value in one.quantities.items()
                },
            )
            for one in people
        )
        q = np.array(
            [
                replace(one, quantities=values).p_yes(pairs)
                for one, values in known
                if one.kind == kind
            ]
        )
        for answer, highest in ((task.yes, q.max()), (task.no, 1.0 - q.min())):
            if highest <= _NEVER:
                raise InputError(
                    f"observers: with {name}, stimuli from {min(s1.min(), s2.min()):g} to {max(s1.max(), s2.max()):g}, P({answer}) of all "
                    f"observers of the kind '{kind}' is below {_NEVER:g}, even of identical stimuli, and nothing can be told; "
                    f"allowed: {allowed}"
                )
