"""What a design will tell: assumed observers answer it, and every answer is analysed as the program analyses a study's.

Of each simulated subject the evidences without order effect, with a constant error and with the update, by the pipeline of the commands
with fewer judging draws: their standard errors are below 0.02 nat, and what is asked is whether factors of 3 and more are passed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Protocol, TypeVar

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.comparison.words import probabilities
from bayes_toe.data.study import Subject
from bayes_toe.inference.proposal import WeightedDraws
from bayes_toe.inference.subject import Wanted, fitted_result
from bayes_toe.kept import Kept, Unkept, keeping
from bayes_toe.model.posterior import Posterior
from bayes_toe.model.prior import Prior
from bayes_toe.planning.assumed import assumed, prior_of
from bayes_toe.planning.observers import PLAIN, UPDATE, Observer
from bayes_toe.planning.power_table import WIDTHS, DataSet, PowerTable
from bayes_toe.planning.study_design import StudyDesign, paper_study_design
from bayes_toe.seeds import generator
from bayes_toe.workers import Progress, Workers

Row = TypeVar("Row")
TRIALS, DATA_SETS = (325, 650, 1300), 100
#: Independent draws behind each evidence.
DRAWS = 4000


class Named(Protocol):
    """By whose name random streams are keyed."""

    @property
    def name(self) -> str:
        """Unique."""


def power(
    design: StudyDesign | Mapping[str, StudyDesign] | None = None,
    trials: Sequence[int] = TRIALS,
    observers: str | Path | Sequence[Observer] | None = None,
    *,
    data_sets: int = DATA_SETS,
    seed: int | None = None,
    prior: Prior | str | None = None,
    workers: Workers = None,
    progress: Progress | None = None,
    keep: str | Path | None = None,
) -> PowerTable:
    """How often a design names the order effect of assumed observers, how often wrongly, and how narrow posteriors become.

    Parameters
    ----------
    design : StudyDesign or mapping of str to StudyDesign, optional
        Or several by name; by default the paper's 13 pairs.
    trials : sequence of int
        Numbers of trials of one subject, shared among the pairs as the design shares its own.
    observers : str, path or sequence of Observer, optional
        As :func:`bayes_toe.planning.observers.observers_from` takes it, or observers themselves. What is not stated is
        assumed in relation to the stimuli of all designs together.
    data_sets : int
        Observers of each kind, each with one simulated data set a design and number of trials.
    seed, prior, workers, progress, keep
        As in :func:`bayes_toe.analysis.evidence`; the prior is that of the analysis, and that which observers 'prior' are drawn from.

    Raises
    ------
    InputError
        If there are fewer trials than pairs, something is not allowed, or observers would practically never say 'equal'.

    Examples
    --------
    >>> table = power(trials=[130], data_sets=1, seed=1, workers=1)
    >>> len(table.rows), table["the paper's pairs", 130, "update", "named, P > 0.95"].data_sets
    (3, 1)
    """
    designs = named_designs(design)
    asked = _asked(designs, trials)
    with keeping(keep, "simulated data sets") as kept:
        root = kept.seed(seed)
        people = assumed(observers, designs, data_sets, root, prior)
        rows, failed = each_observer(kept, simulated, asked, people, root, prior, workers, progress)
    return PowerTable(rows, tuple(designs), root, failed)


def power_for(
    people: Sequence[Observer],
    designs: Mapping[str, StudyDesign],
    trials: int,
    seed: int,
    prior: Prior | str | None,
    workers: Workers,
    progress: Progress | None,
) -> PowerTable:
    """As :func:`power`, for observers who have been assumed already, perhaps for other pairs."""
    rows, failed = each_observer(Unkept(), simulated, _asked(designs, [trials]), people, seed, prior, workers, progress)
    return PowerTable(rows, tuple(designs), seed, failed)


def _asked(designs: Mapping[str, StudyDesign], trials: Sequence[int]) -> list[tuple[str, StudyDesign]]:
    return [(name, one.with_total(number)) for name, one in designs.items() for number in dict.fromkeys(trials)]


def each_observer(
    kept: Kept | Unkept,
    job: Callable[..., Row],
    designs: Iterable[tuple[str, StudyDesign]],
    people: Sequence[Named],
    seed: int,
    prior: Prior | str | None,
    workers: Workers,
    progress: Progress | None,
) -> tuple[tuple[Row, ...], dict[str, str]]:
    """A job done for every observer, or study of such, of every design, and by the observer's name why some could not be.

    The job is called with the design's name, the design, the observer, `seed` and `prior`, in numbers for the design's stimuli.
    """
    jobs = [
        partial(job, name, one, person, seed=seed, prior=numbers)
        for name, one, numbers in [(name, one, prior_of([one], prior)) for name, one in designs]
        for person in people
    ]
    done = kept.work(jobs, workers, progress, [(one.args[2].name,) for one in jobs])
    return tuple(done), {jobs[at].args[2].name: one.reason for at, one in done.failed.items()}


def simulated(name: str, design: StudyDesign, observer: Observer, seed: int, prior: Prior) -> DataSet:
    """One observer's answers to a design, analysed; streams are keyed by seed, observer and number of trials."""
    subject = observer.answers(design, generator(seed, observer.name, "answers", design.total))
    evidence, widths = analysed(subject, seed, prior)
    p = None if evidence is None else probabilities(evidence)
    return DataSet(name, design.total, observer.name, observer.kind, evidence, p, widths)


def analysed(subject: Subject, seed: int, prior: Prior) -> tuple[tuple[float, ...] | None, tuple[float, ...] | None]:
    """Log evidences of the three kinds (nats) and widths of 90 % intervals under the update; None where weights cannot be trusted."""
    found, widths = [], None
    for kind, model in PLAIN.items():
        result, fitted = fitted_result(model.posterior(subject, prior), seed, Wanted(evidence_draws=DRAWS))
        assert result.evidence is not None  # it was asked for
        found.append(result.evidence.value)
        if kind == UPDATE and fitted.proposal.trusted:
            target = fitted.proposal.proposal.posterior
            assert isinstance(target, Posterior)
            widths = interval_widths(target, fitted.proposal.draws)
    known = [value for value in found if value is not None]
    return tuple(known) if len(known) == len(found) else None, widths


def interval_widths(target: Posterior, draws: WeightedDraws) -> tuple[float, ...]:
    """Widths of the 90 % intervals of :data:`WIDTHS`, from weighted draws."""
    values = target.quantities(draws.x)
    return tuple(_between(values[name], draws.shares) for name in WIDTHS)


def _between(values: FloatArray, shares: FloatArray) -> float:
    order = np.argsort(values)
    low, high = np.searchsorted(np.cumsum(shares[order]), (0.05, 0.95))
    return float(values[order[min(high, len(order) - 1)]] - values[order[low]])


def named_designs(design: StudyDesign | Mapping[str, StudyDesign] | None) -> Mapping[str, StudyDesign]:
    """Designs by name; the paper's where there is none."""
    if design is None:
        return {"the paper's pairs": paper_study_design()}
    return {"these pairs": design} if isinstance(design, StudyDesign) else design
