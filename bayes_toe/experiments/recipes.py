"""What `simulate` was asked for in words or files, turned into a design and a population, and its tables."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.data.validation import read_numbers
from bayes_toe.errors import InputError
from bayes_toe.experiments.simulate import Design, Trials, at_intervals, full_design, paper_population, prior_population, reference_design
from bayes_toe.model.closed_form import require_natural
from bayes_toe.model.coordinates import NATURAL, Natural
from bayes_toe.model.prior import Prior
from bayes_toe.seeds import generator

if TYPE_CHECKING:
    import pandas as pd

_DESIGNS = {"reference": reference_design, "full": full_design}
_POPULATIONS = ("paper", "prior")


def design_from(design: str, amplitudes: str, batches: int, isi: str | None = None) -> Design:
    """The design that `--design`, `--amplitudes` and `--isi` name; anything but a known word is a CSV with columns s1,s2 (and isi).

    Examples
    --------
    >>> len(design_from("full", "1,1.2,1.5", 2).s1)
    9
    """
    numbers = _numbers("--amplitudes", amplitudes) if design in _DESIGNS else ()
    chosen = design_named(design, numbers, batches)
    return chosen if isi is None else at_intervals(chosen, _numbers("--isi", isi))


def design_named(design: str, amplitudes: Sequence[float], batches: int) -> Design:
    """The same of numbers, without further intervals; amplitudes are those of a known word."""
    if design in _DESIGNS:
        return _DESIGNS[design](amplitudes, batches)
    _require_file(design, "--design", _DESIGNS)
    columns = read_numbers(design, ("s1", "s2"), optional=("isi",))[1]
    return Design(columns["s1"], columns["s2"], batches, columns.get("isi"))


def subject_names(size: int) -> list[str]:
    """S01, S02 and so on, all of one length.

    Examples
    --------
    >>> subject_names(2), subject_names(100)[0]
    (['S01', 'S02'], 'S001')
    """
    width = max(2, len(str(size)))
    return [f"S{i + 1:0{width}d}" for i in range(size)]


def natural_from(columns: Mapping[str, FloatArray], source: str) -> Natural:
    """Observers of these columns, shape (observers,) each.

    Raises
    ------
    InputError
        That names the source, where a parameter is out of its range.
    """
    observers = Natural(*(columns[name] for name in NATURAL))
    try:
        require_natural(*observers)
    except ArithmeticError as error:
        raise InputError(f"{source}: {error}") from error
    return observers


def population_from(
    population: str, size: int, seed: int, design: Design, *, prior: Prior | str | None = None
) -> tuple[list[str], Natural]:
    """Names and observers that `--population` names; anything but a known word is a CSV with subject and natural parameters.

    A prior may be given with the population 'prior' only, which is drawn from it, as a study of the design has it.
    """
    if prior is not None and population != "prior":
        raise InputError(f"--prior: found with --population {population}, allowed: with --population prior, which is drawn from it")
    if population in _POPULATIONS:
        rng, names = generator(seed, "population"), subject_names(size)
        return names, prior_population(size, rng, design, prior) if population == "prior" else paper_population(size, rng)
    _require_file(population, "--population", _POPULATIONS)
    names, columns = read_numbers(population, NATURAL, key="subject")
    return names, natural_from(columns, population)


def trial_frame(trials: Sequence[Trials]) -> pd.DataFrame:
    """Trials as a table that `bayes-toe` reads; the column `synthetic` marks them for good."""
    import pandas as pd

    parts = [
        pd.DataFrame(
            {
                "subject": one.subject,
                "batch": one.batch,
                "trial": np.arange(1, len(one.equal) + 1),
                "s1": one.s1,
                "s2": one.s2,
                **({} if one.isi is None else {"isi": one.isi}),
                "response": np.where(one.equal, "equal", "different"),
                "synthetic": 1,
            }
        )
        for one in trials
    ]
    return pd.concat(parts, ignore_index=True)


def truth_frame(names: Sequence[str], observers: Natural) -> pd.DataFrame:
    """True natural parameters, one row a subject."""
    import pandas as pd

    return pd.DataFrame({"subject": list(names), **observers._asdict()})


def _numbers(option: str, text: str) -> list[float]:
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise InputError(f"{option}: found {text!r}, allowed: positive numbers separated by commas") from None


def _require_file(text: str, option: str, words: Iterable[str]) -> None:
    if not os.path.isfile(text):  # a Path refuses names that are too long with an error of its own
        raise InputError(f"{option}: found {text!r}, allowed: {', '.join(words)}, or a CSV file that exists")
