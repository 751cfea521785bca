"""Posterior and bootstrap uncertainty side by side."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bayes_toe.classical.fit_table import FitTable
from bayes_toe.errors import InputError
from bayes_toe.inference.draws import Draws
from bayes_toe.model.coordinates import NATURAL

if TYPE_CHECKING:
    import pandas as pd

COLUMNS = (
    *("subject", "parameter", "posterior_median", "posterior_lower", "posterior_upper"),
    *("fit", "bootstrap_lower", "bootstrap_upper", "at_edge"),
)


def uncertainty_table(draws: Draws, fits: FitTable) -> pd.DataFrame:
    """Central posterior interval and percentile bootstrap interval of every subject and natural parameter, both at the table's level.

    Columns: :data:`COLUMNS`; the standard deviations and mu1 in natural-log intensity. The two answer different questions: the posterior
    weighs parameters by the prior and the answers given, the bootstrap says where the maximum would fall if the experiment were done again.

    Raises
    ------
    InputError
        If the two do not hold the same subjects.
    """
    import pandas as pd

    names = [row.subject for row in fits]
    if set(names) != set(draws.names):
        raise InputError("the draws and the fits must be of the same subjects")
    tails = [0.5 - fits.level / 2.0, 0.5, 0.5 + fits.level / 2.0]
    rows = []
    for row in fits:
        for key, best, (lower, upper) in zip(NATURAL, row.parameters, row.bootstrap.intervals(fits.level), strict=True):
            low, middle, high = np.quantile(draws.values(row.subject, key), tails)
            rows.append((row.subject, key, middle, low, high, best, lower, upper, row.at_edge))
    return pd.DataFrame(rows, columns=list(COLUMNS))
