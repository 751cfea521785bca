"""The exceptions and warnings a user may catch.

Every exception is a :class:`BayesToeError`; the command line turns each into one line per problem
and exit code 2. `Remedy` is an option that solves a problem. `with_next_questions` adds the
questions that follow the first answers. `require_kind` and `require_number` refuse arguments.
"""

from __future__ import annotations

import shlex
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from numbers import Integral, Real
from typing import Any, NamedTuple, TypeVar

Result = TypeVar("Result")


class BayesToeError(Exception):
    """Base class of all errors of this package."""


class Remedy(NamedTuple):
    """An option that solves a problem.

    Attributes
    ----------
    option : str
        Name of a parameter of :class:`bayes_toe.ReadOptions`.
    value : str or tuple of (str, str)
        Its value; for `columns` pairs of our names and those of the file.
    meaning : str
        When the option is the right one.
    question : int
        The index of the problem that it solves, among the problems of an error; below 0 the last
        problem. One remedy of each question is enough.
    step : int
        How many questions had to be answered before this question came up.
    together : tuple of Remedy
        Options that are typed with this one, and with no other answer.
    replaces : str
        The option of an answer to an earlier question that is not typed with this one.
    is_evident : bool
        Whether the file leaves no doubt that this is the answer.

    Examples
    --------
    >>> Remedy("equal_code", "1", "if 1 is 'equal'").typed
    '--equal-code 1'
    >>> Remedy("columns", (("s1", "first"), ("s2", "second"))).typed
    '--columns s1=first,s2=second'
    """

    option: str
    value: str | tuple[tuple[str, str], ...]
    meaning: str = ""
    question: int = -1
    step: int = 0
    together: tuple[Any, ...] = ()
    replaces: str = ""
    is_evident: bool = False

    @property
    def typed(self) -> str:
        """The option as it is typed on the command line; a flag has the value ''."""
        option = f"--{self.option.replace('_', '-')}"
        if self.value == "":
            return option
        text = self.value
        if not isinstance(text, str):
            text = ",".join(map("=".join, text))
        return f"{option} {shlex.quote(text)}"

    @property
    def is_complete(self) -> bool:
        """Whether the option can be typed as it is; the user fills a value NAME or REF."""
        texts = {self.value} if isinstance(self.value, str) else set(dict(self.value).values())
        return texts.isdisjoint({"NAME", "REF"})


def option_values(remedies: Iterable[Remedy]) -> dict[str, Any]:
    """The values of options by name, as parameters of :class:`bayes_toe.ReadOptions`.

    Examples
    --------
    >>> option_values([Remedy("columns", (("s1", "a"),)), Remedy("columns", (("s2", "b"),))])
    {'columns': {'s1': 'a', 's2': 'b'}}
    """
    values: dict[str, Any] = {}
    for remedy in remedies:
        if isinstance(remedy.value, str):
            values[remedy.option] = remedy.value or True  # a flag has no text
        else:
            # Several remedies may each name some of the columns.
            values[remedy.option] = {**values.get(remedy.option, {}), **dict(remedy.value)}
    return values


def python_options(remedies: Iterable[Remedy]) -> str:
    """The options of remedies as a call in Python.

    Examples
    --------
    >>> python_options([Remedy("equal_code", "1"), Remedy("standard_first", "")])
    "ReadOptions(equal_code='1', standard_first=True)"
    """
    values = option_values(remedies).items()
    return f"ReadOptions({', '.join(f'{name}={value!r}' for name, value in values)})"


class InputError(BayesToeError, ValueError):
    """The program cannot use the input. The message names fault, place and allowed values.

    Parameters
    ----------
    problems : str or iterable of str
        One line per problem.
    remedies : sequence of Remedy
        What to type, one of each question.

    Examples
    --------
    >>> InputError(["row 2: n_trials=-1", "row 3: n_trials=x"]).problems
    ('row 2: n_trials=-1', 'row 3: n_trials=x')
    """

    def __init__(self, problems: str | Iterable[str], remedies: Sequence[Remedy] = ()) -> None:
        self.problems = (problems,) if isinstance(problems, str) else tuple(problems)
        last_question = len(self.problems) - 1
        numbered = []
        for remedy in remedies:
            if remedy.question < 0:  # its default: the remedy solves the last problem
                remedy = remedy._replace(question=last_question)
            numbered.append(remedy)
        self.remedies = tuple(numbered)
        super().__init__(self.problems, self.remedies)

    def __str__(self) -> str:
        lines = list(self.problems)
        for chosen, meanings in self.choices:
            lines.append(f"use {python_options(chosen)} {', '.join(meanings)}".rstrip())
        return "\n".join(lines)

    @property
    def choices(self) -> list[tuple[list[Remedy], list[str]]]:
        """Remedies that are typed together, and when each of them is right.

        The first choice answers every question by its first remedy. Each further remedy makes a
        further choice, in which it replaces the first answer to its question. First answers to
        questions of later steps are not in a further choice, since these may not come up.

        Examples
        --------
        >>> unit = [Remedy("unit", text, question=0) for text in ("um", "ln")]
        >>> code = Remedy("second_code", "j", question=1)
        >>> for chosen, _ in InputError(["no unit", "no code"], [*unit, code]).choices:
        ...     print(*(remedy.typed for remedy in chosen))
        --unit um --second-code j
        --unit ln --second-code j

        A code that was asked for only after '--unit um' is not in the choice of 'ln'.

        >>> later_code = code._replace(step=1)
        >>> for chosen, _ in InputError(["no unit", "no code"], [*unit, later_code]).choices:
        ...     print(*(remedy.typed for remedy in chosen))
        --unit um --second-code j
        --unit ln
        """
        if not self.remedies:
            return []
        first_answers: dict[int, Remedy] = {}  # by question
        for remedy in self.remedies:
            first_answers.setdefault(remedy.question, remedy)
        first_choice = _without_replaced(first_answers.values())

        meanings = [remedy.meaning for remedy in first_choice if remedy.meaning]
        choices = [(first_choice, meanings)]
        for remedy in self.remedies:
            if remedy is first_answers[remedy.question]:
                continue
            # The first answers, but this remedy to its question.
            answers = _without_replaced({**first_answers, remedy.question: remedy}.values())
            chosen = [answer for answer in answers if answer.step <= remedy.step]
            choices.append((chosen, [remedy.meaning]))

        # The options that are typed with these remedies.
        for chosen, _ in choices:
            for remedy in list(chosen):  # a copy, because the list grows
                chosen += remedy.together
        return choices


class NoTrialsError(InputError):
    """A file that is sound but has no trial, as a session that was stopped leaves it."""


def _without_replaced(answers: Collection[Remedy]) -> list[Remedy]:
    """The answers that no other answer replaces."""
    replaced = {answer.replaces for answer in answers}
    return [answer for answer in answers if answer.option not in replaced]


def with_next_questions(
    error: InputError, options: Any, read: Callable[[Any], Result]
) -> tuple[InputError, Result | None]:
    """The error with the questions that follow, if the first remedy of each question is typed.

    `read` raised the error with `options`; it is called with these and the first remedies. Its
    result follows, or None if the first remedies are not all that is asked for.
    """
    problems = list(error.problems)
    remedies = list(error.remedies)
    step = 0
    while error.choices:
        first_choice, _ = error.choices[0]
        if not all(remedy.is_complete for remedy in first_choice):
            break
        try:
            options = with_remedies(options, first_choice)
        except InputError:
            break  # the remedies exclude a given option, which only the user can replace

        try:
            result = read(options)
            return InputError(problems, remedies), result  # nothing more is asked
        except InputError as next_error:
            error = next_error
        if not set(problems).isdisjoint(error.problems):
            break  # the remedies did not solve the problem

        step += 1
        for remedy in error.remedies:
            question = len(problems) + remedy.question  # behind the problems of earlier steps
            remedies.append(remedy._replace(question=question, step=step))
        problems += error.problems
    return InputError(problems, remedies), None


def with_remedies(options: Any, remedies: Iterable[Remedy]) -> Any:
    """The options with the values of remedies; mappings and tuples keep their earlier entries."""
    new_values = option_values(remedies)
    for name, value in new_values.items():
        earlier_value = getattr(options, name)
        if isinstance(earlier_value, Mapping):
            new_values[name] = {**earlier_value, **value}
        elif isinstance(earlier_value, tuple):
            new_values[name] = (*earlier_value, value)
    return replace(options, **new_values)


class OutputError(BayesToeError, OSError):
    """An output that cannot be written, or exists and may not be replaced."""


class OutputExistsError(OutputError):
    """An output that exists and may not be replaced.

    Parameters
    ----------
    problem : str
        What exists; the message adds how to replace it in Python.
    """

    def __init__(self, problem: str) -> None:
        self.problem = problem
        super().__init__(problem)

    def __str__(self) -> str:
        return f"{self.problem}; overwrite=True replaces it"


class WorkerError(BayesToeError, RuntimeError):
    """Work that is not done, because its processes died more than once."""


class NumericalError(BayesToeError, ArithmeticError):
    """A quantity that must be finite is not, by a bug or an impossible input."""


def require_kind(name: str, value: object, kinds: type | tuple[type, ...], rule: str) -> None:
    """Refuse the value of a parameter if it has none of these types; `rule` names them in words.

    Examples
    --------
    >>> require_kind("draws", "4000", int, "a whole number")
    Traceback (most recent call last):
    ...
    bayes_toe.errors.InputError: draws: found '4000', allowed: a whole number
    """
    if not isinstance(value, kinds):
        # The text of a table or an array would fill the screen, so these show their type.
        finding = repr(value) if isinstance(value, str | Real) else type(value).__name__
        raise InputError(f"{name}: found {finding}, allowed: {rule}")


def require_number(
    name: str, value: Any, smallest: float = 1, largest: float = 10**6, kind: type = Integral
) -> None:
    """Refuse a value that is no number of this kind (whole by default) in the range.

    Examples
    --------
    >>> require_number("draws", 0)
    Traceback (most recent call last):
    ...
    bayes_toe.errors.InputError: draws: found 0, allowed: a whole number from 1 to 1000000
    """
    words = "a whole number" if kind is Integral else "a number"
    rule = f"{words} from {smallest} to {largest}"
    require_kind(name, value, kind, rule)
    # bool is an int for Python, not for a reader; a NaN is in no range.
    if isinstance(value, bool) or not smallest <= value <= largest:
        raise InputError(f"{name}: found {value}, allowed: {rule}")


class ConvergenceWarning(UserWarning):
    """The draws of a subject did not meet the criteria of convergence."""
