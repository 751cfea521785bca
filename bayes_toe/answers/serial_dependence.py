"""Serial dependence: whether responses depend on response or stimuli of the trial before.

`serial_dependence` analyses a study, `subject_dependence` one subject.

Four models of a subject are equally probable beforehand: previous response {no, yes} times stimuli
{static, carry-over}. The models without carry-over have the likeliest of the four models of order.
The models with carry-over have the likelier one of 'contraction' and 'both', since without a
contraction nothing is carried over.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import product

import numpy as np
import pandas as pd

from bayes_toe.answers.order_effect import PROBABILITIES, QUANTILES, format_decimals
from bayes_toe.answers.serial_screen import NO_TESTS, SerialScreen, subject_screen
from bayes_toe.answers.words import word_for
from bayes_toe.arrays import FloatArray, Record, StrPath
from bayes_toe.data.messages import format_estimate
from bayes_toe.data.study import Study, Subject, require_study
from bayes_toe.data.tables import SubjectTable
from bayes_toe.errors import NumericalError
from bayes_toe.inference.engine import Precision, fitted_draws, mixture_of_points
from bayes_toe.inference.mixture import WeightedDraws
from bayes_toe.inference.model_set import ModelSet, weighted_quantiles
from bayes_toe.inference.order_evidence import (
    BATCH,
    MODEL_NAMES,
    OrderEvidence,
    unchecked_evidence,
)
from bayes_toe.model.models import OrderModel
from bayes_toe.model.parameters import ObserverPrior
from bayes_toe.model.prior import Prior
from bayes_toe.model.prior_file import prior_for
from bayes_toe.model.trial_history import TrialHistory, TrialHistoryPosterior, require_order
from bayes_toe.result_store import load_result, resumed_seed, run_stored
from bayes_toe.seeds import generator
from bayes_toe.workers import Progress, Workers, try_each

#: The four models, in the order of their evidences.
HISTORIES = ("static", "previous_response", "carry_over", "carry_over_and_previous_response")
#: The two effects, each with the models of :data:`HISTORIES` that have the effect.
EFFECT_MODELS = {
    "carry_over": np.array([False, False, True, True]),
    "previous_response": np.array([False, True, False, True]),
}
_EQUAL_PRIOR = np.full(len(HISTORIES), 1.0 / len(HISTORIES))  # prior probabilities
_EVIDENCES = tuple(map("log_evidence_{}".format, HISTORIES))
_SIZES = tuple(map("_".join, product(("rho", "kappa"), QUANTILES)))
#: Columns of history.csv.
HISTORY_COLUMNS = (
    "subject",
    *EFFECT_MODELS,
    *map("p_{}".format, EFFECT_MODELS),
    *map("ln_bf_{}".format, EFFECT_MODELS),
    *_SIZES,
    "order_model",
    "carry_over_order_model",
    "best_history",
    *map("".join, product(_EVIDENCES, ("", "_se"))),
    "history_p",
    "moving_criterion_p",
    "note",
)
#: Points from which a mixture is made.
_CLOUD_POINTS = 500
#: Draws of a subject for the figure.
_FIGURE_DRAWS = 300


@dataclass(frozen=True, eq=False)
class SubjectDependence:
    """The conclusion for one subject. Without a result there are only its tests and a note.

    Attributes
    ----------
    subject : str
    order_models : tuple of str
        The model of order without carry-over, and the model of order with carry-over.
    log_evidence, standard_error : ndarray, shape (4,)
        Log evidence of each of :data:`HISTORIES` and its error, nats; NaN without a result.
    rho, kappa : tuple of float
        Median within the central 95 % interval of the carried-over share and of the effect of the
        previous response, over the models that have the effect: quantiles .025, .5, .975.
    screen : SerialScreen
        The score tests.
    note : str
        Why there is no result.
    draws : tuple of ndarray
        Some draws of the model without history, (draws, k), and of the best of the four models.
    """

    subject: str
    order_models: tuple[str, str] = ("", "")
    log_evidence: FloatArray = field(default_factory=lambda: np.full(4, np.nan))
    standard_error: FloatArray = field(default_factory=lambda: np.full(4, np.nan))
    rho: tuple[float, ...] = ()
    kappa: tuple[float, ...] = ()
    screen: SerialScreen = NO_TESTS
    note: str = ""
    draws: tuple[FloatArray, ...] = ()

    @property
    def has_result(self) -> bool:
        """Whether the evidences of all four models are known."""
        return not self.note

    @property
    def best_history(self) -> str:
        """The name of the model that has the highest evidence; empty without a result."""
        return HISTORIES[np.argmax(self.log_evidence)] if self.has_result else ""

    def probability(self, effect: str) -> float:
        """Posterior probability of one of the two effects."""
        return ModelSet(self.log_evidence, _EQUAL_PRIOR).probability(EFFECT_MODELS[effect])

    def log_bayes_factor(self, effect: str) -> float:
        """Log of the evidence with an effect over the evidence without the effect, nats."""
        return ModelSet(self.log_evidence, _EQUAL_PRIOR).log_bayes_factor(EFFECT_MODELS[effect])

    def word(self, effect: str) -> str:
        """The word for an effect; '' without a result.

        An effect of the previous response has a direction, as in 'yes (repetition)'.
        """
        if not self.has_result:
            return ""
        word = word_for(self.probability(effect), self.log_bayes_factor(effect))
        if effect == "previous_response" and word.is_positive:
            # The direction is the sign of the median, the second of the three quantiles.
            direction = "repetition" if self.kappa[1] > 0.0 else "alternation"
            return f"{word} ({direction})"
        return str(word)

    def size(self, effect: str) -> str:
        """The size of an effect with its interval, as '.12 [.05, .20]'; empty without a result."""
        quantiles = self.rho if effect == "carry_over" else self.kappa
        return format_estimate(*map(format_decimals, quantiles)) if quantiles else ""

    def history(self, name: str) -> TrialHistory:
        """The model of one of :data:`HISTORIES`, with the model of order that goes with it."""
        # The name lists the effects of the model, as in 'carry_over_and_previous_response'.
        has_carry_over = "carry_over" in name
        without_carry_over, with_carry_over = self.order_models
        order = OrderModel(with_carry_over if has_carry_over else without_carry_over)
        return TrialHistory(order, "previous_response" in name, has_carry_over)

    @property
    def cells(self) -> Mapping[str, object]:
        """The entries of :data:`HISTORY_COLUMNS`, without empty entries."""
        cells: Record = {
            "subject": self.subject,
            "best_history": self.best_history,
            "note": self.note,
            "history_p": self.screen.joint_p,
            "moving_criterion_p": self.screen.moving_criterion_p,
        }
        for effect in EFFECT_MODELS:
            cells[effect] = self.word(effect)

        if not self.has_result:
            return cells
        cells["order_model"], cells["carry_over_order_model"] = self.order_models
        for effect in EFFECT_MODELS:
            cells[f"p_{effect}"] = self.probability(effect)
            cells[f"ln_bf_{effect}"] = self.log_bayes_factor(effect)
        cells |= zip(_SIZES, (*self.rho, *self.kappa), strict=True)
        for i, column in enumerate(_EVIDENCES):
            cells[column] = self.log_evidence[i]
            cells[f"{column}_se"] = self.standard_error[i]
        return cells


@dataclass(frozen=True, eq=False)
class SerialDependence(SubjectTable[SubjectDependence]):
    """The serial dependence of every subject, with the study, seed and prior."""

    study: Study
    seed: int
    prior: Prior
    short_columns = ("subject", *EFFECT_MODELS, "rho_q50", "kappa_q50", "note")

    def posterior(self, row: SubjectDependence, history: str) -> TrialHistoryPosterior:
        """The posterior of a subject under one of :data:`HISTORIES`."""
        return TrialHistoryPosterior(
            self.study[row.subject], row.history(history), self.prior.observer
        )

    def _full_frame(self) -> pd.DataFrame:
        """The table with the columns of history.csv; natural logs, empty without a result."""
        return pd.DataFrame([row.cells for row in self.rows], columns=HISTORY_COLUMNS)


def serial_dependence(
    study: Study,
    *,
    seed: int | None = None,
    prior: Prior | str | None = None,
    workers: Workers = None,
    progress: Progress | None = None,
    keep: StrPath | None = None,
) -> SerialDependence:
    """Estimate how the responses of every subject depend on the previous trial.

    Parameters
    ----------
    study : Study
        Of trials whose order is known.
    seed, prior, workers, progress, keep
        As in :func:`bayes_toe.analysis.evidence`.

    Raises
    ------
    InputError
        If the order of a subject's trials is not known.
    """
    require_study(study)
    for subject in study:
        require_order(subject)

    study_prior = prior_for(study, prior)
    root = resumed_seed(seed, keep)
    results = run_stored(
        partial(_dependences, seed=root, prior=study_prior.observer),
        study.subjects,
        study.names,
        seed=root,
        folder=keep,
        workers=workers,
        progress=progress,
        batch=BATCH,
    )

    rows = []
    for name, result in zip(study.names, results, strict=True):
        if isinstance(result, NumericalError):
            rows.append(SubjectDependence(name, note=str(result)))
        else:
            rows.append(load_result(result))
    return SerialDependence(tuple(rows), study, root, study_prior)


def _dependences(
    subjects: Sequence[Subject], seed: int, prior: ObserverPrior
) -> list[SubjectDependence | NumericalError]:
    """The serial dependence of some subjects, whose models of order are analysed together."""
    evidences = unchecked_evidence(subjects, seed, prior)
    return try_each(partial(subject_dependence, seed=seed), evidences)


def subject_dependence(evidence: OrderEvidence, seed: int) -> SubjectDependence:
    """The serial dependence of one subject from the evidences of the four models of order."""
    subject = evidence.subject
    prior = evidence.prior
    screen = subject_screen(evidence.checked())
    # The likeliest model of order, and the likeliest model of order that has a contraction.
    log_evidence = dict(zip(MODEL_NAMES, evidence.log_evidence.tolist(), strict=True))
    likeliest = max(MODEL_NAMES, key=log_evidence.__getitem__)
    likeliest_with_contraction = max(("contraction", "both"), key=log_evidence.__getitem__)
    # `dependence.history` needs the models of order; the evidences follow below.
    dependence = SubjectDependence(
        subject.name, (likeliest, likeliest_with_contraction), screen=screen
    )

    # Weighted draws of the four models. The first model has no history: it is the model of order
    # itself, whose draws are known.
    draws = [evidence.draws[MODEL_NAMES.index(likeliest)]]
    histories = []  # of the other three models
    for name in HISTORIES[1:]:
        history = TrialHistoryPosterior(subject, dependence.history(name), prior)
        histories.append(history)
        draws.append(_sample(history, evidence, seed))
        if not np.isfinite(draws[-1].log_evidence):
            note = f"model {history.model.name!r}: its evidence is not a finite number"
            return SubjectDependence(subject.name, screen=screen, note=note)
    models = ModelSet.from_draws(draws, _EQUAL_PRIOR)

    # Draws of equal weight for the figure.
    rng = generator(seed, subject.name, "history draws")
    static_draws = draws[0].resampled(rng, _FIGURE_DRAWS)
    best = np.argmax(models.log_evidence)
    best_draws = static_draws
    if best > 0:
        best_draws = draws[best].resampled(rng, _FIGURE_DRAWS)

    return replace(
        dependence,
        log_evidence=models.log_evidence,
        standard_error=models.standard_error,
        rho=_quantiles("carry_over", models, histories),
        kappa=_quantiles("previous_response", models, histories),
        draws=(static_draws, best_draws),
    )


def _sample(posterior: TrialHistoryPosterior, evidence: OrderEvidence, seed: int) -> WeightedDraws:
    """Weighted draws from the posterior of a model with history.

    The mixture that proposes them is made from points: draws of the same model of order without
    history, with random values of rho and kappa.
    """
    rng = generator(seed, posterior.subject.name, posterior.model.name, "history")
    order_index = MODEL_NAMES.index(posterior.model.order.name)
    order_points = evidence.draws[order_index].resampled(rng, _CLOUD_POINTS)
    # The coordinates of rho and kappa have standard normal priors, and the posterior is narrower.
    history_points = 0.7 * rng.standard_normal((_CLOUD_POINTS, len(posterior.model.effects)))
    points = np.concatenate([order_points, history_points], axis=1)  # (points, coordinates)
    mixture = mixture_of_points(points, posterior.array.is_free[0])
    # More draws than usual, because intervals of rho and kappa come from them too.
    precision = Precision(effective_draws=1000.0, most_draws=12_000, pool_rounds=6)
    _, (draws,) = fitted_draws(posterior.array, [mixture], [rng], precision)
    return draws


def _quantiles(
    effect: str, models: ModelSet, histories: Sequence[TrialHistoryPosterior]
) -> tuple[float, ...]:
    """Quantiles .025, .5 and .975 of rho or kappa, over the models that have the effect.

    The models are weighted by their evidence. `histories` has the posteriors of all models but the
    first model, which has no history.
    """
    has_effect = EFFECT_MODELS[effect]
    values = []  # rho or kappa at the draws of each model, (draws,)
    for i in np.flatnonzero(has_effect).tolist():
        posterior = histories[i - 1]  # of model i
        values.append(posterior.quantities(models.draws[i].x)[effect])
    weights = models.weights(has_effect)
    return tuple(weighted_quantiles(np.concatenate(values), weights, PROBABILITIES))
