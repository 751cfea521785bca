"""Answers averaged over models: what a subject's pull, constant error and gain are, and its P(equal), whichever model it follows.

Each model counts with its posterior probability, at equal prior probabilities of the models in the space. One without a part contributes
exactly what that part leaves: no pull is 0, no constant error is 0, and the gain is then 1. Free frequencies have none of these and are
left out. Source: Hoeting et al. 1999 (Statist. Sci. 14:382).
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
from bayes_toe.data.study import Study, Subject, as_name
from bayes_toe.data.tables import SubjectTable
from bayes_toe.errors import InputError
from bayes_toe.inference.evidence import Evidence, weighed
from bayes_toe.inference.prediction import Predictor
from bayes_toe.inference.sampling import SamplerSettings
from bayes_toe.inference.subject import EVIDENCE_DRAWS, QUANTILES, Wanted, infer
from bayes_toe.model.ladder import Record, require_models
from bayes_toe.model.posterior import Model, Posterior
from bayes_toe.model.prior import Prior
from bayes_toe.model.study_prior import prior_for
from bayes_toe.seeds import root_seed
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
        return float(sum(w for w, one in zip(self.weights, self.drawn, strict=True) if name not in one.target.names.all))

    def equal(self, s1: npt.ArrayLike, s2: npt.ArrayLike, isi: npt.ArrayLike | None = None) -> FloatArray:
        """P(equal) of pairs, natural-log intensities (and intervals in seconds, where the subject has them) -> (draws, pairs).

        Raises
        ------
        InputError
            If intervals are missing or not known.
        """
        if (isi is None) != (self.counts.isi is None):
            raise InputError(f"isi: subject {self.subject!r} was tested {'without' if self.counts.isi is None else 'with'} intervals")
        given = [np.asarray(values, np.float64) for values in (s1, s2, *(() if isi is None else (isi,)))]
        pairs = [np.atleast_1d(values) for values in np.broadcast_arrays(*given)]
        return np.concatenate([one.equal(*pairs) for one in self.drawn if len(one.x)])


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
            (one.subject, name, *_summarised(one.values(name)), null, one.without(name)) for one in self for name, null in AVERAGED.items()
        ]
        return pd.DataFrame(rows, columns=["subject", "quantity", "mean", *QUANTILES, "value_without", "p_without"])

    def frame(self) -> pd.DataFrame:
        """The same: what :meth:`save` writes."""
        return self.summary()

    def weights(self) -> pd.DataFrame:
        """One row per subject and model: subject, model, probability."""
        import pandas as pd

        rows = [(one.subject, *row) for one in self for row in zip(one.models, one.weights.tolist(), strict=True)]
        return pd.DataFrame(rows, columns=["subject", "model", "probability"])

    def equal(self, subject: str, s1: npt.ArrayLike, s2: npt.ArrayLike, isi: npt.ArrayLike | None = None) -> pd.DataFrame:
        """P(equal) of pairs of one subject, one row each: s1, s2, isi (only with intervals), mean, q05 ... q95."""
        import pandas as pd

        given = {"s1": s1, "s2": s2} | ({} if isi is None else {"isi": isi})
        columns = dict(zip(given, np.broadcast_arrays(*(np.atleast_1d(values) for values in given.values())), strict=True))
        found = np.stack(_summarised(self[subject].equal(s1, s2, isi)), axis=1)
        return pd.DataFrame(columns).join(pd.DataFrame(found, columns=["mean", *QUANTILES]))


def average(
    study: Study,
    models: str | Sequence[str | Record] = "parts",
    *,
    draws: int = 1000,
    seed: int | None = None,
    prior: Prior | str | None = None,
    workers: Workers = None,
    progress: Progress | None = None,
) -> Averages:
    """Pull, constant error, gain and P(equal) of every subject, averaged over a space of models.

    Parameters
    ----------
    study : Study
    models : str or sequence of str or record
        As in :func:`bayes_toe.comparison.model_comparison.compare`; free frequencies do not count.
    draws : int
        Effective draws to reach under every model, and how many the average has.
    seed, prior, workers, progress
        As in :func:`bayes_toe.comparison.model_comparison.compare`; with the same seed the weights are those of its evidences.

    Raises
    ------
    InputError
        If a model, the seed or a number is not allowed, or nothing is left to average.

    Examples
    --------
    >>> one = Subject("S01", [0.0, 0.0, 0.3], [0.0, 0.3, 0.0], [49, 20, 15], [50, 50, 50])
    >>> found = average(Study([one]), ["none", "constant error"], draws=500, seed=1, workers=1)
    >>> found.summary()["p_without"].round(2).tolist() == [1.0, round(found["S01"].weights[0], 2), 1.0]
    True
    """
    records = [model for model in require_models(models) if isinstance(model, Model)]
    if not records:
        raise InputError("models: free frequencies have neither pull nor gain; nothing is left to average")
    root, chosen, sampler = root_seed(seed), prior_for(study, prior), SamplerSettings(draws=draws, max_quantile_error=np.inf)
    jobs = [partial(_draw, model.posterior(subject, chosen), root, sampler) for subject in study for model in records]
    names = [(f"{subject.name}: {model.name}",) for subject in study for model in records]
    done = run_in_order(jobs, workers, progress, names)
    found = [averaged(subject, done[i * len(records) : (i + 1) * len(records)], draws) for i, subject in enumerate(study)]
    rows = tuple(one for one in found if isinstance(one, Average))
    withheld = {subject.name: one for subject, one in zip(study, found, strict=True) if isinstance(one, str)}
    return Averages(rows, withheld, root, chosen, study.synthetic)


@dataclass(frozen=True, eq=False)
class Drawn:
    """One model of one subject: evidence, some draws in unconstrained coordinates, and what is wrong with them."""

    target: Posterior
    evidence: Evidence
    x: FloatArray
    not_converged: str


def _draw(target: Posterior, seed: int, sampler: SamplerSettings) -> Drawn:
    result = infer(target, seed, Wanted(sampler, EVIDENCE_DRAWS))
    assert result.evidence is not None  # it was asked for, as was the other
    assert result.chains is not None
    x = result.chains.x.reshape(-1, len(target.coordinates))
    return Drawn(target, result.evidence, _thinned(x, sampler.draws), "" if result.chains.converged else result.chains.reason)


def averaged(counts: Subject, found: Sequence[Drawn], draws: int) -> Average | str:
    """The average of one subject, or why there is none."""
    values = weighed([one.evidence.value for one in found], [one.evidence.bound for one in found])
    if np.isnan(values).any():
        return f"no evidence of {', '.join(one.target.model.name for one, value in zip(found, values, strict=True) if np.isnan(value))}"
    weights = softmax(values)
    sizes = np.diff(np.rint(draws * np.cumsum(weights)).astype(np.int64), prepend=0).tolist()  # each within one of its share
    poor = [f"{one.target.model.name}: {one.not_converged}" for one, size in zip(found, sizes, strict=True) if size and one.not_converged]
    if poor:
        return f"draws did not converge ({'; '.join(poor)})"
    drawn = tuple(Predictor(one.target, _thinned(one.x, size)) for one, size in zip(found, sizes, strict=True))
    return Average(counts, tuple(one.target.model.name for one in found), np.asarray(weights), drawn)


def _thinned(x: FloatArray, size: int) -> FloatArray:
    """So many draws, evenly spaced."""
    return x[np.arange(size) * len(x) // max(size, 1)]


def _quantity(one: Predictor, quantity: str) -> FloatArray:
    known = one.target.quantities(one.x)
    if quantity == "pull" and "gain" in known:
        return known["pull"] if "pull" in known else 1.0 - known["gain"]
    return known.get(quantity, np.full(len(one.x), AVERAGED[quantity]))


def _summarised(values: FloatArray) -> list[FloatArray]:
    """Mean and quantiles over the first axis."""
    return [values.mean(axis=0), *np.quantile(values, list(QUANTILES.values()), axis=0)]
