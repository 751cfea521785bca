"""How evidence and posteriors depend on the prior: one value of it varied at a time, the weighted draws of one proposal re-used.

Draws x of a fitted proposal g carry log likelihood and log g; under another prior pi' their importance weights are L(x) pi'(x) / g(x),
exactly, so nothing is sampled again. The largest weights are smoothed (PSIS, Vehtari et al. 2024). Where k-hat exceeds 0.7 or too few draws
count, a proposal is fitted under that prior and fresh draws are made; the table says which was done.

The prior of H0, one uniform frequency per pair, has no scale to vary: the log Bayes factor moves as the evidence of H1 does.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from numbers import Integral, Real
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.special import logsumexp

from bayes_toe.arrays import FloatArray
from bayes_toe.comparison.verdict import log_weights_under
from bayes_toe.comparison.words import STRONG, conclusion
from bayes_toe.data.study import Study, Subject
from bayes_toe.data.tables import Table
from bayes_toe.data.tasks import SAME_DIFFERENT, Task
from bayes_toe.errors import InputError, require_kind
from bayes_toe.inference.adaptation import fit_proposal
from bayes_toe.inference.diagnostics import smoothed_unnormalised
from bayes_toe.inference.proposal import TRUSTED_EFFICIENCY, TRUSTED_K, FittedProposal, efficiency
from bayes_toe.inference.subject import EVIDENCE_DRAWS, Wanted, fitted_result
from bayes_toe.model.free_frequencies import frequency_evidence
from bayes_toe.model.ladder import posterior_of
from bayes_toe.model.posterior import Posterior
from bayes_toe.model.prior import Prior
from bayes_toe.model.prior_fields import PriorField
from bayes_toe.model.study_prior import prior_for
from bayes_toe.seeds import generator, root_seed
from bayes_toe.workers import Progress, Workers, run_in_order

if TYPE_CHECKING:
    import pandas as pd


QUANTILES = {"q05": 0.05, "q50": 0.5, "q95": 0.95}
#: How draws were made.
REWEIGHTED, RESAMPLED = "reweighted", "resampled"
_NUMBERS = ("subject", "varied", "factor", "value", "log_bayes_factor", "se", "pareto_k", "method")
_ENOUGH = 1000  # effective draws below which re-weighted draws give way to fresh ones


def summarised(task: Task = SAME_DIFFERENT) -> tuple[str, ...]:
    """Of which quantities the quantiles are told."""
    return ("mu1", "sigma_p", "sigma_l", task.lapses, "gain")


def sensitivity_columns(task: Task = SAME_DIFFERENT) -> tuple[str, ...]:
    """Columns of sensitivity.csv."""
    return (
        *_NUMBERS,
        *(f"{name}_{key}" for name in summarised(task) for key in QUANTILES),
        "prior",
    )


@dataclass(frozen=True, eq=False)
class SensitivityRow:
    """One subject under one prior.

    Attributes
    ----------
    subject, varied : str
        `varied` is the number of the prior that differs from the one given, by its name.
    factor : float or None
        By which a scale or shape is multiplied; None where a location is varied.
    prior : Prior
    log_bayes_factor, se : float or None
        H1 minus H0, natural log, with its standard error; None where k-hat says that neither can be trusted.
    pareto_k : float
    method : str
        "reweighted" or "resampled".
    quantiles : array, shape (5, 3)
        Of mu1, sigma_p, sigma_l (natural-log intensity), q0 or lapse_rate, and gain at 5, 50 and 95 %; NaN where there is no log Bayes
        factor.
    """

    subject: str
    varied: str
    factor: float | None
    prior: Prior
    log_bayes_factor: float | None
    se: float | None
    pareto_k: float
    method: str
    quantiles: FloatArray

    @property
    def value(self) -> float:
        """The varied value itself."""
        return float(getattr(self.prior, self.varied))


@dataclass(frozen=True, eq=False)
class SensitivityTable(Table[SensitivityRow]):
    """Rows of every subject of a study, in the study's order; within a subject one value of the prior after the other, ascending."""

    prior: Prior
    seed: int
    task: Task = SAME_DIFFERENT

    @property
    def names(self) -> tuple[str, ...]:
        """Subjects."""
        return tuple(dict.fromkeys(row.subject for row in self.rows))

    @property
    def varied(self) -> tuple[str, ...]:
        """What is varied: the numbers that the prior declares for H1, scales and shapes first."""
        return tuple(dict.fromkeys(row.varied for row in self.rows))

    @property
    def scales(self) -> tuple[str, ...]:
        """What is varied by factors: scales and shapes."""
        return tuple(name for name in self.varied if self.prior.declared_as(name).positive)

    def of(self, subject: str, varied: str) -> tuple[SensitivityRow, ...]:
        """Rows of one subject and one varied value."""
        found = tuple(row for row in self.rows if row.subject == subject and row.varied == varied)
        if not found:
            raise InputError(
                f"no rows of subject {subject!r} with {varied!r} varied; values: {', '.join(self.varied)}"
            )
        return found

    def default(self, subject: str) -> SensitivityRow:
        """The row of the prior that was given, of one subject: with one of a scale's factors, 1."""
        return next(row for row in self.of(subject, self.scales[0]) if row.factor == 1.0)

    def given(self, subject: str, varied: str) -> float:
        """The value of the prior that was given: with the numbers of this subject's stimuli."""
        return float(getattr(self.default(subject).prior, varied))

    def turns(self, subject: str, varied: str, level: float = 0.0) -> tuple[float, ...]:
        """Values of the prior at which the log Bayes factor crosses a level, between neighbouring rows.

        Interpolated linearly, in the logarithm of a scale; two rows without a value between them are not joined.
        """
        rows, scale = self.of(subject, varied), self.prior.declared_as(varied).positive
        value, above = np.array(
            [(row.value, row.log_bayes_factor) for row in rows], np.float64
        ).T - [[0.0], [level]]  # None becomes NaN
        at = np.flatnonzero(((above[:-1] < 0) != (above[1:] < 0)) & np.isfinite(np.diff(above)))
        share, (first, second) = above[at] / (above[at] - above[at + 1]), (value[at], value[at + 1])
        return tuple(
            (
                first * (second / first) ** share if scale else first + share * (second - first)
            ).tolist()
        )

    def summary(self) -> tuple[str, ...]:
        """One line a subject: where its conclusion turns, where it stops being strong, where values are missing, along each value."""
        lines = []
        for name in self.names:
            middle, firm = self.default(name).log_bayes_factor, list[str]()
            said = [
                f"{name}: "
                + (
                    "no log Bayes factor"
                    if middle is None
                    else f"log Bayes factor {middle:+.2f}, {conclusion(middle)}"
                )
            ]
            for varied in self.varied:
                rows, turns = self.of(name, varied), self.turns(name, varied)
                told = {
                    "turns": turns,
                    **{
                        f"passes {level:+g} nats": self.turns(name, varied, level)
                        for level in (STRONG, -STRONG)
                    },
                    "no reliable value": [
                        row.value for row in rows if row.log_bayes_factor is None
                    ],
                }
                said += [
                    f"{what} at {varied} = {' and '.join(f'{one:.3g}' for one in at)}"
                    for what, at in told.items()
                    if at
                ]
                firm += [] if turns else [f"{varied} = {rows[0].value:.3g}..{rows[-1].value:.3g}"]
            lines.append(
                "; ".join([*said, *([f"does not turn within {', '.join(firm)}"] if firm else [])])
            )
        return tuple(lines)

    def frame(self) -> pd.DataFrame:
        """The table with the columns of sensitivity.csv; natural logs and natural-log intensity, empty where a value does not exist."""
        import pandas as pd

        rows = [
            [
                *(getattr(row, name) for name in _NUMBERS),
                *row.quantiles.ravel().tolist(),
                row.prior.describe(self.task),
            ]
            for row in self.rows
        ]
        return pd.DataFrame(rows, columns=list(sensitivity_columns(self.task)))


def sensitivity(
    study: Study,
    *,
    prior: Prior | str | None = None,
    reach: float = 4.0,
    steps: int = 9,
    seed: int | None = None,
    workers: Workers = None,
    progress: Progress | None = None,
) -> SensitivityTable:
    """Evidence and posterior quantiles of every subject under priors around the one given.

    Parameters
    ----------
    study : Study
    prior : Prior, optional
        The middle of the range, with the numbers of each subject's stimuli.
    reach : float
        Scales and shapes are multiplied by factors from 1/reach to reach, evenly in their logarithm; larger than 1. Locations are shifted
        by up to one prior standard deviation of their parameter to both sides.
    steps : int
        Values of each, an odd number from 3, so that the prior itself is among them.
    seed : int, optional
        Root seed; with the same one the row of the prior itself uses the draws behind :func:`bayes_toe.analysis.evidence`.
    workers, progress
        As in :func:`bayes_toe.analysis.run`.

    Raises
    ------
    InputError
        If `reach` or `steps` is out of range.

    Examples
    --------
    >>> one = Subject("S01", [0.0, 0.0, 0.3], [0.0, 0.3, 0.0], [49, 20, 15], [50, 50, 50])
    >>> table = sensitivity(Study([one]), steps=3, seed=1, workers=1)
    >>> [(row.varied, row.value) for row in table.of("S01", "width_median")]
    [('width_median', 0.075), ('width_median', 0.3), ('width_median', 1.2)]
    """
    require_range(reach, steps)
    root, middle = root_seed(seed), prior_for(study, prior)
    powers = tuple(np.linspace(-1.0, 1.0, steps).tolist())
    jobs = [partial(_one_subject, subject, middle, powers, reach, root) for subject in study]
    found = run_in_order(jobs, workers, progress, [(name,) for name in study.names])
    return SensitivityTable(tuple(row for rows in found for row in rows), middle, root, study.task)


def require_range(reach: float, steps: int) -> None:
    """Refuse a range that cannot be walked."""
    require_kind("reach", reach, Real, "a number above 1, up to 1e6")
    require_kind("steps", steps, Integral, "an odd number from 3 to 999")
    if not 1.0 < reach <= 1e6:
        raise InputError(f"reach={reach:g}: allowed is a number above 1, up to 1e6")
    if not 3 <= steps < 1000 or steps % 2 == 0:
        raise InputError(
            f"steps={steps}: allowed is an odd number from 3 to 999, so that the prior itself is among them"
        )


def _one_subject(
    subject: Subject, middle: Prior, powers: tuple[float, ...], reach: float, seed: int
) -> list[SensitivityRow]:
    """Rows of one subject: for each value that is varied, one for each power of the reach."""
    posterior = posterior_of(subject, middle)
    middle = posterior.prior  # in numbers
    fitted = fitted_result(posterior, seed, Wanted(evidence_draws=EVIDENCE_DRAWS))[1].proposal
    own = _reweighted(fitted, middle)
    rows = []
    for varied, power in product(middle.varied(middle.of_h1(subject.task)), powers):
        wanted = posterior_of(subject, moved(middle, varied, power, reach))
        found = own if wanted.prior == middle else _under(fitted, wanted, seed)
        rows.append(_row(wanted, varied.name, reach**power if varied.positive else None, found))
    return rows


def moved(prior: Prior, varied: PriorField, power: float, reach: float) -> Prior:
    """The prior with a scale or shape multiplied by a power of the reach, or a location shifted by so many standard deviations."""
    value: float = getattr(prior, varied.name)
    there = (
        value * reach**power
        if varied.positive
        else value + power * prior.distribution(varied.parameter).spread
    )
    changes: dict[str, Any] = {varied.name: there}
    return replace(prior, **changes)


class _Weighted(NamedTuple):
    """Draws x, their log weights, k-hat and efficiency under some prior, and how they were made."""

    x: FloatArray
    log_weights: FloatArray
    pareto_k: float
    efficiency: float
    method: str

    @property
    def trusted(self) -> bool:
        """Whether averages over the weights can be trusted."""
        return self.pareto_k <= TRUSTED_K and self.efficiency > TRUSTED_EFFICIENCY


def _under(fitted: FittedProposal, wanted: Posterior, seed: int) -> _Weighted:
    """The draws of a proposal for one posterior under the prior of another one of the same model; fresh ones where those do not do."""
    old = _reweighted(fitted, wanted.prior)
    if old.trusted and old.efficiency * len(old.x) >= _ENOUGH:
        return old
    rng = generator(
        seed,
        wanted.subject.name,
        wanted.model.name,
        "sensitivity",
        wanted.model.describe(wanted.prior),
    )
    return _reweighted(fit_proposal(wanted, rng), wanted.prior)._replace(method=RESAMPLED)


def _reweighted(fitted: FittedProposal, prior: Prior) -> _Weighted:
    """The draws of a proposal that was fitted to one posterior as draws of the same model's under another prior."""
    made, k = smoothed_unnormalised(log_weights_under(fitted, prior))
    return _Weighted(fitted.draws.x, made, k, efficiency(made), REWEIGHTED)


def _row(wanted: Posterior, varied: str, factor: float | None, found: _Weighted) -> SensitivityRow:
    names, difference, error = summarised(wanted.subject.task), None, None
    quantiles = np.full((len(names), len(QUANTILES)), np.nan)
    if found.trusted:
        error = float(np.sqrt((1.0 / found.efficiency - 1.0) / len(found.x)))
        difference = float(
            logsumexp(found.log_weights) - np.log(len(found.x))
        ) - frequency_evidence(wanted.subject)
        some = np.isfinite(found.log_weights)
        weights = np.exp(found.log_weights[some] - found.log_weights.max())
        values = wanted.quantities(found.x[some])
        quantiles = np.stack(
            [weighted_quantiles(values[name], weights, list(QUANTILES.values())) for name in names]
        )
    return SensitivityRow(
        wanted.subject.name,
        varied,
        factor,
        wanted.prior,
        difference,
        error,
        found.pareto_k,
        found.method,
        quantiles,
    )


def weighted_quantiles(
    values: FloatArray, weights: FloatArray, probabilities: npt.ArrayLike
) -> FloatArray:
    """Quantiles of weighted values, each of shape (draws,); linear between the middles of the steps of the distribution function."""
    order = np.argsort(values)
    share = np.cumsum(weights[order])
    middles = (share - 0.5 * weights[order]) / share[-1]
    return np.asarray(np.interp(np.asarray(probabilities, np.float64), middles, values[order]))
