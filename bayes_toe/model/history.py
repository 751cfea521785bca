"""What a trial leaves to the next: an expectation that follows the stimuli felt so far, trial by trial.

Only mu1 changes. With stimuli counted from mu0, the mean of all that were felt, and K = 1 - p,

    mu1(t) = mu1 + E_t,    E_{t+1} = d_t E_t + b_t,    E = 0 where memory begins anew,

so that the numerator of the normalised distance of a trial is the static one less p E_t. *Carry-over*: after a trial the belief has mean
p mu_2 + K s2 with mu_2 = K s1 + p mu1(t), and relaxes to the prior by a factor rho until the next: d = rho p^2, b = rho (p K s1 + K s2).
rho = 0 is the paper's observer, whose expectation has relaxed by then; rho = 1 is one Kalman filter through all stimuli. Where the time
between trials is known, rho = exp(-iti/tau). *Running average*: d = 2^(-1/h) with half-life h, b = (1 - d) (s1 + s2)/2.

Trials that nobody answered were felt all the same: they feed E and not the likelihood. At several inter-stimulus intervals p is that of
the trial.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from scipy.special import expit

from bayes_toe.arrays import FloatArray, IndexArray, IntArray, run_starts
from bayes_toe.data.study import Subject
from bayes_toe.data.trial_sequence import require_order


@dataclass(frozen=True, eq=False)
class Trials:
    """Answered trials of a subject one by one, and all that were felt in their order, sessions beside each other.

    Of those answered arrays have the shape (trials,), in the order of the subject's pairs, of those felt (longest session, sessions, 1).
    """

    s1: FloatArray
    s2: FloatArray
    isi: FloatArray | None
    n_yes: IntArray  # 1 where the answer was the one that the task counts, else 0
    n_trials: IntArray  # 1
    starts: IndexArray  # (pairs,): where the trials of every pair start
    before: FloatArray  # 1 after a trial that got this answer, -1 after the other one, 0 after none
    previous: FloatArray  # mean stimulus of the trial before; NaN where memory begins anew
    at: IndexArray  # where among those felt each is, (longest session, sessions) in rows
    first: FloatArray  # stimuli felt, from mu0, as second; 0 behind the end of a session
    second: FloatArray
    seconds: FloatArray | None  # inter-stimulus interval of those felt
    iti: FloatArray | None  # time from each to the next, infinite where that is not known

    @classmethod
    def of(cls, subject: Subject) -> Trials:
        """Those of a subject whose order of trials is known."""
        answers = require_order(subject)
        begins, keys = answers.begins, answers.keys
        session = np.cumsum(begins) - 1
        step = np.arange(len(begins)) - np.flatnonzero(begins)[session]
        shape = int(step.max()) + 1, int(session[-1]) + 1
        mu0 = keys[:, :2].mean()

        def laid_out(values: FloatArray, rest: float) -> FloatArray:
            """Values of all trials by step and session."""
            out = np.full((*shape, 1), rest)
            out[step, session, 0] = values
            return out

        given = np.flatnonzero(answers.n_trials)
        given = given[np.lexsort(keys[given].T[::-1])]
        answer = np.where(answers.n_trials > 0, 2.0 * answers.n_yes - 1.0, 0.0)
        before, previous = (
            np.r_[rest, values[:-1]]
            for rest, values in ((0.0, answer), (np.nan, keys[:, :2].mean(axis=1)))
        )
        iti = None
        if answers.iti is not None:
            until = np.where(np.isnan(answers.iti) | begins, np.inf, answers.iti)
            iti = laid_out(np.r_[until[1:], np.inf], np.inf)
        timed = keys.shape[1] > 2
        return cls(
            keys[given, 0],
            keys[given, 1],
            keys[given, 2] if timed else None,
            answers.n_yes[given],
            answers.n_trials[given],
            run_starts(*keys[given].T),
            np.where(begins, 0.0, before)[given],
            np.where(begins, np.nan, previous)[given],
            (step * shape[1] + session)[given],
            laid_out(keys[:, 0] - mu0, 0.0),
            laid_out(keys[:, 1] - mu0, 0.0),
            laid_out(keys[:, 2], float(keys[0, 2])) if timed else None,
            iti,
        )

    @property
    def n_pairs(self) -> int:
        """Rows of the likelihood, which are trials."""
        return int(self.s1.shape[-1])

    def answered(self, felt: FloatArray) -> FloatArray:
        """What is known of all trials that were felt, (steps, sessions, points), at those that were answered, (points, trials)."""
        steps, sessions, points = felt.shape
        return felt.reshape(steps * sessions, points)[self.at].T

    def by_pair(self, log_probability: FloatArray) -> FloatArray:
        """Log of the mean probability of each pair's trials, (points, trials) -> (points, pairs)."""
        highest = np.maximum.reduceat(log_probability, self.starts, axis=1)
        counts = np.diff(np.r_[self.starts, self.n_pairs])
        shares = np.exp(
            log_probability
            - np.repeat(np.where(np.isfinite(highest), highest, 0.0), counts, axis=1)
        )
        with np.errstate(divide="ignore"):  # an answer that is impossible in all trials
            return np.asarray(
                np.log(np.add.reduceat(shares, self.starts, axis=1) / counts) + highest
            )


class _Filter(NamedTuple):
    """E_{t+1} = keep E_t + add, and derivatives of both in the own coordinate; (steps, sessions, points), or 1 in their place."""

    keep: FloatArray
    add: FloatArray
    keep_slope: FloatArray
    add_slope: FloatArray


@dataclass(frozen=True)
class History:
    """How the expectation follows the stimuli; the coordinate is logit rho, log tau (seconds) or the log of the half-life (trials)."""

    kind: Literal["carry-over", "carry-over by time", "running average"]
    coordinate: str

    def expectation(self, trials: Trials, own: FloatArray, pull: FloatArray) -> FloatArray:
        """E of every trial that was felt, (steps, sessions, points), at the own coordinate, (points,), and pulls, which broadcast."""
        made = self._filter(trials, own, pull)
        return _filtered(made.keep, made.add)

    def slopes(
        self,
        trials: Trials,
        own: FloatArray,
        pull: FloatArray,
        expectation: FloatArray,
        of_pull: Sequence[FloatArray],
    ) -> list[FloatArray]:
        """Derivatives of E: in the history's coordinate, and in those coordinates in which the pull has the derivatives `of_pull`."""
        made = self._filter(trials, own, pull)
        found = [_filtered(made.keep, made.keep_slope * expectation + made.add_slope)]
        for rise in of_pull:
            if self.kind == "running average":
                found.append(np.zeros_like(expectation))
            else:
                bend = 2.0 * pull * expectation + (1.0 - 2.0 * pull) * trials.first - trials.second
                found.append(_filtered(made.keep, self._kept(trials, own)[0] * rise * bend))
        return found

    def _filter(self, trials: Trials, own: FloatArray, pull: FloatArray) -> _Filter:
        if self.kind == "running average":
            rate = np.log(2.0) * np.exp(-own)
            keep, slope, mean = (
                np.exp(-rate),
                rate * np.exp(-rate),
                0.5 * (trials.first + trials.second),
            )
            return _Filter(keep, -np.expm1(-rate) * mean, slope, -slope * mean)
        rho, slope = self._kept(trials, own)
        square, felt = np.square(pull), (1.0 - pull) * (pull * trials.first + trials.second)
        return _Filter(rho * square, rho * felt, slope * square, slope * felt)

    def _kept(self, trials: Trials, own: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Rho until the next trial, and its derivative in the own coordinate."""
        if self.kind == "carry-over":
            return expit(own), expit(own) * expit(-own)
        assert trials.iti is not None  # required where the posterior was made
        times = trials.iti * np.exp(-own)
        rho = np.exp(-times)
        return rho, np.where(np.isfinite(times), times, 0.0) * rho


def _filtered(keep: FloatArray, add: FloatArray) -> FloatArray:
    """The recursion from 0, along the first axis of `add`."""
    out = np.zeros(np.broadcast_shapes(keep.shape, add.shape))
    add = np.broadcast_to(add, out.shape)
    keep = np.broadcast_to(keep, out.shape)
    for t in range(len(out) - 1):
        np.multiply(out[t], keep[t], out=out[t + 1])
        out[t + 1] += add[t]
    return out
