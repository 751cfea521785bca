"""What observers are asked after two stimuli in sequence, and which of the two answers is counted."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Task:
    """A question with two answers.

    Attributes
    ----------
    name : str
        What files and messages call it.
    yes, no : str
        The answer that is counted, and the other one; ``n_yes`` of a subject counts the first.
    lapses : str
        The fourth parameter of the paper's observer in this task: how answers come that the curve does not explain.
    """

    name: str
    yes: str
    no: str
    lapses: str

    @property
    def count(self) -> str:
        """The column of files that has how often the first answer was given."""
        return f"n_{self.yes}"


#: 'Were they the same or different?': the paper's task.
SAME_DIFFERENT = Task("same/different", "equal", "different", "q0")
#: 'Which was stronger (longer, louder, heavier)?', also called 2AFC and 2IFC.
WHICH_STRONGER = Task("which is stronger", "second", "first", "lapse_rate")
TASKS = (SAME_DIFFERENT, WHICH_STRONGER)
