"""population_subjects.csv: quantities of every subject in the light of the others, with those of the same subject alone beside them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bayes_toe.data.tables import Table
from bayes_toe.inference.diagnostics import convergence_of, errors_of
from bayes_toe.inference.subject_draws import SUMMARY_COLUMNS, SummaryRow, location

if TYPE_CHECKING:
    import pandas as pd

    from bayes_toe.groups.population import Population

ALONE = {"alone_q05": 0.05, "alone_q50": 0.5, "alone_q95": 0.95}
#: Those of summary.csv but the contraction, which is held against the prior of a single subject: that does not enter here.
COLUMNS = (*(name for name in SUMMARY_COLUMNS if name != "contraction"), *ALONE)


@dataclass(frozen=True, eq=False)
class MemberTable(Table[SummaryRow]):
    """One row per subject and quantity."""

    def frame(self) -> pd.DataFrame:
        """With the columns of population_subjects.csv."""
        import pandas as pd

        return pd.DataFrame(self.rows, columns=list(COLUMNS))


def member_table(found: Population) -> MemberTable:
    """Of every subject in the group; who was left out is not in it."""
    return MemberTable(tuple(row for i in range(len(found.study)) for row in _rows(found, i)))


def _rows(found: Population, i: int) -> Iterator[SummaryRow]:
    name = found.study.names[i]
    together, alone = found.quantities(found.chains.eta[:, :, i]), found.quantities(found.alone[:, i])
    reported = {key: together[key] for key in found.posterior(name).names.reported}
    judged, uncertain = convergence_of(reported), errors_of(reported)
    for key, values in reported.items():
        own = np.quantile(alone[key], list(ALONE.values())).tolist()
        yield (name, key, *location(values), *judged[key], *uncertain[key], *own)
