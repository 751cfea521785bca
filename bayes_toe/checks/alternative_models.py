"""Other explanations of the responses: the subject guesses, swaps the keys, or has another task.

`compare_alternatives` compares each with the observer of the four models, by their evidences. So
an observer with a strong contraction, a repulsion or roved stimuli is no surprise.

Each explanation has a marginal likelihood, so that
:func:`~bayes_toe.checks.alarm_rate.evidence_limit` holds for its Bayes factor.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import starmap
from typing import NamedTuple

import numpy as np
from scipy.special import betaln

from bayes_toe.arrays import FloatArray
from bayes_toe.data.responses import response_trend
from bayes_toe.data.study import Study, Subject
from bayes_toe.data.tasks import SAME_DIFFERENT, WHICH_STRONGER
from bayes_toe.inference.engine import Precision
from bayes_toe.inference.order_evidence import unchecked_evidence

#: For each task, the task whose answers they may be by mistake.
OTHER_TASK = {SAME_DIFFERENT: WHICH_STRONGER, WHICH_STRONGER: SAME_DIFFERENT}


class Alternatives(NamedTuple):
    """Log Bayes factors of other explanations against the observer of the four models, in nats."""

    guesses: float
    swapped: float
    other_task: float


def compare_alternatives(study: Study) -> dict[str, Alternatives]:
    """The other explanations of the responses, for subjects who leave a doubt.

    A subject leaves no doubt if the responses clearly change with s2 - s1 as the task expects, if
    no two stimuli differ, or if all responses are the same. Of three answers, only 'second' and
    'first' count.

    Examples
    --------
    >>> rising = Subject("A", [0, 0.3], [0.3, 0], [27, 3], [30, 30], task=WHICH_STRONGER)
    >>> falling = Subject("B", [0, 0.3], [0.3, 0], [3, 27], [30, 30], task=WHICH_STRONGER)
    >>> doubtful = compare_alternatives(Study([rising, falling]))
    >>> [*doubtful], doubtful["B"].swapped > 10
    (['B'], True)
    """
    with_two_answers = filter(None, (subject.two_answers for subject in study))
    subjects = [subject for subject in with_two_answers if _is_doubtful(subject)]
    # Each subject with the responses as they are, then each with both response codes exchanged.
    inverted = [replace(subject, n_yes=subject.n_trials - subject.n_yes) for subject in subjects]
    both_codes = [*subjects, *inverted]

    # The log evidences of the observer and of each other explanation, (subjects,).
    observer, swapped = np.split(_log_evidence(both_codes), 2)

    n_yes = np.array([subject.n_yes.sum() for subject in subjects])
    n_trials = np.array([subject.total_trials for subject in subjects])
    # One probability p for all trials, with a uniform prior: the integral of p^k (1 - p)^(n - k).
    guesses = betaln(n_yes + 1.0, n_trials - n_yes + 1.0)

    if study.task in OTHER_TASK:
        subjects_in_other_task = [
            replace(subject, task=OTHER_TASK[study.task]) for subject in both_codes
        ]
        # Which response is which is not known in another task. Both codes have the probability 1/2.
        first_code, second_code = np.split(_log_evidence(subjects_in_other_task), 2)
        other_task = np.logaddexp(first_code, second_code) - math.log(2.0)
    else:  # no other task has three answers
        other_task = np.full(len(subjects), -np.inf)

    log_bayes_factors = np.column_stack([guesses, swapped, other_task]) - observer[:, None]
    names = [subject.name for subject in subjects]
    return dict(zip(names, starmap(Alternatives, log_bayes_factors.tolist()), strict=True))


def log_bayes_factor(changed: Subject, subject: Subject) -> float:
    """The log Bayes factor of changed responses against the responses as they are, in nats."""
    changed_evidence, evidence = _log_evidence([changed, subject])
    return float(changed_evidence - evidence)


def _is_doubtful(subject: Subject) -> bool:
    """Whether the responses do not clearly change with s2 - s1 as the task expects."""
    difference = subject.s2 - subject.s1
    # Without different stimuli, or with one response only, no explanation predicts better.
    if not difference.any() or subject.n_yes.sum() in (0, subject.total_trials):
        return False
    expected_trend = -np.abs(difference) if subject.task == SAME_DIFFERENT else difference
    covariance, variance = response_trend(subject, expected_trend / np.abs(difference).max())
    # Without variance, the trend expects the same of all pairs, and there is nothing to see. If the
    # responses follow the trend by more than 5 standard errors, no other explanation can win.
    return variance == 0.0 or covariance / math.sqrt(variance) < 5.0


def _log_evidence(subjects: Sequence[Subject]) -> FloatArray:
    """Log mean evidence of the four models by their prior probabilities, nats, (subjects,).

    NaN where it fails.
    """
    # Alarms have limits of some nats, so that a standard error of 0.2 nat is small enough. At 1000
    # draws it may be larger: a check of all subjects must not take long.
    quick = Precision(standard_error=0.2, effective_draws=50.0, most_draws=1000)
    log_evidence = np.full(len(subjects), np.nan)
    # A fixed seed gives the same study the same alarms.
    for i, evidence in enumerate(unchecked_evidence(subjects, seed=0, precision=quick)):
        if np.isfinite(evidence.log_evidence).all():
            log_evidence[i] = evidence.log_mean_evidence
    return log_evidence
