"""The priors of the paper's model (H1) and, as `Prior.observer`, of the observer's four models.

The default takes location and scales from the stimuli of each subject, so that adding a constant to
all stimuli, or multiplying them, changes no probability. With M the mean of all stimuli, R their
standard deviation and D the root mean square of s2 - s1 over unequal pairs, H1 has
mu1 ~ Normal(M, 2.5 R), log w ~ Normal(log D, 1), gamma ~ Uniform(0, 1) and q0 ~ Beta(4, 1).

`Prior()` is the paper's in H1's four parameters, whatever the stimuli are: mu1 ~ Normal(0, 10),
sigma_p ~ HalfNormal(1), gamma and q0 uniform (V_1 = 10^2, 0 < sigma_l < sigma_p).

The numbers of H1 are declared in :mod:`bayes_toe.model.prior_fields`, those of the observer in
:class:`bayes_toe.model.parameters.ObserverPrior`; files are read by
:mod:`bayes_toe.model.prior_file`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Self, cast

from bayes_toe.arrays import Record
from bayes_toe.data.study import Subject, common_scales
from bayes_toe.data.tasks import SAME_DIFFERENT, Task
from bayes_toe.errors import InputError
from bayes_toe.model.densities import ProbitOfBeta
from bayes_toe.model.parameters import SCALES, ObserverPrior
from bayes_toe.model.prior_fields import STIMULI, PriorFields


@dataclass(frozen=True)
class Prior(PriorFields):
    """The prior of the paper's model (H1) and of the observer in the four models.

    Log densities are normalised.

    Parameters
    ----------
    mu1_mean, mu1_sd : float or "stimuli"
        Mean and standard deviation of mu1, natural-log intensity; "stimuli" stands for a property
        of the stimuli of the subject, here and below; :meth:`for_subjects` replaces it by a number.
    sigma_p_scale : float or "stimuli"
        Scale of the half-normal of sigma_p, natural-log intensity, where the width has no prior of
        its own.
    width_median, width_sd : float or "stimuli"
        Median of a lognormal prior of the width w, natural-log intensity, in the place of
        sigma_p's; standard deviation of its logarithm.
    gamma_a, gamma_b, q0_a, q0_b, lapse_rate_a, lapse_rate_b : float
        Of the beta distributions of gamma, q0 and the lapse rate, the share of answers given
        without regard to the stimuli.

    Raises
    ------
    InputError
        If a value is not finite or a scale is not positive.

    Examples
    --------
    >>> Prior().describe()
    'mu1 ~ Normal(0, 10), sigma_p ~ HalfNormal(1), gamma ~ Uniform(0, 1), q0 ~ Uniform(0, 1)'
    """

    #: The prior of the four models of the observer.
    observer: ObserverPrior = field(default_factory=ObserverPrior)

    #: The family of every parameter's distribution, which takes its numbers in the order of their
    #: declaration.
    families: ClassVar[Mapping[str, str]] = {
        "mu1": "Normal",
        "sigma_p": "HalfNormal",
        "width": "LogNormal",
        "gamma": "Beta",
        "q0": "Beta",
        "lapse_rate": "Beta",
    }

    def paper_parameters(self, task: Task = SAME_DIFFERENT) -> tuple[str, ...]:
        """The parameters of the predictive update (H1) that have a distribution.

        The width's, or in its place sigma_p's, among them.
        """
        return ("mu1", self.spread, "gamma", task.lapses)

    @property
    def spread(self) -> str:
        """The parameter whose prior determines the width of the curve: "width" or "sigma_p"."""
        return "sigma_p" if self.width_median is None else "width"

    def for_subjects(self, *subjects: Subject) -> Self:
        """This prior with numbers in the place of "stimuli", for a subject or for several together.

        Raises
        ------
        InputError
            If no pair has different stimuli and the prior of H1 asks for their scale.

        Examples
        --------
        >>> subject = Subject("S", [0.0, 0.0], [0.0, 0.5], [9, 4], [10, 10])
        >>> Prior(mu1_mean="stimuli").for_subjects(subject).mu1_mean
        0.125
        """
        open_numbers = {}
        for number in self.declared():
            if getattr(self, number.name) == STIMULI:
                open_numbers[number.name] = number
        if not open_numbers:
            return self
        scales = common_scales(*subjects)
        if scales is None:
            # A number that H1 does not use may stay open.
            if any(number.parameter in self.paper_parameters() for number in open_numbers.values()):
                raise InputError(
                    f"subject {subjects[0].name!r}: the prior takes its scale from pairs of "
                    "different stimuli, found none; allowed: the "
                    "prior 'paper' (--prior paper), or one of numbers"
                )
            return self
        numbers = {"M": scales.mean, "2.5 R": 2.5 * scales.spread, "D": scales.step}
        values: Record = {}
        for name, number in open_numbers.items():
            values[name] = numbers[number.stimuli]
        return replace(self, **values)

    def depends_on_stimuli(self, parameter: str) -> bool:
        """Whether a parameter's distribution has a number of the stimuli, and so their unit."""
        return STIMULI in self._numbers(parameter).values()

    def _numbers(self, parameter: str) -> Record:
        """The numbers of a parameter's distribution by name."""
        names = [number.name for number in self.declared() if number.parameter == parameter]
        return {name: getattr(self, name) for name in names}

    def describe_distribution(self, parameter: str) -> str:
        """The distribution of a parameter in words.

        As in 'Normal(M, 2.5 R)' where its numbers are those of the stimuli.
        """
        words = []
        for number in self.declared():
            if number.parameter == parameter:
                value = getattr(self, number.name)
                words.append(number.stimuli if value == STIMULI else f"{value:g}")
        family = self.families[parameter]
        if family == "Beta" and words == ["1", "1"]:
            return "Uniform(0, 1)"
        return f"{family}({', '.join(words)})"

    @property
    def spread_scale(self) -> float:
        """The median of the width, or the scale of sigma_p, natural-log intensity."""
        scale = self.sigma_p_scale if self.width_median is None else self.width_median
        return cast(float, scale)

    @property
    def gamma_density(self) -> ProbitOfBeta:
        """The density of the probit of gamma."""
        return ProbitOfBeta(self.gamma_a, self.gamma_b)

    def share_density(self, task: Task) -> ProbitOfBeta:
        """The density of the probit of the task's q0 or lapse rate."""
        name = task.lapses
        return ProbitOfBeta(getattr(self, f"{name}_a"), getattr(self, f"{name}_b"))

    @property
    def mu1_normal(self) -> tuple[float, float]:
        """Mean and standard deviation of mu1, which are the penalty of a maximum-likelihood fit."""
        return cast(float, self.mu1_mean), cast(float, self.mu1_sd)

    def spread_probability(self, low: float, high: float) -> float:
        """Probability that the width, or sigma_p, lies between two numbers."""
        from scipy import stats

        scale = self.spread_scale
        density = stats.halfnorm(scale=scale)
        if self.spread == "width":
            density = stats.lognorm(self.width_sd, scale=scale)
        return float(density.cdf(high) - density.cdf(low))

    def describe(self, task: Task = SAME_DIFFERENT) -> str:
        """H1's in one line for tables, files and Methods sections."""
        parts = []
        for name in self.paper_parameters(task):
            parts.append(f"{name} ~ {self.describe_distribution(name)}")
        return ", ".join(parts) + self.remark

    def describe_all(self, task: Task = SAME_DIFFERENT) -> str:
        """The priors of the observer and of H1 in words, in one line."""
        return f"{self.observer.describe(task)}. The paper's model (H1): {self.describe(task)}"

    @property
    def remark(self) -> str:
        """What the symbols of a description mean, to follow it."""
        if any(map(self.depends_on_stimuli, self.paper_parameters())):
            return f"; M is the mean of the stimuli, {SCALES}"
        return ""

    def describe_penalty(self) -> str:
        """:attr:`mu1_normal` in words."""
        words = f"mu1 ~ {self.describe_distribution('mu1')}"
        if self.depends_on_stimuli("mu1"):
            words += "; M is the mean and R is the SD of the stimuli"
        return words


def stored_prior(values: Mapping[str, Any]) -> Prior:
    """The prior that a file of results holds."""
    numbers = dict(values)
    observer = ObserverPrior(**numbers.pop("observer"))
    return Prior(observer=observer, **numbers)


#: The default: every scale is that of the stimuli of the subject.
DEFAULT = Prior(mu1_mean=STIMULI, mu1_sd=STIMULI, width_median=STIMULI, q0_a=4.0)
