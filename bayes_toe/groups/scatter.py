"""How members scatter about the mean of their group: normal, or with Student's tails, which let single members be far away."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.special import ndtri, stdtrit

from bayes_toe.arrays import FloatArray
from bayes_toe.errors import InputError
from bayes_toe.model.distributions import LOG_2PI, Random


class Scatter(Protocol):
    """A density of scores u, member less mean over tau, symmetric about 0."""

    @property
    def name(self) -> str:
        """The word for it."""
        ...

    def log_density(self, u: FloatArray) -> FloatArray:
        """Normalised log density, shape (...)."""
        ...

    def slope(self, u: FloatArray) -> FloatArray:
        """Its derivative, shape (...)."""
        ...

    def sample(self, rng: Random, shape: tuple[int, ...]) -> FloatArray:
        """Independent scores."""
        ...

    def quantile(self, p: FloatArray) -> FloatArray:
        """Scores below which these probabilities lie."""
        ...

    def precisions(self, rng: Random, u: FloatArray) -> FloatArray:
        """Draws of the precision with which each score, given its value, may count as a normal one."""
        ...


@dataclass(frozen=True)
class NormalScatter:
    """Standard normal scores; tau is their standard deviation."""

    name: str = "normal"

    def log_density(self, u: FloatArray) -> FloatArray:
        """-u^2/2 - ln(2 pi)/2."""
        return np.asarray(-0.5 * (np.square(u) + LOG_2PI))

    def slope(self, u: FloatArray) -> FloatArray:
        """-u."""
        return np.asarray(-u)

    def sample(self, rng: Random, shape: tuple[int, ...]) -> FloatArray:
        """Independent scores."""
        return rng.standard_normal(shape)

    def quantile(self, p: FloatArray) -> FloatArray:
        """Of the standard normal."""
        return np.asarray(ndtri(p))

    def precisions(self, rng: Random, u: FloatArray) -> FloatArray:
        """One: it is normal."""
        return np.ones(u.shape)


@dataclass(frozen=True)
class StudentScatter:
    """Scores of Student's t with 4 degrees of freedom; tau is their scale, 1/2^(1/2) of the standard deviation."""

    name: str = "t"

    def log_density(self, u: FloatArray) -> FloatArray:
        """ln(3/8) - (5/2) ln(1 + u^2/4)."""
        return np.asarray(np.log(0.375) - 2.5 * np.log1p(0.25 * np.square(u)))

    def slope(self, u: FloatArray) -> FloatArray:
        """-5 u / (4 + u^2)."""
        return np.asarray(-5.0 * u / (4.0 + np.square(u)))

    def sample(self, rng: Random, shape: tuple[int, ...]) -> FloatArray:
        """Independent scores."""
        return rng.standard_t(4, shape)

    def quantile(self, p: FloatArray) -> FloatArray:
        """Of t with 4 degrees of freedom."""
        return np.asarray(stdtrit(4.0, p))

    def precisions(self, rng: Random, u: FloatArray) -> FloatArray:
        """Student's t is normal with a precision of Gamma(2, rate 2), which given the score is Gamma(5/2, rate 2 + u^2/2)."""
        return np.asarray(rng.standard_gamma(2.5, u.shape) / (2.0 + 0.5 * np.square(u)))


SCATTERS: dict[str, Scatter] = {one.name: one for one in (NormalScatter(), StudentScatter())}


def scatter_named(name: str) -> Scatter:
    """The scatter of this name.

    Raises
    ------
    InputError
        If there is none.

    Examples
    --------
    >>> scatter_named("t").log_density(np.zeros(1)).round(4).tolist()
    [-0.9808]
    """
    if name not in SCATTERS:
        raise InputError(f"population {name!r}: allowed: {', '.join(SCATTERS)}")
    return SCATTERS[name]
