"""The numbers of a prior, each declared once with parameter, unit, words and range.

They are the numbers of the prior of the paper's model (H1). Help texts, prior files and checks read
:meth:`PriorFields.declared` and name none of them. The numbers are apart from what is computed
with them (:mod:`bayes_toe.model.prior`), so that a help text loads no SciPy.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cache
from numbers import Real
from typing import Any, Final, Literal

from bayes_toe.data.messages import display_name, quoted
from bayes_toe.errors import InputError

#: Beyond these a square would leave the range of floats.
SMALLEST, LARGEST = 1e-100, 1e100
LOG_INTENSITY = "natural-log intensity"
#: What may stand for a number that a subject's stimuli give.
STIMULI: Final = "stimuli"
#: What that number is, in words, by its symbol: over the trials of a subject, M is the mean of all
#: stimuli, R their standard deviation, D the root mean square of s2 - s1 over unequal pairs.
OF_STIMULI = {
    "M": "their mean",
    "2.5 R": "2.5 times their standard deviation",
    "D": "the root mean square step between different ones",
}


@dataclass(frozen=True)
class PriorField:
    """One number of a prior."""

    name: str  # of the field, the key in a prior file
    # None where leaving the number out means something of its own, which `words` say
    default: float | Literal["stimuli"] | None
    parameter: str  # to whose distribution it belongs
    words: str  # what it is, in a prior file's comment
    unit: str  # empty for a pure number
    smallest: float
    largest: float
    # what "stimuli" stands for, a key of :data:`OF_STIMULI`; empty where it may not be said
    stimuli: str = ""

    @property
    def is_positive(self) -> bool:
        """Whether it is a scale or a shape, not a location."""
        return self.smallest > 0

    @property
    def about(self) -> str:
        """Words, unit and sign in one line."""
        words = ", ".join(filter(None, (self.words, self.unit)))
        if self.is_positive:
            words += "; positive"
        if self.stimuli:
            words += f'; or "{STIMULI}", {OF_STIMULI[self.stimuli]}'
        return words

    def takes(self, value: object) -> bool:
        """Whether a value lies in the range, or is "stimuli" where that is allowed."""
        if value == STIMULI:
            return bool(self.stimuli)
        return self.smallest <= real(value) <= self.largest  # a NaN is in no range

    @property
    def allowed(self) -> str:
        """The range in words."""
        words = f"a number from {self.smallest:g} to {self.largest:g}"
        return f"{words} or '{STIMULI}'" if self.stimuli else words


def prior_field(
    default: float | Literal["stimuli"] | None,
    *,
    parameter: str,
    words: str,
    unit: str = "",
    limits: tuple[float, float] = (SMALLEST, LARGEST),
    stimuli: str = "",
) -> Any:
    """Declare one number of a prior, as the default of a dataclass field.

    See :class:`PriorField` for the arguments.
    """
    number = PriorField("", default, parameter, words, unit, *limits, stimuli)
    return field(default=default, metadata={"number": number})


def _of_beta(default: float, parameter: str, words: str) -> Any:
    """A number of a beta; beyond these limits it is all but an atom, at an edge or at one value."""
    return prior_field(default, parameter=parameter, words=words, limits=(0.05, 1000.0))


@dataclass(frozen=True)
class PriorFields:
    """The numbers of H1's prior; :class:`bayes_toe.model.prior.Prior` explains them.

    Raises
    ------
    InputError
        If a value is outside its range.
    """

    mu1_mean: float | Literal["stimuli"] = prior_field(
        0.0,
        parameter="mu1",
        limits=(-LARGEST, LARGEST),
        words="mean of the normal prior of mu1",
        unit=LOG_INTENSITY,
        stimuli="M",
    )
    mu1_sd: float | Literal["stimuli"] = prior_field(
        10.0,
        parameter="mu1",
        words="its standard deviation",
        unit=LOG_INTENSITY,
        stimuli="2.5 R",
    )
    sigma_p_scale: float | Literal["stimuli"] = prior_field(
        1.0,
        parameter="sigma_p",
        words="scale of the half-normal prior of sigma_p",
        unit=LOG_INTENSITY,
        stimuli="D",
    )
    width_median: float | Literal["stimuli"] | None = prior_field(
        None,
        parameter="width",
        words=(
            "median of a lognormal prior of the width, in the place of sigma_p's; left out: "
            "sigma_p has its own"
        ),
        unit=LOG_INTENSITY,
        stimuli="D",
    )
    width_sd: float = prior_field(1.0, parameter="width", words="sd of the width's logarithm")
    gamma_a: float = _of_beta(1.0, "gamma", "a of the beta prior of gamma; 1 and 1 are uniform")
    gamma_b: float = _of_beta(1.0, "gamma", "its b")
    q0_a: float = _of_beta(1.0, "q0", "a of the beta prior of q0")
    q0_b: float = _of_beta(1.0, "q0", "its b")
    lapse_rate_a: float = _of_beta(1.0, "lapse_rate", "a of the beta prior of the lapse rate")
    lapse_rate_b: float = _of_beta(9.0, "lapse_rate", "its b")

    def __post_init__(self) -> None:
        for number in self.declared():
            value = getattr(self, number.name)
            is_left_out = value is None and number.default is None
            if not is_left_out and not number.takes(value):
                raise InputError(
                    f"prior: {number.name}: found {shown(value)}, allowed: {number.allowed}"
                )

    @classmethod
    @cache
    def declared(cls) -> tuple[PriorField, ...]:
        """Its numbers in the order of their declaration."""
        numbers = []
        for row in fields(cls):
            if "number" in row.metadata:
                numbers.append(replace(row.metadata["number"], name=row.name))
        return tuple(numbers)


def number_problems(keys: Mapping[str, PriorField], key: str, value: object) -> list[str]:
    """The problem of one number, in one line that ends in the allowed values.

    Nothing where it is right.
    """
    if key not in keys:
        return [f"key {quoted(key)}: unknown, allowed: {', '.join(keys)}"]
    if keys[key].takes(value):
        return []
    return [f"key {key}: found {shown(value)}, allowed: {keys[key].allowed}"]


def real(value: object) -> float:
    """The number that a value is; NaN where it is none, or too large an integer."""
    # bool is an int for Python, not for a reader.
    if isinstance(value, bool) or not isinstance(value, Real):
        return math.nan
    try:
        return float(value)
    except OverflowError:
        return math.nan


def shown(value: object) -> str:
    """A value of a TOML file as messages show it."""
    if isinstance(value, Mapping):
        return "a table"
    if isinstance(value, list):
        return "a list"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return quoted(value)
    if isinstance(value, int) and math.isnan(real(value)):
        return "an integer too large for a number"
    return display_name(str(value))
