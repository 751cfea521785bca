"""One subject under one model of the ladder: draws, evidence, predictive checks, leave-one-out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.comparison.evidence_table import frequency_evidence, importance_evidence
from bayes_toe.comparison.leave_one_out import LeaveOneOut, Unit, leave_one_out, leave_one_out_frequencies
from bayes_toe.data.study import Subject
from bayes_toe.inference.adaptation import adapt_proposal, fit_proposal, with_fresh_draws
from bayes_toe.inference.modes import find_maxima
from bayes_toe.inference.predictive_checks import FitSummary, summarise_fit
from bayes_toe.inference.sampling import Chains, SamplerSettings, sample_chains
from bayes_toe.model.free_frequencies import FrequencyModel
from bayes_toe.model.ladder import FREE_FREQUENCIES, PREDICTIVE_UPDATE, knows_intervals, model_named, model_posterior, said_of_intervals
from bayes_toe.model.prior import Prior
from bayes_toe.model.target import Target
from bayes_toe.seeds import generator, root_seed

_LEFT_OUT_VALUES = 5_000_000  # values of one array of log probabilities; draws are thinned to stay below, to no fewer than _LEAST_DRAWS
_LEAST_DRAWS = 1000
_FREQUENCY_DRAWS = 2000
_MOST_REFITS = 5  # a model that more pairs surprise describes the answers badly, which the other columns show
_UNITS: tuple[Unit, Unit] = ("trial", "pair")


@dataclass(frozen=True, eq=False)
class ModelDraws:
    """Posterior draws of one subject under one model, with the evidence from the same fitted proposal.

    Attributes
    ----------
    subject, model : str
    target : Target
        The posterior that was sampled.
    chains : Chains
        Unconstrained draws with their diagnostics.
    quantities : dict of str to array, shape (chains, draws)
        Named parameters.
    log_evidence, log_evidence_se : float or None
        Nats; None where withheld.
    pareto_k : float
        Of the importance weights.
    notes : tuple of str
        Why something is withheld.
    """

    subject: str
    model: str
    target: Target
    chains: Chains
    quantities: dict[str, FloatArray]
    log_evidence: float | None
    log_evidence_se: float | None
    pareto_k: float
    notes: tuple[str, ...]

    @property
    def converged(self) -> bool:
        """Whether every judged quantity met the criteria."""
        return self.chains.converged


def sample_model(subject: Subject, model: str, *, draws: int = 4000, seed: int | None = None, prior: Prior | None = None) -> ModelDraws:
    """Posterior draws and evidence of one subject under a model of the ladder.

    Parameters
    ----------
    subject : Subject
    model : str
        A name of :data:`bayes_toe.model.ladder.MODELS`. Free frequencies have their posterior in closed form and are not sampled.
    draws : int
        Bulk and tail effective draws to reach for every named quantity.
    seed : int, optional
        Root seed; for the predictive update the draws are those of :func:`bayes_toe.api.sample`.
    prior : Prior, optional

    Raises
    ------
    InputError
        If there is no such model.

    Examples
    --------
    >>> subject = Subject("S01", [0.0, 0.0, 0.3], [0.0, 0.3, 0.0], [49, 20, 15], [50, 50, 50])
    >>> found = sample_model(subject, "symmetric", draws=500, seed=1)
    >>> found.converged, sorted(found.quantities)
    (True, ['q0', 'width'])
    """
    root = root_seed(seed)
    target = model_posterior(subject, model_named(model), prior)
    # Under H1 the stream of the ordinary analysis: its numbers are the same to the last bit.
    keys = ("proposal",) if model == PREDICTIVE_UPDATE.name else ("proposal", model)
    rng = generator(root, subject.name, *keys)
    adapted = adapt_proposal(target, rng, maxima=find_maxima(target))
    chains = sample_chains(adapted, SamplerSettings(draws=draws), root)
    fitted = with_fresh_draws(adapted, rng)
    value, error, why_not = importance_evidence(fitted)
    notes = (why_not.replace("of H1 ", ""), "" if chains.converged else f"draws did not converge: {chains.reason}")
    return ModelDraws(
        subject.name, model, target, chains, target.judged(chains.x), value, error, fitted.pareto_k, tuple(note for note in notes if note)
    )


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

    def cell(self, column: str) -> object:
        """The entry of a column of compare.csv."""
        if column == "note":
            return "; ".join(self.notes)
        return getattr(self.checks if hasattr(self.checks, column) else self, column)


def compare_one(subject: Subject, model: str, *, draws: int, seed: int, prior: Prior) -> ModelRow:
    """Everything that the table says of one subject under one model."""
    return _frequency_row(subject, seed) if model == FREE_FREQUENCIES else _model_row(subject, model, draws, seed, prior)


def _frequency_row(subject: Subject, seed: int) -> ModelRow:
    model = FrequencyModel(subject)
    x = model.sample(generator(seed, subject.name, FREE_FREQUENCIES), _FREQUENCY_DRAWS)
    trial, pair = (leave_one_out_frequencies(subject.n_equal, subject.n_trials, unit=unit) for unit in _UNITS)
    checks, notes = _checks(trial, pair, summarise_fit(model, x, seed)), _of_intervals(subject, FREE_FREQUENCIES)
    return ModelRow(subject.name, FREE_FREQUENCIES, subject.n_pairs, frequency_evidence(subject), 0.0, None, checks, notes)


def _model_row(subject: Subject, model: str, draws: int, seed: int, prior: Prior) -> ModelRow:
    made = sample_model(subject, model, draws=draws, seed=seed, prior=prior)
    notes, checks, k = [*_of_intervals(subject, model), *made.notes], Checks(), len(made.target.coordinates)
    if made.converged:
        x = made.chains.x.reshape(-1, k)
        trial, pair = _left_out(made.target, x)
        if np.isnan(pair.elpd):
            pair = pair.filled(_refitted(made, np.flatnonzero(np.isnan(pair.values[0])).tolist(), seed))
        notes += [one.note for one in (trial, pair) if one.note]
        checks = _checks(trial, pair, summarise_fit(made.target, x, seed))
    else:
        notes.append("leave-one-out and predictive checks withheld with the draws")
    return ModelRow(subject.name, model, k, made.log_evidence, made.log_evidence_se, made.pareto_k, checks, tuple(notes))


def _of_intervals(subject: Subject, model: str) -> tuple[str, ...]:
    """The note of a model that does not know the intervals of a subject that has them."""
    return () if subject.isi is None or knows_intervals(model) else (said_of_intervals(model),)


def _left_out(target: Target, x: FloatArray) -> tuple[LeaveOneOut, LeaveOneOut]:
    """Leave-one-out by trial and by pair from draws of equal weight."""
    subject = target.subject
    most = max(_LEAST_DRAWS, _LEFT_OUT_VALUES // subject.n_pairs)
    logs = target.log_answers(x[:: max(1, -(-len(x) // most))])
    trial, pair = (leave_one_out(*logs, subject.n_equal, subject.n_trials, unit=unit) for unit in _UNITS)
    return trial, pair


def _refitted(made: ModelDraws, pairs: list[int], seed: int) -> dict[int, float]:
    """Log predictive density of left-out pairs where weights fail: ln p(y_i | rest) = ln Z(all) - ln Z(rest), by a fit without the pair.

    Where either evidence is withheld, or more pairs fail than are worth a fit each, there are no values.
    """
    if made.log_evidence is None or len(pairs) > _MOST_REFITS:
        return {}
    found: dict[int, float] = {}
    for pair in pairs:
        rest = _log_evidence_without(made.target, pair, generator(seed, made.subject, "left out", made.model, pair))
        if rest is not None:
            found[pair] = made.log_evidence - rest
    return found


def _log_evidence_without(target: Target, pair: int, rng: np.random.Generator) -> float | None:
    subject = target.subject
    kept = np.arange(subject.n_pairs) != pair
    if not kept.any():
        return 0.0  # no answers: their probability is 1
    isi = None if subject.isi is None else subject.isi[kept]
    rest = Subject(subject.name, subject.s1[kept], subject.s2[kept], subject.n_equal[kept], subject.n_trials[kept], isi)
    other = target.for_subject(rest)
    return importance_evidence(fit_proposal(other, rng))[0]


def _checks(trial: LeaveOneOut, pair: LeaveOneOut, summary: FitSummary) -> Checks:
    values = [None if np.isnan(value) else value for value in (trial.elpd, trial.se, pair.elpd, pair.se)]
    return Checks(values[0], values[1], values[2], values[3], summary.p_overall, summary.worst_p)
