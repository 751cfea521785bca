"""The next pair, chosen by what its answer is expected to tell, trial after trial."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.special import logsumexp

from bayes_toe.arrays import FloatArray
from bayes_toe.comparison.verdict import Verdict
from bayes_toe.data.messages import shown
from bayes_toe.data.study import Subject
from bayes_toe.data.tasks import SAME_DIFFERENT, Task, task_of
from bayes_toe.data.whole_files import whole_file
from bayes_toe.errors import InputError
from bayes_toe.model.ladder import PREDICTIVE_UPDATE, model_named, models_of
from bayes_toe.model.posterior import Posterior
from bayes_toe.model.prior import Prior, stored_prior
from bayes_toe.model.record import Model
from bayes_toe.planning.information import entropy, told
from bayes_toe.planning.judging import judged
from bayes_toe.planning.observers import prior_of
from bayes_toe.planning.particles import ENOUGH, Particles
from bayes_toe.planning.study_design import StudyDesign, each_once
from bayes_toe.seeds import generator, root_seed

#: A pair: s1 and s2 (natural-log intensities), and the interval (seconds) where there are several.
Pair = tuple[float, ...]
#: What answers may be asked about, beside the name of a quantity.
PARAMETERS, WHICH_MODEL = "parameters", "model"
DRAWS = 4000
_JUDGES, _JUDGED = (
    512,
    512_000,
)  # draws of a model by which pairs are compared, at least, and their answers to all pairs, about
_BINS = 16  # of a quantity
_FORMAT = "bayes-toe adaptive 1"


class Adaptive:
    """Chooses pairs one by one and keeps the posterior up to date.

    `probabilities` are of the session's own models, by its weighted draws; `verdict` has the words of every command.

    Parameters
    ----------
    pairs : StudyDesign or array_like, shape (pairs, 2 or 3)
        What can be shown: s1, s2 and, where there are several, intervals. Numbers of trials play no role. A design knows its task.
    model : str or sequence of str
        One model, or several that are equally probable beforehand.
    prior : Prior or str, optional
        As in :func:`bayes_toe.analysis.evidence`; what refers to the stimuli refers to those of all pairs, each as often.
    seed : int, optional
    about : str, optional
        "parameters", all of them; the name of a quantity, such as "gain"; "model", which of several. By default the last where there are
        several, else the first.
    draws : int
        Particles of each model.
    task : Task or str
        Of pairs that are no design; "2afc": which is stronger.

    Raises
    ------
    InputError
        If something is not allowed.

    Examples
    --------
    >>> levels = np.linspace(-0.5, 1.0, 7)
    >>> session = Adaptive([(a, b) for a in levels for b in levels], seed=1)
    >>> pair = session.next()
    >>> session.answer(pair, True)
    >>> session.trials, len(session.information())
    (1, 49)
    """

    def __init__(
        self,
        pairs: StudyDesign | npt.ArrayLike,
        model: str | Sequence[str] = PREDICTIVE_UPDATE.name,
        prior: Prior | str | None = None,
        *,
        seed: int | None = None,
        about: str | None = None,
        draws: int = DRAWS,
        task: Task | str = SAME_DIFFERENT,
    ) -> None:
        self.pairs = pairs if isinstance(pairs, StudyDesign) else _design(pairs, task_of(task))
        self.prior, self.seed, self.draws = prior_of([self.pairs], prior), root_seed(seed), draws
        names = [model] if isinstance(model, str) else list(model)
        models = list(
            dict.fromkeys(_allowed(name, self.pairs.task) for name in names)
        )  # of which one may have two names
        if not models:
            raise InputError("model: found none, allowed: one or several")
        self.about = about if about is not None else PARAMETERS if len(models) == 1 else WHICH_MODEL
        if draws < _JUDGES:
            raise InputError(f"draws={draws}: allowed is at least {_JUDGES}")
        self._judges = min(
            draws, max(_JUDGES, _JUDGED // self.pairs.n_pairs)
        )  # few would take their scatter for information
        centre = float(self.pairs.s1.mean())
        interval = 1.0 if self.prior.reference_interval is None else self.prior.reference_interval
        self._clouds = {
            one.name: Particles.of_prior(
                Posterior(self.pairs.unanswered, one, self.prior, centre, interval),
                draws,
                generator(self.seed, "adaptive", one.name, "prior"),
            )
            for one in models
        }
        self._answers: list[tuple[Pair, bool]] = []
        self._seen: dict[str, tuple[int, FloatArray, FloatArray]] = {}
        quantities = next(iter(self._clouds.values())).rule.names.all
        if self.about not in (PARAMETERS, *([WHICH_MODEL] if len(models) > 1 else quantities)):
            allowed = f"{PARAMETERS}, {WHICH_MODEL} with at least two models, or of one model: {', '.join(quantities)}"
            raise InputError(f"about={self.about!r}: allowed: {allowed}")

    # --- A session --------------------------------------------------------------------------------------

    def next(self) -> Pair:
        """The pair whose answer is expected to tell most; of equals any, by chance."""
        worth = self.information()
        best = np.flatnonzero(worth >= worth.max() - 1e-12)
        return self.pairs.pairs[
            int(generator(self.seed, "adaptive", "next", self.trials).choice(best))
        ]

    def answer(self, pair: Sequence[float], yes: bool) -> None:
        """Take in the answer to a pair, also to one that was not proposed: True for 'equal', or for 'second', as the task counts.

        A model that says it is impossible has the probability 0 from then on.

        Raises
        ------
        InputError
            If something is not allowed, or the answer is impossible under every model; the session is then as it was.
        """
        if not isinstance(yes, bool | np.bool_):
            raise InputError(f"yes={yes!r}: allowed is True or False")
        shown_pair = tuple(float(value) for value in pair)
        if len(shown_pair) != (2 if self.pairs.isi is None else 3):
            raise InputError(
                f"pair {shown_pair}: allowed are s1 and s2{'' if self.pairs.isi is None else ' and isi'}"
            )
        task, single = (
            self.pairs.task,
            self._subject([(shown_pair, bool(yes))]),
        )  # refuses what is not finite
        gained = {name: cloud.gain(single) for name, cloud in self._clouds.items()}
        if not any(
            np.isfinite(cloud.log_weight + gained[name]).any()
            for name, cloud in self._clouds.items()
        ):
            raise InputError(
                f"pair {shown_pair}: {task.yes if yes else task.no!r} is impossible under {' and '.join(self._clouds)}; allowed are "
                "also models with lapses or a constant error"
            )
        self._answers.append((shown_pair, bool(yes)))
        for name, cloud in self._clouds.items():
            cloud.add(gained[name])
        share, clouds = self.probabilities, self._clouds
        if few := [
            name for name, cloud in clouds.items() if cloud.possible and cloud.left < ENOUGH
        ]:
            # Made anew are the draws of the model by whose log evidence, with its error of 1/sqrt(effective), probabilities are moved most.
            worst = max(few, key=lambda name: share[name] / np.sqrt(clouds[name].effective))
            clouds[worst].renew(
                self.subject, generator(self.seed, "adaptive", worst, "particles", self.trials)
            )

    def information(self) -> FloatArray:
        """Expected information of one answer to each pair about what is asked, nats, shape (pairs,)."""
        share = {name: p for name, p in self.probabilities.items() if self._clouds[name].possible}
        found = [(p, *self._judged(name)) for name, p in share.items()]
        weights = np.concatenate([p * own for p, own, _, _ in found])
        answers = np.concatenate([one for _, _, one, _ in found], axis=1)
        if self.about == PARAMETERS:
            return np.asarray(
                entropy(weights @ answers) - weights @ np.concatenate([each for *_, each in found])
            )
        if self.about == WHICH_MODEL:
            return told(
                answers,
                weights,
                np.repeat(np.arange(len(found)), [len(own) for _, own, _, _ in found]),
            )
        [cloud] = self._clouds.values()
        values = cloud.rule.quantities(cloud.x[: self._judges])[self.about]
        order = np.argsort(values)  # in bins of equal probability
        return told(
            answers,
            weights,
            (_BINS * np.cumsum(weights[order]) * (1.0 - 1e-9)).astype(np.intp)[np.argsort(order)],
        )

    # --- What is known ----------------------------------------------------------------------------------

    @property
    def trials(self) -> int:
        """Answers so far."""
        return len(self._answers)

    @property
    def answers(self) -> list[tuple[Any, ...]]:
        """The pair and the answer, as :meth:`answer` takes it, of every trial in order: s1, s2, isi where there are several, answer."""
        return [(*pair, yes) for pair, yes in self._answers]

    @property
    def subject(self) -> Subject:
        """The answers, as every verb of the package takes them.

        Raises
        ------
        InputError
            Before the first answer.
        """
        if not self._answers:
            raise InputError("session: no answers yet, allowed after the first one")
        return self._subject(self._answers)

    @property
    def probabilities(self) -> dict[str, float]:
        """Posterior probability of each model, equally probable beforehand."""
        values = np.array([cloud.log_evidence for cloud in self._clouds.values()])
        return dict(zip(self._clouds, np.exp(values - logsumexp(values)).tolist(), strict=True))

    @property
    def verdict(self) -> Verdict:
        """What the answers say of an order effect: over all models of the verdict, whichever the session's own are; half a second.

        Without fit, and what is about data and prior.

        Raises
        ------
        InputError
            Before the first answer.
        """
        return judged(self.subject, self.seed, self.prior, models_of(self.pairs.task).space).verdict

    def quantiles(
        self,
        quantity: str,
        levels: Sequence[float] = (0.05, 0.5, 0.95),
        *,
        model: str | None = None,
    ) -> list[float]:
        """Posterior quantiles of a quantity under a model, by default the first.

        Raises
        ------
        InputError
            If it is not a quantity of the model, the model is not of the session or cannot have given the answers, or a level is not
            between 0 and 1.
        """
        name = (
            next(iter(self._clouds)) if model is None else model_named(model, self.pairs.task).name
        )
        if name not in self._clouds or not self._clouds[name].possible:
            possible = [known for known, cloud in self._clouds.items() if cloud.possible]
            raise InputError(
                f"model {name!r}: allowed, of this session and its answers: {', '.join(possible)}"
            )
        if not all(0.0 <= level <= 1.0 for level in levels):
            raise InputError(f"levels {list(levels)}: allowed are numbers from 0 to 1")
        cloud = self._clouds[name]
        values = cloud.rule.quantities(cloud.x)
        if quantity not in values:
            raise InputError(f"quantity {quantity!r}: allowed: {', '.join(values)}")
        order = np.argsort(values[quantity])
        places = np.minimum(np.searchsorted(np.cumsum(cloud.shares[order]), levels), len(order) - 1)
        return [float(value) for value in values[quantity][order][places]]

    def effective(self) -> dict[str, float]:
        """How many particles of each model count; with a dozen models, whose turns take a while, few of improbable ones in the beginning.

        The error of a log evidence is about one over the square root of it.
        """
        return {name: cloud.effective for name, cloud in self._clouds.items()}

    # --- Files ------------------------------------------------------------------------------------------

    def save(self, path: str | Path, *, overwrite: bool = True) -> Path:
        """Write all that :meth:`resume` needs, whole or not at all; after every trial, if one likes."""
        content = {
            "format": _FORMAT,
            "task": self.pairs.task.name,
            "pairs": self.pairs.pairs,
            "model": list(self._clouds),
            "prior": asdict(self.prior),
            **{key: getattr(self, key) for key in ("seed", "about", "draws")},
            "answers": self.answers,
        }
        with whole_file(path, overwrite=overwrite) as target:
            target.write_text(json.dumps(content), encoding="utf-8")
        return Path(path)

    @classmethod
    def resume(cls, path: str | Path) -> Adaptive:
        """The session of a file, as it was: every answer is taken in again, in a few milliseconds each.

        Raises
        ------
        InputError
            If the file cannot be read or was not written by :meth:`save`.
        """
        try:
            content: dict[str, Any] = json.loads(Path(path).read_text(encoding="utf-8"))
            if content["format"] != _FORMAT:
                raise ValueError(f"format {content['format']!r}")
            made = cls(
                content["pairs"], content["model"], stored_prior(content["prior"]),
                seed=content["seed"], about=content["about"], draws=content["draws"],
                task=content.get("task", SAME_DIFFERENT.name),
            )  # fmt: skip
            for *pair, yes in content["answers"]:
                made.answer(pair, yes)
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise InputError(
                f"{shown(Path(path))}: not a session that can be read ({error}); allowed: a file of Adaptive.save"
            ) from error
        return made

    # --- Parts ------------------------------------------------------------------------------------------

    def _subject(self, answers: Sequence[tuple[Pair, bool]]) -> Subject:
        columns = np.array([pair for pair, _ in answers]).T
        return Subject.from_trials(
            "adaptive",
            columns[0],
            columns[1],
            [yes for _, yes in answers],
            *columns[2:],
            task=self.pairs.task,
        )

    def _judged(self, name: str) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Weights of some particles, (draws,), their probabilities of both answers to pairs, (2, draws, pairs), and the entropy of these.

        The first particles are as good as any others, and stay until all are made anew, and so do their answers.
        """
        cloud = self._clouds[name]
        if name not in self._seen or self._seen[name][0] != cloud.generation:
            answers = np.exp(np.stack(cloud.rule.log_answers(cloud.x[: self._judges])))
            self._seen[name] = cloud.generation, answers, entropy(answers)
        weights = cloud.log_weight[: self._judges]
        return np.exp(weights - logsumexp(weights)), *self._seen[name][1:]


def _design(pairs: npt.ArrayLike, task: Task) -> StudyDesign:
    try:
        columns = np.asarray(pairs, np.float64).T
    except (TypeError, ValueError) as error:
        raise InputError(
            f"pairs: allowed are rows of s1 and s2, and isi where there are several intervals ({error})"
        ) from error
    if columns.ndim != 2 or len(columns) not in (2, 3):
        raise InputError(
            f"pairs: found shape {columns.T.shape}, allowed: (pairs, 2), or (pairs, 3) with intervals"
        )
    return each_once(*columns, task=task)


def _allowed(name: str, task: Task) -> Model:
    found = model_named(name, task)
    if not isinstance(found, Model) or dict(found.levels)["spread"] != "binomial":
        raise InputError(
            f"model {found.name!r}: allowed are models with parameters, by which answers are independent"
        )
    return found
