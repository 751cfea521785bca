"""The prior of a group: the mean of every parameter, and the standard deviation between subjects.

    c/D, p, log(sigma_d/D), logit q0 of a subject ~ Normal(m, tau)
    c/D:               m ~ Student t, 3 df, scale .5    tau ~ half Student t, 3 df, scale .3
    p:                 m ~ Normal(0, .2)                tau ~ half-normal, scale .15
    log(sigma_d/D):    m ~ Normal(0, .6)                tau ~ half-normal, scale .4
    logit q0:          m ~ Normal(1.8, 1)               tau ~ half-normal, scale 1

D is the root mean square of s2 - s1 over unequal pairs of the whole study. The other parameters of
the observer have the prior of a single subject. Effects of covariates have the scale of tau;
differences between conditions are normal, with half the scales.

`Hyperprior` has the numbers, `read_hyperprior` reads them from a TOML file, and `HyperpriorNumbers`
computes densities and slopes for the sampler.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from bayes_toe.arrays import BoolArray, FloatArray, StrPath
from bayes_toe.data.messages import format_path
from bayes_toe.data.read_table import toml_table
from bayes_toe.data.tasks import Task
from bayes_toe.errors import InputError, require_kind
from bayes_toe.model.densities import (
    StandardNormal,
    StandardStudent,
    from_half_normal_score,
)
from bayes_toe.model.parameters import CONSTANT_ERROR, CONTRACTION, NOISE, PEAK, Parameter
from bayes_toe.model.prior_fields import real

_LARGEST = 1e3
_SMALLEST = 1e-3


class GroupParameter(NamedTuple):
    """A parameter of which subjects have a normal distribution.

    Attributes
    ----------
    parameter : Parameter
    label : str
        In tables, on the scale on which subjects are normally distributed.
    """

    parameter: Parameter
    label: str

    @property
    def name(self) -> str:
        """The name in files."""
        return self.parameter.name


_GROUP_PARAMETERS = (
    GroupParameter(CONSTANT_ERROR, "constant error, D"),
    GroupParameter(CONTRACTION, "contraction"),
    GroupParameter(NOISE, "log(sigma_d/D)"),
    GroupParameter(PEAK, "logit q0"),
)


def group_parameters(task: Task) -> tuple[GroupParameter, ...]:
    """The parameters that the group has a distribution of.

    Examples
    --------
    >>> from bayes_toe.data.tasks import WHICH_STRONGER
    >>> [parameter.name for parameter in group_parameters(WHICH_STRONGER)]
    ['constant_error', 'contraction', 'noise']
    """
    return tuple(row for row in _GROUP_PARAMETERS if task in row.parameter.tasks)


@dataclass(frozen=True)
class ParameterHyperprior:
    """The prior of the mean and of the standard deviation between subjects of one parameter.

    Attributes
    ----------
    mean : float
        Centre of the prior of the mean.
    mean_scale, sd_scale : float
        Scale of the prior of the mean, and of the prior of the standard deviation.
    has_heavy_tails : bool
        Whether both are Student's t with 3 degrees of freedom; otherwise they are normal.
    """

    mean: float
    mean_scale: float
    sd_scale: float
    has_heavy_tails: bool = False

    @property
    def difference(self) -> ParameterHyperprior:
        """The prior of a difference between two conditions: normal, half as wide."""
        return ParameterHyperprior(0.0, 0.5 * self.mean_scale, 0.5 * self.sd_scale)

    def narrowed(self, share: float) -> ParameterHyperprior:
        """The same with scales of this share."""
        mean_scale, sd_scale = share * self.mean_scale, share * self.sd_scale
        return replace(self, mean_scale=mean_scale, sd_scale=sd_scale)

    @property
    def words(self) -> str:
        """Both distributions."""
        if self.has_heavy_tails:
            family = "Student t, 3 df,"
            return (
                f"mean ~ {family} centre {self.mean:g}, scale {self.mean_scale:g}; "
                f"SD between subjects ~ half {family} scale {self.sd_scale:g}"
            )
        return (
            f"mean ~ Normal({self.mean:g}, {self.mean_scale:g}); "
            f"SD between subjects ~ half-normal, scale {self.sd_scale:g}"
        )


@dataclass(frozen=True)
class Hyperprior:
    """The prior of a group, with a field for each parameter.

    Constant errors and noise are in units of D.

    Examples
    --------
    >>> wide = Hyperprior().changed({"contraction": {"mean_scale": 0.6}})
    >>> wide.contraction.words
    'mean ~ Normal(0, 0.6); SD between subjects ~ half-normal, scale 0.15'
    """

    constant_error: ParameterHyperprior = field(
        default=ParameterHyperprior(0.0, 0.5, 0.3, has_heavy_tails=True)
    )
    contraction: ParameterHyperprior = field(default=ParameterHyperprior(0.0, 0.2, 0.15))
    noise: ParameterHyperprior = field(default=ParameterHyperprior(0.0, 0.6, 0.4))
    q0: ParameterHyperprior = field(default=ParameterHyperprior(1.8, 1.0, 1.0))

    def __post_init__(self) -> None:
        sections = asdict(self)
        for row in sections.values():
            del row["has_heavy_tails"]
        _require("hyperprior", sections)

    def changed(
        self, sections: Mapping[str, Mapping[str, float]], source: str = "hyperprior"
    ) -> Hyperprior:
        """The same with other numbers, by parameter and number; errors name the source.

        Raises
        ------
        InputError
            For an unknown parameter or number, and for a number that is out of range.
        """
        _require(source, sections)
        rows = {name: replace(getattr(self, name), **row) for name, row in sections.items()}
        return replace(self, **rows)

    def describe(self, task: Task) -> tuple[str, ...]:
        """A line for each parameter of a task."""
        return tuple(
            f"{row.label}: {getattr(self, row.name).words}" for row in group_parameters(task)
        )


#: Numbers of a section of a hyperprior file.
NUMBERS = ("mean", "mean_scale", "sd_scale")
_SECTIONS = tuple(row.name for row in fields(Hyperprior))


def hyperprior_from(value: Hyperprior | StrPath | None) -> Hyperprior:
    """A hyperprior, the one in the file of a path, or the default one."""
    if value is None:
        return Hyperprior()
    if isinstance(value, Hyperprior):
        return value
    kinds = "a Hyperprior, or the path of a TOML file"
    require_kind("hyperprior", value, (str, os.PathLike), kinds)
    return read_hyperprior(value)


def read_hyperprior(path: StrPath) -> Hyperprior:
    """The hyperprior in a TOML file with a section per parameter; what it omits is the default.

    Raises
    ------
    InputError
        If the file cannot be read, or if it names something that is unknown or out of range.
    """
    example = "NUMBER = VALUE below a line [PARAMETER], as in sd_scale = 0.3 below [contraction]"
    return Hyperprior().changed(toml_table(path, example), format_path(Path(path)))


def _require(source: str, sections: Mapping[str, Any]) -> None:
    """Refuse unknown names and numbers out of range, a line for each."""
    problems = []
    for name, section in sections.items():
        if name not in _SECTIONS or not isinstance(section, Mapping):
            problems.append(f"no section {name!r}, allowed: {', '.join(_SECTIONS)}")
            continue
        for key, value in section.items():
            if key not in NUMBERS:
                problems.append(f"[{name}] no number {key!r}, allowed: {', '.join(NUMBERS)}")
                continue
            least = -_LARGEST if key == "mean" else _SMALLEST
            if not least <= real(value) <= _LARGEST:
                number_range = f"a number from {least:g} to {_LARGEST:g}"
                problems.append(f"[{name}] {key} is {value!r}; allowed is {number_range}")
    if problems:
        raise InputError("\n".join(f"{source}: {problem}" for problem in problems))


# --- As arrays -----------------------------------------------------------------------------------


class StandardDeviations(NamedTuple):
    """Standard deviations between subjects by their scores, (..., coefficients) each.

    Attributes
    ----------
    values : ndarray
    rise : ndarray
        Their derivatives in the scores.
    log_prior, prior_slope : ndarray
        Log prior density of each score, without a constant, and its derivative.
    """

    values: FloatArray
    rise: FloatArray
    log_prior: FloatArray
    prior_slope: FloatArray


class HyperpriorNumbers(NamedTuple):
    """The numbers of several coefficients, shape (coefficients,) each."""

    mean: FloatArray
    mean_scale: FloatArray
    sd_scale: FloatArray
    has_heavy_tails: BoolArray

    @classmethod
    def from_rows(cls, rows: list[ParameterHyperprior]) -> HyperpriorNumbers:
        """The numbers of some rows, as arrays."""
        return cls(
            np.array([row.mean for row in rows]),
            np.array([row.mean_scale for row in rows]),
            np.array([row.sd_scale for row in rows]),
            np.array([row.has_heavy_tails for row in rows]),
        )

    def log_prior_of_mean(self, mean: FloatArray) -> FloatArray:
        """Log prior density of each mean, (..., coefficients)."""
        return self._log_density((mean - self.mean) / self.mean_scale) - np.log(self.mean_scale)

    def slope_of_mean_prior(self, mean: FloatArray) -> FloatArray:
        """Its derivative."""
        return self._slope((mean - self.mean) / self.mean_scale) / self.mean_scale

    def sds(self, score: FloatArray) -> StandardDeviations:
        """Standard deviations from their scores, (..., coefficients).

        The score is the standard normal quantile of the probability that a half-normal variable
        is smaller. Where the data do not show that subjects differ, the posterior of a score has
        a normal tail; that of a log SD has a long one.
        """
        normal = StandardNormal()
        u = from_half_normal_score(score)
        rise = 0.5 * np.exp(0.5 * (np.square(u) - np.square(score)))
        log_prior = normal.log_density(score) + self._log_density(u) - normal.log_density(u)
        slope = (self._slope(u) + u) * rise - score
        return StandardDeviations(self.sd_scale * u, self.sd_scale * rise, log_prior, slope)

    def log_effect(self, effect: FloatArray) -> FloatArray:
        """Log prior density of a covariate's effects: Normal(0, sd_scale)."""
        density = StandardNormal().log_density(effect / self.sd_scale)
        return density - np.log(self.sd_scale)

    def effect_slope(self, effect: FloatArray) -> FloatArray:
        """Its derivative."""
        return -effect / np.square(self.sd_scale)

    def _log_density(self, u: FloatArray) -> FloatArray:
        student, normal = StandardStudent().log_density(u), StandardNormal().log_density(u)
        return np.where(self.has_heavy_tails, student, normal)

    def _slope(self, u: FloatArray) -> FloatArray:
        student, normal = StandardStudent().slope(u), StandardNormal().slope(u)
        return np.where(self.has_heavy_tails, student, normal)
