"""What a prior is made of: each of its numbers declared once, with parameter, kind, unit, words and range.

Everything that shows, reads, varies or refuses a prior's numbers iterates over :meth:`PriorFields.declared` and names none of them. The
numbers are apart from what is computed with them (:mod:`bayes_toe.model.prior`), so that a help text loads no SciPy.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from math import isfinite
from typing import Literal

from bayes_toe.errors import InputError

#: A location moves a density, a scale stretches it, a shape does neither. Scales and shapes are positive and count in factors.
Kind = Literal["location", "scale", "shape"]
#: Beyond these a square would leave the range of floats.
SMALLEST, LARGEST = 1e-100, 1e100
LOG_INTENSITY = "natural-log intensity"


@dataclass(frozen=True)
class PriorField:
    """One number of a prior.

    Attributes
    ----------
    name : str
        Of the field, the key in a prior file.
    default : float
    parameter : str
        To whose distribution it belongs.
    kind : {"location", "scale", "shape"}
    words : str
        What it is, in a prior file's comment.
    unit : str
        Empty for a pure number.
    smallest, largest : float
        What a prior file may say.
    """

    name: str
    default: float
    parameter: str
    kind: Kind
    words: str
    unit: str
    smallest: float
    largest: float

    @property
    def positive(self) -> bool:
        """Whether it is a scale or a shape, which factors vary; a location is shifted."""
        return self.kind != "location"

    @property
    def label(self) -> str:
        """Short words for a figure's key: 'sd of mu1'."""
        return f"{self.name.removeprefix(f'{self.parameter}_')} of {self.parameter}"

    @property
    def about(self) -> str:
        """Words, unit and sign in one line."""
        return ", ".join(part for part in (self.words, self.unit) if part) + ("; positive" if self.positive else "")

    @property
    def allowed(self) -> str:
        """The range in words."""
        return f"a number from {self.smallest:g} to {self.largest:g}"


def prior_field(
    default: float,
    *,
    parameter: str,
    kind: Kind,
    words: str,
    unit: str = "",
    smallest: float | None = None,
    largest: float = LARGEST,
) -> float:
    """Declare one number of a prior, as the default of a dataclass field; see :class:`PriorField` for the arguments."""
    least = (-largest if kind == "location" else SMALLEST) if smallest is None else smallest
    said = {"parameter": parameter, "kind": kind, "words": words, "unit": unit, "smallest": least, "largest": largest}
    return field(default=default, metadata={"default": default, **said})


@dataclass(frozen=True)
class PriorFields:
    """The numbers of the default prior; :class:`bayes_toe.model.prior.Prior` says what they are numbers of.

    Raises
    ------
    InputError
        If a value is not finite, or a scale or shape is not positive.

    Examples
    --------
    >>> [(field.name, field.label) for field in PriorFields.declared()]
    [('mu1_mean', 'mean of mu1'), ('mu1_sd', 'sd of mu1'), ('sigma_p_scale', 'scale of sigma_p')]
    """

    mu1_mean: float = prior_field(0.0, parameter="mu1", kind="location", words="mean of the normal prior of mu1", unit=LOG_INTENSITY)
    mu1_sd: float = prior_field(10.0, parameter="mu1", kind="scale", words="its standard deviation", unit=LOG_INTENSITY)
    sigma_p_scale: float = prior_field(
        1.0, parameter="sigma_p", kind="scale", words="scale of the half-normal prior of sigma_p", unit=LOG_INTENSITY
    )

    def __post_init__(self) -> None:
        for one in self.declared():
            value = getattr(self, one.name)
            if not isfinite(value) or (one.positive and value <= 0):
                allowed = "a positive finite number" if one.positive else "a finite number"
                raise InputError(f"prior: {one.name}={value:g}, allowed: {allowed}")

    @classmethod
    def declared(cls) -> tuple[PriorField, ...]:
        """Its numbers in the order of their declaration."""
        return tuple(PriorField(one.name, **one.metadata) for one in fields(cls))

    @classmethod
    def declared_as(cls, name: str) -> PriorField:
        """One of its numbers.

        Raises
        ------
        InputError
            If there is none of that name.
        """
        for one in cls.declared():
            if one.name == name:
                return one
        raise InputError(f"prior: no value {name!r}, allowed: {', '.join(one.name for one in cls.declared())}")

    @classmethod
    def varied(cls) -> tuple[PriorField, ...]:
        """Its numbers in the order of a sensitivity scan: scales and shapes first, then locations."""
        return tuple(sorted(cls.declared(), key=lambda one: not one.positive))
