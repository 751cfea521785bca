"""The exceptions and warnings a user may catch.

Every exception is a :class:`BayesToeError`; the command line turns each into one line per problem
and exit code 2. `Remedy` is an option that solves a problem. `require_kind` and `require_share`
refuse arguments.
"""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Sequence
from numbers import Real
from typing import NamedTuple


class BayesToeError(Exception):
    """Root of every error that this package raises on purpose."""


class Remedy(NamedTuple):
    """An option that solves a problem.

    Attributes
    ----------
    option : str
        Name of a parameter of :class:`bayes_toe.ReadOptions`.
    value : str or tuple of (str, str)
        Its value; for `columns` pairs of our names and those of the file.
    meaning : str
        When it is the right one.

    Examples
    --------
    >>> remedy = Remedy("equal_code", "1", "if 1 is 'equal'")
    >>> remedy.typed, remedy.python
    ('--equal-code 1', "ReadOptions(equal_code='1')")
    >>> Remedy("columns", (("s1", "first"), ("s2", "second"))).typed
    '--columns s1=first,s2=second'
    """

    option: str
    value: str | tuple[tuple[str, str], ...]
    meaning: str = ""

    @property
    def typed(self) -> str:
        """On the command line; an option without a value has the value ''."""
        option = f"--{self.option.replace('_', '-')}"
        if self.value == "":
            return option
        text = self.value
        if not isinstance(text, str):
            text = ",".join(f"{ours}={theirs}" for ours, theirs in text)
        return f"{option} {shlex.quote(text)}"

    @property
    def python(self) -> str:
        """The name in Python."""
        value: object = dict(self.value) if isinstance(self.value, tuple) else self.value or True
        return f"ReadOptions({self.option}={value!r})"


class InputError(BayesToeError, ValueError):
    """Input that cannot be used: says what, where, and what is allowed.

    Parameters
    ----------
    problems : str or iterable of str
        One line per problem.
    remedies : sequence of Remedy
        What to type instead, one of them.

    Examples
    --------
    >>> InputError(["row 2: n_trials=-1", "row 3: n_trials=x"]).problems
    ('row 2: n_trials=-1', 'row 3: n_trials=x')
    """

    def __init__(self, problems: str | Iterable[str], remedies: Sequence[Remedy] = ()) -> None:
        self.problems: tuple[str, ...] = (
            (problems,) if isinstance(problems, str) else tuple(problems)
        )
        self.remedies = tuple(remedies)
        use = [f"use {remedy.python} {remedy.meaning}".rstrip() for remedy in self.remedies]
        super().__init__("\n".join([*self.problems, *use]))

    def __reduce__(self) -> tuple[type[InputError], tuple[tuple[str, ...], tuple[Remedy, ...]]]:
        # Errors cross process borders when subjects run in parallel.
        return type(self), (self.problems, self.remedies)


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
        super().__init__(f"{problem}; overwrite=True replaces it")

    def __reduce__(self) -> tuple[type[OutputExistsError], tuple[str]]:
        return type(self), (self.problem,)


class WorkerError(BayesToeError, RuntimeError):
    """Work that cannot be had: the processes that did it died, more than once."""


class NumericalError(BayesToeError, ArithmeticError):
    """A quantity that has to be finite was not: a bug or an impossible input, never hidden."""


def require_kind(name: str, given: object, kinds: type | tuple[type, ...], rule: str) -> None:
    """Refuse what is of another kind than its parameter takes.

    Examples
    --------
    >>> require_kind("draws", "4000", int, "a whole number from 1")
    Traceback (most recent call last):
    ...
    bayes_toe.errors.InputError: draws: found '4000', allowed: a whole number from 1
    """
    if not isinstance(given, kinds):
        finding = repr(given) if isinstance(given, str | Real) else type(given).__name__
        raise InputError(f"{name}: found {finding}, allowed: {rule}")


def require_share(name: str, given: float) -> None:
    """Refuse a number that does not lie between 0 and 1."""
    require_kind(name, given, Real, "a number between 0 and 1")
    if not 0.0 < given < 1.0:
        raise InputError(f"{name}={given:g} must lie between 0 and 1")


class ConvergenceWarning(UserWarning):
    """A subject's draws did not meet the stated convergence criteria."""
