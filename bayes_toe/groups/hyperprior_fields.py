"""What a hyperprior is made of: every group parameter declared once, with its scale, words, unit and default numbers.

Everything that reads, shows, stores or varies these numbers iterates over :data:`GROUP_PARAMETERS` and names none of them.
"""

from __future__ import annotations

from math import log
from typing import Literal, NamedTuple

from bayes_toe.model.prior_fields import LARGEST, LOG_INTENSITY, SMALLEST, STIMULI, Kind, PriorField

#: A number, or the property of :class:`bayes_toe.model.study_prior.Stimuli` that gives it.
Default = float | Literal["mean_s1", "four_ranges", "inverse_range", "step", "log_step"]

#: The numbers of every group parameter, on its scale.
NUMBERS: tuple[tuple[str, Kind, str], ...] = (
    ("mean", "location", "mean of the normal prior of the population mean of {}"),
    ("mean_sd", "scale", "its standard deviation"),
    ("sd_scale", "scale", "scale of the half-normal prior of the sd between subjects"),
    ("effect_sd", "scale", "sd of the normal prior, about 0, of a covariate's effect"),
)


class GroupParameter(NamedTuple):
    """A parameter eta that a population of subjects has a normal distribution of, on a scale.

    Attributes
    ----------
    name : str
        The section in a hyperprior file.
    words : str
    scale : {"identity", "log", "probit"}
        From the parameter to eta; by the probit an edge is infinitely far, and Uniform(0, top) is Normal(0, 1).
    mean, mean_sd, sd_scale : float or str
        Default numbers on the scale: m ~ Normal(mean, mean_sd), tau ~ HalfNormal(sd_scale).
    unit : str
        Of eta; empty for a pure number.
    top : float
        Of a probit: the parameter's largest value.
    """

    name: str
    words: str
    scale: Literal["identity", "log", "probit"]
    mean: Default
    mean_sd: Default
    sd_scale: Default
    unit: str = ""
    top: float = 1.0

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
        >>> [GROUP_PARAMETERS[name].label for name in ("mu1", "width", "gamma", "gain")]
        ['mu1', 'log width', 'probit gamma', 'probit(gain/2)']
        """
        if self.scale == "identity":
            return self.name
        return f"{self.scale} {self.name}" if self.top == 1.0 else f"{self.scale}({self.name}/{self.top:g})"

    @property
    def fields(self) -> dict[str, PriorField]:
        """Its numbers as a file has them, by name."""
        return {name: self._field(name, kind, words.format(self.label)) for name, kind, words in NUMBERS}

    def _field(self, name: str, kind: Kind, words: str) -> PriorField:
        default: Default = getattr(self, name)
        least = -LARGEST if kind == "location" else SMALLEST
        if isinstance(default, str):
            return PriorField(name, STIMULI, self.name, kind, words, self.unit, least, LARGEST, default)
        return PriorField(name, default, self.name, kind, words, self.unit, least, LARGEST)


_DECLARED = (
    GroupParameter("mu1", "mean of the prior belief", "identity", "mean_s1", "four_ranges", "four_ranges", LOG_INTENSITY),
    GroupParameter("gamma", "noise ratio (sigma_l/sigma_p)^2", "probit", 0.0, 1.0, 1.0),
    GroupParameter("width", "width w of the curve", "log", "log_step", 1.0, 0.7),
    GroupParameter("q0", "P(equal) of equal stimuli", "probit", 1.0, 1.0, 1.0),
    # Here the population's mean has what a single subject's prior is by default, Uniform(0, 1) and Beta(1, 9), on this scale.
    GroupParameter("lapse_rate", "share of answers that do not depend on the stimuli", "probit", 0.0, 1.0, 0.7),
    GroupParameter("icc", "intra-class correlation of answers", "probit", -1.5, 0.6, 0.7),
    GroupParameter("pull", "pull of a memory that decays", "probit", 0.0, 1.0, 1.0),
    GroupParameter("split", "share v of the decay in that pull, rho = g^v and K = g^(1 - v)", "probit", 0.0, 1.0, 1.0),
    GroupParameter("gain", "weight of the first stimulus", "probit", 0.0, 1.0, 1.0, top=2.0),
    GroupParameter("exponent", "exponent of the curve", "log", log(2.0), 0.5, 0.5),
    GroupParameter(
        "noise_slope", "slope of the noise, 0 for Weber's law", "identity", 0.0, "inverse_range", "inverse_range", f"1/({LOG_INTENSITY})"
    ),
    GroupParameter("offset", "constant error", "identity", 0.0, "step", "step", LOG_INTENSITY),
)
#: Those that a population can be asked for, by name.
GROUP_PARAMETERS = {one.name: one for one in _DECLARED}
#: The section of what holds for all parameters together, and its number.
CORRELATIONS = "correlations"
LKJ = PriorField(
    "lkj", 2.0, CORRELATIONS, "shape", "shape of the LKJ prior of correlations between parameters; 1: uniform", "", SMALLEST, LARGEST
)


class Section(NamedTuple):
    """A part of a hyperprior file: what it is about, and its numbers by name."""

    words: str
    fields: dict[str, PriorField]


SECTIONS = {one.name: Section(one.words, one.fields) for one in _DECLARED} | {
    CORRELATIONS: Section("of parameters between subjects, where they are asked for", {LKJ.name: LKJ})
}
