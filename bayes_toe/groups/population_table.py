"""The rows of population.csv and population_subjects.csv.

A `PopulationRow` is one quantity of the group. `summary_row` computes it from draws.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd

from bayes_toe.arrays import FloatArray
from bayes_toe.data.tables import Table
from bayes_toe.groups.zero_mean import ZeroBayesFactor
from bayes_toe.inference.diagnostics import convergence
from bayes_toe.model.parameters import CONSTANT_ERROR, CONTRACTION, NOISE, PEAK

#: The parameters that are order effects.
EFFECTS = (CONSTANT_ERROR.name, CONTRACTION.name)
#: The median and the ends of the 95 % interval.
QUANTILES = (0.025, 0.5, 0.975)
#: The quantities that are computed from parameters, in the units of screens.
COMPUTED = {
    CONSTANT_ERROR.name: "pse_shift_percent",
    NOISE.name: "jnd_percent",
    PEAK.name: "peak_probability",
}


class PopulationRow(NamedTuple):
    """One quantity of the group; the names are the columns of population.csv.

    Attributes
    ----------
    parameter : str
        `constant_error` (c/D), `contraction` (p), `noise` (log(sigma_d/D)), `q0` (logit q0), or
        a quantity computed from these: `pse_shift_percent`, `jnd_percent`, `peak_probability`.
    quantity : {"mean", "sd", "new_subject", "effect", "difference", "difference_sd"}
        What the row says of the subjects. An effect is that of a covariate, and a difference is
        between two conditions.
    level : str
        The covariate of an effect, or the two conditions of a difference. For other quantities,
        the cell is empty.
    q025, q50, q975 : float
        Median and 95 % interval.
    ess_bulk, ess_tail, r_hat : float
    p_direction : float or None
        Probability of the more probable sign.
    ln_bf_zero : float or None
        Natural log of the Bayes factor of 0 against any other value. A value below -10 is
        imprecise, and shows only that 0 is very improbable.
    ln_bf_zero_se : float or None
        Monte Carlo standard error of `ln_bf_zero`.
    """

    parameter: str
    quantity: str
    level: str
    q025: float
    q50: float
    q975: float
    ess_bulk: float
    ess_tail: float
    r_hat: float
    p_direction: float | None = None
    ln_bf_zero: float | None = None
    ln_bf_zero_se: float | None = None

    @property
    def interval(self) -> FloatArray:
        """The median between the ends of the 95 % interval, shape (3,)."""
        return np.array([self.q025, self.q50, self.q975])


#: The columns of population_subjects.csv, of which a row is one parameter of one subject. The last
#: columns, from q025 to r_hat, have the numbers of :func:`summary`.
SUBJECT_COLUMNS = ("subject", "parameter", *PopulationRow._fields[3:9])


def summary(draws: FloatArray) -> tuple[float, ...]:
    """Quantiles .025, .5, .975 of draws, shape (chains, draws), ESS of bulk and tail, and R-hat."""
    return *np.quantile(draws, QUANTILES).tolist(), *convergence(draws)


def summary_row(
    parameter: str,
    quantity: str,
    draws: FloatArray,
    level: str = "",
    zero_factor: ZeroBayesFactor | None = None,
) -> PopulationRow:
    """The row of a quantity from its draws, shape (chains, draws).

    `zero_factor` is the Bayes factor of 0, if 0 is a value of interest.
    """
    row = PopulationRow(parameter, quantity, level, *summary(draws))
    if zero_factor is None:
        return row
    p_positive = float((draws > 0.0).mean())  # the share of draws above 0
    return row._replace(
        p_direction=max(p_positive, 1.0 - p_positive),
        ln_bf_zero=zero_factor.log_bf,
        ln_bf_zero_se=zero_factor.error,
    )


@dataclass(frozen=True, eq=False)
class PopulationTable(Table[PopulationRow]):
    """The rows of population.csv. The short table has no diagnostics and no standard error."""

    seed: int
    # The first six columns end with the quantiles.
    short_columns = (*PopulationRow._fields[:6], "p_direction", "ln_bf_zero")

    def _full_frame(self) -> pd.DataFrame:
        """One row per quantity, with the columns of population.csv.

        A percentage that is too large for a number is NaN.
        """
        columns = list(PopulationRow._fields)
        # All columns behind the level, the third column, are numbers, also where every entry of a
        # column is None.
        frame = pd.DataFrame(self.rows, columns=columns).astype(dict.fromkeys(columns[3:], float))
        return frame.replace([np.inf, -np.inf], np.nan)

    def select(self, quantity: str, parameter: str | None = None) -> tuple[PopulationRow, ...]:
        """The rows of one quantity; only those of a parameter, if it is given."""
        return tuple(
            row
            for row in self.rows
            if row.quantity == quantity and parameter in (None, row.parameter)
        )

    def row(self, quantity: str, parameter: str) -> PopulationRow:
        """The only row of a mean, a standard deviation or a new subject."""
        (row,) = self.select(quantity, parameter)
        return row
