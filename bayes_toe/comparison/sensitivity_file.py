"""sensitivity.csv and sensitivity_parts.csv read back, beside the draws that they belong to."""

from __future__ import annotations

from dataclasses import replace
from math import isnan
from pathlib import Path

import numpy as np

from bayes_toe.comparison.parts_sensitivity import PartsRow, PartsSensitivity
from bayes_toe.comparison.parts_table import STUDY
from bayes_toe.comparison.prior_sensitivity import QUANTILES, SUMMARISED, SensitivityRow, SensitivityTable
from bayes_toe.data.messages import bare, quoted
from bayes_toe.data.validation import read_rows
from bayes_toe.errors import InputError
from bayes_toe.inference.belonging import require_said_prior, require_subjects, require_update
from bayes_toe.inference.draws import Draws

_NOTHING = np.full((len(SUMMARISED), len(QUANTILES)), np.nan)


def read_sensitivity(path: str | Path, draws: Draws) -> SensitivityTable:
    """The table without its quantiles, with the seed of the draws.

    Raises
    ------
    InputError
        If the file is not such a table, or is of other subjects or a range about another prior than the draws.
    """
    source = bare(Path(path).name)
    require_update(draws, source)
    texts, numbers = read_rows(path, ("subject", "varied", "method", "prior"), ("factor", "value", "log_bayes_factor", "se", "pareto_k"))
    require_subjects(source, texts["subject"], draws)
    rows = []
    for i, (subject, varied, method, said) in enumerate(zip(*texts.values(), strict=True)):
        draws.prior.declared_as(varied)
        prior = replace(draws.prior, **{varied: float(numbers["value"][i])})  # type: ignore[arg-type]  # a number of the prior
        require_said_prior(source, said, prior.describe(), f" but for {varied}")
        factor, bayes_factor, error = (_known(numbers[name][i]) for name in ("factor", "log_bayes_factor", "se"))
        rows.append(SensitivityRow(subject, varied, factor, prior, bayes_factor, error, float(numbers["pareto_k"][i]), method, _NOTHING))
    found = SensitivityTable(tuple(rows), prior=draws.prior, seed=draws.seed)
    _require_middle(source, found)
    return found


def read_parts_sensitivity(path: str | Path, draws: Draws) -> PartsSensitivity:
    """The table, with the seed of the draws; the file does not say which prior it is about, but where it is in the middle.

    Raises
    ------
    InputError
        If the file is not such a table, or is of other subjects or a range about another prior than the draws.
    """
    source = bare(Path(path).name)
    texts, numbers = read_rows(path, ("subject", "varied", "part", "level"), ("factor", "value", "probability", "pareto_k", "sampled_anew"))
    require_subjects(source, (name for name in texts["subject"] if name != STUDY), draws)
    rows = []
    for i, (subject, varied, part, level) in enumerate(zip(*texts.values(), strict=True)):
        value, k, anew = (float(numbers[name][i]) for name in ("value", "pareto_k", "sampled_anew"))
        factor, probability = (_known(numbers[name][i]) for name in ("factor", "probability"))
        rows.append(PartsRow(subject, varied, factor, value, part, level, probability, k, int(anew)))
    found = PartsSensitivity(tuple(rows), prior=draws.prior, seed=draws.seed)
    _require_middle(source, found)
    return found


def _known(value: float) -> float | None:
    return None if isnan(value) else float(value)


def _require_middle(source: str, found: SensitivityTable | PartsSensitivity) -> None:
    """Whether every range has the value of the draws' own prior, which conclusions are compared with."""
    values = {(row.varied, row.value) for row in found.rows}
    for varied in dict.fromkeys(row.varied for row in found.rows):
        given = getattr(found.prior, varied, None)
        if (varied, given) not in values:
            raise InputError(f"{source}: found a range of {quoted(varied)} about another prior, allowed: about that of the draws, {given}")
