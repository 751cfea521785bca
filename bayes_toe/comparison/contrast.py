"""What differs between the conditions of a subject: constant error, pull, width; each with a Bayes factor, and by how much.

All conditions are fitted together (:mod:`bayes_toe.model.contrasted`), once for each of the 2^3 compositions of what differs. The Bayes
factor of a quantity is that of inclusion: the mean evidence of the compositions in which it differs over that of the others. 'Order effect'
asks whether constant error, pull or both differ, a third each, against neither. How much a quantity differs is averaged over the
compositions in which it does, by their evidence: 'if it differs, then by so much'.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.special import logsumexp

from bayes_toe.arrays import FloatArray
from bayes_toe.data.conditions import Conditions, by_person
from bayes_toe.data.messages import bare, counted, listed
from bayes_toe.data.study import Study, Subject, pooled, require_study
from bayes_toe.data.tables import Table, frame_of
from bayes_toe.data.tasks import SAME_DIFFERENT, WHICH_STRONGER, Task
from bayes_toe.errors import InputError, WorkerError
from bayes_toe.inference.adaptation import quick_proposal, with_trusted_draws
from bayes_toe.inference.evidence import importance_evidence
from bayes_toe.inference.maxima import Maxima, find_maxima
from bayes_toe.inference.proposal import FittedProposal
from bayes_toe.kept import keeping
from bayes_toe.model.contrasted import OF_ORDER, QUANTITIES, Contrasted, contrasted
from bayes_toe.model.ladder import model_named
from bayes_toe.model.posterior import Posterior
from bayes_toe.model.prior import Prior
from bayes_toe.model.record import Model
from bayes_toe.model.study_prior import prior_for
from bayes_toe.seeds import generator
from bayes_toe.workers import Progress, Workers

if TYPE_CHECKING:
    import pandas as pd

#: The model of every condition by task: a constant error and a pull of their own, noise that may depart from Weber's law, lapses.
MODELS = {
    SAME_DIFFERENT: "contraction + sloped + both ways",
    WHICH_STRONGER: "contraction + sloped",
}
ORDER_EFFECT = "order effect"
#: Bayes factors from which a difference, or none, is probable, and from which it is said.
PROBABLY, SURELY = 3.0, 20.0
WORDS = ("differs", "probably differs", "undecided", "probably no difference", "no difference")
CONTRAST_COLUMNS = (
    *("subject", "quantity", "comparison", "mean", "sd", "q05", "q50", "q95", "p_direction"),
    *("log_bf_differs", "log_bf_differs_se", "word", "robust", "model", "prior"),
)
#: What words mean, and columns.
SAID = f"Words: a difference is said from a Bayes factor of {SURELY:g} on and is probable from {PROBABLY:g}, none likewise"
LEGEND = (
    f"{SAID}; 'order effect': constant error, pull or both; of more than two levels that are no numbers any two may differ. "
    "Not robust: lapses that differ too change the word"
)
_FAR = 10.0  # nats below the best maximum of the pooled answers from which on others are no starts
_CLOUD, _FLATTEST = (
    400,
    0.02,
)  # draws of Laplace's normal with which a proposal begins; curvature, of 1, of no use as a scale
_DRAWS, _SHOWN = 4000, 400  # of a difference, and of curves


class Difference(NamedTuple):
    """A quantity at one level less that at another, natural units; of the order effect the size of its change. Names are columns.

    Attributes
    ----------
    subject, quantity, comparison : str
        As in 'S01', 'pull', 'right - left'.
    mean, sd, q05, q50, q95 : float or None
        Given that it differs: of a constant error and of the width natural-log intensity, of the pull no unit; of the order effect the root
        mean square of the change of the shift over the first stimuli shown, natural-log intensity.
    p_direction : float or None
        Probability of the more probable sign; none of a size.
    log_bf_differs, log_bf_differs_se : float or None
        Natural log of the Bayes factor of a difference, between any levels, against none.
    robust : str
        'yes' where lapses that differ too leave the word as it is; empty where that is not known.
    """

    subject: str
    quantity: str
    comparison: str
    mean: float
    sd: float
    q05: float
    q50: float
    q95: float
    p_direction: float | None
    log_bf_differs: float | None
    log_bf_differs_se: float | None
    robust: str

    @property
    def word(self) -> str:
        """One of :data:`WORDS`; empty where there is no Bayes factor."""
        return word_of(self.log_bf_differs)

    @property
    def factor(self) -> str:
        """The Bayes factor of a difference against none, in words."""
        value = float("nan") if self.log_bf_differs is None else float(np.exp(self.log_bf_differs))
        return (
            "-"
            if np.isnan(value)
            else "> 1000"
            if value > 1000.0
            else "< 0.001"
            if value < 0.001
            else f"{value:.2g}"
        )

    @property
    def size(self) -> str:
        """Median (5 %, 95 %), with two digits of what is between these and two decimals at least.

        Examples
        --------
        >>> Difference("S", "width", "b - a", 0.01, 0.01, -0.0012, 0.0104, 0.019, 0.98, 2.5, 0.01, "yes").size
        '+0.010 (-0.001, +0.019)'
        """
        sign = "" if self.p_direction is None else "+"
        digits = (
            max(2, 1 - int(np.floor(np.log10(self.q95 - self.q05)))) if self.q95 > self.q05 else 2
        )
        low, middle, high = (
            f"{value:{sign}.{digits}f}" for value in (self.q05, self.q50, self.q95)
        )
        return f"{middle} ({low}, {high})"

    @property
    def conclusion(self) -> str:
        """Its word and the Bayes factor of a difference.

        Examples
        --------
        >>> Difference("S", "pull", "b - a", 0.1, 0.05, 0.02, 0.1, 0.19, 0.98, 2.5, 0.01, "yes").conclusion
        'probably differs (BF 12)'
        """
        return (f"{self.word} (BF {self.factor})" if self.word else "no evidence") + (
            ", not robust" if self.robust == "no" else ""
        )


def word_of(log_bf: float | None) -> str:
    """What a log Bayes factor of a difference says.

    Examples
    --------
    >>> [word_of(value) for value in (3.1, 1.2, 0.0, -1.2, -3.1, None)]
    ['differs', 'probably differs', 'undecided', 'probably no difference', 'no difference', '']
    """
    return (
        ""
        if log_bf is None
        else WORDS[
            sum(
                log_bf < limit for limit in np.log([SURELY, PROBABLY, 1.0 / PROBABLY, 1.0 / SURELY])
            )
        ]
    )


@dataclass(frozen=True, eq=False)
class SubjectContrast:
    """All differences of one subject, the conditions that it met, and equally weighted draws, over all compositions of what differs.

    `x` has the model's coordinates in each condition, (draws, conditions, k).
    """

    subject: str
    rows: tuple[Difference, ...]
    levels: tuple[str, ...]
    x: FloatArray
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class ContrastTable(Table[Difference]):
    """Differences of every subject, with what they were asked of.

    Attributes
    ----------
    subjects : tuple of SubjectContrast
    conditions : Conditions
    left_out : mapping of str to str
        Subjects who met no two levels that are compared, and which ones they met.
    failed : mapping of str to str
        Subjects whose work was lost, and why.
    """

    subjects: tuple[SubjectContrast, ...]
    conditions: Conditions
    model: str
    prior: Prior
    seed: int
    task: Task = SAME_DIFFERENT
    left_out: dict[str, str] = field(default_factory=dict)
    failed: dict[str, str] = field(default_factory=dict)

    def frame(self) -> pd.DataFrame:
        """With the columns of contrast.csv."""
        frame = frame_of(self.rows, CONTRAST_COLUMNS[:-2])
        described = model_named(self.model, self.task).describe(self.prior)
        return frame.assign(model=self.model, prior=described)

    @property
    def quantities(self) -> tuple[str, ...]:
        """What was asked of, in order."""
        return tuple(dict.fromkeys(row.quantity for row in self.rows))

    def sentences(self) -> tuple[str, ...]:
        """Of how many subjects each quantity differs, a sentence each."""
        return sentences(self.frame())

    def some(self, quantity: str, comparison: str | None = None) -> tuple[Difference, ...]:
        """The rows of a quantity, and of a comparison."""
        return tuple(
            row
            for row in self.rows
            if row.quantity == quantity and comparison in (None, row.comparison)
        )


def sentences(frame: pd.DataFrame) -> tuple[str, ...]:
    """Of how many subjects each quantity differs, of the rows of a contrast.csv.

    Every subject counts once, whatever the comparisons are: the Bayes factor is that of a difference between any levels.
    """
    said = []
    for quantity, rows in frame.drop_duplicates(["subject", "quantity"]).groupby(
        "quantity", sort=False
    ):
        words, doubted = Counter(rows["word"]), int((rows["robust"] == "no").sum())
        parts = [
            f"{word or 'no Bayes factor'} {words[word]}" for word in (*WORDS, "") if words[word]
        ]
        doubt = f"; of {doubted} the lapses have a say" if doubted else ""
        said.append(f"{quantity}, of {counted(len(rows), 'subject')}: {', '.join(parts)}{doubt}")
    return tuple(said)


def contrast(
    study: Study,
    *,
    model: str | None = None,
    seed: int | None = None,
    prior: Prior | str | None = None,
    workers: Workers = None,
    progress: Progress | None = None,
    keep: str | Path | None = None,
) -> ContrastTable:
    """What differs between the conditions of each subject, and by how much.

    Parameters
    ----------
    study : Study
        Read with a condition, see :class:`bayes_toe.ReadOptions`.
    model : str, optional
        A composition for every condition; by default :data:`MODELS`, with a constant error and a pull.
    seed, prior, workers, progress, keep
        As in :func:`bayes_toe.run`.

    Raises
    ------
    InputError
        If the study has no conditions, nobody met two levels that are compared, or the model is none of parts or has a history.
    """
    require_study(study)
    if study.conditions is None:
        raise InputError(
            f"{study.source}: found no condition within subjects, allowed: a column condition, or --condition COLUMN"
        )
    record = model_named(MODELS[study.task] if model is None else model, study.task)
    if not isinstance(record, Model):
        raise InputError(
            f"contrast: model {record.name!r} has no quantities that conditions share; allowed: a composition of parts"
        )
    if record.by_trial:
        raise InputError(
            f"contrast: model {record.name!r} has a history of trials, which conditions cut; allowed: one without"
        )
    met = {
        person: {one.condition: one for one in units} for person, units in by_person(study).items()
    }
    compared = study.conditions.comparisons
    asked = {
        person: own
        for person, own in met.items()
        if any(own.keys() >= {*pair} for pair in compared)
    }
    left_out = {
        person: f"at {listed([*map(bare, own)])} only"
        for person, own in met.items()
        if person not in asked
    }
    if not asked:
        pairs = " or ".join(f"{bare(level)} and {bare(reference)}" for level, reference in compared)
        raise InputError(
            f"contrast: found no subject at both {pairs}, allowed: one and more; another --reference"
        )
    with keeping(keep) as kept:
        root, numbers = kept.seed(seed), prior_for(study, prior)
        jobs = [
            partial(subject_contrast, [*own.values()], study.conditions, record.name, numbers, root)
            for own in asked.values()
        ]
        done = kept.work(jobs, workers, progress, [(person,) for person in asked])
        found = tuple(done)
    failed = {[*asked][index]: one.reason for index, one in sorted(done.failed.items())}
    if not found:
        raise WorkerError("\n".join(f"{name}: {reason}" for name, reason in failed.items()))
    rows = tuple(row for one in found for row in one.rows)
    return ContrastTable(
        rows, found, study.conditions, record.name, numbers, root, study.task, left_out, failed
    )


# --- One subject -----------------------------------------------------------------------------------


class _Sampled(NamedTuple):
    """One composition of what differs: log evidence, NaN where it is withheld, its error, and draws."""

    log_evidence: float
    se: float
    fitted: FittedProposal

    @property
    def target(self) -> Contrasted:
        """Its posterior."""
        posterior = self.fitted.proposal.posterior
        assert isinstance(posterior, Contrasted)
        return posterior


_Space = dict[frozenset[str], _Sampled]


def subject_contrast(
    units: Sequence[Subject], conditions: Conditions, model: str, prior: Prior, seed: int
) -> SubjectContrast:
    """The differences of one subject between these conditions; random streams are keyed by seed, subject, model and what differs."""
    levels = tuple(one.condition for one in units)
    known, freed = joint_evidences(units, conditions.design(levels), model, prior, seed)
    asked = [key for key in QUANTITIES if any(key in some for some in known)]
    rng, rows = generator(seed, units[0].person, model, "differences"), list[Difference]()
    order = [key for key in OF_ORDER if key in asked]
    for quantity in (*asked, *([ORDER_EFFECT] if order else [])):
        (value, se), (other, _) = (log_bayes_factor(space, quantity) for space in (known, freed))
        robust = (
            ""
            if value is None or other is None
            else "yes"
            if word_of(value) == word_of(other)
            else "no"
        )
        of = order if quantity == ORDER_EFFECT else [quantity]
        parts = next(iter(known.values())).target.values(
            _draws(known, [some for some in known if some & {*of}], rng, _DRAWS)
        )
        for level, reference in conditions.comparisons:
            if level in levels and reference in levels:
                at = levels.index(level), levels.index(reference)
                apart = (
                    _change(parts, at, units)
                    if quantity == ORDER_EFFECT
                    else parts[quantity][:, at[0]] - parts[quantity][:, at[1]]
                )
                side = (
                    None
                    if quantity == ORDER_EFFECT
                    else float(max(np.mean(apart > 0.0), np.mean(apart < 0.0)))
                )
                low, middle, high = np.quantile(apart, [0.05, 0.5, 0.95]).tolist()
                name, spread = (
                    f"{level} - {reference}",
                    (float(apart.mean()), float(apart.std(ddof=1))),
                )
                rows.append(
                    Difference(
                        units[0].person,
                        quantity,
                        name,
                        *spread,
                        low,
                        middle,
                        high,
                        side,
                        value,
                        se,
                        robust,
                    )
                )
    gone = [
        [some for some, one in space.items() if np.isnan(one.log_evidence)]
        for space in (known, freed)
    ]
    withheld = [
        f"no evidence where these differ: {', '.join(sorted(some)) or 'none'}" for some in gone[0]
    ]
    withheld += (
        ["no evidence where lapses differ too: whether that changes words is not known"]
        if gone[1] and not gone[0]
        else []
    )
    return SubjectContrast(
        units[0].person, tuple(rows), levels, _draws(known, [*known], rng, _SHOWN), tuple(withheld)
    )


def joint_evidences(
    units: Sequence[Subject], design: FloatArray, model: str, prior: Prior, seed: int
) -> tuple[_Space, _Space]:
    """Evidence and draws of every composition of what differs, and again with lapses that differ too."""
    whole, record = pooled(units), model_named(model, units[0].task)
    assert isinstance(record, Model)
    same = record.posterior(whole, prior)
    maxima = find_maxima(same)
    group = {*record.group}
    asked = [key for key in ("constant error", "pull", "width") if group & {*QUANTITIES[key]}]
    sets = [frozenset(some) for size in range(len(asked) + 1) for some in combinations(asked, size)]
    lapses = frozenset(["lapses"] if group & {*QUANTITIES["lapses"]} else [])
    known = {some: _sampled(same, maxima, units, design, some, seed) for some in sets}
    return known, {
        some: _sampled(same, maxima, units, design, some | lapses, seed) for some in sets
    } if lapses else known


def _sampled(
    same: Posterior,
    maxima: Maxima,
    units: Sequence[Subject],
    design: FloatArray,
    some: frozenset[str],
    seed: int,
) -> _Sampled:
    """The composition in which these differ, from the maxima where nothing does."""
    target = contrasted(same, units, design, sorted(some))
    starts = target.without_differences(maxima.x[maxima.value > maxima.value[0] - _FAR])
    found = find_maxima(target, starts)
    rng = generator(seed, same.subject.name, same.model.name, *sorted(some), "contrast")
    fitted = with_trusted_draws(
        quick_proposal(target, found.x[:1], _cloud(target, found, rng), rng), rng
    )
    evidence = importance_evidence(fitted)
    value, se = (np.nan if one is None else one for one in (evidence.value, evidence.se))
    return _Sampled(value, se, fitted)


def _cloud(target: Contrasted, maxima: Maxima, rng: np.random.Generator) -> FloatArray:
    """Draws of Laplace's normal on the group scales, on which posteriors are nearly normal, (draws, k + differences)."""
    k, top = len(target.model.coordinates), maxima.x[0]
    eta, turn = target.pooled.to_group(top[None, :k]), np.eye(len(top))
    turn[:k, :k] = target.pooled.from_group(eta)[1][0]
    bend = turn.T @ maxima.curvature[0] @ turn
    size = np.sqrt(np.maximum(np.abs(np.diagonal(bend)), 1e-3))
    bend /= np.outer(size, size)
    bend += max(0.0, _FLATTEST - float(np.linalg.eigvalsh(bend)[0])) * np.eye(len(size))
    u = (
        np.append(eta[0], top[k:])
        + rng.standard_normal((_CLOUD, len(size))) @ np.linalg.inv(np.linalg.cholesky(bend)) / size
    )
    return np.concatenate([target.pooled.from_group(u[:, :k])[0], u[:, k:]], axis=1)


def log_bayes_factor(space: _Space, quantity: str) -> tuple[float | None, float | None]:
    """Natural log of the Bayes factor of a difference in a quantity, or in the order effect, against none; and its standard error."""
    order = quantity == ORDER_EFFECT
    of = {*OF_ORDER} if order else {quantity}
    with_it, without = (
        [one for some, one in space.items() if bool(some & of) == differs]
        for differs in (True, False)
    )
    values = [np.array([one.log_evidence for one in part]) for part in (with_it, without)]
    if np.isnan(np.concatenate(values)).any():
        return None, None
    errors = [np.array([one.se for one in part]) for part in (with_it, without)]
    means = [float(logsumexp(value) - np.log(len(value))) for value in values]
    shares = [np.exp(value - logsumexp(value)) for value in values]
    variance = sum(
        float(np.square(share * error).sum()) for share, error in zip(shares, errors, strict=True)
    )
    return means[0] - means[1], float(np.sqrt(variance))


def _draws(
    space: _Space, sets: Sequence[frozenset[str]], rng: np.random.Generator, size: int
) -> FloatArray:
    """Draws of the model's coordinates in every condition, (draws, conditions, k), over some compositions by their evidence."""
    values = np.array([space[some].log_evidence for some in sets])
    values = np.where(np.isnan(values), -np.inf, values)
    shares = np.exp(values - values.max()) if np.isfinite(values).any() else np.ones(len(values))
    drawn = list[FloatArray]()
    for some, count in zip(
        sets, rng.multinomial(size, shares / shares.sum()).tolist(), strict=True
    ):
        drawn.append(
            space[some].target.in_conditions(space[some].fitted.draws.resampled(rng, count))
        )
    return np.concatenate(drawn)


def _change(
    parts: dict[str, FloatArray], at: tuple[int, int], units: Sequence[Subject]
) -> FloatArray:
    """Root mean square, over the first stimuli shown, of the change of c - p (s1 - sbar) between two conditions, (draws,)."""
    s1, n = (np.concatenate([getattr(one, key) for one in units]) for key in ("s1", "n_trials"))
    offset, pull = (
        parts[key][:, at[0]] - parts[key][:, at[1]] if key in parts else np.zeros(1)
        for key in OF_ORDER
    )
    spread = np.average(np.square(s1 - np.average(s1, weights=n)), weights=n)
    return np.asarray(np.sqrt(np.square(offset) + np.square(pull) * spread))
