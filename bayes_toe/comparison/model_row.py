"""One subject under one model, as the comparison table has it: evidence, predictive checks, leave-one-out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.comparison.leave_one_out import (
    LeaveOneOut,
    Unit,
    below_best,
    leave_one_out,
    leave_one_out_frequencies,
    leave_one_pair_out,
    left_out_pairs,
    thinning,
)
from bayes_toe.comparison.verdict import Doubt, Verdict, verdict
from bayes_toe.data.study import Subject
from bayes_toe.inference.adaptation import redrawn
from bayes_toe.inference.diagnostics import smoothed_weights
from bayes_toe.inference.evidence import Evidence
from bayes_toe.inference.maxima import Maxima
from bayes_toe.inference.predictive_checks import FitSummary, summarise_fit
from bayes_toe.inference.proposal import FittedProposal
from bayes_toe.inference.sampling import SamplerSettings, sample_chains
from bayes_toe.inference.space import WINDOW
from bayes_toe.inference.subject import EVIDENCE_DRAWS, Wanted, exact_result, fitted_result
from bayes_toe.model.free_frequencies import FREE_FREQUENCIES, FrequencyPosterior
from bayes_toe.model.ladder import Answering, Record, Target
from bayes_toe.model.prior import Prior
from bayes_toe.model.target import hessian
from bayes_toe.seeds import generator

_EQUAL_DRAWS = 2500  # at least, so that a k-hat of 0.7 is allowed
#: Said of models outside the window.
FAR = f"more than {WINDOW:g} nats below the best: Laplace's approximation, and no draws"
UNITS: tuple[Unit, Unit] = ("trial", "pair")


@dataclass(frozen=True)
class Checks:
    """How well a model predicts; None where a value is withheld.

    Attributes
    ----------
    elpd_loo_trial, elpd_loo_pair : float or None
        Leave-one-out expected log predictive density of a left-out answer or pair, summed, nats; each with its standard error.
    p_predictive, p_worst_pair : float or None
        Posterior predictive p-value of the deviance, and the smallest one of a pair, not corrected for their number.
    """

    elpd_loo_trial: float | None = None
    elpd_loo_trial_se: float | None = None
    elpd_loo_pair: float | None = None
    elpd_loo_pair_se: float | None = None
    p_predictive: float | None = None
    p_worst_pair: float | None = None


@dataclass(frozen=True)
class ModelRow:
    """One subject under one model, as the comparison table has it; None where a value does not exist, with the reason in `notes`.

    With intervals, the notes of a model that does not know them begin by saying so.

    Attributes
    ----------
    parameters : int
        Dimension of the model.
    log_evidence, log_evidence_se, pareto_k : float or None
        Nats; the evidence of free frequencies is exact and has no k-hat.
    model_probability : float or None
        Posterior probability at equal prior probabilities of the models in the table.
    differences : dict of str to float
        By column, leave-one-out differences to the subject's best model in the table with their paired errors; without what is withheld.
    left_out : dict of str to LeaveOneOut
        By unit, the values behind the leave-one-out columns; empty where draws did not converge.
    failed : bool
        Whether the work was lost, and all values with it.
    bound : float
        What a withheld log evidence is at most, nats.
    """

    subject: str
    model: str
    parameters: int
    log_evidence: float | None
    log_evidence_se: float | None
    pareto_k: float | None
    checks: Checks
    notes: tuple[str, ...] = ()
    model_probability: float | None = None
    differences: Mapping[str, float] = field(default_factory=dict)
    left_out: Mapping[Unit, LeaveOneOut] = field(default_factory=dict, compare=False, repr=False)
    failed: bool = False
    bound: float = np.inf

    def cell(self, column: str) -> object:
        """The entry of a column of compare.csv."""
        if column == "note":
            return "; ".join(self.notes)
        if "_diff" in column:
            return self.differences.get(column)
        return getattr(self.checks if hasattr(self.checks, column) else self, column)


def compare_one(
    subject: Subject, model: Record, *, draws: int, seed: int, prior: Prior
) -> ModelRow:
    """Everything that the table says of one subject under one model."""
    target, settings = model.posterior(subject, prior), _settings(draws)
    if isinstance(target, FrequencyPosterior):  # in closed form, but for predictive checks
        exact = exact_result(target, seed, Wanted(settings, EVIDENCE_DRAWS))
        assert exact.evidence is not None  # it was asked for
        left_out = {
            unit: leave_one_out_frequencies(subject.n_yes, subject.n_trials, unit=unit)
            for unit in UNITS
        }
        return _row(target, exact.evidence, left_out, exact.fit)
    result, (maxima, fitted) = fitted_result(target, seed, Wanted(evidence_draws=EVIDENCE_DRAWS))
    assert result.evidence is not None
    return _checked(fitted, maxima, result.evidence, settings, seed)


def compare_space(
    subject: Subject, *, draws: int, seed: int, prior: Prior, data: tuple[Doubt, ...] = ()
) -> tuple[tuple[ModelRow, ...], Verdict]:
    """The same of free frequencies and every model of the space, from the evidences of the verdict, and the verdict."""
    said, space = verdict(subject, prior, seed, data=data)
    rows = [compare_one(subject, FREE_FREQUENCIES, draws=draws, seed=seed, prior=prior)]
    for i, (model, value) in enumerate(zip(space.models, space.log_evidence.tolist(), strict=True)):
        if i in space.sampled:
            fitted, evidence, mode = space.sampled[i]
            target = fitted.proposal.posterior
            bend = -hessian(partial(_slope, target), mode)
            maxima = Maxima(mode, target.log_density(mode), bend, True, mode[:0])
            enough = redrawn(
                fitted,
                generator(seed, subject.name, model.name, "compared"),
                max(_EQUAL_DRAWS, 5 * draws),
            )
            rows.append(
                _checked(
                    enough if enough.trusted else fitted, maxima, evidence, _settings(draws), seed
                )
            )
        else:
            rows.append(
                ModelRow(
                    subject.name,
                    model.name,
                    len(model.coordinates),
                    value,
                    None,
                    None,
                    Checks(),
                    (FAR,),
                )
            )
    return tuple(rows), said


def _slope(target: Target, x: FloatArray) -> FloatArray:
    return target.gradient(x)[1]


def _settings(draws: int) -> SamplerSettings:
    return SamplerSettings(draws=draws, max_quantile_error=np.inf)


def _row(
    target: Answering,
    evidence: Evidence,
    left_out: Mapping[Unit, LeaveOneOut],
    fit: FitSummary | None,
    reason: str = "",
) -> ModelRow:
    """The row of what was found, or without fit and what was left out, of why draws fall short."""
    subject = target.subject
    # Models that do not know the intervals of a subject say so.
    notes = (
        [] if subject.isi is None or target.model.knows_intervals else [target.model.of_intervals]
    )
    notes += [note for note in (evidence.why_not, *(one.note for one in left_out.values())) if note]
    if target.model.by_trial:
        notes.append("leave-one-out withheld: answers depend on the trials before")
    if reason:
        notes += [
            f"draws did not converge: {reason}",
            "leave-one-out and predictive checks withheld with the draws",
        ]
    scores = {
        f"elpd_loo_{unit}{end}": value
        for unit, one in left_out.items()
        for end, value in (("", one.elpd), ("_se", one.se))
    }
    known = {name: value for name, value in scores.items() if not np.isnan(value)}
    checks = (
        Checks()
        if fit is None
        else Checks(**known, p_predictive=fit.p_overall, p_worst_pair=fit.worst_p)
    )
    return ModelRow(
        subject=subject.name,
        model=target.model.name,
        parameters=len(target.coordinates),
        log_evidence=evidence.value,
        log_evidence_se=evidence.se,
        pareto_k=evidence.pareto_k,
        checks=checks,
        notes=tuple(notes),
        left_out=left_out,
        bound=evidence.bound,
    )


def failed_row(subject: Subject, model: Record, reason: str, *, prior: Prior) -> ModelRow:
    """The row where that work was lost."""
    size = len(model.posterior(subject, prior).coordinates)
    return ModelRow(
        subject.name, model.name, size, None, None, None, Checks(), (reason,), failed=True
    )


def with_differences(rows: Sequence[ModelRow]) -> list[ModelRow]:
    """The rows of one subject with the leave-one-out differences to the best of its models."""
    found: list[dict[str, float]] = [{} for _ in rows]
    for unit in UNITS:
        known = [i for i, row in enumerate(rows) if unit in row.left_out]
        for i, pair in zip(known, below_best([rows[i].left_out[unit] for i in known]), strict=True):
            found[i] |= {
                name: value
                for name, value in zip(difference_columns(unit), pair, strict=True)
                if not np.isnan(value)
            }
    return [replace(row, differences=own) for row, own in zip(rows, found, strict=True)]


def difference_columns(unit: Unit) -> tuple[str, str]:
    """Columns of the difference to the best model and of its error."""
    return f"elpd_loo_{unit}_diff", f"elpd_loo_{unit}_diff_se"


def _checked(
    fitted: FittedProposal, maxima: Maxima, evidence: Evidence, settings: SamplerSettings, seed: int
) -> ModelRow:
    """The row from the draws of a fitted proposal."""
    target = fitted.proposal.posterior
    x, log_likelihood, reason = _equal_draws(fitted, settings, seed)
    if reason:
        return _row(target, evidence, {}, None, reason)
    fit = summarise_fit(target, x, seed, log_likelihood=log_likelihood)
    if target.model.by_trial:  # without an answer the trials behind it would be others
        return _row(target, evidence, {}, fit)
    subject, some = target.subject, x[:: thinning(len(x), target.subject.n_pairs)]
    trial = leave_one_out(*target.answers_given_the_rest(some), subject.n_yes, subject.n_trials)
    if fitted.trusted:
        pair = left_out_pairs(fitted, maxima, evidence, seed)
    else:
        pair = leave_one_pair_out(target.pair_log_likelihood(some), subject.n_trials)
    return _row(target, evidence, {"trial": trial, "pair": pair}, fit)


def _equal_draws(
    fitted: FittedProposal, settings: SamplerSettings, seed: int
) -> tuple[FloatArray, FloatArray, str]:
    """Posterior draws of equal weight, shape (draws, k), their log likelihoods, and why they fall short where they do.

    Those of the proposal, taken by their weights: they are independent. Chains where the proposal cannot be trusted, or fewer count than
    were asked for.
    """
    target, draws, size = (
        fitted.proposal.posterior,
        fitted.draws,
        max(_EQUAL_DRAWS, 5 * settings.draws // 2),
    )
    counting = 1.0 / (1.0 / (fitted.efficiency * len(draws.x)) + 1.0 / size)
    if not fitted.trusted or counting < settings.draws:
        chains = sample_chains(fitted, settings, seed)
        x = chains.x.reshape(-1, len(target.coordinates))
        return x, chains.log_posterior.ravel() - target.log_prior(x), chains.reason
    below = np.cumsum(np.exp(smoothed_weights(draws.log_weights).log_weights))
    places = (
        np.arange(size)
        + generator(seed, target.subject.name, target.model.name, "equal draws").uniform()
    ) / size
    kept = np.searchsorted(below[:-1], places * below[-1], side="right")
    return draws.x[kept], draws.log_posterior[kept] - draws.log_prior[kept], ""
