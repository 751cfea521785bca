"""Answers averaged over models: what a subject's pull, constant error and gain are, and how it answers, whichever model it follows.

Each model of the space (:func:`bayes_toe.model.ladder.models_of`) counts with its posterior probability, at equal prior probabilities;
those far behind the best have no draws and are left out with less than 1 % of it. One without a part contributes exactly what that part
leaves: no pull is 0, no constant error is 0, and the gain is then 1. Source: Hoeting et al. 1999 (Statist. Sci. 14:382).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from scipy.special import softmax

from bayes_toe.arrays import FloatArray
from bayes_toe.comparison.verdict import verdict
from bayes_toe.data.messages import as_name
from bayes_toe.data.study import Study, Subject
from bayes_toe.data.tables import SubjectTable
from bayes_toe.errors import InputError
from bayes_toe.inference.prediction import Predictor
from bayes_toe.inference.subject import QUANTILES
from bayes_toe.model.prior import Prior
from bayes_toe.model.study_prior import prior_for
from bayes_toe.seeds import generator, root_seed
from bayes_toe.workers import Progress, Workers, run_in_order

if TYPE_CHECKING:
    import pandas as pd

#: What is averaged, and its value without the part. Pull and gain are those at the reference interval where there are intervals, the
#: constant error is that at the mean first stimulus.
AVERAGED: Mapping[str, float] = {"pull": 0.0, "offset": 0.0, "gain": 1.0}


@dataclass(frozen=True, eq=False)
class Average:
    """One subject, averaged over models.

    Attributes
    ----------
    counts : Subject
    models : tuple of str
    weights : array, shape (models,)
        Probabilities of the models.
    drawn : tuple of Predictor
        Posterior draws of each model, as many as its share of all.
    """

    counts: Subject
    models: tuple[str, ...]
    weights: FloatArray
    drawn: tuple[Predictor, ...]

    @property
    def subject(self) -> str:
        """Identifier."""
        return self.counts.name

    def values(self, quantity: str) -> FloatArray:
        """Draws of pull, offset (natural-log intensity) or gain, shape (draws,)."""
        return np.concatenate([_quantity(one, quantity) for one in self.drawn])

    def without(self, quantity: str) -> float:
        """Probability that it is exactly 0, or the gain 1: that of the models without it."""
        name = "gain" if quantity == "pull" else quantity
        return float(
            sum(
                w
                for w, one in zip(self.weights, self.drawn, strict=True)
                if name not in one.target.names.all
            )
        )

    def yes(
        self, s1: npt.ArrayLike, s2: npt.ArrayLike, isi: npt.ArrayLike | None = None
    ) -> FloatArray:
        """P of the answer that the task counts, (draws, pairs), of pairs: natural-log intensities, intervals (s) where there are any.

        Raises
        ------
        InputError
            If intervals are missing or not known.
        """
        if (isi is None) != (self.counts.isi is None):
            raise InputError(
                f"isi: subject {self.subject!r} was tested {'without' if self.counts.isi is None else 'with'} intervals"
            )
        given = [
            np.asarray(values, np.float64) for values in (s1, s2, *(() if isi is None else (isi,)))
        ]
        pairs = [np.atleast_1d(values) for values in np.broadcast_arrays(*given)]
        return np.concatenate([one.yes(*pairs) for one in self.drawn if len(one.x)])


@dataclass(frozen=True, eq=False)
class Averages(SubjectTable[Average]):
    """Every subject of a study, averaged over models.

    Attributes
    ----------
    withheld : dict of str to str
        Subjects without an average, and why.
    """

    withheld: Mapping[str, str]
    seed: int
    prior: Prior
    synthetic: bool = False

    def __getitem__(self, name: str | int) -> Average:
        if as_name(name) in self.withheld:
            raise InputError(f"subject {name!r}: no average, {self.withheld[as_name(name)]}")
        return super().__getitem__(name)

    def summary(self) -> pd.DataFrame:
        """One row per subject and quantity: subject, quantity, mean, q05 ... q95, value_without the part, p_without, its probability."""
        import pandas as pd

        rows = [
            (one.subject, name, *_summarised(one.values(name)), null, one.without(name))
            for one in self
            for name, null in AVERAGED.items()
        ]
        return pd.DataFrame(
            rows, columns=["subject", "quantity", "mean", *QUANTILES, "value_without", "p_without"]
        )

    def frame(self) -> pd.DataFrame:
        """The same: what :meth:`save` writes."""
        return self.summary()

    def weights(self) -> pd.DataFrame:
        """One row per subject and model: subject, model, probability."""
        import pandas as pd

        rows = [
            (one.subject, *row)
            for one in self
            for row in zip(one.models, one.weights.tolist(), strict=True)
        ]
        return pd.DataFrame(rows, columns=["subject", "model", "probability"])

    def yes(
        self, subject: str, s1: npt.ArrayLike, s2: npt.ArrayLike, isi: npt.ArrayLike | None = None
    ) -> pd.DataFrame:
        """P of the answer that the task counts, a row a pair of one subject: s1, s2, isi (only with intervals), mean, q05 ... q95."""
        import pandas as pd

        given = {"s1": s1, "s2": s2} | ({} if isi is None else {"isi": isi})
        columns = dict(
            zip(
                given,
                np.broadcast_arrays(*(np.atleast_1d(values) for values in given.values())),
                strict=True,
            )
        )
        found = np.stack(_summarised(self[subject].yes(s1, s2, isi)), axis=1)
        return pd.DataFrame(columns).join(pd.DataFrame(found, columns=["mean", *QUANTILES]))


def average_models(
    study: Study,
    *,
    draws: int = 1000,
    seed: int | None = None,
    prior: Prior | str | None = None,
    workers: Workers = None,
    progress: Progress | None = None,
) -> Averages:
    """Pull, constant error, gain and answers of every subject, averaged over the space of models.

    Parameters
    ----------
    study : Study
    draws : int
        How many the average has.
    seed, prior, workers, progress
        As in :func:`bayes_toe.analysis.evidence`; with the same seed the weights are those of its verdicts.

    Examples
    --------
    >>> one = Subject("S01", [0.0, 0.0, 0.3], [0.0, 0.3, 0.0], [49, 20, 15], [50, 50, 50])
    >>> found = average_models(Study([one]), draws=500, seed=1, workers=1)
    >>> found.summary()["q50"].round().tolist()
    [0.0, 0.0, 1.0]
    """
    root, chosen = root_seed(seed), prior_for(study, prior)
    jobs = [partial(_averaged, subject, chosen, root, draws) for subject in study]
    found = run_in_order(jobs, workers, progress, [(subject.name,) for subject in study])
    rows = tuple(one for one in found if isinstance(one, Average))
    withheld = {
        subject.name: one for subject, one in zip(study, found, strict=True) if isinstance(one, str)
    }
    return Averages(rows, withheld, root, chosen, study.synthetic)


def _averaged(counts: Subject, prior: Prior, seed: int, draws: int) -> Average | str:
    """The average of one subject, or why there is none."""
    said, space = verdict(counts, prior, seed)
    if said.p_orders is None:
        return "; ".join(said.notes)
    rng, places = generator(seed, counts.name, "average"), sorted(space.sampled)
    drawn = [space.predictor(space.models[i].name, draws, rng) for i in places]
    return mixed(counts, space.log_evidence[places], drawn, draws)


def mixed(
    counts: Subject, log_evidence: FloatArray, drawn: Sequence[Predictor], draws: int
) -> Average:
    """So many draws in all, of each model its share."""
    weights = np.asarray(softmax(log_evidence))
    sizes = np.diff(
        np.rint(draws * np.cumsum(weights)).astype(np.int64), prepend=0
    ).tolist()  # each within one of its share
    parts = (
        Predictor(one.target, one.x[np.arange(size) * len(one.x) // max(size, 1)])
        for one, size in zip(drawn, sizes, strict=True)
    )
    return Average(counts, tuple(one.target.model.name for one in drawn), weights, tuple(parts))


def _quantity(one: Predictor, quantity: str) -> FloatArray:
    known = one.target.quantities(one.x)
    if quantity == "pull" and "gain" in known:
        return known["pull"] if "pull" in known else 1.0 - known["gain"]
    return known.get(quantity, np.full(len(one.x), AVERAGED[quantity]))


def _summarised(values: FloatArray) -> list[FloatArray]:
    """Mean and quantiles over the first axis."""
    return [values.mean(axis=0), *np.quantile(values, list(QUANTILES.values()), axis=0)]
