"""The answer of one subject: whether there is an order effect, a constant error, a contraction.

`answer_subject` gives an :class:`OrderEffect`. The functions whose names begin with `format_` write
numbers as all screens do.

The four models of the observer give the probabilities and Bayes factors. The sizes are averaged
over the models that have the effect. The flags say why an answer may be wrong: the design cannot
show it, the responses cannot be interpreted, the model does not fit, or another scale of the prior
changes it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.special import expit

from bayes_toe.answers.serial_screen import NO_TESTS, SerialScreen, subject_screen
from bayes_toe.answers.words import Word, remains, word_for
from bayes_toe.arrays import BoolArray, FloatArray, Texts
from bayes_toe.checks.alarm_rate import FALSE_ALARM_SHARE, flag_limit
from bayes_toe.checks.answer_checks import Finding
from bayes_toe.checks.identification import Identification, identify
from bayes_toe.data.messages import capitalized, describe_p_value, format_estimate, join_words
from bayes_toe.data.stimulus_unit import UNKNOWN_UNIT, StimulusUnit, percent
from bayes_toe.data.study import Subject
from bayes_toe.inference.diagnostics import quantile_errors
from bayes_toe.inference.goodness_of_fit import GoodnessOfFit, PairResidual, summarise_fit
from bayes_toe.inference.model_set import ModelSet
from bayes_toe.inference.order_evidence import (
    HAS_CONTRACTION,
    HAS_EFFECT,
    HAS_ERROR,
    MODEL_NAMES,
    OrderDraws,
    OrderEvidence,
    order_evidence,
)
from bayes_toe.model.models import OrderModel
from bayes_toe.model.observer import DEFAULT_PRIOR
from bayes_toe.model.parameters import CONSTANT_ERROR, CONTRACTION, ObserverPrior
from bayes_toe.seeds import generator

#: The questions in the order of all tables, each with the models that have the effect.
QUESTIONS = {
    "order_effect": HAS_EFFECT,
    "constant_error": HAS_ERROR,
    "contraction": HAS_CONTRACTION,
}
#: Sizes, each with the quantiles of :data:`QUANTILES`. The zone is the difference between two
#: stimuli up to which the answer is 'equal'.
SIZES = (
    "pse_shift_percent",
    "pse_shift_jnd",
    "contraction_p",
    "jnd_percent",
    "zone_percent",
    "zone_jnd",
)
#: The size that stands beside the word for an effect.
SIZE_OF = {"constant_error": "pse_shift_percent", "contraction": "contraction_p"}
#: How a sentence on an effect ends with that size.
_SIZE_TEXTS = {"constant_error": ", PSE shift {}", "contraction": ", {} of the way to the mean"}
QUANTILES = {"q025": 0.025, "q50": 0.5, "q975": 0.975}
PROBABILITIES = tuple(QUANTILES.values())
#: Columns with which evidence.csv begins.
ANSWER_COLUMNS = (
    "subject",
    *QUESTIONS,
    "interpretable",
    "flags",
    *map("p_{}".format, QUESTIONS),
    *map("ln_bf_{}".format, QUESTIONS),
    *map("_".join, product(SIZES, QUANTILES)),
    "best_model",
    "fit_p",
    "history_p",
    "moving_criterion_p",
    *(
        f"log_evidence_{name}{ending}".replace(" ", "_")
        for name, ending in product(MODEL_NAMES, ("", "_se", "_laplace"))
    ),
)
#: A number for each question, or for each model, by name.
_Numbers = Mapping[str, float]
#: Nats below the highest evidence from which on a model hardly counts: exp(-5) is .007.
COUNTS_WITHIN = 5.0
#: Decimals that any number may have; more would show the error of rounding.
_MOST_DECIMALS = 15
#: Flags that do not come from :data:`bayes_toe.checks.answer_checks.FLAG_WORDS`.
MISFIT_FLAG = "the model does not fit"
PRIOR_FLAG = "depends on the prior"
PREVIOUS_TRIAL_FLAG = "responses depend on the previous trial"
WANDERING_FLAG = "the preference for a response wanders"


class Size(NamedTuple):
    """An estimate: the median and the ends of the central 95 % interval."""

    q025: float
    q50: float
    q975: float


#: The numbers of a :class:`Size`, in its order.
ThreeNumbers = Size | FloatArray | list[float]


class Line(NamedTuple):
    """The conclusion on one question, as it is printed; a text that does not exist is empty.

    Attributes
    ----------
    question : str
    word : str
        With the direction of a contraction.
    marks : str
        `!` for a poor fit, `?` if the word depends on the prior, each after a space.
    size : str
        The estimate with its 95 % interval and its unit.
    probability : str
        The posterior probability, as in '= .97'.
    factor : str
        The Bayes factor.
    reason : str
        Why the design cannot answer the question.
    """

    question: str
    word: str
    marks: str = ""
    size: str = ""
    probability: str = ""
    factor: str = ""
    reason: str = ""


@dataclass(frozen=True)
class Problem:
    """A sentence on the responses of a subject, with the option to type if there is one.

    Attributes
    ----------
    message : str
    option : str
        Option of a command that acts on the problem; empty if there is none.
    """

    message: str
    option: str = ""


@dataclass(frozen=True)
class OrderEffect:
    """The conclusion of one subject. The fields are columns of evidence.csv.

    Attributes
    ----------
    subject : str
    words : mapping of str to Word
        The word for each of :data:`QUESTIONS`.
    direction : str
        'contraction' or 'repulsion', by the sign of the median of p.
    is_interpretable : bool
        Whether the responses may be interpreted at all.
    probabilities, log_bayes_factors : mapping of str to float
        Numbers for each question; the Bayes factors do not depend on the models' prior
        probabilities.
    sizes : mapping of str to Size
        The estimate of each of :data:`SIZES` that the task has.
    upper_bounds : mapping of str to float
        The 95 % quantile of each question's size in JND, 0 where the effect is absent.
    best_model : str
        The model with the highest evidence.
    fit_p, history_p, moving_criterion_p : float or None
        P-values of the deviance of the best model, of the trial before, and of a criterion that
        wanders.
    log_evidence, standard_error, laplace : mapping of str to float
        Log evidence of each model, its standard error, and Laplace's approximation.
    unit : StimulusUnit
        The unit in which sizes are shown.
    notes : tuple of str
        What the design leaves open for this subject.
    reasons : mapping of str to str
        Why the design cannot answer a question, by the name of the question.
    problems : mapping of str to Problem
        Problems that speak against the answer or belong to it, by a flag of a few words.
    worst_pairs : tuple of PairResidual
        The pairs with the largest residuals.
    n_subjects : int
        Subjects of the study, which decide the limit of these p-values.
    """

    subject: str
    words: Mapping[str, Word]
    direction: str
    is_interpretable: bool
    probabilities: _Numbers
    log_bayes_factors: _Numbers
    sizes: Mapping[str, Size]
    upper_bounds: _Numbers
    best_model: str
    fit_p: float | None
    history_p: float | None
    moving_criterion_p: float | None
    log_evidence: _Numbers
    standard_error: _Numbers
    laplace: _Numbers
    unit: StimulusUnit = UNKNOWN_UNIT
    notes: Texts = ()
    reasons: Mapping[str, str] = field(default_factory=dict)
    problems: Mapping[str, Problem] = field(default_factory=dict)
    worst_pairs: tuple[PairResidual, ...] = ()
    n_subjects: int = 1

    @property
    def flags(self) -> Texts:
        """Problems that speak against the answer or belong to it, each in a few words."""
        return tuple(self.problems)

    @property
    def options(self) -> Texts:
        """Options of a command that act on the problems."""
        return tuple(problem.option for problem in self.problems.values() if problem.option)

    @property
    def fits(self) -> bool | None:
        """Whether the best model describes the responses; None where the fit is not testable."""
        return None if self.fit_p is None else self.fit_p >= flag_limit(self.n_subjects)

    @property
    def depends_on_prior(self) -> bool:
        """Whether a prior scale, halved or doubled, makes a `yes` or `no` less than probable."""
        return any(flag.startswith(PRIOR_FLAG) for flag in self.flags)

    @property
    def depends_on_previous_trial(self) -> bool:
        """Whether the score test of the trial before is below its limit."""
        return PREVIOUS_TRIAL_FLAG in self.flags

    @property
    def mark(self) -> str:
        """`!` if the subject needs a decision, else `?` if a word depends on the prior, or ''."""
        if self.fits is False or self.options or not self.is_interpretable:
            return "!"
        return "?" if self.depends_on_prior else ""

    def in_study(self, n_subjects: int) -> OrderEffect:
        """The answer with the flags of fit and of trial order for a study of so many subjects.

        The limit of a p-value depends on their number, so earlier flags of this kind are replaced.
        """
        wandering = "The preference for a response wanders over the trials ({})."
        # Without a zone the task is 'which was stronger?', where a preference for a response and a
        # constant error predict the same responses.
        if "zone_percent" not in self.sizes:
            wandering += " A constant error may be due to it."
        previous_trial = (
            "Responses seem to depend on the previous trial ({}). The command `history` estimates "
            "how probable and how large the effect is."
        )
        # Flag, p-value and message of each test; the braces are the place of the p-value.
        tests = (
            (MISFIT_FLAG, self.fit_p, "The model does not fit: {}."),
            (PREVIOUS_TRIAL_FLAG, self.history_p, previous_trial),
            (WANDERING_FLAG, self.moving_criterion_p, wandering),
        )

        problems = dict(self.problems)
        for flag, p_value, message in tests:
            problems.pop(flag, None)  # the flag of a study of another size
            if p_value is not None and p_value < flag_limit(n_subjects):
                problems[flag] = Problem(message.format(format_limit(p_value, n_subjects)))
        return replace(self, n_subjects=n_subjects, problems=problems)

    @property
    def first_is_overestimated(self) -> bool | None:
        """Whether the first stimulus seems stronger than it is; None if the interval holds 0."""
        size = self.sizes["pse_shift_percent"]
        if size.q025 <= 0.0 <= size.q975:
            return None
        return size.q50 > 0.0

    def word(self, question: str) -> str:
        """The word for a question as tables have it, with the direction of a contraction."""
        word = self.words[question]
        if question == "contraction" and word.is_positive:
            return f"{word} ({self.direction})"
        return str(word)

    @property
    def lines(self) -> Mapping[str, Line]:
        """The conclusion on each question, as screens, report, methods and figures print it.

        A question that is not interpreted, or cannot be told, has a word but no numbers.
        """
        return {question: self._line(question) for question in self.words}

    def _line(self, question: str) -> Line:
        """The conclusion on one question."""
        word = self.words[question]
        name = question.replace("_", " ")
        if not self.is_interpretable:
            return Line(name, "not interpreted")
        if word is Word.CANNOT_BE_TOLD:
            return Line(name, str(word), reason=self.reasons.get(question, ""))

        size = ""  # of the order effect, or of an effect that is denied
        if question in SIZE_OF and word not in (Word.NO, Word.PROBABLY_NOT):
            size = self.format_size(SIZE_OF[question])
        marks = " !" if self.fits is False else ""
        # The flag of the prior names the questions that depend on it.
        if any(flag.startswith(PRIOR_FLAG) and name in flag for flag in self.flags):
            marks += " ?"
        return Line(
            name,
            self.word(question),
            marks=marks,
            size=size,
            probability=format_probability(self.probabilities[question]),
            factor=format_bayes_factor(self.log_bayes_factors[question]),
        )

    def format_size(self, name: str) -> str:
        """One of :data:`SIZES` with its 95 % interval and its unit."""
        size = self.sizes[name]
        if name == "contraction_p":
            return format_share(size)
        sign = "+" if name.startswith("pse_shift") else ""
        if name.endswith("jnd"):  # a multiple of the JND has no unit
            return format_signed(size, sign=sign)
        return format_difference(size, self.unit, sign)

    @property
    def texts(self) -> Mapping[str, str]:
        """A row of a short table by its headings: each word with its size.

        An order effect has no size of its own. The mark of the subject takes its place.
        """
        texts = {"subject": self.subject}
        for question, line in self.lines.items():
            size_or_mark = line.size if question in SIZE_OF else self.mark
            texts[line.question] = f"{self.words[question]} {size_or_mark}".rstrip()
        return texts

    @property
    def cells(self) -> Mapping[str, object]:
        """The entries of :data:`ANSWER_COLUMNS`, in their order; an empty entry is None."""
        quantiles = []  # of all sizes
        for name in SIZES:
            for quantile in self.sizes.get(name, [np.nan] * 3):  # a task may lack a size
                quantiles.append(quantile if np.isfinite(quantile) else None)
        evidences = []  # all numbers of the first model, then all numbers of the next model
        for model in MODEL_NAMES:
            evidences += [
                self.log_evidence[model],
                self.standard_error[model],
                self.laplace[model],
            ]

        entries = (
            self.subject,
            *map(self.word, QUESTIONS),
            "yes" if self.is_interpretable else "no",
            "; ".join(self.flags),
            *map(self.probabilities.get, QUESTIONS),
            *map(self.log_bayes_factors.get, QUESTIONS),
            *quantiles,
            self.best_model,
            self.fit_p,
            self.history_p,
            self.moving_criterion_p,
            *evidences,
        )
        return dict(zip(ANSWER_COLUMNS, entries, strict=True))

    def describe(self) -> str:
        """The conclusion in sentences, without the name of the subject."""
        if not self.is_interpretable:
            return f"Not interpreted: {', '.join(self.flags)}."
        sentences = [self._describe_line(question, line) for question, line in self.lines.items()]
        sentences += [f"{capitalized(flag)}." for flag in self.flags]
        return " ".join(sentences)

    def _describe_line(self, question: str, line: Line) -> str:
        """A sentence on one question: the word, its probability, and the size or its upper bound.

        As in 'Constant error: yes (P > .99), PSE shift +12 % [+8, +16].', or 'Contraction: no (P
        = .02). With 95 % probability, the effect is at most 0.031 JND.'
        """
        text = f"{capitalized(line.question)}: {short_direction(line.word)}"
        if line.reason:
            return f"{text}, because {line.reason}."
        if line.probability:
            text += f" (P {line.probability})"
        # 'Yes' and 'probably' have the size of the effect, and other words its upper bound. The
        # order effect has no size of its own, and so no text for a size.
        bound = self.upper_bounds.get(question, 0.0)
        if self.words[question].is_positive:
            text += _SIZE_TEXTS.get(question, "").format(line.size)
        elif line.probability and bound > 0.0:
            text += f". With 95 % probability, the effect is at most {format_number(bound)} JND"
        return f"{text}."


def short_direction(word: str) -> str:
    """A word without the direction 'contraction', and with a comma before 'repulsion'.

    Examples
    --------
    >>> short_direction("yes (contraction)"), short_direction("yes (repulsion) ?")
    ('yes', 'yes, repulsion ?')
    """
    return word.replace(" (contraction)", "").replace(" (repulsion)", ", repulsion")


def format_probability(probability: float) -> str:
    """A probability after '=', or a bound after '>' or '<', with two digits.

    More digits show that a probability is not on the other side of the limit of a word.

    Examples
    --------
    >>> format_probability(0.914), format_probability(0.9999), format_probability(0.0)
    ('= .91', '> .99', '< .01')
    >>> format_probability(0.7498)  # undecided
    '= .7498'
    """
    if probability > 0.995:  # two digits would be 1.00
        return "> .99"
    if probability < 0.005:  # two digits would be 0.00
        return "< .01"
    text = f"{probability:.2f}"
    # Two digits must not be on the other side of a limit. With a log Bayes factor of -9, far
    # against the effect, each limit of probability changes the word.
    if word_for(float(text), -9.0) != word_for(probability, -9.0):
        text = f"{probability:.6g}"
    return f"= {text}".replace("0.", ".")


def format_difference(size: ThreeNumbers, unit: StimulusUnit, sign: str = "+") -> str:
    """A difference in per cent of intensity, written in a unit with its 95 % interval.

    A difference that per cents cannot show is in natural logs. `sign` '+' gives positive numbers a
    sign too.

    Examples
    --------
    >>> format_difference(Size(2.5, 5.61, 8.3), StimulusUnit("g"))
    '+5.6 % [+2.5, +8.3]'
    >>> format_difference(Size(900.0, 3.2e4, 9.1e9), StimulusUnit())
    '+6 ln [+2, +18]'
    """
    shown_unit = unit.with_logs_if_large(size)  # the unit, or natural logs where per cents end
    return format_signed(shown_unit.from_percent(size).tolist(), shown_unit.difference_unit, sign)


def format_signed(size: ThreeNumbers, unit: str = "", sign: str = "+") -> str:
    """A size with its unit and 95 % interval, two digits of the largest number.

    There are more digits if the ends would look equal. A number that is not 0 has as many digits as
    it needs not to look like 0. `sign` '+' gives positive numbers a sign too.

    Examples
    --------
    >>> format_signed(Size(2.5, 5.61, 8.3), "%"), format_signed(Size(-0.4, 11.7, 22.1))
    ('+5.6 % [+2.5, +8.3]', '+12 [-0.4, +22]')
    >>> format_signed(Size(2e-5, 3e-5, 4e-5), "%"), format_signed(Size(5.601, 5.61, 5.62))
    ('+0.000030 % [+0.000020, +0.000040]', '+5.61 [+5.60, +5.62]')
    """
    # Infinite numbers do not count, because they are printed as bounds, without decimals.
    largest = max(map(abs, filter(np.isfinite, size)), default=0.0)
    return _format_interval(size, unit, decimals_of(largest), sign)


def _format_interval(size: ThreeNumbers, unit: str, decimals: int, sign: str = "") -> str:
    """A size with its unit and interval: so many decimals, or more if its ends would look equal.

    As in '+5.61 % [+5.60, +5.62]'.
    """
    low, _, high = size
    if low < high:  # equal ends look equal with any decimals
        while decimals < _MOST_DECIMALS and round(low, decimals) >= round(high, decimals):
            decimals += 1
    low_text, median_text, high_text = (_format_value(value, decimals, sign) for value in size)
    return format_estimate(low_text, median_text, high_text, unit)


def decimals_of(value: float) -> int:
    """Decimals that show two significant digits of a positive number: 3 of 0.031, 0 of 110."""
    if not np.isfinite(value) or value <= 0.0:  # no digits to count
        return 0
    printed = float(f"{value:.2g}")  # 0.0996 is printed as 0.10, and has two decimals
    # The logarithm of 0.031 is -1.5, and its first digit is in decimal 2.
    return int(min(max(1 - np.floor(np.log10(printed)), 0), _MOST_DECIMALS))


def _format_value(value: float, decimals: int, sign: str = "") -> str:
    """A number with its decimals, or with one digit if it would look like 0 and is not.

    An infinite number is a natural log that was stored as per cent: the text is then a bound in
    natural logs. Per cents are finite up to a natural log of 700, and above -100 down to a
    natural log of -30.
    """
    if np.isinf(value):
        return "> 700" if value > 0.0 else "< -30"
    if round(value, decimals) == 0.0:
        decimals = max(decimals, decimals_of(abs(value)) - 1)  # one digit, not two
    return f"{value + 0.0:{sign}.{decimals}f}"  # + 0.0 makes 0 of -0


def format_number(value: float) -> str:
    """A number with two significant digits and no exponent.

    Examples
    --------
    >>> format_number(112.4), format_number(8.0), format_number(-0.0312), format_number(0.0)
    ('110', '8.0', '-0.031', '0')
    """
    return _format_value(float(f"{value:.2g}"), decimals_of(abs(value)))


def format_share(size: ThreeNumbers, sign: str = "") -> str:
    """A share with its 95 % interval, in per cent. `sign` '+' gives positive numbers a sign too.

    The contraction p is such a share, of the way to the mean.

    Examples
    --------
    >>> format_share(Size(-0.001, 0.16, 0.22)), format_share(Size(0.1, 0.2, 0.3), "+")
    ('16 % [-0.1, 22]', '+20 % [+10, +30]')
    """
    return _format_interval([100.0 * value for value in size], "%", decimals=0, sign=sign)


def format_draws(draws: FloatArray, n_effective: float, most_decimals: int, unit: str = "") -> str:
    """Median and 95 % interval of draws, (draws,), as text, with their effective number.

    Numbers end with the decimal in which the largest of their Monte Carlo errors begins, or earlier
    with `most_decimals`. An error above 1 leaves tens or hundreds. A number that is not 0 has as
    many decimals as it needs not to look like 0.

    Examples
    --------
    >>> format_draws(np.linspace(0.0, 2.0, 201), n_effective=201.0, most_decimals=3)
    '1.00 [0.05, 1.95]'
    """
    quantiles = np.quantile(draws, PROBABILITIES)
    error = quantile_errors(draws, PROBABILITIES, n_effective).max()
    decimals = most_decimals
    if 0.0 < error < np.inf:
        # The exponent of the error with one digit: 0.0096 is '1e-02', which leaves two decimals.
        _, _, exponent = f"{error:.0e}".partition("e")
        decimals = min(decimals, -int(exponent))
    if decimals < 0:  # numbers end with tens or hundreds
        quantiles = np.round(quantiles, decimals)
        decimals = 0
    return _format_interval(quantiles.tolist(), unit, decimals)


def format_decimals(value: float) -> str:
    """A number between -1 and 1 without the zero before its point.

    Examples
    --------
    >>> format_decimals(-0.047), format_decimals(-0.001), format_decimals(1.0)
    ('-.05', '-.001', '1.00')
    """
    return _format_value(value, decimals=2).replace("0.", ".", 1)


def format_limit(p_value: float, n_subjects: int) -> str:
    """A p-value below the limit for a study of so many subjects, with that limit.

    Examples
    --------
    >>> format_limit(0.00083, 12), format_limit(0.0, 1)
    ('test p = .00083, below .05/12', 'test p < .00001, below .05')
    """
    limit = format_decimals(FALSE_ALARM_SHARE)
    if n_subjects > 1:
        limit += f"/{n_subjects}"
    return f"{describe_p_value(p_value)}, below {limit}"


def describe_fit(fit_p: float | None, n_subjects: int) -> str:
    """Whether a model fits, with the p-value.

    Examples
    --------
    >>> describe_fit(0.4, 12), describe_fit(0.0008, 12), describe_fit(None, 12)
    ('good, test p = .40', 'poor, test p = .00080, below .05/12', 'not testable')
    """
    if fit_p is None:
        return "not testable"
    if fit_p < flag_limit(n_subjects):
        return f"poor, {format_limit(fit_p, n_subjects)}"
    return f"good, {describe_p_value(fit_p)}"


def format_bayes_factor(log_bayes_factor: float) -> str:
    """A Bayes factor, not its log: two digits between 1/100 and 100, a bound beyond.

    More digits show that it is not on the other side of the limit of a word.

    Examples
    --------
    >>> [format_bayes_factor(value) for value in (2.9, -0.92, 4.601, 5.0, -9.0)]
    ['18', '0.4', '100', '> 100', '< 1/100']
    >>> [format_bayes_factor(np.log(value)) for value in (2.97, 18.96, 0.3349)]
    ['2.97', '18.96', '0.3349']
    """
    if abs(log_bayes_factor) > np.log(100.0):
        return "> 100" if log_bayes_factor > 0.0 else "< 1/100"
    text = f"{np.exp(log_bayes_factor):.2g}"
    if word_of_bayes_factor(np.log(float(text))) is not word_of_bayes_factor(log_bayes_factor):
        text = f"{np.exp(log_bayes_factor):.4g}"
    return f"{float(text):g}"  # 100, not 1e+02


def word_of_bayes_factor(log_bayes_factor: float) -> Word:
    """The word for an effect whose prior probability is 1/2, by its log Bayes factor.

    Examples
    --------
    >>> str(word_of_bayes_factor(2.9)), str(word_of_bayes_factor(-0.9))
    ('probably', 'undecided')
    """
    return word_for(float(expit(log_bayes_factor)), log_bayes_factor)


# --- From evidences to the answer ----------------------------------------------------------------


def order_effect(
    evidence: OrderEvidence,
    identification: Identification,
    findings: Sequence[Finding] = (),
    fit: GoodnessOfFit | None = None,
    screen: SerialScreen = NO_TESTS,
) -> OrderEffect:
    """The answer of one subject.

    Parameters
    ----------
    evidence : OrderEvidence
    identification : Identification
        Which questions the design can answer.
    findings : sequence of Finding
        Problems in the responses.
    fit : GoodnessOfFit, optional
        Goodness of fit of the best model.
    screen : SerialScreen, optional
        Score tests of the trial before.
    """
    # Whether each model has the effect, by question. Where these pairs cannot distinguish a
    # contraction from a constant error, both appear as an error, which is then the whole effect.
    models_with_effect = dict(QUESTIONS)
    if identification.contraction_adds_to_error:
        models_with_effect["order_effect"] = HAS_ERROR
    probabilities = {}
    log_bayes_factors = {}
    for question, has_effect in models_with_effect.items():
        probabilities[question] = evidence.probability(has_effect)
        log_bayes_factors[question] = evidence.log_bayes_factor(has_effect)

    is_interpretable = all(finding.is_interpretable for finding in findings)
    answerable = [question for question in QUESTIONS if question not in identification.reasons]
    if is_interpretable:
        words = _words(evidence, models_with_effect, answerable)
    else:
        words = dict.fromkeys(QUESTIONS, Word.NOT_INTERPRETABLE)
    sizes, upper_bounds, flags = _sizes(evidence)

    problems = {}  # by flag; problems that forbid an interpretation come first
    for finding in sorted(findings, key=lambda finding: finding.is_interpretable):
        problems[finding.words] = Problem(finding.message, finding.option)
    problems |= _prior_problems(evidence, words, answerable, models_with_effect)
    for flag in flags:
        problems[flag] = Problem(f"{capitalized(flag)}.")

    # `in_study` adds the flags of p-values, here with the limit for a single subject. A table
    # of several subjects calls it again.
    return OrderEffect(
        subject=evidence.subject.name,
        words=words,
        direction="contraction" if sizes["contraction_p"].q50 >= 0.0 else "repulsion",
        is_interpretable=is_interpretable,
        probabilities=probabilities,
        log_bayes_factors=log_bayes_factors,
        sizes=sizes,
        upper_bounds=upper_bounds,
        unit=evidence.subject.unit,
        best_model=MODEL_NAMES[np.argmax(evidence.log_evidence)],
        # NaN if the fit is not testable.
        fit_p=fit.fit_p if fit is not None and np.isfinite(fit.fit_p) else None,
        history_p=screen.joint_p,
        moving_criterion_p=screen.moving_criterion_p,
        log_evidence=_by_model(evidence.log_evidence),
        standard_error=_by_model(evidence.standard_error),
        laplace=_by_model(evidence.laplace),
        notes=(*identification.notes, *dict.fromkeys(identification.reasons.values())),
        reasons=identification.reasons,
        problems=problems,
        worst_pairs=() if fit is None else fit.worst,
    ).in_study(n_subjects=1)


def _words(
    models: ModelSet, models_with_effect: Mapping[str, BoolArray], answerable: Sequence[str]
) -> dict[str, Word]:
    """The word for each question, from the posterior probability and Bayes factor of its effect.

    `models_with_effect` says, for each question, which models have the effect, (models,). A
    question that is not in `answerable` gets the word 'cannot be told', because the design cannot
    show its effect.
    """
    words = dict.fromkeys(QUESTIONS, Word.CANNOT_BE_TOLD)
    for question in answerable:
        has_effect = models_with_effect[question]
        words[question] = word_for(
            models.probability(has_effect), models.log_bayes_factor(has_effect)
        )
    return words


def _by_model(values: FloatArray) -> _Numbers:
    """Values of the four models by their names."""
    return dict(zip(MODEL_NAMES, values.tolist(), strict=True))


def _sizes(evidence: OrderEvidence) -> tuple[dict[str, Size], _Numbers, list[str]]:
    """The :data:`SIZES`, upper bounds in JND, and flags of sizes and evidences.

    The size of an effect is averaged over the models that have it; JND, zone and upper bounds are
    averaged over all models.
    """
    # Weighted draws; a quantity of them has the shape (draws,).
    all_draws = evidence.averaged()
    error_draws = evidence.averaged(HAS_ERROR)
    contraction_draws = evidence.averaged(HAS_CONTRACTION)
    shift = error_draws.quantities["constant_error"]
    jnd = all_draws.quantities["jnd"]
    sizes = {
        "pse_shift_percent": _size(error_draws, percent(shift)),
        "pse_shift_jnd": _size(error_draws, shift / error_draws.quantities["jnd"]),
        "contraction_p": _size(contraction_draws, contraction_draws.quantities["contraction"]),
        "jnd_percent": _size(all_draws, percent(jnd)),
    }
    if "zone" in all_draws.quantities:  # the task has the answer 'equal'
        zone = all_draws.quantities["zone"]
        sizes["zone_percent"] = _size(all_draws, percent(zone))
        sizes["zone_jnd"] = _size(all_draws, zone / jnd)

    return (
        sizes,
        _upper_bounds(evidence, all_draws),
        _flags(evidence, error_draws, contraction_draws),
    )


def _upper_bounds(evidence: OrderEvidence, draws: OrderDraws) -> _Numbers:
    """The 95 % quantile of each question's absolute size, in JND, at draws of all models."""
    subject = evidence.subject
    scales = subject.scales
    c = draws.quantities["constant_error"]  # (draws,)
    p = draws.quantities["contraction"]
    # The shift of the PSE at a first stimulus s1 is c - p (s1 - sbar), with the mean first stimulus
    # sbar over all conditions of the subject. `mean_shift` is the shift at the mean first stimulus
    # of this condition, and `roving` the SD of the shift over its first stimuli.
    mean_shift = c - p * (subject.mean_first - scales.sbar)
    roving = np.abs(p) * scales.first_spread
    sizes = {
        "order_effect": np.hypot(mean_shift, roving),  # the root mean square of the shift
        "constant_error": np.abs(c),
        "contraction": roving,
    }

    bounds = {}
    for question, size in sizes.items():
        (bounds[question],) = draws.quantiles(size / draws.quantities["jnd"], [0.95])
    return bounds


def _flags(
    evidence: OrderEvidence, error_draws: OrderDraws, contraction_draws: OrderDraws
) -> list[str]:
    """A flag for each size that rests on the prior, and one for inexact log evidences.

    A size rests on the prior if its median lies beyond the pairs shown. A log evidence is inexact
    if its standard error is above 0.1 nats, which changes a Bayes factor by 10 %. Only models whose
    log evidence is near the highest one count.
    """
    flags = []
    subject = evidence.subject
    scales = subject.scales
    size_of_error = np.abs(error_draws.quantities["constant_error"])
    largest_difference = np.abs(subject.s2 - subject.s1).max()
    if _size(error_draws, size_of_error).q50 > largest_difference:
        flags.append("the PSE lies outside the pairs shown, so its size rests on the prior")
    # The stimuli of a pair are about a step apart, so a shift of three steps lies beyond them.
    roving = np.abs(contraction_draws.quantities["contraction"]) * scales.first_spread
    if _size(contraction_draws, roving).q50 > 3.0 * scales.step:
        flags.append("the size of the contraction rests on the prior")

    is_near = evidence.log_evidence > evidence.log_evidence.max() - COUNTS_WITHIN
    largest_error = evidence.standard_error[is_near].max()
    if largest_error > 0.1:
        flags.append(f"the log evidences have a standard error of {largest_error:.2g}")
    return flags


def _size(draws: OrderDraws, values: FloatArray) -> Size:
    """The median and 95 % interval of values at weighted draws, (draws,)."""
    return Size(*draws.quantiles(values, PROBABILITIES))


# --- Prior sensitivity ---------------------------------------------------------------------------


def _prior_problems(
    evidence: OrderEvidence,
    words: Mapping[str, Word],
    answerable: Sequence[str],
    models_with_effect: Mapping[str, BoolArray],
) -> dict[str, Problem]:
    """A flag that names the questions whose words depend on the prior, with the explanation.

    In each of four other priors, the prior of one effect is half or twice as wide. A `yes` depends
    on the prior if it is not even `probably` with one of them, and a `no` if it is not even
    `probably not`. The dictionary is empty if no word depends on the prior.
    """
    names: list[str] = []  # of the questions whose words depend on the prior
    sentences = []
    widths = {"half": 0.5, "twice": 2.0}
    for effect, width in product((CONSTANT_ERROR, CONTRACTION), widths):
        models = evidence.with_prior_scale(effect, widths[width])
        new_words = _words(models, models_with_effect, answerable)

        changes = []
        for question in answerable:
            name = question.replace("_", " ")
            # Only the first change of a question is reported.
            if name not in names and not remains(words[question], new_words[question]):
                names.append(name)
                changes.append(f"{name} from '{words[question]}' to '{new_words[question]}'")
        if changes:
            prior = f"prior of the {effect.name.replace('_', ' ')} {width} as wide"
            sentences.append(f"A {prior} changes {join_words(changes)}.")
    if not names:
        return {}
    return {f"{PRIOR_FLAG}: {', '.join(names)}": Problem(" ".join(sentences))}


# --- The whole way of one subject ----------------------------------------------------------------


def answer_subject(
    subject: Subject, seed: int, prior: ObserverPrior = DEFAULT_PRIOR
) -> tuple[OrderEffect, OrderEvidence]:
    """The answer of one subject, and the evidences and draws that it rests on.

    Examples
    --------
    >>> subject = Subject("S01", [0.0, 0.0, 0.3], [0.0, 0.3, 0.0], [49, 20, 15], [50, 50, 50])
    >>> answer, _ = answer_subject(subject, seed=1)
    >>> answer.word("constant_error")
    'probably not'
    """
    (evidence,) = order_evidence([subject], seed, prior)
    return answer_evidence(evidence, seed), evidence


def answer_evidence(
    evidence: OrderEvidence, seed: int, findings: Sequence[Finding] = ()
) -> OrderEffect:
    """The answer of a subject from its evidences; tests of fit and of trial order are made here."""
    return order_effect(
        evidence,
        identify(evidence.subject),
        findings,
        fit=best_model_fit(evidence, seed),
        screen=subject_screen(evidence),
    )


def best_model_fit(evidence: OrderEvidence, seed: int) -> GoodnessOfFit:
    """Goodness of fit of the model with the highest evidence."""
    best = np.argmax(evidence.log_evidence)
    posterior = OrderModel(MODEL_NAMES[best]).posterior(evidence.subject, evidence.prior)
    rng = generator(seed, evidence.subject.name, MODEL_NAMES[best], "goodness of fit")
    # Draws and modes have all coordinates of the model 'both', of which the best model has some.
    points = evidence.draws[best].resampled(rng, 1000)[:, posterior.is_free]
    return summarise_fit(posterior, points, evidence.modes[best, posterior.is_free])
