"""Effective draws per second of the global move over those of every other sampler, and what each ratio was meant to be."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from speed.method import IDENTIFIED, NATURAL
from speed.methods import GLOBAL, MANY, NUMPYRO, NUMPYRO_JIT, NUTPIE, STRETCH

if TYPE_CHECKING:
    import pandas as pd

HEADLINE = 10_000  # effective draws asked for: what the commands are meant to deliver
MEASURES = ("claimed", "true", "spread")  # what effective draws are counted by
RIVALS = (
    (STRETCH, NATURAL, 100.0),
    (MANY, NATURAL, 100.0),
    (STRETCH, IDENTIFIED, None),
    ("emcee DE + stretch", IDENTIFIED, None),
    (NUTPIE, NATURAL, 30.0),
    (NUTPIE, IDENTIFIED, 30.0),
    (NUMPYRO, NATURAL, 300.0),
    (NUMPYRO, IDENTIFIED, 300.0),
    (NUMPYRO_JIT, NATURAL, 300.0),
    (NUMPYRO_JIT, IDENTIFIED, 300.0),
    ("dynesty", NATURAL, None),
    ("dynesty", IDENTIFIED, None),
    ("nautilus", NATURAL, None),
    ("nautilus", IDENTIFIED, None),
    ("importance sampling", IDENTIFIED, None),
)
#: What is asked of the spread of means, which neither flatters nor punishes a sampler that is biased: in identified coordinates.
OF_SPREAD = {NUTPIE: 4.0, NUMPYRO_JIT: 4.0, STRETCH: 80.0}


@dataclass(frozen=True)
class Ratio:
    """Global move over one rival, by one measure of effective draws, over the subjects where both have a value."""

    rival: str
    by: str
    bar: float | None
    median: float
    worst: float
    subjects: int

    @property
    def verdict(self) -> str:
        """Whether the median over subjects reaches the bar."""
        if self.bar is None or not self.subjects:
            return ""
        return "met" if self.median >= self.bar else "MISSED"


def ratios(table: pd.DataFrame, kind: str, effort: int) -> Iterator[Ratio]:
    """All ratios on subjects of one kind; a rival counts with the effort that suits it best on that subject."""
    chosen = table[table.kind == kind]
    for name, coordinates, bar in RIVALS:
        rival = chosen[(chosen.method == name) & (chosen.coordinates == coordinates)]
        for by in MEASURES:
            column = f"{by}_ess_per_s"
            ours = chosen[(chosen.method == GLOBAL) & (chosen.effort == effort)].set_index("subject")[column].astype(float)
            best = rival.groupby("subject")[column].apply(lambda values: values.astype(float).max())
            values = (ours / best).replace(np.inf, np.nan).dropna()
            median, worst = (float(values.median()), float(values.min())) if len(values) else (np.nan, np.nan)
            asked = bar if by != "spread" else OF_SPREAD.get(name) if coordinates == IDENTIFIED else None
            yield Ratio(f"{name} ({coordinates})", by, asked, median, worst, len(values))
