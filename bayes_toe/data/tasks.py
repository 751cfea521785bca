"""The tasks: the question after two stimuli, and the answer that is counted."""

from __future__ import annotations

import re
from collections.abc import Container, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from bayes_toe.arrays import FloatArray, IntArray
from bayes_toe.errors import InputError


@dataclass(frozen=True)
class Task:
    """A question with its answers.

    Attributes
    ----------
    name : str
        Its name in files and messages.
    title : str
        Its name on screens.
    question : str
        What participants report.
    answers : tuple of str
        What participants can answer.
    yes, no : str
        The answer that is counted, and what all other answers say; ``n_yes`` of a subject counts
        the first.
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
    answers: tuple[str, ...]
    yes: str
    no: str
    lapses: str
    compared_answer: str
    slice_stimulus: str

    @property
    def short_name(self) -> str:
        """Its name where several tasks are compared."""
        return self.name if self.has_criterion else "2AFC"

    @property
    def count(self) -> str:
        """The column of files with the counts of the answer that is counted, such as 'n_equal'."""
        return f"n_{self.yes}"

    @property
    def questions(self) -> tuple[str, ...]:
        """The answer that each question counts; three answers make two questions of two answers."""
        return self.answers[:-1]

    @property
    def counts(self) -> tuple[str, ...]:
        """The names of the counts of a subject."""
        return ("n_yes", "n_trials", "n_second")[: len(self.answers)]

    @property
    def has_criterion(self) -> bool:
        """Whether participants can answer 'equal', for which they need a criterion."""
        return "equal" in self.answers

    @property
    def has_direction(self) -> bool:
        """Whether participants can answer 'first' and 'second'."""
        return "second" in self.answers

    @property
    def has_three_answers(self) -> bool:
        """Whether participants can answer 'first', 'equal' and 'second'."""
        return len(self.answers) == 3

    def right(self, difference: FloatArray) -> FloatArray:
        """1 where the counted answer is right, -1 where another is, 0 where no answer is right.

        `difference` is s2 - s1, of any shape.

        Examples
        --------
        >>> difference = np.array([-1, 0, 1])
        >>> SAME_DIFFERENT.right(difference).tolist(), WHICH_STRONGER.right(difference).tolist()
        ([-1, 1, -1], [-1, 0, 1])
        """
        return np.where(difference == 0, 1, -1) if self.has_criterion else np.sign(difference)

    def wrong(self, difference: FloatArray, n_yes: IntArray, n_trials: IntArray) -> IntArray:
        """Numbers of wrong answers, from s2 - s1 and the numbers of the counted answer.

        It is 0 where no answer is wrong. The shapes of the arguments are broadcast.

        Examples
        --------
        >>> difference, n_yes, n_trials = np.array([-1, 0, 1]), np.array([2, 2, 2]), np.array([5])
        >>> WHICH_STRONGER.wrong(difference, n_yes, n_trials).tolist()
        [2, 0, 3]
        """
        right = self.right(difference)
        return np.select([right > 0, right < 0], [n_trials - n_yes, n_yes])


#: 'Were they the same or different?': the paper's task.
SAME_DIFFERENT = Task(
    name="same/different",
    title="same-different task",
    question="whether two successive stimuli were equal or different",
    answers=("equal", "different"),
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
    answers=("second", "first"),
    yes="second",
    no="first",
    lapses="lapse_rate",
    compared_answer="wrong",
    slice_stimulus="first",
)
#: 'Which was stronger, or were they equal?', the ternary format. ``n_second`` of a subject counts
#: 'second' among the answers that are not 'equal'.
THREE_ANSWERS = Task(
    name="three answers",
    title="three answers (first, equal, second)",
    question="which of two successive stimuli was stronger, or whether they were equal",
    answers=("equal", "second", "first"),
    yes="equal",
    no="unequal",
    lapses="q0",
    compared_answer="equal",
    slice_stimulus="weaker",
)
#: The tasks; a task with fewer answers stands before a task that has more.
TASKS = (SAME_DIFFERENT, WHICH_STRONGER, THREE_ANSWERS)
#: Names of the tasks, in small letters and digits alone.
_NAMES = {
    SAME_DIFFERENT: ["samedifferent", "samediff", "equaldifferent", "equality", "sd", "ax"],
    WHICH_STRONGER: ["whichisstronger", "which", "2afc", "2ifc", "secondfirst", "firstsecond"],
    THREE_ANSWERS: ["threeanswers", "ternary", "firstequalsecond"],
}


def task_of(name: Task | str, option: str = "--task") -> Task:
    """The task with this name, or a task as it is; without such a task, an InputError."""
    if isinstance(name, Task):
        return name
    task = task_named(str(name))
    if task is None:
        rule = f"{SAME_DIFFERENT.name}, 2afc ({WHICH_STRONGER.name}), or ternary"
        raise InputError(f"{option}: found {name!r}, allowed: {rule}")
    return task


def task_counted(columns: Container[Any]) -> Task | None:
    """The task whose answers these columns count, such as n_equal; None without such columns.

    Examples
    --------
    >>> task_counted(["n_different", "n_trials"]) == SAME_DIFFERENT
    True
    """
    answers = (*THREE_ANSWERS.answers, SAME_DIFFERENT.no)
    return task_with(answer for answer in answers if f"n_{answer}" in columns)


def are_trials(columns: Container[Any]) -> bool:
    """Whether each row of a table with these columns is a trial."""
    return task_counted(columns) is None and "n_trials" not in columns


def task_with(answers: Iterable[str]) -> Task | None:
    """The first task with these answers; None without an answer, or if no task has them all.

    Examples
    --------
    >>> task_with(["first"]) == WHICH_STRONGER, task_with(["first", "equal"]) == THREE_ANSWERS
    (True, True)
    >>> task_with(["first", "different"])
    """
    answers = set(answers)
    if not answers:
        return None
    return next((task for task in TASKS if answers <= set(task.answers)), None)


def tasks_named(texts: Iterable[str]) -> dict[str, Task]:
    """The texts that name a task, with the task.

    Examples
    --------
    >>> [*tasks_named(["2AFC", "practice"])]
    ['2AFC']
    """
    tasks = {}
    for text in texts:
        task = task_named(text)
        if task is not None:
            tasks[text] = task
    return tasks


def task_named(text: str) -> Task | None:
    """The task with this name, in any spelling; None if no task has it.

    Examples
    --------
    >>> task_named("2AFC") == WHICH_STRONGER, task_named("same / different") == SAME_DIFFERENT
    (True, True)
    >>> task_named("comparison")
    """
    plain = re.sub("[^a-z0-9]", "", text.lower())
    return next((task for task, names in _NAMES.items() if plain in names), None)
