"""Predictions from posterior draws, for any pairs, tested or not.

`Predictor` gives probabilities at draws, and `predict` a table with quantiles.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pandas as pd

from bayes_toe.arrays import FloatArray, NamedArrays, thinned
from bayes_toe.data.answers import Answers, real_numbers
from bayes_toe.data.study import Subject
from bayes_toe.errors import InputError
from bayes_toe.inference.draws import Draws, require_draws
from bayes_toe.inference.subject import QUANTILES
from bayes_toe.model.posterior import SubjectPosterior


@dataclass(frozen=True, eq=False)
class Predictor:
    """Predictions of posterior draws of one subject; x has the shape (draws, k)."""

    target: SubjectPosterior
    x: FloatArray

    @classmethod
    def from_draws(cls, draws: Draws, subject: str, *, n_draws: float = np.inf) -> Predictor:
        """The predictor of a subject's draws: all of them, or at most `n_draws`, evenly spaced."""
        require_draws(draws)
        x = np.concatenate(list(draws.points(subject)))
        return cls(draws.posterior(subject), thinned(x, n_draws))

    def yes(self, s1: FloatArray, s2: FloatArray) -> FloatArray:
        """P of the answer that the task counts, for any pairs, (pairs,) -> (draws, pairs).

        Intensities are natural logs.
        """
        return self.answers(s1, s2)[self.target.subject.task.yes]

    def answers(self, s1: FloatArray, s2: FloatArray) -> NamedArrays:
        """P of each answer that the model predicts, for any pairs, (draws, pairs) each.

        With three answers, the paper's model predicts 'equal' alone.
        """
        # A subject has each pair once, in sorted order. Its counts do not matter here.
        pairs, index_of_sorted = np.unique(_stimuli_of_pairs(s1, s2).T, axis=0, return_inverse=True)
        counts = np.ones(len(pairs), np.int64)
        tested_subject = self.target.subject
        subject = Subject.from_answers(
            tested_subject.name, Answers(pairs, counts, counts), tested_subject.task
        )

        # (answers, draws, pairs), in the order of the answers, for the sorted pairs.
        p_of_sorted_pairs = np.exp(self.target.for_subject(subject).log_answers(self.x))
        probabilities = p_of_sorted_pairs[..., index_of_sorted.ravel()]
        answers = tested_subject.task.answers
        if len(probabilities) < len(answers):  # the paper's model, without 'second' and 'first'
            return {tested_subject.task.yes: probabilities[0]}
        return dict(zip(answers, probabilities, strict=True))


def _stimuli_of_pairs(s1: npt.ArrayLike, s2: npt.ArrayLike) -> FloatArray:
    """Stimuli as numbers, (2, pairs). A single s1 is in a pair with every s2, and vice versa."""
    first = real_numbers("s1", s1)
    second = real_numbers("s2", s2)
    try:
        return np.array(np.broadcast_arrays(first, second), np.float64)
    except ValueError as error:
        raise InputError(f"s1, s2: allowed are as many of each ({error})") from error


def predict(draws: Draws, subject: str, s1: npt.ArrayLike, s2: npt.ArrayLike) -> pd.DataFrame:
    """Predict P('equal') or P('second') for pairs of stimuli. Each row is a pair.

    The columns are the mean and quantiles over the draws. The quantiles show the uncertainty of the
    parameters, without the scatter of a finite number of answers.

    Parameters
    ----------
    draws : Draws
    subject : str
    s1, s2 : array_like
        Natural-log intensities.

    Returns
    -------
    pandas.DataFrame
        s1, s2, mean, q05, q25, q50, q75, q95.

    Raises
    ------
    InputError
        For an unknown subject, or for stimuli that are no pairs of finite numbers.

    Examples
    --------
    >>> from bayes_toe.analysis import sample
    >>> from bayes_toe.data.study import Study, Subject
    >>> counts = [49, 20, 15], [50, 50, 50]
    >>> subject = Subject("S01", [0.0, 0.0, 0.3], [0.0, 0.3, 0.0], *counts)
    >>> draws = sample(Study([subject]), draws=500, seed=1, workers=1)
    >>> predict(draws, "S01", [0.0, 0.3], 0.3).columns.tolist()
    ['s1', 's2', 'mean', 'q05', 'q25', 'q50', 'q75', 'q95']
    """
    predictor = Predictor.from_draws(draws, subject)
    first, second = _stimuli_of_pairs(s1, s2)
    values = predictor.yes(first, second)

    quantiles = np.quantile(values, list(QUANTILES.values()), axis=0)
    columns = {"s1": first, "s2": second, "mean": values.mean(axis=0)}
    return pd.DataFrame(columns | dict(zip(QUANTILES, quantiles, strict=True)))
