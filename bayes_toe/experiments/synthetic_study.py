"""A synthetic study in one call: who answers, which pairs, and the study that their answers make."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from bayes_toe.data.read_study import Truth
from bayes_toe.data.study import Study, Subject
from bayes_toe.errors import InputError
from bayes_toe.experiments.recipes import design_named, natural_from, population_from
from bayes_toe.experiments.simulate import PAPER_AMPLITUDES, PAPER_BATCHES, Design, at_intervals, simulate_trials
from bayes_toe.model.coordinates import NATURAL, Natural
from bayes_toe.model.prior import Prior
from bayes_toe.seeds import root_seed


class Simulated(NamedTuple):
    """A synthetic study, and the natural parameters by subject that made it; with intervals sigma_p is per square root of a second."""

    study: Study
    truth: Truth


def simulate(
    observers: int | Truth = 16,
    *,
    population: str = "paper",
    design: str | Design = "reference",
    amplitudes: Sequence[float] = PAPER_AMPLITUDES,
    batches: int = PAPER_BATCHES,
    isi: Sequence[float] | None = None,
    prior: Prior | str | None = None,
    seed: int | None = None,
) -> Simulated:
    """Answers of observers who follow the model: what `bayes-toe simulate` writes, as a study.

    Parameters
    ----------
    observers : int or mapping
        How many, drawn from the population; or by name the parameters mu1, sigma_p, sigma_l (natural-log intensity) and q0 of each.
    population : {"paper", "prior"}
        Where observers are drawn from, see :mod:`bayes_toe.experiments.simulate`.
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
    root, planned = root_seed(seed), _design(design, amplitudes, batches, isi)
    if isinstance(observers, Mapping):
        names, natural = list(observers), _given(observers)
    else:
        names, natural = population_from(_word(population), _whole(observers), root, planned, prior=prior)
    subjects = [
        Subject.from_trials(one.subject, one.s1, one.s2, one.equal, one.isi) for one in simulate_trials(names, natural, planned, root)
    ]
    truth = {name: {key: float(values[i]) for key, values in natural._asdict().items()} for i, name in enumerate(names)}
    return Simulated(Study(tuple(subjects), f"simulated, seed {root}", synthetic=True), truth)


def _design(design: str | Design, amplitudes: Sequence[float], batches: int, isi: Sequence[float] | None) -> Design:
    chosen = design if isinstance(design, Design) else design_named(design, amplitudes, batches)
    return chosen if isi is None else at_intervals(chosen, isi)


def _given(observers: Truth) -> Natural:
    """Parameters by subject as arrays, shape (observers,)."""
    for name, values in observers.items():
        if set(values) != set(NATURAL):
            raise InputError(f"observer {name!r}: found {', '.join(values)}, allowed: {', '.join(NATURAL)}, all four")
    if not observers:
        raise InputError("observers: found none, allowed: at least one")
    return natural_from({key: np.array([float(values[key]) for values in observers.values()]) for key in NATURAL}, "observers")


def _whole(observers: int) -> int:
    if isinstance(observers, bool) or not isinstance(observers, int) or observers < 1:
        raise InputError(f"observers: found {observers!r}, allowed: a whole number from 1, or parameters by name")
    return observers


def _word(population: str) -> str:
    if population not in ("paper", "prior"):
        raise InputError(f"population: found {population!r}, allowed: paper, prior; parameters of your own go to `observers`")
    return population
