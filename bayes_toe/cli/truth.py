"""Known values of subjects, from a file: what marks are drawn at."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from bayes_toe.data.messages import bare, listed, quoted
from bayes_toe.data.read_study import Truth
from bayes_toe.data.validation import read_numbers
from bayes_toe.errors import InputError
from bayes_toe.inference.draws import Draws


def read_truth(path: Path, draws: Sequence[Draws], subjects: Sequence[str]) -> Truth:
    """True values by subject from a CSV file: a column subject, and one for each quantity that is known, empty where it is not.

    With intervals sigma_p is per square root of a second in the file, as `simulate` writes it, and over the draws' reference interval here.

    Raises
    ------
    InputError
        One line per problem; also where no model of these draws has such a quantity, or there is no true value of any of these subjects.
    """
    allowed = list(dict.fromkeys(name for one in draws for name in one.posterior(one.names[0]).names.all))
    names, columns = read_numbers(path, (), "subject", optional=allowed, gaps=True)
    interval = next((one.prior.reference_interval for one in draws if one.intervals), None)
    if interval is not None and "sigma_p" in columns:
        columns["sigma_p"] = columns["sigma_p"] * np.sqrt(interval)
    found = {
        name: {key: float(values[row]) for key, values in columns.items() if not np.isnan(values[row])} for row, name in enumerate(names)
    }
    if not any(found.get(name) for name in subjects):
        raise InputError(f"{bare(path.name)}: found no true values of {listed([*map(quoted, subjects)], 3)}, allowed: a row of each")
    return found
