"""The parameters of the observer: one row each, with names, unit, words, prior and limits.

`ObserverPrior` has the numbers of their prior. The names of all quantities in tables and figures,
and the four models, are here too.

The observer of one subject works on stimuli about sbar in units of D, so that no unit of intensity
matters. Every parameter has one unconstrained coordinate u, in units of its prior:

    noise            u = (log(sigma_d / D) - log median) / sd     standard normal
    q0               u = logit q0                                 Beta(a, b) of q0
    lapse_rate       u = normal score of lambda                   standard normal
    noise_slope      u = b R / scale                              Student t, 3 df
    criterion_slope  u = g R / scale                              Student t, 3 df
    constant_error   u = (c / D) / scale                          Student t, 3 df
    contraction      u = p / scale                                standard normal, cut at abs(p) = 1
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import MISSING, dataclass, field, fields
from numbers import Real
from typing import Any, Final

import numpy as np
from scipy.special import log_ndtr, ndtri_exp

from bayes_toe.arrays import ArrayPair, FloatArray
from bayes_toe.data.messages import display_name, quoted
from bayes_toe.data.tasks import TASKS, Task
from bayes_toe.errors import InputError

LOG_INTENSITY_UNIT = "ln intensity"
PER_LOG_INTENSITY = "1 / ln intensity"
PURE_NUMBER = "1"
#: What the symbols of a prior mean.
SCALES = "D is the root mean square of s2 - s1 over unequal pairs, and R is the SD of the stimuli"


#: The word in a prior for a number that the stimuli of a subject give.
STIMULI: Final = "stimuli"


# --- Numbers of a prior ---------------------------------------------------------------------------


@dataclass(frozen=True)
class PriorNumber:
    """A number of a prior: its default, and the values that it takes.

    Attributes
    ----------
    default : float or None
        None if the number may be omitted.
    smallest, largest : float
    stimuli : str
        The symbol of the number for which "stimuli" stands; empty if "stimuli" is not allowed.
    """

    default: Any
    smallest: float
    largest: float
    stimuli: str

    def problem(self, value: object) -> str:
        """What is wrong with a value, such as 'found -1, allowed: a number from 0.001 to 1000'.

        Empty if nothing is wrong.
        """
        is_omitted = value is None and self.default is None
        is_of_stimuli = value == STIMULI and self.stimuli != ""
        # A value that is no number becomes NaN by `real`, and NaN is in no range.
        is_in_range = self.smallest <= real(value) <= self.largest
        if is_omitted or is_of_stimuli or is_in_range:
            return ""
        allowed = f"a number from {self.smallest:g} to {self.largest:g}"
        if self.stimuli:
            allowed += f" or '{STIMULI}'"
        return f"found {format_value(value)}, allowed: {allowed}"


def prior_number(
    default: object = MISSING, smallest: float = 1e-3, largest: float = 1e3, stimuli: str = ""
) -> Any:
    """Declare a :class:`PriorNumber` as a field of a dataclass.

    Without a default the field is required. A class reads its declarations by `declared`.
    """
    number = PriorNumber(default, smallest, largest, stimuli)
    return field(default=default, metadata={"number": number})


@dataclass(frozen=True)
class PriorNumbers:
    """Numbers of a prior, which are fields that :func:`prior_number` declares."""

    @classmethod
    def declared(cls) -> dict[str, PriorNumber]:
        """The numbers by name, in the order of their declaration."""
        # Other attributes, such as `has_heavy_tails`, have no metadata.
        return {
            attribute.name: attribute.metadata["number"]
            for attribute in fields(cls)
            if attribute.metadata
        }

    def require_valid(self, source: str) -> None:
        """Refuse numbers out of range, a line each that begins with the source."""
        problems = []
        for name, number in self.declared().items():
            problem = number.problem(getattr(self, name))
            if problem:
                problems.append(f"{source}{name}: {problem}")
        if problems:
            raise InputError(problems)


@dataclass(frozen=True)
class ObserverPrior(PriorNumbers):
    """The numbers of the observer's prior. Its scales count in D and R of the stimuli.

    The name of a number begins with that of its parameter. The rest is the key in a prior file.

    Attributes
    ----------
    noise_median, noise_sd : float
        Median of sigma_d in D, and standard deviation of its logarithm.
    q0_a, q0_b : float
        The beta distribution of q0, the largest P(equal).
    lapse_rate_b : float
        The lapse rate has the distribution Beta(1, b).
    noise_slope_scale, criterion_slope_scale : float
        Scales of Student's t with 3 degrees of freedom, over R.
    constant_error_scale : float
        Scale of Student's t with 3 degrees of freedom, in D.
    contraction_sd : float
        Standard deviation of the normal distribution of p on (-1, 1). Where first stimuli spread
        beyond 4 D, D over their standard deviation takes its place, in proportion.
    """

    noise_median: float = prior_number(1.0)
    noise_sd: float = prior_number(0.7)
    q0_a: float = prior_number(4.0)
    q0_b: float = prior_number(1.0)
    lapse_rate_b: float = prior_number(9.0)
    noise_slope_scale: float = prior_number(0.15)
    criterion_slope_scale: float = prior_number(0.15)
    constant_error_scale: float = prior_number(0.5)
    contraction_sd: float = prior_number(0.25)

    def __post_init__(self) -> None:
        self.require_valid("prior: ")

    def describe(self, task: Task, held_parameters: Collection[Parameter] = ()) -> str:
        """The prior of a task's parameters in words, without parameters that are held at 0.

        Examples
        --------
        >>> ObserverPrior().describe(TASKS[1], (CONSTANT_ERROR, CONTRACTION))[:56]
        'noise ~ LogNormal(1 D, 0.7), lapse_rate ~ Beta(1, 9), no'
        """
        free_parameters = [
            parameter for parameter in task_parameters(task) if parameter not in held_parameters
        ]
        priors = [
            f"{parameter.name} ~ {parameter.prior.format_map(vars(self))}"
            for parameter in free_parameters
        ]
        return f"{', '.join(priors)}; {SCALES}"


def real(value: object) -> float:
    """A value as a float; NaN if it is not a number, or too large an integer."""
    # bool is an int for Python, not for a reader.
    if isinstance(value, bool) or not isinstance(value, Real):
        return math.nan
    try:
        return float(value)
    except OverflowError:
        return math.nan


def format_value(value: object) -> str:
    """A value of a TOML file as messages show it, such as 'a table', 'true' or '0.5'."""
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


# --- Quantities and parameters --------------------------------------------------------------------


@dataclass(frozen=True)
class Quantity:
    """A number that describes an observer, and how files, figures and pages name it.

    Attributes
    ----------
    name : str
        Its name in files and in the interface.
    symbol : str
        The label of an axis, with formulas in TeX.
    label : str
        The label of an axis in plain text.
    words : str
        The quantity in words.
    unit : str
        Its unit in files; '1' for a pure number.
    display : str
        How an axis shows the number: 'difference' in the unit of differences, 'known difference'
        too, but only if the unit of the stimuli is known, 'stimulus' in the unit of the stimuli,
        'percent' in per cent. If it is empty, the axis shows the number itself.
    """

    name: str
    symbol: str
    label: str
    words: str
    unit: str = LOG_INTENSITY_UNIT
    display: str = ""

    @property
    def scale(self) -> float:
        """The factor by which tables and figures multiply the number: 100 for per cent."""
        return 100.0 if self.display == PERCENT else 1.0


@dataclass(frozen=True)
class Parameter(Quantity):
    """One parameter of the observer.

    Attributes
    ----------
    prior : str
        Its distribution; fields of :class:`ObserverPrior` stand in braces.
    limits : tuple of (float, float, str)
        The two numbers between which the parameter lies, both excluded, and the rule in words.
    typical : float
        Its value in an observer without order effects; the noise is in D.
    tasks : tuple of Task
        The tasks whose observer has the parameter.
    group_label : str
        Its name on the scale on which subjects of a group are normally distributed; empty if a
        group has no distribution of the parameter.
    """

    prior: str = ""
    limits: tuple[float, float, str] = (-np.inf, np.inf, "finite")
    typical: float = 0.0
    tasks: tuple[Task, ...] = TASKS
    group_label: str = ""


_WITH_EQUAL = tuple(task for task in TASKS if task.has_criterion)
#: What axes show, see :class:`Quantity`.
DIFFERENCE = "difference"
KNOWN_DIFFERENCE = "known difference"
STIMULUS = "stimulus"
PERCENT = "percent"

NOISE = Parameter(
    "noise",
    r"noise $\sigma_d$",
    "noise σ",
    "standard deviation of the perceived difference",
    display=KNOWN_DIFFERENCE,
    prior="LogNormal({noise_median:g} D, {noise_sd:g})",
    limits=(0.0, np.inf, "above 0"),
    typical=0.5,
    group_label="log(sigma_d/D)",
)
PEAK = Parameter(
    "q0",
    r"peak $q_0$",
    "peak q₀",
    "P(equal) at the peak",
    PURE_NUMBER,
    prior="Beta({q0_a:g}, {q0_b:g})",
    limits=(0.0, 1.0, "above 0 and below 1"),
    typical=0.9,
    tasks=_WITH_EQUAL,
    group_label="logit q0",
)
LAPSE_RATE = Parameter(
    "lapse_rate",
    r"lapse rate $\lambda$",
    "lapse λ",
    "share of responses that ignore the stimuli",
    PURE_NUMBER,
    prior="Beta(1, {lapse_rate_b:g})",
    limits=(-1e-300, 1.0, "from 0 to below 1"),  # a limit is itself not allowed, but 0 is
    typical=0.05,
)
NOISE_SLOPE = Parameter(
    "noise_slope",
    r"noise slope $b$",
    "slope b",
    "change of log noise with intensity",
    PER_LOG_INTENSITY,
    prior="Student(3, {noise_slope_scale:g}/R)",
)
CRITERION_SLOPE = Parameter(
    "criterion_slope",
    r"criterion slope $g$",
    "slope g",
    "change of the log criterion for 'equal' with intensity",
    PER_LOG_INTENSITY,
    prior="Student(3, {criterion_slope_scale:g}/R)",
    tasks=_WITH_EQUAL,
)
CONSTANT_ERROR = Parameter(
    "constant_error",
    r"constant error $c$",
    "PSE shift c",
    "constant error: above 0 the first stimulus is overestimated",
    display=DIFFERENCE,
    prior="Student(3, {constant_error_scale:g} D)",
    group_label="constant error, D",
)
CONTRACTION = Parameter(
    "contraction",
    "contraction",
    "contraction",
    "share of the way to the mean; below 0: repulsion",
    PURE_NUMBER,
    PERCENT,
    prior="Normal(0, {contraction_sd:g}) on (-1, 1)",
    limits=(-1.0, 1.0, "above -1 and below 1"),
    group_label="contraction",
)
#: All parameters of the observer, in the order of the coordinates.
PARAMETERS = (
    NOISE,
    PEAK,
    LAPSE_RATE,
    NOISE_SLOPE,
    CRITERION_SLOPE,
    CONSTANT_ERROR,
    CONTRACTION,
)
#: What posteriors describe, in the order of tables and figures, by name.
QUANTITY_BY_NAME: Mapping[str, Quantity] = {
    quantity.name: quantity
    for quantity in (
        NOISE,
        Quantity(
            "mu1",
            r"prior mean $\mu_1$",
            "prior mean μ₁",
            "centre of the contraction",
            display=STIMULUS,
        ),
        Quantity(
            "sigma_p",
            r"memory noise $\sigma_p$",
            "memory noise σₚ",
            "noise that is added between the stimuli",
            display=KNOWN_DIFFERENCE,
        ),
        Quantity(
            "sigma_l",
            r"sensory noise $\sigma_\ell$",
            "sensory noise σℓ",
            "noise of the measurement",
            display=KNOWN_DIFFERENCE,
        ),
        PEAK,
        LAPSE_RATE,
        NOISE_SLOPE,
        CRITERION_SLOPE,
        Quantity("gamma", r"noise ratio $\gamma$", "noise ratio γ", "σℓ²/σₚ²", PURE_NUMBER),
        Quantity(
            "sigma1",
            r"prior sd $\sigma_1$",
            "prior sd σ₁",
            "spread of the prior",
            display=KNOWN_DIFFERENCE,
        ),
        Quantity(
            "gain",
            "gain $K$",
            "gain K",
            "weight of the first stimulus; 1: no contraction",
            PURE_NUMBER,
        ),
        Quantity("width", "width $w$", "width w", "width of the curve", display=KNOWN_DIFFERENCE),
        Quantity(
            "offset",
            "offset $c$",
            "offset c",
            "constant part of the order effect",
            display=KNOWN_DIFFERENCE,
        ),
        Quantity(
            "pull",
            "contraction",
            "contraction",
            "share of the way to the centre; 0: none",
            PURE_NUMBER,
            PERCENT,
        ),
        Quantity(
            "pse_shift",
            "PSE shift",
            "PSE shift",
            "second minus first stimulus when both seem equal, at the mean first stimulus",
            display=DIFFERENCE,
        ),
        CONSTANT_ERROR,
        CONTRACTION,
        Quantity("jnd", "JND", "JND", "just noticeable difference", display=DIFFERENCE),
        Quantity(
            "zone",
            "zone",
            "zone",
            "half-width of the differences that are called 'equal'",
            display=DIFFERENCE,
        ),
    )
}

#: Parameters in the order of the coordinates.
Parameters = tuple[Parameter, ...]


#: The four models of the observer by name, with the order effects that each model has.
ORDER_MODELS: Mapping[str, Parameters] = {
    "none": (),
    "constant error": (CONSTANT_ERROR,),
    "contraction": (CONTRACTION,),
    "both": (CONSTANT_ERROR, CONTRACTION),
}
#: Prior probability of each model.
MODEL_PRIOR = {"none": 1 / 2, "constant error": 1 / 6, "contraction": 1 / 6, "both": 1 / 6}


def task_parameters(task: Task) -> Parameters:
    """The parameters of a task's observer, in the order of the coordinates.

    Examples
    --------
    >>> [parameter.name for parameter in task_parameters(TASKS[1])]
    ['noise', 'lapse_rate', 'noise_slope', 'constant_error', 'contraction']
    """
    return tuple(parameter for parameter in PARAMETERS if task in parameter.tasks)


def group_parameters(task: Task) -> Parameters:
    """The parameters that a group has a distribution of.

    Examples
    --------
    >>> [parameter.name for parameter in group_parameters(TASKS[1])]
    ['constant_error', 'contraction', 'noise']
    """
    parameters = CONSTANT_ERROR, CONTRACTION, NOISE, PEAK  # the order of a group's tables
    return tuple(parameter for parameter in parameters if task in parameter.tasks)


def lapse_logs(u: FloatArray, b: float) -> ArrayPair:
    """Log of the lapse rate lambda and of 1 - lambda, from its normal score u.

    lambda has the distribution Beta(1, b), so that 1 - lambda = (1 - Phi(u))^(1/b).
    """
    log_complement = log_ndtr(-u) / b
    with np.errstate(divide="ignore", invalid="ignore"):
        log_rate = np.log(-np.expm1(log_complement))
        # Below -8, lambda is Phi(u) / b to all digits. Its log is finite where Phi(u) is too small
        # for a float, and `log_rate` is -inf.
        log_small_rate = log_ndtr(u) - np.log(b)
    return np.where(u < -8.0, log_small_rate, log_rate), log_complement


def lapse_score(rate: FloatArray, b: float) -> FloatArray:
    """The normal score of a lapse rate under Beta(1, b), the inverse of :func:`lapse_logs`."""
    return -ndtri_exp(b * np.log1p(-rate))
