"""Synthetic studies: a design, a population of observers, a seed."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from bayes_toe.arrays import BoolArray, FloatArray, IntArray
from bayes_toe.data.study import Study, Subject
from bayes_toe.errors import InputError
from bayes_toe.model.closed_form import equal_probability
from bayes_toe.model.coordinates import Natural
from bayes_toe.model.intervals import equal_probability_at, require_intervals
from bayes_toe.model.prior import Prior
from bayes_toe.model.study_prior import prior_for
from bayes_toe.seeds import generator

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
        if self.s1.shape != self.s2.shape or not len(self.s1) or not np.isfinite([self.s1, self.s2]).all():
            raise InputError("design: s1 and s2 must be finite and have one common length of at least 1")
        if self.batches < 1:
            raise InputError(f"design: batches={self.batches} must be at least 1")
        if self.isi is not None:
            object.__setattr__(self, "isi", np.atleast_1d(require_intervals(self.isi)))
            if self.isi.shape != self.s1.shape:
                raise InputError("design: isi must have the length of s1 and s2")


def reference_design(amplitudes: Iterable[float] = PAPER_AMPLITUDES, batches: int = PAPER_BATCHES) -> Design:
    """The paper's design: every stimulus with itself, and the first with every other one in both orders.

    Parameters
    ----------
    amplitudes : iterable of float
        Positive, in units of the reference; s = ln(amplitude).
    batches : int

    Examples
    --------
    >>> len(reference_design().s1)
    13
    """
    s = _log_amplitudes(amplitudes)
    first = np.full(len(s) - 1, s[0])
    return Design(np.concatenate([s, first, s[1:]]), np.concatenate([s, s[1:], first]), batches)


def full_design(amplitudes: Iterable[float] = PAPER_AMPLITUDES, batches: int = PAPER_BATCHES) -> Design:
    """Every ordered pair of the stimuli, equal pairs included.

    Examples
    --------
    >>> len(full_design([1.0, 1.2]).s1)
    4
    """
    s = _log_amplitudes(amplitudes)
    s1, s2 = np.meshgrid(s, s, indexing="ij")
    return Design(s1.ravel(), s2.ravel(), batches)


def at_intervals(design: Design, isi: Iterable[float]) -> Design:
    """Every pair of a design at every one of these intervals (seconds).

    Raises
    ------
    InputError
        If the design has intervals already, or an interval is repeated, not positive or not finite.

    Examples
    --------
    >>> len(at_intervals(reference_design(), [0.5, 1.0, 2.0]).s1)
    39
    """
    seconds = np.array(list(isi), np.float64)
    if design.isi is not None or not len(seconds) or len(np.unique(seconds)) < len(seconds):
        raise InputError("intervals: allowed is at least one, each once, for a design without intervals of its own")
    times = len(seconds)
    return Design(np.tile(design.s1, times), np.tile(design.s2, times), design.batches, np.repeat(seconds, len(design.s1)))


def _log_amplitudes(amplitudes: Iterable[float]) -> FloatArray:
    values = np.array(list(amplitudes), np.float64)
    if not len(values) or not np.isfinite(values).all() or np.any(values <= 0):
        raise InputError(f"amplitudes must be positive finite numbers, found {values.tolist()}")
    return np.log(values)


def paper_population(size: int, rng: np.random.Generator) -> Natural:
    """Observers of the paper's kinds in turn: A, B, C, B, A, and every sixteenth the paper's inset C.

    A: prior mean below the stimuli, mu1 ~ Normal(-0.5, 0.15); more accurate with the weaker stimulus first.
    B: prior mean above the stimuli, mu1 ~ Normal(0.95, 0.2); more accurate with the stronger first.
    C: prior mean among the stimuli, mu1 ~ Normal(0.25, 0.08); nearly symmetric.
    Inset C of Fig. 4: mu1 = -0.6 but sigma_l = 0.02, so symmetric all the same.
    For all: sigma_p = 0.22 exp(0.15 Normal(0, 1)), gamma ~ Uniform(0.1, 0.5), q0 ~ Beta(40, 4).
    """
    kinds = np.array([(-0.5, 0.15), (0.95, 0.2), (0.25, 0.08), (0.95, 0.2), (-0.5, 0.15)])[np.arange(size) % 5]
    mu1 = rng.normal(kinds[:, 0], kinds[:, 1])
    sigma_p = 0.22 * np.exp(0.15 * rng.standard_normal(size))
    sigma_l = sigma_p * np.sqrt(rng.uniform(0.1, 0.5, size))
    q0 = rng.beta(40.0, 4.0, size)
    inset = np.arange(size) % 16 == 15
    return Natural(np.where(inset, -0.6, mu1), sigma_p, np.where(inset, 0.02, sigma_l), q0)


def prior_population(size: int, rng: np.random.Generator, design: Design, prior: Prior | str | None = None) -> Natural:
    """Observers drawn from the prior under which a study of this design is analysed, the default one where none is given.

    As there (:func:`bayes_toe.model.study_prior.prior_for`), numbers that are the stimuli's are those of the design, and with intervals the
    prior is about sigma_p over the reference interval; the observers' is per square root of a second.
    """
    counts = np.zeros(len(design.s1), np.int64), np.full(len(design.s1), design.batches)
    pairs = Subject.from_counts("design", design.s1, design.s2, *counts, design.isi)
    numbers = prior_for(Study((pairs,), "design", synthetic=True), prior)
    drawn = numbers.sample(rng, size)
    interval = numbers.reference_interval or 1.0  # without intervals there is no unit of time
    return drawn._replace(sigma_p=drawn.sigma_p / np.sqrt(interval))


@dataclass(frozen=True, eq=False)
class Trials:
    """Single trials of one synthetic subject in the order of presentation."""

    subject: str
    batch: IntArray
    s1: FloatArray
    s2: FloatArray
    equal: BoolArray
    isi: FloatArray | None = None


def simulate_trials(names: Iterable[str], observers: Natural, design: Design, seed: int) -> list[Trials]:
    """Answers of every observer; each subject's stream is keyed by its name.

    Parameters
    ----------
    names : iterable of str
        One per observer.
    observers : Natural
        Arrays of shape (observers,).
    design : Design
    seed : int

    Examples
    --------
    >>> one = Natural(*(np.array([v]) for v in (0.0, 0.3, 0.1, 0.9)))
    >>> len(simulate_trials(["S01"], one, reference_design(batches=2), seed=1)[0].equal)
    26
    """
    subjects = list(names)
    if len(subjects) != len(observers.mu1):
        raise InputError(f"{len(subjects)} names for {len(observers.mu1)} observers")
    return [
        _simulate_one(name, Natural(*(values[i] for values in observers)), design, generator(seed, name, "trials"))
        for i, name in enumerate(subjects)
    ]


def _simulate_one(name: str, observer: Natural, design: Design, rng: np.random.Generator) -> Trials:
    order = np.argsort(rng.uniform(size=(design.batches, len(design.s1))), axis=1).ravel()
    s1, s2 = design.s1[order], design.s2[order]
    isi = None if design.isi is None else design.isi[order]
    q = equal_probability(s1, s2, *observer) if isi is None else equal_probability_at(s1, s2, isi, observer)
    batch = np.repeat(np.arange(1, design.batches + 1), len(design.s1))
    return Trials(name, batch, s1, s2, rng.uniform(size=len(q)) < q, isi)
