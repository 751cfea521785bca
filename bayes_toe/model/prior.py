"""The prior of the paper's model (H1), of the observer, and of a group.

The default takes location and scales from the stimuli of each subject, so that adding a constant to
all stimuli, or multiplying them, changes no probability. With M the mean of all stimuli, R their
standard deviation and D the root mean square of s2 - s1 over unequal pairs, H1 has
mu1 ~ Normal(M, 2.5 R), log w ~ Normal(log D, 1), gamma ~ Uniform(0, 1) and q0 ~ Beta(4, 1).

`Prior()` is the paper's prior of H1's four parameters, whatever the stimuli are:
mu1 ~ Normal(0, 10), sigma_p ~ HalfNormal(1), gamma and q0 uniform (V_1 = 10^2,
0 < sigma_l < sigma_p).

The numbers of a prior are those of H1 (`Prior`), of the observer in the four models
(`Prior.observer`) and of a group (`Prior.group`):

    c/D, p, log(sigma_d/D), logit q0 of a subject ~ Normal(m, tau)
    c/D:               m ~ Student t, 3 df, scale .5    tau ~ half Student t, 3 df, scale .3
    p:                 m ~ Normal(0, .2)                tau ~ half-normal, scale .15
    log(sigma_d/D):    m ~ Normal(0, .6)                tau ~ half-normal, scale .4
    logit q0:          m ~ Normal(1.8, 1)               tau ~ half-normal, scale 1

D is here the scale of the whole study. The other parameters of the observer have the prior of a
single subject. Effects of covariates have the scale of tau; differences between conditions are
normal, with half the scales.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, ClassVar, Literal, Self, cast

from bayes_toe.arrays import Record, Texts
from bayes_toe.data.messages import display_name, quoted
from bayes_toe.data.study import Subject, common_scales
from bayes_toe.data.tasks import SAME_DIFFERENT, Task
from bayes_toe.errors import InputError, require_kind
from bayes_toe.model.parameters import (
    SCALES,
    STIMULI,
    ObserverPrior,
    PriorNumber,
    PriorNumbers,
    group_parameters,
    prior_number,
)

#: Sections of a prior file: that of the paper's model (H1), and that of a group.
PAPER = "paper"
GROUP = "group"
#: The square of a number beyond these limits would leave the range of floats.
_SMALLEST = 1e-100
_LARGEST = 1e100

# --- A group --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class ParameterHyperprior(PriorNumbers):
    """The prior of the mean and of the standard deviation between subjects of one parameter.

    Attributes
    ----------
    mean : float
        Centre of the prior of the mean.
    mean_scale, sd_scale : float
        Scale of the prior of the mean, and of the prior of the standard deviation.
    has_heavy_tails : bool
        Whether both priors are Student's t with 3 degrees of freedom; otherwise they are normal.
    """

    mean: float = prior_number(smallest=-1e3)
    mean_scale: float = prior_number()
    sd_scale: float = prior_number()
    has_heavy_tails: bool = False

    @property
    def difference(self) -> ParameterHyperprior:
        """The prior of a difference between two conditions: normal, half as wide."""
        return ParameterHyperprior(
            mean=0.0, mean_scale=0.5 * self.mean_scale, sd_scale=0.5 * self.sd_scale
        )

    def narrowed(self, share: float) -> ParameterHyperprior:
        """This prior with both scales multiplied by a share."""
        return replace(self, mean_scale=share * self.mean_scale, sd_scale=share * self.sd_scale)

    @property
    def words(self) -> str:
        """The prior of the mean and of the standard deviation, in words."""
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
    >>> wide = Hyperprior(contraction=ParameterHyperprior(0.0, mean_scale=0.6, sd_scale=0.15))
    >>> wide.contraction.words
    'mean ~ Normal(0, 0.6); SD between subjects ~ half-normal, scale 0.15'
    """

    # Each prior has the mean, the scale of the mean, and the scale of the SD between subjects.
    constant_error: ParameterHyperprior = ParameterHyperprior(0.0, 0.5, 0.3, has_heavy_tails=True)
    contraction: ParameterHyperprior = ParameterHyperprior(0.0, 0.2, 0.15)
    noise: ParameterHyperprior = ParameterHyperprior(0.0, 0.6, 0.4)
    q0: ParameterHyperprior = ParameterHyperprior(1.8, 1.0, 1.0)

    def __post_init__(self) -> None:
        for name, prior in vars(self).items():
            require_kind(f"hyperprior: {name}", prior, ParameterHyperprior, "a ParameterHyperprior")
            prior.require_valid(f"hyperprior: [{name}] ")

    @classmethod
    def from_record(cls, record: Mapping[str, Mapping[str, Any]]) -> Self:
        """The hyperprior that a file of results holds."""
        return cls(**{name: ParameterHyperprior(**numbers) for name, numbers in record.items()})

    def describe(self, task: Task) -> Texts:
        """A line for each parameter of a task."""
        return tuple(
            f"{parameter.group_label}: {getattr(self, parameter.name).words}"
            for parameter in group_parameters(task)
        )


# --- The paper's model (H1), and all other models -------------------------------------------------


@dataclass(frozen=True)
class Prior(PriorNumbers):
    """The prior of the paper's model (H1), of the observer in the four models, and of a group.

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
        The numbers a and b of the beta distributions of gamma, q0 and the lapse rate, the share of
        answers given without regard to the stimuli.
    observer : ObserverPrior
        The prior of the observer in the four models.
    group : Hyperprior
        The prior of a group.

    Raises
    ------
    InputError
        If a number is outside its range.

    Examples
    --------
    >>> Prior().describe()
    'mu1 ~ Normal(0, 10), sigma_p ~ HalfNormal(1), gamma ~ Uniform(0, 1), q0 ~ Uniform(0, 1)'
    """

    # Each number has a default, a smallest and a largest value, and what "stimuli" stands for.
    mu1_mean: float | Literal["stimuli"] = prior_number(0.0, -_LARGEST, _LARGEST, "M")
    mu1_sd: float | Literal["stimuli"] = prior_number(10.0, _SMALLEST, _LARGEST, "2.5 R")
    sigma_p_scale: float | Literal["stimuli"] = prior_number(1.0, _SMALLEST, _LARGEST, "D")
    width_median: float | Literal["stimuli"] | None = prior_number(None, _SMALLEST, _LARGEST, "D")
    width_sd: float = prior_number(1.0, _SMALLEST, _LARGEST)
    # With a smaller number a beta distribution is all but an atom at an edge.
    gamma_a: float = prior_number(1.0, smallest=0.05)
    gamma_b: float = prior_number(1.0, smallest=0.05)
    q0_a: float = prior_number(1.0, smallest=0.05)
    q0_b: float = prior_number(1.0, smallest=0.05)
    lapse_rate_a: float = prior_number(1.0, smallest=0.05)
    lapse_rate_b: float = prior_number(9.0, smallest=0.05)
    observer: ObserverPrior = field(default_factory=ObserverPrior)
    group: Hyperprior = field(default_factory=Hyperprior)

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

    def __post_init__(self) -> None:
        self.require_valid("prior: ")
        require_kind("prior: observer", self.observer, ObserverPrior, "an ObserverPrior")
        require_kind("prior: group", self.group, Hyperprior, "a Hyperprior")

    def paper_parameters(self, task: Task = SAME_DIFFERENT) -> Texts:
        """The parameters of H1 that have a distribution: the width or sigma_p is one of them."""
        return ("mu1", self.spread, "gamma", task.lapses)

    @property
    def spread(self) -> str:
        """The parameter whose prior determines the width of the curve: "width" or "sigma_p"."""
        return "sigma_p" if self.width_median is None else "width"

    @property
    def spread_scale(self) -> float:
        """The median of the width, or the scale of sigma_p, natural-log intensity."""
        scale = self.sigma_p_scale if self.width_median is None else self.width_median
        return cast(float, scale)

    @property
    def spread_sd(self) -> float | None:
        """Standard deviation of the log width; None where sigma_p has a half-normal prior."""
        return None if self.width_median is None else self.width_sd

    @property
    def mu1_normal(self) -> tuple[float, float]:
        """Mean and standard deviation of mu1, which are the penalty of a maximum-likelihood fit."""
        return cast(float, self.mu1_mean), cast(float, self.mu1_sd)

    # --- Numbers of the stimuli -------------------------------------------------------------------

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
        symbols = self._symbols()
        if not symbols:
            return self

        scales = common_scales(*subjects)
        if scales is None:
            # A number that H1 does not use may stay "stimuli".
            if any(map(self.depends_on_stimuli, self.paper_parameters())):
                raise InputError(
                    f"subject {subjects[0].name!r}: the prior takes its scale from pairs of "
                    "different stimuli, found none; allowed: the "
                    "prior 'paper' (--prior paper), or one of numbers"
                )
            return self

        numbers = {"M": scales.mean, "2.5 R": 2.5 * scales.spread, "D": scales.step}
        values: Record = {name: numbers[symbol] for name, symbol in symbols.items()}
        return replace(self, **values)

    def depends_on_stimuli(self, parameter: str) -> bool:
        """Whether a parameter's distribution has a number of the stimuli, and so their unit."""
        # 'mu1_mean' and 'mu1_sd' are numbers of mu1: the part before the last '_' is the parameter.
        return any(name.rpartition("_")[0] == parameter for name in self._symbols())

    def _symbols(self) -> dict[str, str]:
        """The symbols of the numbers that the stimuli give, such as {'mu1_mean': 'M'}."""
        numbers = self.declared().items()
        return {name: number.stimuli for name, number in numbers if getattr(self, name) == STIMULI}

    # --- In words ---------------------------------------------------------------------------------

    def describe_distribution(self, parameter: str) -> str:
        """The distribution of a parameter, such as 'Normal(0, 10)'.

        Symbols stand for numbers of the stimuli: 'Normal(M, 2.5 R)'.
        """
        symbols = self._symbols()
        numbers = []
        for name in self.declared():
            if name.rpartition("_")[0] == parameter:  # as 'mu1' of 'mu1_mean' and of 'mu1_sd'
                numbers.append(symbols.get(name) or f"{getattr(self, name):g}")

        family = self.families[parameter]
        if family == "Beta" and numbers == ["1", "1"]:
            return "Uniform(0, 1)"
        return f"{family}({', '.join(numbers)})"

    def describe(self, task: Task = SAME_DIFFERENT) -> str:
        """The prior of H1 in one line, for tables, files and Methods sections."""
        parameters = self.paper_parameters(task)
        words = ", ".join(f"{name} ~ {self.describe_distribution(name)}" for name in parameters)
        if any(map(self.depends_on_stimuli, parameters)):
            words += f"; M is the mean of the stimuli, {SCALES}"
        return words

    def describe_all(self, task: Task = SAME_DIFFERENT) -> str:
        """The priors of the observer and of H1 in words, in one line."""
        return f"{self.observer.describe(task)}. The paper's model (H1): {self.describe(task)}"

    def describe_penalty(self) -> str:
        """:attr:`mu1_normal` in words."""
        words = f"mu1 ~ {self.describe_distribution('mu1')}"
        if self.depends_on_stimuli("mu1"):
            words += "; M is the mean and R is the SD of the stimuli"
        return words


#: The default: every scale is that of the stimuli of the subject.
DEFAULT = Prior(mu1_mean=STIMULI, mu1_sd=STIMULI, width_median=STIMULI, q0_a=4.0)


def stored_prior(values: Mapping[str, Any]) -> Prior:
    """The prior that a file of results holds, by its fields; a file may have no group."""
    numbers = dict(values)
    observer = ObserverPrior(**numbers.pop("observer"))
    group = Hyperprior.from_record(numbers.pop("group", {}))
    return Prior(observer=observer, group=group, **numbers)


# --- Sections -------------------------------------------------------------------------------------


def sections() -> dict[str, dict[str, PriorNumber]]:
    """The numbers of every section of a prior file by their keys, by the name of the section.

    Examples
    --------
    >>> list(sections()["group.noise"])
    ['mean', 'mean_scale', 'sd_scale']
    """
    numbers_by_section: dict[str, dict[str, PriorNumber]] = defaultdict(dict)
    for name, number in ObserverPrior.declared().items():
        parameter, _, key = name.rpartition("_")  # 'noise_slope_scale' -> 'noise_slope', 'scale'
        numbers_by_section[parameter][key] = number
    numbers_by_section[PAPER] = Prior.declared()
    for attribute in fields(Hyperprior):
        numbers_by_section[f"{GROUP}.{attribute.name}"] = ParameterHyperprior.declared()
    return numbers_by_section


def changed_prior(prior: Prior, table: Mapping[str, Any], source: str) -> Prior:
    """A prior with the numbers of a table of sections; errors name the source.

    Raises
    ------
    InputError
        For an unknown section or key, something that is not a number, or a number out of range: one
        line per problem.
    """
    # TOML gives the section [group.noise] as a table 'noise' in a table 'group'.
    contents = dict(table)
    if isinstance(table.get(GROUP), Mapping):
        for name, values in contents.pop(GROUP).items():
            contents[f"{GROUP}.{name}"] = values
    problems = []
    for section, values in contents.items():
        problems += _section_problems(section, values)
    if problems:
        raise InputError([f"{source}: {problem}" for problem in problems])

    # The new values of attributes of `Prior`, of `ObserverPrior` and of `Hyperprior`.
    changes: Record = {}
    observer_changes: Record = {}
    group_changes: Record = {}
    for section, values in contents.items():
        numbers = dict(values)
        for key, value in values.items():
            if value != STIMULI:
                numbers[key] = float(value)  # an integer becomes a float

        part, _, parameter = section.partition(".")  # 'group.noise' -> ('group', '.', 'noise')
        if part == PAPER:
            changes |= numbers
        elif part == GROUP:
            group_changes[parameter] = replace(getattr(prior.group, parameter), **numbers)
        else:  # the section [noise] has the numbers noise_median and noise_sd
            observer_changes |= {f"{section}_{key}": number for key, number in numbers.items()}

    changes["observer"] = replace(prior.observer, **observer_changes)
    changes["group"] = replace(prior.group, **group_changes)
    return replace(prior, **changes)


def _section_problems(section: str, values: object) -> list[str]:
    """Problems of a section of a prior file, a line each."""
    all_sections = sections()
    if section not in all_sections or not isinstance(values, Mapping):
        # The name may be a key, such as 'sd', outside of its section.
        sections_with_key = [name for name, keys in all_sections.items() if section in keys]
        names = ", ".join(f"[{name}]" for name in sections_with_key or all_sections)
        return [f"{display_name(section)}: found no such section, allowed: {names}"]

    numbers = all_sections[section]
    problems = []
    for key, value in values.items():
        if key not in numbers:
            problems.append(
                f"[{section}] {quoted(key)}: unknown key, allowed: {', '.join(numbers)}"
            )
            continue
        problem = numbers[key].problem(value)
        if problem:
            problems.append(f"[{section}] {key}: {problem}")
    return problems
