"""The exceptions and warnings a user may catch.

Every exception is a :class:`BayesToeError`; the command line turns each into one line per problem and exit code 2.
"""

from __future__ import annotations

from collections.abc import Iterable
from numbers import Real


class BayesToeError(Exception):
    """Root of every error that this package raises on purpose."""


class InputError(BayesToeError, ValueError):
    """Input that cannot be used: says what, where, and what is allowed.

    Parameters
    ----------
    problems : str or iterable of str
        One line per problem.

    Examples
    --------
    >>> InputError(["row 2: n_trials=-1", "row 3: n_trials=x"]).problems
    ('row 2: n_trials=-1', 'row 3: n_trials=x')
    """

    def __init__(self, problems: str | Iterable[str]) -> None:
        self.problems: tuple[str, ...] = (
            (problems,) if isinstance(problems, str) else tuple(problems)
        )
        super().__init__("\n".join(self.problems))

    def __reduce__(self) -> tuple[type[InputError], tuple[tuple[str, ...]]]:
        # Errors cross process borders when subjects run in parallel.
        return type(self), (self.problems,)


class OutputError(BayesToeError, OSError):
    """An output that cannot be written, or exists and may not be replaced."""


class WorkerError(BayesToeError, RuntimeError):
    """Work that cannot be had: the processes that did it died, more than once."""


class NumericalError(BayesToeError, ArithmeticError):
    """A quantity that has to be finite was not: a bug or an impossible input, never hidden."""


def require_kind(name: str, given: object, kinds: type | tuple[type, ...], allowed: str) -> None:
    """Refuse what is of another kind than its parameter takes.

    Examples
    --------
    >>> require_kind("draws", "4000", int, "a whole number from 1")
    Traceback (most recent call last):
    ...
    bayes_toe.errors.InputError: draws: found '4000', allowed: a whole number from 1
    """
    if not isinstance(given, kinds):
        found = repr(given) if isinstance(given, str | Real) else type(given).__name__
        raise InputError(f"{name}: found {found}, allowed: {allowed}")


def require_share(name: str, given: float) -> None:
    """Refuse a number that does not lie between 0 and 1."""
    require_kind(name, given, Real, "a number between 0 and 1")
    if not 0.0 < given < 1.0:
        raise InputError(f"{name}={given:g} must lie between 0 and 1")


class ConvergenceWarning(UserWarning):
    """A subject's draws did not meet the stated convergence criteria."""
