"""One subject under one model, as the comparison table has it: evidence, predictive checks, leave-one-out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from bayes_toe.comparison.leave_one_out import LeaveOneOut, Unit, below_best, leave_one_out, leave_one_out_frequencies, leave_one_pair_out
from bayes_toe.data.study import Subject
from bayes_toe.inference.adaptation import fit_proposal
from bayes_toe.inference.evidence import Evidence, importance_evidence
from bayes_toe.inference.predictive_checks import FitSummary
from bayes_toe.inference.sampling import Chains, SamplerSettings
from bayes_toe.inference.subject import EVIDENCE_DRAWS, AnyPosterior, Wanted, infer
from bayes_toe.model.ladder import Record
from bayes_toe.model.prior import Prior
from bayes_toe.model.target import Answering, Conjugate, Target
from bayes_toe.seeds import generator

_LEFT_OUT_VALUES = 5_000_000  # values of one array of log probabilities; draws are thinned to stay below, to no fewer than _LEAST_DRAWS
_LEAST_DRAWS = 1000
_MOST_REFITS = 5  # a model that more pairs surprise describes the answers badly, which the other columns show
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

    def cell(self, column: str) -> object:
        """The entry of a column of compare.csv."""
        if column == "note":
            return "; ".join(self.notes)
        if "_diff" in column:
            return self.differences.get(column)
        return getattr(self.checks if hasattr(self.checks, column) else self, column)


def compare_one(subject: Subject, model: Record, *, draws: int, seed: int, prior: Prior) -> ModelRow:
    """Everything that the table says of one subject under one model."""
    target = model.posterior(subject, prior)
    result = infer(target, seed, Wanted(SamplerSettings(draws=draws, max_quantile_error=np.inf), EVIDENCE_DRAWS))
    found, chains, fit = result.evidence, result.chains, result.fit
    assert found is not None  # it was asked for, as were the others
    assert chains is not None
    assert fit is not None
    notes = [*_of_intervals(target), *(note for note in (found.why_not,) if note)]
    if chains.converged:
        trial, pair = _left_out(target, chains, found, seed)
        notes += [one.note for one in (trial, pair) if one.note]
        checks, left_out = _checks(trial, pair, fit), dict(zip(UNITS, (trial, pair), strict=True))
    else:
        notes += [f"draws did not converge: {chains.reason}", "leave-one-out and predictive checks withheld with the draws"]
        checks, left_out = Checks(), {}
    evidence = found.value, found.se, found.pareto_k
    return ModelRow(subject.name, target.model.name, len(target.coordinates), *evidence, checks, tuple(notes), left_out=left_out)


def failed_row(subject: Subject, model: Record, reason: str, *, prior: Prior) -> ModelRow:
    """The row where that work was lost."""
    size = len(model.posterior(subject, prior).coordinates)
    return ModelRow(subject.name, model.name, size, None, None, None, Checks(), (reason,), failed=True)


def with_differences(rows: Sequence[ModelRow]) -> list[ModelRow]:
    """The rows of one subject with the leave-one-out differences to the best of its models."""
    found: list[dict[str, float]] = [{} for _ in rows]
    for unit in UNITS:
        known = [i for i, row in enumerate(rows) if unit in row.left_out]
        for i, pair in zip(known, below_best([rows[i].left_out[unit] for i in known]), strict=True):
            found[i] |= {name: value for name, value in zip(difference_columns(unit), pair, strict=True) if not np.isnan(value)}
    return [replace(row, differences=own) for row, own in zip(rows, found, strict=True)]


def difference_columns(unit: Unit) -> tuple[str, str]:
    """Columns of the difference to the best model and of its error."""
    return f"elpd_loo_{unit}_diff", f"elpd_loo_{unit}_diff_se"


def _of_intervals(target: Answering) -> tuple[str, ...]:
    """The note of a model that does not know the intervals of a subject that has them."""
    return () if target.subject.isi is None or target.model.knows_intervals else (target.model.of_intervals,)


def _left_out(target: AnyPosterior, chains: Chains, evidence: Evidence, seed: int) -> tuple[LeaveOneOut, LeaveOneOut]:
    """Leave-one-out by trial and by pair: in closed form, or from draws, refitting where their weights fail."""
    subject = target.subject
    if isinstance(target, Conjugate):
        trial, pair = (leave_one_out_frequencies(subject.n_equal, subject.n_trials, unit=unit) for unit in UNITS)
        return trial, pair
    x = chains.x.reshape(-1, len(target.coordinates))
    most = max(_LEAST_DRAWS, _LEFT_OUT_VALUES // subject.n_pairs)
    some = x[:: max(1, -(-len(x) // most))]
    trial = leave_one_out(*target.answers_given_the_rest(some), subject.n_equal, subject.n_trials)
    pair = leave_one_pair_out(target.pair_log_likelihood(some), subject.n_trials)
    failed = np.flatnonzero(np.isnan(pair.values[0])).tolist()
    return trial, pair.filled(_refitted(target, evidence, failed, seed)) if failed else pair


def _refitted(target: Target, evidence: Evidence, pairs: list[int], seed: int) -> dict[int, float]:
    """Log predictive density of left-out pairs where weights fail: ln p(y_i | rest) = ln Z(all) - ln Z(rest), by a fit without the pair.

    Where either evidence is withheld, or more pairs fail than are worth a fit each, there are no values.
    """
    if evidence.value is None or len(pairs) > _MOST_REFITS:
        return {}
    found: dict[int, float] = {}
    for pair in pairs:
        rest = _log_evidence_without(target, pair, generator(seed, target.subject.name, target.model.name, "left out", pair))
        if rest is not None:
            found[pair] = evidence.value - rest
    return found


def _log_evidence_without(target: Target, pair: int, rng: np.random.Generator) -> float | None:
    subject = target.subject
    kept = np.arange(subject.n_pairs) != pair
    if not kept.any():
        return 0.0  # no answers: their probability is 1
    isi = None if subject.isi is None else subject.isi[kept]
    rest = Subject(subject.name, subject.s1[kept], subject.s2[kept], subject.n_equal[kept], subject.n_trials[kept], isi)
    return importance_evidence(fit_proposal(target.for_subject(rest), rng)).value


def _checks(trial: LeaveOneOut, pair: LeaveOneOut, summary: FitSummary) -> Checks:
    values = [None if np.isnan(value) else value for value in (trial.elpd, trial.se, pair.elpd, pair.se)]
    return Checks(values[0], values[1], values[2], values[3], summary.p_overall, summary.worst_p)
