"""The prior of a population: where the means of the group parameters lie, how far subjects lie apart, what covariates may do.

    eta_ik ~ Normal(m_k + x_i' beta_k, tau_k^2),
    m_k ~ Normal(mean, mean_sd),  tau_k ~ HalfNormal(sd_scale),  beta_k ~ Normal(0, effect_sd),  R ~ LKJ(lkj), independent.

Every parameter eta is declared once, in :data:`GROUP_PARAMETERS`; what reads, shows, stores or varies numbers iterates over these.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import log
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.data.conditions import Stimuli
from bayes_toe.data.messages import quoted
from bayes_toe.data.study import Study
from bayes_toe.errors import InputError, require_kind
from bayes_toe.model.prior_fields import (
    LARGEST,
    LOG_INTENSITY,
    SMALLEST,
    STIMULI,
    Kind,
    PriorField,
    number_problems,
    real,
    shown,
    toml_table,
)

#: A number, or the key of :data:`bayes_toe.model.prior_fields.OF_STIMULI` that gives it.
Default = float | Literal["M", "2.5 R", "0.5/R", "D/2", "log D", "0.3 D"]

#: The numbers of every group parameter, on its scale.
NUMBERS: tuple[tuple[str, Kind, str], ...] = (
    ("mean", "location", "mean of the normal prior of the population mean of {}"),
    ("mean_sd", "scale", "its standard deviation"),
    ("sd_scale", "scale", "scale of the half-normal prior of the sd between subjects"),
    ("effect_sd", "scale", "sd of the normal prior, about 0, of a covariate's effect"),
)


class GroupParameter(NamedTuple):
    """A parameter that a population of subjects has a normal distribution of, on a scale, where it is called eta.

    By the probit an edge is infinitely far, and Uniform(0, top) is Normal(0, 1). Default numbers, on the scale, are those of
    m ~ Normal(mean, mean_sd), tau ~ HalfNormal(sd_scale).
    """

    name: str  # the section in a hyperprior file
    words: str
    scale: Literal["identity", "log", "probit"]
    mean: Default
    mean_sd: Default
    sd_scale: Default
    unit: str = ""  # of eta; empty for a pure number
    top: float = 1.0  # of a probit: the parameter's largest value

    @property
    def effect_sd(self) -> Default:
        """Default of beta ~ Normal(0, effect_sd): groups may differ by as much as subjects do.

        A sd of a covariate, or a level of a category, that moved subjects much further than they lie apart would be seen without a model;
        and the wider the prior, the more a Savage-Dickey ratio says 'no difference' by its width alone.
        """
        return self.sd_scale

    @property
    def label(self) -> str:
        """Eta in words.

        Examples
        --------
        >>> [GROUP_PARAMETERS[name].label for name in ("mu1", "width", "gamma", "gain", "offset")]
        ['mu1', 'log width', 'probit gamma', 'probit(gain/2)', 'constant error']
        """
        if self.scale == "identity":
            return "constant error" if self.name == "offset" else self.name
        return (
            f"{self.scale} {self.name}"
            if self.top == 1.0
            else f"{self.scale}({self.name}/{self.top:g})"
        )

    @property
    def fields(self) -> dict[str, PriorField]:
        """Its numbers as a file has them, by name."""
        found = {}
        for name, kind, words in NUMBERS:
            default: Default = getattr(self, name)
            number: float | Literal["stimuli"] = STIMULI if isinstance(default, str) else default
            stimuli = default if isinstance(default, str) else ""
            least = -LARGEST if kind == "location" else SMALLEST
            found[name] = PriorField(
                name,
                number,
                self.name,
                kind,
                words.format(self.label),
                self.unit,
                least,
                LARGEST,
                stimuli,
            )
        return found


_DECLARED = (
    GroupParameter(
        "mu1", "mean of the prior belief", "identity", "M", "2.5 R", "2.5 R", LOG_INTENSITY
    ),
    GroupParameter("gamma", "noise ratio (sigma_l/sigma_p)^2", "probit", 0.0, 1.0, 1.0),
    GroupParameter("width", "width w of the curve", "log", "log D", 1.0, 0.7),
    GroupParameter("q0", "P(equal) of equal stimuli", "probit", 1.0, 0.7, 0.7),
    # Of q0, lapse rate and icc the population's mean has what a single subject's prior is by default on this scale.
    GroupParameter(
        "lapse_rate", "share of answers that do not depend on the stimuli", "probit", -1.5, 0.6, 0.7
    ),
    GroupParameter("icc", "intra-class correlation of answers", "probit", -1.5, 0.6, 0.7),
    GroupParameter("pull", "pull of a memory that decays", "probit", 0.0, 1.0, 1.0),
    GroupParameter(
        "split",
        "share v of the decay in that pull, rho = g^v and K = g^(1 - v)",
        "probit",
        0.0,
        1.0,
        1.0,
    ),
    GroupParameter("gain", "weight of the first stimulus", "probit", 0.0, 0.4, 0.4, top=2.0),
    GroupParameter("exponent", "exponent of the curve", "log", log(2.0), 0.5, 0.5),
    GroupParameter(
        "noise_slope",
        "slope of the noise, 0 for Weber's law",
        "identity",
        0.0,
        "0.5/R",
        "0.5/R",
        f"1/({LOG_INTENSITY})",
    ),
    GroupParameter("offset", "constant error", "identity", 0.0, "D/2", "D/2", LOG_INTENSITY),
    GroupParameter(
        "peak_slope",
        "slope of logit q0, 0 for one peak",
        "identity",
        0.0,
        "0.5/R",
        "0.5/R",
        f"1/({LOG_INTENSITY})",
    ),
    GroupParameter(
        "carry_over",
        "share of what was felt that is left in the next trial",
        "probit",
        0.0,
        1.0,
        1.0,
    ),
    GroupParameter(
        "carry_over_tau",
        "time in which that share falls to a third, seconds",
        "log",
        log(5.0),
        1.0,
        0.7,
    ),
    GroupParameter(
        "half_life", "trials in which a running average forgets half", "log", log(1.5), 1.2, 0.7
    ),
    GroupParameter(
        "answer_bias", "bias by the answer before", "identity", 0.0, "0.3 D", "0.3 D", LOG_INTENSITY
    ),
)
#: Those that a population can be asked for, by name.
GROUP_PARAMETERS = {one.name: one for one in _DECLARED}
#: The section of what holds for all parameters together, and its number.
CORRELATIONS = "correlations"
LKJ = PriorField(
    "lkj",
    2.0,
    CORRELATIONS,
    "shape",
    "shape of the LKJ prior of correlations between parameters; 1: uniform",
    "",
    SMALLEST,
    LARGEST,
)


#: Sections of a hyperprior file: their numbers by name.
_FIELDS = {one.name: one.fields for one in _DECLARED} | {CORRELATIONS: {LKJ.name: LKJ}}
_NAMES = tuple(name for name, _, _ in NUMBERS)


class HyperpriorNumbers(NamedTuple):
    """Those of some group parameters on their scales, arrays of shape (parameters,), and the shape of the prior of correlations."""

    mean: FloatArray
    mean_sd: FloatArray
    sd_scale: FloatArray
    effect_sd: FloatArray
    lkj: float


@dataclass(frozen=True)
class Hyperprior:
    """Numbers of the prior of a population; :meth:`changed` gives one with others, :func:`read_hyperprior` that of a file.

    Parameters
    ----------
    values : tuple of tuple of float or "stimuli"
        Mean, mean_sd, sd_scale and effect_sd of every group parameter, in the order of their declaration, then what holds for all of them;
        "stimuli" becomes a number where the hyperprior meets a study, :meth:`for_study`.

    Raises
    ------
    InputError
        If one is not a number in its range.

    Examples
    --------
    >>> Hyperprior().changed({"gamma": {"sd_scale": 0.5}}).describe(["gamma", "offset"])[0]
    'probit gamma: mean ~ Normal(0, 1), sd between subjects ~ HalfNormal(0.5), effect ~ Normal(0, 1)'
    """

    values: tuple[tuple[float | str, ...], ...] = tuple(
        tuple(one.default for one in fields.values() if one.default is not None)
        for fields in _FIELDS.values()
    )

    def __post_init__(self) -> None:
        _require("hyperprior", self.as_dict())

    def changed(self, sections: Mapping[str, Mapping[str, float | str]]) -> Hyperprior:
        """The hyperprior with some other numbers, by parameter and number.

        Raises
        ------
        InputError
            For an unknown parameter or number, and for one that is out of range.
        """
        _require("hyperprior", sections)
        whole = (
            {**section, **sections.get(name, {})}.values()
            for name, section in self.as_dict().items()
        )
        return Hyperprior(
            tuple(
                tuple(one if one == STIMULI else real(one) for one in section) for section in whole
            )
        )

    def for_study(self, study: Study) -> Hyperprior:
        """With numbers in the place of "stimuli", the same for all models of the study.

        Raises
        ------
        InputError
            If the stimuli have no scale: no pair has different ones.

        Examples
        --------
        >>> from bayes_toe.data.study import Subject
        >>> study = Study([Subject("S", [0.0, 0.5], [0.0, 2.0], [9, 4], [10, 10])])
        >>> Hyperprior().for_study(study).describe(["mu1"])[0]
        'mu1: mean ~ Normal(0.625, 2.0492), sd between subjects ~ HalfNormal(2.0492), effect ~ Normal(0, 2.0492), natural-log intensity'
        """
        found = {
            name: {key: value for key, value in section.items() if value == STIMULI}
            for name, section in self.as_dict().items()
        }
        if not any(found.values()):
            return self
        stimuli = Stimuli.of(*study)
        if stimuli is None:
            raise InputError(
                f"{STIMULI!r} in a hyperprior needs pairs of different stimuli, found none; allowed: numbers"
            )
        return self.changed(
            {
                name: {key: stimuli.number(_FIELDS[name][key].stimuli) for key in keys}
                for name, keys in found.items()
            }
        )

    def numbers(self, names: Sequence[str]) -> HyperpriorNumbers:
        """Those of some parameters, in this order.

        Raises
        ------
        InputError
            For an unknown parameter, and where a number is still that of the stimuli.

        Examples
        --------
        >>> Hyperprior().numbers(["q0", "gamma"]).mean.tolist()
        [1.0, 0.0]
        """
        sections = self._sections(names)
        for name, section in sections.items():
            for key, value in section.items():
                if value == STIMULI:
                    raise InputError(
                        f"hyperprior: {key} of {name} is that of the stimuli; Hyperprior.for_study(study) puts in the number"
                    )
        lkj = real(self.as_dict()[CORRELATIONS][LKJ.name])
        mean, mean_sd, sd_scale, effect_sd = (
            np.array([sections[name][key] for name in names], np.float64) for key in _NAMES
        )
        return HyperpriorNumbers(mean, mean_sd, sd_scale, effect_sd, lkj)

    def describe(self, names: Sequence[str], *, correlations: bool = False) -> tuple[str, ...]:
        """A line for each of some parameters, and one for their correlations.

        Raises
        ------
        InputError
            For an unknown parameter.
        """
        law = "{}: mean ~ Normal({mean}, {mean_sd}), sd between subjects ~ HalfNormal({sd_scale}), effect ~ Normal(0, {effect_sd})"
        lines = []
        for name, section in self._sections(names).items():
            known = {key: field.stimuli for key, field in _FIELDS[name].items()}
            said = {
                key: known[key] if value == STIMULI else f"{value:g}"
                for key, value in section.items()
            }
            parameter = GROUP_PARAMETERS[name]
            lines.append(
                ", ".join(
                    part for part in (law.format(parameter.label, **said), parameter.unit) if part
                )
            )
        return (
            *lines,
            *(
                [f"correlations ~ LKJ({self.as_dict()[CORRELATIONS][LKJ.name]:g})"]
                if correlations
                else []
            ),
        )

    def as_dict(self) -> dict[str, dict[str, float | str]]:
        """All numbers by parameter and name, as JSON has them."""
        return {
            name: dict(zip(fields, values, strict=True))
            for (name, fields), values in zip(_FIELDS.items(), self.values, strict=True)
        }

    def _sections(self, names: Iterable[str]) -> dict[str, dict[str, float | str]]:
        known = self.as_dict()
        for name in names:
            if name not in GROUP_PARAMETERS:
                raise InputError(
                    f"hyperprior: no parameter {quoted(name)}, allowed: {', '.join(GROUP_PARAMETERS)}"
                )
        return {name: known[name] for name in names}


def hyperprior_of(given: Hyperprior | str | Path | None) -> Hyperprior:
    """The hyperprior, or the one in the file of this path; the default one where there is nothing."""
    if given is None or isinstance(given, Hyperprior):
        return given or Hyperprior()
    require_kind(
        "hyperprior", given, (str, os.PathLike), "a Hyperprior, or the path of a TOML file"
    )
    return read_hyperprior(given)


def read_hyperprior(path: str | Path) -> Hyperprior:
    """The hyperprior in a TOML file with a section per parameter; what it leaves out keeps its default. :func:`example_file` has all.

    What cannot be used is refused with one line per problem.
    """
    found = toml_table(
        path,
        f"NAME = NUMBER below a line [PARAMETER], as in {_NAMES[0]} = 0 below [{next(iter(_FIELDS))}]",
    )
    _require(str(path), found)
    return Hyperprior().changed(found)


def example_file() -> str:
    """A complete hyperprior file with the defaults and what they mean."""
    words = {one.name: one.words for one in _DECLARED} | {
        CORRELATIONS: "of parameters between subjects, where they are asked for"
    }
    texts = {
        (name, key): f"{key} = {json.dumps(one.default)}"
        for name, fields in _FIELDS.items()
        for key, one in fields.items()
    }
    width, lines = max(map(len, texts.values())), list[str]()
    for name, fields in _FIELDS.items():
        lines += [
            f"[{name}]  # {words[name]}\n",
            *(f"{texts[name, key]:<{width}}  # {one.about}\n" for key, one in fields.items()),
        ]
    return "".join(lines)


def _require(source: str, sections: Mapping[str, Any]) -> None:
    """Refuse numbers by parameter and name, one line for each thing that is wrong."""
    problems = []
    for name, section in sections.items():
        if name not in _FIELDS:
            problems.append(f"section {quoted(name)}: unknown, allowed: {', '.join(_FIELDS)}")
        elif not isinstance(section, Mapping):
            problems.append(
                f"key {name}: found {shown(section)}, allowed: a section [{name}] with {', '.join(_FIELDS[name])}"
            )
        else:
            problems += [
                f"[{name}] {line}"
                for key, value in section.items()
                for line in number_problems(_FIELDS[name], key, value)
            ]
    if problems:
        raise InputError([f"{source}: {line}" for line in problems])
