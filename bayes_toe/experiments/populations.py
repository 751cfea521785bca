"""Whom a synthetic study is of: the paper's kinds of observers, the prior's, or those of a file."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.data.read_study import Truth
from bayes_toe.data.study import Study
from bayes_toe.data.tasks import SAME_DIFFERENT, Task
from bayes_toe.data.validation import read_numbers
from bayes_toe.errors import InputError
from bayes_toe.model.closed_form import require_natural
from bayes_toe.model.coordinates import Natural, natural_names
from bayes_toe.model.ladder import models_of
from bayes_toe.model.prior import Prior
from bayes_toe.model.study_prior import prior_for
from bayes_toe.seeds import generator

if TYPE_CHECKING:
    from bayes_toe.experiments.simulate import Design

#: Those that have a name.
POPULATIONS = ("paper", "prior")


def paper_population(size: int, rng: np.random.Generator, task: Task = SAME_DIFFERENT) -> Natural:
    """Observers of the paper's kinds in turn: A, B, C, B, A, and every sixteenth the paper's inset C.

    A: prior mean below the stimuli, mu1 ~ Normal(-0.5, 0.15); more accurate with the weaker stimulus first.
    B: prior mean above the stimuli, mu1 ~ Normal(0.95, 0.2); more accurate with the stronger first.
    C: prior mean among the stimuli, mu1 ~ Normal(0.25, 0.08); nearly symmetric.
    Inset C of Fig. 4: mu1 = -0.6 but sigma_l = 0.02, so symmetric all the same.
    For all: sigma_p = 0.22 exp(0.15 Normal(0, 1)), gamma ~ Uniform(0.1, 0.5), q0 ~ Beta(40, 4); to 'which is stronger?' the lapse rate,
    in the place of q0, ~ Beta(2, 30).
    """
    kinds = np.array([(-0.5, 0.15), (0.95, 0.2), (0.25, 0.08), (0.95, 0.2), (-0.5, 0.15)])[
        np.arange(size) % 5
    ]
    mu1 = rng.normal(kinds[:, 0], kinds[:, 1])
    sigma_p = 0.22 * np.exp(0.15 * rng.standard_normal(size))
    sigma_l = sigma_p * np.sqrt(rng.uniform(0.1, 0.5, size))
    q0 = rng.beta(40.0, 4.0, size) if task == SAME_DIFFERENT else rng.beta(2.0, 30.0, size)
    inset = np.arange(size) % 16 == 15
    return Natural(np.where(inset, -0.6, mu1), sigma_p, np.where(inset, 0.02, sigma_l), q0)


def prior_population(
    size: int,
    rng: np.random.Generator,
    design: Design,
    prior: Prior | str | None = None,
    task: Task = SAME_DIFFERENT,
) -> Natural:
    """Observers drawn from the prior under which a study of this design is analysed, the default one where none is given.

    As there (:func:`bayes_toe.model.study_prior.prior_for`), numbers that are the stimuli's are those of the design, and with intervals the
    prior is about sigma_p over the reference interval; the observers' is per square root of a second.
    """
    pairs = design.pairs(task)
    numbers = prior_for(Study((pairs,), "design", synthetic=True), prior).at(pairs)
    if task == SAME_DIFFERENT:
        drawn = numbers.sample(rng, size)
    else:
        observer = models_of(task).update.posterior(pairs, numbers)
        found = observer.quantities(observer.sample_prior(rng, size))
        drawn = Natural(*(found[name] for name in natural_names(task)))
    interval = numbers.reference_interval or 1.0  # without intervals there is no unit of time
    return drawn._replace(sigma_p=drawn.sigma_p / np.sqrt(interval))


def population_from(
    population: str,
    size: int,
    seed: int,
    design: Design,
    *,
    prior: Prior | str | None = None,
    task: Task = SAME_DIFFERENT,
) -> tuple[list[str], Natural]:
    """Names and observers that `--population` names; anything but a known word is a CSV with subject and natural parameters.

    A prior may be given with the population 'prior' only, which is drawn from it, as a study of the design has it.
    """
    if prior is not None and population != "prior":
        raise InputError(
            f"--prior: found with --population {population}, allowed: with --population prior, which is drawn from it"
        )
    if population in POPULATIONS:
        rng, names = generator(seed, "population"), subject_names(size)
        return names, prior_population(
            size, rng, design, prior, task
        ) if population == "prior" else paper_population(size, rng, task)
    require_file(population, "--population", POPULATIONS)
    names, columns = read_numbers(population, natural_names(task), key="subject")
    return names, _natural_from([columns[name] for name in natural_names(task)], population, task)


def subject_names(size: int) -> list[str]:
    """S01, S02 and so on, all of one length.

    Examples
    --------
    >>> subject_names(2), subject_names(100)[0]
    (['S01', 'S02'], 'S001')
    """
    width = max(2, len(str(size)))
    return [f"S{i + 1:0{width}d}" for i in range(size)]


def given(observers: Truth, task: Task) -> Natural:
    """Parameters by subject as arrays, shape (observers,)."""
    names = natural_names(task)
    for name, values in observers.items():
        if set(values) != set(names):
            raise InputError(
                f"observer {name!r}: found {', '.join(values)}, allowed: {', '.join(names)}, all four"
            )
    if not observers:
        raise InputError("observers: found none, allowed: at least one")
    return _natural_from(
        [np.array([float(values[key]) for values in observers.values()]) for key in names],
        "observers",
        task,
    )


def _natural_from(columns: Sequence[FloatArray], source: str, task: Task) -> Natural:
    """Observers of these columns, shape (observers,) each; the error of a parameter out of its range names the source."""
    observers = Natural(*columns)
    try:
        require_natural(*observers)
    except ArithmeticError as error:
        raise InputError(f"{source}: {str(error).replace('q0', task.lapses)}") from error
    return observers


def require_file(text: str, option: str, words: Iterable[str]) -> None:
    """Refuse what is neither one of the words nor a file."""
    if not os.path.isfile(text):  # a Path refuses names that are too long with an error of its own
        raise InputError(
            f"{option}: found {text!r}, allowed: {', '.join(words)}, or a CSV file that exists"
        )
