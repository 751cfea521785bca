"""Synthetic studies: a design, a population of observers, a seed."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.special import ndtr

from bayes_toe.arrays import BoolArray, FloatArray, IntArray
from bayes_toe.data.answers import Answers
from bayes_toe.data.conditions import felt_together
from bayes_toe.data.read_study import Truth
from bayes_toe.data.study import Study, Subject
from bayes_toe.data.tasks import SAME_DIFFERENT, Task, task_of
from bayes_toe.data.validation import AT, read_numbers
from bayes_toe.errors import InputError
from bayes_toe.experiments.conditions import Differing
from bayes_toe.experiments.populations import POPULATIONS, given, population_from, require_file
from bayes_toe.model.closed_form import equal_probability, evolved_mean, pull, variance_ratio
from bayes_toe.model.coordinates import Natural, natural_names
from bayes_toe.model.intervals import at_interval, require_intervals
from bayes_toe.model.prior import Prior
from bayes_toe.seeds import generator, root_seed

if TYPE_CHECKING:
    import pandas as pd

#: Amplitudes of the paper's five stimuli in units of the reference (0.087 g). Source: Methods, design of the stimuli.
PAPER_AMPLITUDES = (1.0, 1.15, 1.36, 1.55, 1.66)
#: Answered repetitions of the whole set of pairs by each of the paper's subjects.
PAPER_BATCHES = 50


@dataclass(frozen=True, eq=False)
class Design:
    """Ordered pairs of one batch and the number of batches; the order within a batch is random.

    Parameters
    ----------
    s1, s2 : array_like, shape (pairs,)
        Natural-log intensities.
    batches : int
    isi : array_like, shape (pairs,), optional
        Inter-stimulus intervals, seconds; sigma_p of the observers is then per square root of a second.
    """

    s1: FloatArray
    s2: FloatArray
    batches: int
    isi: FloatArray | None = None

    def __post_init__(self) -> None:
        for key in ("s1", "s2"):
            object.__setattr__(self, key, np.array(getattr(self, key), np.float64, ndmin=1))
        if (
            self.s1.shape != self.s2.shape
            or not len(self.s1)
            or not np.isfinite([self.s1, self.s2]).all()
        ):
            raise InputError(
                "design: s1 and s2 must be finite and have one common length of at least 1"
            )
        if self.batches < 1:
            raise InputError(f"design: batches={self.batches} must be at least 1")
        if self.isi is not None:
            object.__setattr__(self, "isi", np.atleast_1d(require_intervals(self.isi)))
            if self.isi.shape != self.s1.shape:
                raise InputError("design: isi must have the length of s1 and s2")

    def pairs(self, task: Task) -> Subject:
        """The pairs as a subject who never gave the answer that the task counts: for what depends on the pairs alone."""
        counts = np.zeros(len(self.s1), np.int64), np.full(len(self.s1), self.batches)
        return Subject.from_counts("design", self.s1, self.s2, *counts, self.isi, task=task)


def reference_design(
    amplitudes: Iterable[float] = PAPER_AMPLITUDES, batches: int = PAPER_BATCHES
) -> Design:
    """The paper's design: every stimulus with itself, and the first with every other one in both orders.

    Amplitudes are in units of the reference, s = ln(amplitude).
    """
    s = _log_amplitudes(amplitudes)
    first = np.full(len(s) - 1, s[0])
    return Design(np.concatenate([s, first, s[1:]]), np.concatenate([s, s[1:], first]), batches)


def full_design(
    amplitudes: Iterable[float] = PAPER_AMPLITUDES, batches: int = PAPER_BATCHES
) -> Design:
    """Every ordered pair of the stimuli, equal pairs included."""
    s1, s2 = np.meshgrid(*2 * [_log_amplitudes(amplitudes)], indexing="ij")
    return Design(s1.ravel(), s2.ravel(), batches)


def at_intervals(design: Design, isi: Iterable[float]) -> Design:
    """Every pair of a design at every one of these intervals (seconds), each once."""
    seconds = np.array(list(isi), np.float64)
    if design.isi is not None or not len(seconds) or len(np.unique(seconds)) < len(seconds):
        raise InputError(
            "intervals: allowed is at least one, each once, for a design without intervals of its own"
        )
    times = len(seconds)
    return Design(
        np.tile(design.s1, times),
        np.tile(design.s2, times),
        design.batches,
        np.repeat(seconds, len(design.s1)),
    )


def _log_amplitudes(amplitudes: Iterable[float]) -> FloatArray:
    values = np.array(list(amplitudes), np.float64)
    if not len(values) or not np.isfinite(values).all() or np.any(values <= 0):
        raise InputError(f"amplitudes must be positive finite numbers, found {values.tolist()}")
    return np.log(values)


_DESIGNS = {"reference": reference_design, "full": full_design}


@dataclass(frozen=True, eq=False)
class Trials:
    """Single trials of one synthetic subject in the order of presentation; where `missed` nobody answered in time.

    The observer's parameters have the shape (); of a subject under several conditions the trials are those of one, as is the name.
    """

    subject: str
    observer: Natural
    batch: IntArray
    s1: FloatArray
    s2: FloatArray
    yes: BoolArray
    missed: BoolArray
    isi: FloatArray | None = None
    task: Task = SAME_DIFFERENT
    condition: str = ""

    @property
    def truth(self) -> dict[str, float]:
        """The natural parameters by name."""
        return {
            name: float(value)
            for name, value in zip(natural_names(self.task), self.observer, strict=True)
        }

    @property
    def answered(self) -> Subject:
        """The subject with these answers, in their order."""
        keys = np.column_stack([key for key in (self.s1, self.s2, self.isi) if key is not None])
        counts = np.where(self.yes & ~self.missed, 1, 0), np.where(self.missed, 0, 1)
        answers = Answers(keys, *counts, None, (), True, np.arange(len(self.yes)))
        return replace(
            Subject.from_answers(self.subject, answers, self.task), condition=self.condition
        )


def simulate_trials(
    names: Iterable[str],
    observers: Natural,
    design: Design,
    seed: int,
    task: Task = SAME_DIFFERENT,
    *,
    carried: float = 0.0,
    missed: float = 0.0,
    differing: Differing | None = None,
) -> list[Trials]:
    """Answers of every observer, in every condition where there are some; each stream is keyed by the name, of units such as S01@left.

    Parameters of observers have the shape (observers,); to 'which is stronger?' the lapse rate is in the place of q0. `carried` is the
    share of what is expected after a trial that is carried over to the next (0: all has relaxed), `missed`
    that of trials that nobody answers in time.
    """
    subjects = list(names)
    for option, value in (("--carry-over", carried), ("--missed", missed)):
        if not 0.0 <= value < 1.0:
            raise InputError(f"{option}: found {value:g}, allowed: a number from 0 to below 1")
    if len(subjects) != len(observers.mu1):
        raise InputError(f"{len(subjects)} names for {len(observers.mu1)} observers")
    made, shown = (
        list[Trials](),
        partial(_trials, design=design, seed=seed, task=task, carried=carried, missed=missed),
    )
    for i, name in enumerate(subjects):
        observer = Natural(*(values[i] for values in observers))
        if differing is None:
            made.append(shown(name, observer))
        else:
            units = zip(
                differing.conditions.levels,
                *differing.observers(design.pairs(task), name, observer, seed),
                strict=True,
            )
            made += [
                replace(shown(f"{name}{AT}{level}", Natural(*values)), condition=level)
                for level, *values in units
            ]
    return made


def _trials(
    name: str,
    observer: Natural,
    design: Design,
    seed: int,
    task: Task,
    carried: float,
    missed: float,
) -> Trials:
    """Those of one observer."""
    rng = generator(seed, name, "trials")
    order = np.argsort(rng.uniform(size=(design.batches, len(design.s1))), axis=1).ravel()
    s1, s2 = design.s1[order], design.s2[order]
    isi = None if design.isi is None else design.isi[order]
    felt = observer if isi is None else at_interval(observer, isi)
    if carried:
        felt = felt._replace(mu1=felt.mu1 + _carried_over(s1, s2, felt, carried))
    if task == SAME_DIFFERENT:
        q = equal_probability(s1, s2, *felt)
    else:  # half the lapse rate, and else Phi((s2 - mu_2) / (G sigma_p))
        away = s2 - evolved_mean(s1, felt.mu1, felt.gamma)
        q = 0.5 * felt.q0 + (1.0 - felt.q0) * ndtr(
            away / (variance_ratio(felt.gamma) * felt.sigma_p)
        )
    batch = np.repeat(np.arange(1, design.batches + 1), len(design.s1))
    yes = rng.uniform(size=len(q)) < q
    return Trials(name, observer, batch, s1, s2, yes, rng.uniform(size=len(q)) < missed, isi, task)


def _carried_over(s1: FloatArray, s2: FloatArray, observer: Natural, share: float) -> FloatArray:
    """By how much the expectation of every trial is off mu1: the belief after the one before, of which a share is left."""
    middle, p = 0.5 * (s1.mean() + s2.mean()), np.broadcast_to(pull(observer.gamma), s1.shape)
    expected = np.zeros(len(s1))
    for t in range(len(s1) - 1):
        memory = (1.0 - p[t]) * (s1[t] - middle) + p[t] * expected[t]
        expected[t + 1] = share * ((1.0 - p[t]) * (s2[t] - middle) + p[t] * memory)
    return expected


class Simulated(NamedTuple):
    """A synthetic study, and the natural parameters by subject that made it; with intervals sigma_p is per square root of a second."""

    study: Study
    truth: Truth


def simulate(  # noqa: PLR0913  # each is a choice of its own, and has a default
    observers: int | Truth = 16,
    *,
    population: str = "paper",
    design: str | Design = "reference",
    amplitudes: Sequence[float] = PAPER_AMPLITUDES,
    batches: int = PAPER_BATCHES,
    isi: Sequence[float] | None = None,
    prior: Prior | str | None = None,
    seed: int | None = None,
    task: Task | str = SAME_DIFFERENT,
    carry_over: float = 0.0,
    missed: float = 0.0,
    conditions: Sequence[str] = (),
    differ: Mapping[str, float | tuple[float, float]] | None = None,
) -> Simulated:
    """Answers of observers who follow the model: what `bayes-toe simulate` writes, as a study.

    Parameters
    ----------
    observers : int or mapping
        How many, drawn from the population; or by name the parameters mu1, sigma_p, sigma_l (natural-log intensity) and q0 of each, to
        'which is stronger?' lapse_rate in the place of q0.
    population : {"paper", "prior"}
        Where observers are drawn from, see :func:`paper_population` and :func:`prior_population`.
    design : {"reference", "full"} or Design
        The paper's pairs, all ordered pairs of the amplitudes, or pairs of your own with their batches.
    amplitudes : sequence of float
        Stimuli in units of the reference, weakest first.
    batches : int
        Repetitions of the whole set of pairs.
    isi : sequence of float, optional
        Inter-stimulus intervals, seconds: every pair at each; sigma_p of the observers is then per square root of a second, where that
        of an analysis is over its reference interval.
    prior : Prior or str, optional
        Of the population "prior", as :func:`~bayes_toe.model.study_prior.prior_for` takes it: with intervals, too, observers are drawn
        from the prior under which their study is analysed.
    seed : int, optional
        Root seed; without one, fresh entropy.
    task : Task or str
        "same/different", or "2afc": which of the two is stronger.
    carry_over, missed : float
        Share of what is expected after a trial that is carried over to the next; share of trials without an answer.
    conditions : sequence of str
        Levels of a condition within subjects, each of whom meets all pairs under each; the truth is then that of units such as 'S01@left'.
    differ : mapping, optional
        Of "constant error" (natural-log intensity), "pull" (its probit), "width" (its log) the difference between the first and the last
        of the conditions, or with it the sd between subjects: {"pull": (0.5, 0.15)}.

    Raises
    ------
    InputError
        For an unknown word, or a number that is not allowed.

    Examples
    --------
    >>> study, truth = simulate(2, batches=10, seed=1)
    >>> study
    <Study 'simulated, seed 1', synthetic: 2 subjects ('S01', 'S02'), 260 trials>
    >>> simulate({"A": {"mu1": -0.7, "sigma_p": 0.2, "sigma_l": 0.1, "q0": 0.95}}, batches=5).study.names
    ('A',)
    """
    asked, root = task_of(task), root_seed(seed)
    planned = design_from(design, amplitudes, batches, isi)
    if differ is not None and not conditions:
        raise InputError("differ: allowed with conditions, between which observers differ")
    differing = Differing.of(conditions, differ) if conditions else None
    if isinstance(observers, Mapping):
        names, natural = list(observers), given(observers, asked)
    elif isinstance(observers, bool) or not isinstance(observers, int) or observers < 1:
        raise InputError(
            f"observers: found {observers!r}, allowed: a whole number from 1, or parameters by name"
        )
    elif population not in POPULATIONS:
        raise InputError(
            f"population: found {population!r}, allowed: paper, prior; parameters of your own go to `observers`"
        )
    else:
        names, natural = population_from(
            population, observers, root, planned, prior=prior, task=asked
        )
    trials = simulate_trials(
        names, natural, planned, root, asked, carried=carry_over, missed=missed, differing=differing
    )
    truth = {
        one.subject: one.truth | ({"carry_over": carry_over} if carry_over else {})
        for one in trials
    }
    study = Study(tuple(one.answered for one in trials), f"simulated, seed {root}", synthetic=True)
    if differing is not None:
        study = replace(study, subjects=felt_together(study), conditions=differing.conditions)
    return Simulated(study, truth)


# --- what the command is told in words and files ------------------------------------------------------------------------------------


def design_from(
    design: str | Design,
    amplitudes: str | Sequence[float],
    batches: int,
    isi: str | Sequence[float] | None = None,
) -> Design:
    """The design that `--design`, `--amplitudes` and `--isi` name; anything but a known word is a CSV with columns s1,s2 (and isi)."""
    if isinstance(design, Design):
        made = design
    elif design in _DESIGNS:
        made = _DESIGNS[design](_numbers("--amplitudes", amplitudes), batches)
    else:
        require_file(design, "--design", _DESIGNS)
        columns = read_numbers(design, ("s1", "s2"), optional=("isi",))[1]
        made = Design(columns["s1"], columns["s2"], batches, columns.get("isi"))
    return made if isi is None else at_intervals(made, _numbers("--isi", isi))


def trial_frame(trials: Sequence[Trials]) -> pd.DataFrame:
    """Trials as a table that `bayes-toe` reads, conditions in turn batch by batch; the column `synthetic` marks them for good."""
    import pandas as pd

    parts = [
        {
            "subject": one.subject.removesuffix(f"{AT}{one.condition}" if one.condition else ""),
            **({"condition": one.condition} if one.condition else {}),
            "batch": one.batch,
            "trial": 0,
            "s1": one.s1,
            "s2": one.s2,
            **({} if one.isi is None else {"isi": one.isi}),
            "response": np.where(one.missed, "", np.where(one.yes, one.task.yes, one.task.no)),
            "synthetic": 1,
        }
        for one in trials
    ]
    frame = pd.concat([pd.DataFrame(part) for part in parts], ignore_index=True)
    if trials[0].condition:
        people = pd.factorize(frame["subject"])[0]
        frame = frame.iloc[np.lexsort([frame["batch"].to_numpy(), people])].reset_index(drop=True)
    return frame.assign(trial=frame.groupby("subject", sort=False).cumcount() + 1)


def truth_frame(trials: Sequence[Trials]) -> pd.DataFrame:
    """True natural parameters, one row a subject, or a subject in a condition."""
    import pandas as pd

    return pd.DataFrame([{"subject": one.subject} | one.truth for one in trials])


def _numbers(option: str, given: str | Sequence[float]) -> list[float]:
    try:
        return [float(part) for part in (given.split(",") if isinstance(given, str) else given)]
    except ValueError:
        raise InputError(
            f"{option}: found {given!r}, allowed: positive numbers separated by commas"
        ) from None
