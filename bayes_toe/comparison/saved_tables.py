"""Tables that commands wrote, read back beside the draws that they belong to: evidence.csv, compare.csv, contrast.csv."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from bayes_toe.comparison.contrast import CONTRAST_COLUMNS
from bayes_toe.comparison.evidence_table import EVIDENCE_COLUMNS
from bayes_toe.comparison.model_comparison import STUDY, beside
from bayes_toe.data.messages import bare, listed, quoted
from bayes_toe.data.validation import read_rows
from bayes_toe.errors import InputError
from bayes_toe.inference.belonging import require_said_prior, require_subjects, require_update
from bayes_toe.inference.draws import Draws
from bayes_toe.model.free_frequencies import FREE_FREQUENCIES, frequency_evidence
from bayes_toe.model.ladder import Record, model_named

if TYPE_CHECKING:
    import pandas as pd

_TEXTS = ("subject", "effect", "kind", "fit", "data", "robust", "best_model", "prior")
_DIGITS = 1e-6  # of an exact evidence, nats: files have all digits


def read_evidence(path: str | Path, draws: Draws) -> pd.DataFrame:
    """An evidence.csv with its columns, a row for each subject of the draws, in their order; a text that is not there is empty.

    Refused where it is of other subjects, answers or another prior than the draws, as :func:`read_comparison` refuses its files.
    """
    import pandas as pd

    source = bare(Path(path).name)
    require_update(draws, source)
    texts, numbers = read_rows(
        path, _TEXTS, [name for name in EVIDENCE_COLUMNS if name not in _TEXTS]
    )
    require_subjects(source, texts["subject"], draws)
    require_said_prior(source, texts["prior"][0], draws.prior.describe_orders(draws.task))
    _require_answers(source, texts["subject"], numbers["log_evidence_h0"], draws)
    return aligned(pd.DataFrame({**texts, **numbers}, columns=list(EVIDENCE_COLUMNS)), draws)


def aligned(evidence: pd.DataFrame, draws: Draws) -> pd.DataFrame:
    """Rows of an evidence.csv by subject, in the order of the draws: numbers that may be NaN, texts that may be empty."""
    rows = evidence.set_index("subject", drop=False).loc[list(draws.names)]
    numbers = (
        rows.drop(columns=list(_TEXTS)).astype(float).astype({"n_pairs": int, "n_trials": int})
    )
    return rows[list(_TEXTS)].fillna("").join(numbers)[list(EVIDENCE_COLUMNS)]


@dataclass(frozen=True)
class SavedComparison:
    """What is told of a comparison: its models, which of them are best, what parts are.

    `best` has for how many subjects a model has the highest evidence, free frequencies aside, most frequent first; `withheld` subjects of
    whom an evidence is missing; `parts` by part how probable each level is for a new subject, empty with fewer than two subjects.
    """

    models: tuple[Record, ...]
    best: dict[str, int]
    withheld: tuple[str, ...]
    parts: dict[str, dict[str, float]]


def read_comparison(path: str | Path, draws: Draws) -> SavedComparison:
    """A compare.csv with the table of parts beside it."""
    import pandas as pd

    source, (_, of_parts) = bare(Path(path).name), beside(Path(path))
    texts, numbers = read_rows(
        path, ("subject", "model", "prior"), ("log_evidence", "model_probability")
    )
    rows = pd.DataFrame({**texts, **numbers}).drop_duplicates(["subject", "model"])
    require_subjects(source, rows["subject"], draws)
    models = tuple(map(model_named, rows["model"].unique()))
    for record in models:
        require_said_prior(
            source,
            rows["prior"][rows["model"] == record.name].iloc[0],
            record.describe(draws.prior),
        )
    free = rows[rows["model"] == FREE_FREQUENCIES.name]
    _require_answers(source, free["subject"], free["log_evidence"], draws)
    others = rows[(rows["model"] != FREE_FREQUENCIES.name) & rows["log_evidence"].notna()]
    best = others.loc[others.groupby("subject")["log_evidence"].idxmax(), "model"]
    missing = rows["log_evidence"].isna() & (rows["model_probability"] != 0.0)
    said, shares = read_rows(of_parts, ("subject", "part", "level"), ("probability",))
    parts: dict[str, dict[str, float]] = {}
    for who, part, level, p in zip(*said.values(), shares["probability"].tolist(), strict=True):
        if who == STUDY:
            parts.setdefault(part, {})[level] = p
    return SavedComparison(
        models, dict(Counter(best).most_common()), tuple(rows["subject"][missing].unique()), parts
    )


def read_contrast(path: Path, draws: Draws) -> pd.DataFrame:
    """The rows of a contrast.csv, refused where it has subjects that the draws do not have."""
    import pandas as pd

    texts = ("subject", "quantity", "comparison", "word", "robust", "model", "prior")
    said, numbers = read_rows(path, texts, [name for name in CONTRAST_COLUMNS if name not in texts])
    if others := {*said["subject"]}.difference(one.person for one in draws.study):
        raise InputError(
            f"{bare(path.name)}: found other subjects than the draws have, {listed(sorted(others), 3)}, allowed: one study"
        )
    return pd.DataFrame({**said, **numbers})


def _require_answers(
    source: str, names: npt.ArrayLike, frequencies: npt.ArrayLike, draws: Draws
) -> None:
    """The evidence of free frequencies is exact, and so tells whether the answers are the same."""
    for name, found in zip(
        np.asarray(names, str).tolist(), np.asarray(frequencies, np.float64).tolist(), strict=True
    ):
        if name in draws.failed:
            continue
        exact = frequency_evidence(draws.subject(name))
        if not abs(found - exact) < _DIGITS * (1.0 + abs(exact)):
            raise InputError(
                f"{source}: found other answers than the draws have of {quoted(name)}, allowed: one study"
            )
