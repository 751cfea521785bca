"""The tasks: the question after two stimuli, and the answer that is counted."""

from __future__ import annotations

import re
from collections.abc import Container
from dataclasses import dataclass
from typing import Any

import numpy as np

from bayes_toe.arrays import FloatArray, IntArray
from bayes_toe.errors import InputError


@dataclass(frozen=True)
class Task:
    """A question with two answers.

    Attributes
    ----------
    name : str
        Its name in files and messages.
    title : str
        Its name on screens.
    question : str
        What participants report.
    yes, no : str
        The answer that is counted, and the other one; ``n_yes`` of a subject counts the first.
    lapses : str
        The fourth parameter of the paper's observer in this task: how answers come that the curve
        does not explain.
    compared_answer : str
        The answer whose shares in both orders the asymmetry compares: `yes`, or "wrong".
    slice_stimulus : str
        The stimulus that all pairs of a slice of the explorer share.
    """

    name: str
    title: str
    question: str
    yes: str
    no: str
    lapses: str
    compared_answer: str
    slice_stimulus: str

    @property
    def count(self) -> str:
        """The column of files that has how often the first answer was given."""
        return f"n_{self.yes}"

    def right(self, difference: FloatArray) -> FloatArray:
        """1 where the counted answer is right, -1 where the other one is, 0 where neither is.

        It depends on the difference s2 - s1.

        Examples
        --------
        >>> difference = np.array([-1, 0, 1])
        >>> SAME_DIFFERENT.right(difference).tolist(), WHICH_STRONGER.right(difference).tolist()
        ([-1, 1, -1], [-1, 0, 1])
        """
        return np.where(difference == 0, 1, -1) if self == SAME_DIFFERENT else np.sign(difference)

    def wrong(self, difference: FloatArray, n_yes: IntArray, n_trials: IntArray) -> IntArray:
        """Numbers of wrong answers, from s2 - s1 and the numbers of the counted answer.

        0 where neither is wrong. Broadcasts.

        Examples
        --------
        >>> difference, n_yes, n_trials = np.array([-1, 0, 1]), np.array([2, 2, 2]), np.array([5])
        >>> WHICH_STRONGER.wrong(difference, n_yes, n_trials).tolist()
        [2, 0, 3]
        """
        right = self.right(difference)
        return np.where(right > 0, n_trials - n_yes, np.where(right < 0, n_yes, 0))


#: 'Were they the same or different?': the paper's task.
SAME_DIFFERENT = Task(
    name="same/different",
    title="same-different task",
    question="whether two successive stimuli were equal or different",
    yes="equal",
    no="different",
    lapses="q0",
    compared_answer="equal",
    slice_stimulus="weaker",
)
#: 'Which was stronger (longer, louder, heavier)?', also called 2AFC and 2IFC.
WHICH_STRONGER = Task(
    name="which is stronger",
    title="which was stronger (2AFC)",
    question="which of two successive stimuli was stronger",
    yes="second",
    no="first",
    lapses="lapse_rate",
    compared_answer="wrong",
    slice_stimulus="first",
)
TASKS = (SAME_DIFFERENT, WHICH_STRONGER)
_CALLED = {
    SAME_DIFFERENT: {"samedifferent", "equaldifferent"},
    WHICH_STRONGER: {"whichisstronger", "2afc", "2ifc", "secondfirst", "firstsecond"},
}


def task_of(given: Task | str, option: str = "--task") -> Task:
    """The task, or the one that is called so; an InputError of an option where none is."""
    if isinstance(given, Task):
        return given
    task = task_named(given) if isinstance(given, str) else None
    if task is None:
        allowed = f"{SAME_DIFFERENT.name}, or 2afc ({WHICH_STRONGER.name})"
        raise InputError(f"{option}: found {given!r}, allowed: {allowed}")
    return task


def task_counted(columns: Container[Any]) -> Task | None:
    """The task whose answer these columns count; None where none does."""
    return next((task for task in TASKS if task.count in columns), None)


def task_named(text: str) -> Task | None:
    """The task that somebody calls so; None where none is.

    Examples
    --------
    >>> task_named("2AFC") == WHICH_STRONGER, task_named("same / different") == SAME_DIFFERENT
    (True, True)
    >>> task_named("comparison")
    """
    plain = re.sub("[^a-z0-9]", "", text.lower())
    return next((task for task, names in _CALLED.items() if plain in names), None)
