"""The next pair, chosen by what its answer is expected to tell, trial after trial.

`Adaptive` is a session: `next` gives a pair, `answer` takes the answer in.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.special import entr

from bayes_toe.answers.order_effect import OrderEffect, answer_subject
from bayes_toe.arrays import FloatArray, Rng, StrPath
from bayes_toe.data.messages import format_path
from bayes_toe.data.study import Subject
from bayes_toe.data.tasks import SAME_DIFFERENT, Task, task_of
from bayes_toe.data.whole_files import whole_file
from bayes_toe.design.study_design import StudyDesign, each_once
from bayes_toe.errors import InputError, require_number
from bayes_toe.inference.engine import SHARP, PriorMixture, fresh_draws
from bayes_toe.inference.fitted import fit_posterior
from bayes_toe.inference.mixture import WeightedDraws
from bayes_toe.inference.model_set import ModelSet
from bayes_toe.inference.order_evidence import MODEL_NAMES, PRIOR_PROBABILITIES
from bayes_toe.model.models import ObserverPosterior, OrderModel
from bayes_toe.model.parameters import ObserverPrior
from bayes_toe.model.prior import Prior
from bayes_toe.model.prior_file import preset_or_file
from bayes_toe.seeds import generator, root_seed

#: An answer: whether the task counts it; of three answers, its word.
Response = bool | str
#: s1, s2 and the answer.
Trial = tuple[float, float, Response]
#: What pairs are chosen to find out: which of the four models holds, or its parameters as well.
MODEL = "model"
PARAMETERS = "parameters"
#: Draws of each model in a session.
DRAWS = 4000
#: The fewest draws of a model by which pairs are compared.
_FEWEST_DRAWS = 512
#: The format of a session's file, with its version.
_FORMAT = "bayes-toe adaptive 2"


@dataclass(eq=False)
class Particles:
    """Draws of one model with their weights: both change when answers come.

    When the effective number of draws has halved, the mixture that they came from is adapted to
    them, and all are drawn again with new weights, so that errors do not accumulate.

    Attributes
    ----------
    template : ObserverPosterior
        The posterior before the first answer: prior and scales of the pairs. `for_subject` adds
        answers.
    draws : WeightedDraws
        With all coordinates of the task. Their posterior density counts all answers so far.
    first_efficiency : float
        Efficiency of the draws when they were made.
    mixture : PriorMixture, optional
        What the draws came from; None before the first renewal.
    p_answers : ndarray, optional
        P of each answer by these draws; None until it is used.
    """

    template: ObserverPosterior
    draws: WeightedDraws
    first_efficiency: float = 1.0
    mixture: PriorMixture | None = None
    p_answers: FloatArray | None = None

    @property
    def x(self) -> FloatArray:
        """The draws in the coordinates of the model, shape (draws, k)."""
        return self.draws.x[:, self.template.is_free]

    def add(self, answer: Subject) -> None:
        """Change the weights of the draws by further answers; the draws stay where they are."""
        log_likelihood = self.template.for_subject(answer).log_likelihood(self.x)
        self.draws = replace(self.draws, log_posterior=self.draws.log_posterior + log_likelihood)

    def renew(self, subject: Subject, rng: Rng) -> None:
        """Replace the draws by new ones, from the posterior of all answers so far.

        They come from the adapted mixture. If there is none, or fewer than a quarter of its draws
        would count, the posterior is fitted anew.
        """
        posterior = self.template.for_subject(subject)
        size = len(self.draws.x)
        mixture = self.mixture
        draws = self.draws
        if mixture is not None:
            # As for emcee: one heavy draw would stand for many in all choices that follow.
            mixture = mixture.updated(draws, precision=SHARP)
            (draws,) = fresh_draws(posterior.array, [mixture], [rng], size)  # of one posterior

        # The efficiency is the effective share of the draws.
        if mixture is None or draws.efficiency < 0.25:
            fitted = fit_posterior(posterior, rng)
            mixture = fitted.mixture
            draws = fitted.fresh(rng, size)

        self.mixture = mixture
        self.draws = draws
        self.first_efficiency = draws.efficiency
        self.p_answers = None


class Adaptive:
    """Choose the next pair of an experiment from the responses so far.

    Parameters
    ----------
    pairs : StudyDesign or array_like, shape (pairs, 2)
        What can be shown: s1 and s2. Numbers of trials play no role. A design knows its task.
    prior : Prior or str, optional
        As in :func:`bayes_toe.analysis.evidence`. Its scales follow from all pairs, each once.
    seed : int, optional
    about : str
        "model": which of the four models; "parameters": their parameters as well.
    draws : int
        Particles of each model.
    task : Task or str
        Of pairs that are no design; "2afc": which is stronger.

    Attributes
    ----------
    answers : list of tuple
        s1, s2 and the answer of every trial so far, in order.

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
        prior: Prior | str | None = None,
        *,
        seed: int | None = None,
        about: str = MODEL,
        draws: int = DRAWS,
        task: Task | str = SAME_DIFFERENT,
    ) -> None:
        if about not in (MODEL, PARAMETERS):
            raise InputError(f"about={about!r}: allowed: {MODEL}, {PARAMETERS}")
        require_number("draws", draws, _FEWEST_DRAWS)
        task = task_of(task)
        if not isinstance(pairs, StudyDesign):
            pairs = _design_of_rows(pairs, task)
        self.pairs = pairs
        self.prior = preset_or_file(prior).observer
        self.seed = root_seed(seed)
        self.about = about
        self.draws = draws
        self.answers: list[Trial] = []

        # The draws of each model by which pairs are compared. Their probabilities of answers are
        # kept: 512,000 of them, pairs times draws, take 4 MB for each answer of the task.
        self._n_compared = min(draws, max(_FEWEST_DRAWS, 512_000 // self.pairs.n_pairs))
        self._particles = {name: self._draw_prior(name) for name in MODEL_NAMES}

    def _draw_prior(self, name: str) -> Particles:
        """The particles of a model before the first answer: draws from its prior."""
        template = OrderModel(name).posterior(self.pairs.unanswered, self.prior)
        rng = generator(self.seed, "adaptive", name, "prior")
        points = template.full_points(template.sample_prior(rng, self.draws))  # (1, draws, k)
        log_prior = template.array.log_prior(points)[0]  # (draws,)
        # The posterior and what was drawn from are the prior, too.
        draws = WeightedDraws(
            x=points[0], log_prior=log_prior, log_posterior=log_prior, log_proposal=log_prior
        )
        return Particles(template, draws)

    # --- A session --------------------------------------------------------------------------------

    def next(self) -> tuple[float, float]:
        """A pair whose answer is expected to be most informative; of several, a random pair."""
        information = self.information()
        # Pairs whose information is equal up to rounding.
        best_pairs = np.flatnonzero(information >= information.max() - 1e-12)
        rng = generator(self.seed, "adaptive", "next", self.trials)
        return self.pairs.pairs[rng.choice(best_pairs)]

    def answer(self, pair: Sequence[float], yes: Response) -> None:
        """Take in the answer to a pair, also to a pair that was not proposed.

        Parameters
        ----------
        pair : sequence of float
            s1 and s2.
        yes : bool or str
            True for 'equal', or for 'second', as the task counts. Of three answers: "first",
            "equal" or "second".

        Raises
        ------
        InputError
            If something is not allowed; the session is then as it was.
        """
        if not self.pairs.task.has_three_answers:
            if not isinstance(yes, bool | np.bool_):
                raise InputError(f"yes={yes!r}: allowed is True or False")
            yes = bool(yes)
        try:
            s1, s2 = map(float, pair)
        except (TypeError, ValueError) as error:
            raise InputError(f"pair {pair!r}: allowed are s1 and s2") from error

        trial = s1, s2, yes
        trial_subject = self._make_subject([trial])  # refuses what is not finite
        self.answers.append(trial)
        for particles in self._particles.values():
            particles.add(trial_subject)
        self._renew_worst()

    def _renew_worst(self) -> None:
        """Draw anew for one model whose efficiency is below half the efficiency of its first draws.

        Of several such models, it is the one whose Monte Carlo error matters most: in proportion to
        its probability, and to one over the root of its effective number of draws. So an answer
        takes no longer than one renewal.
        """
        probabilities = self.probabilities
        errors = {}
        for name, particles in self._particles.items():
            if particles.draws.efficiency < 0.5 * particles.first_efficiency:
                errors[name] = probabilities[name] / np.sqrt(particles.draws.effective_number)
        if errors:
            worst = max(errors, key=errors.__getitem__)
            rng = generator(self.seed, "adaptive", worst, "particles", self.trials)
            self._particles[worst].renew(self.subject, rng)

    def information(self) -> FloatArray:
        """Expected information of one answer to each pair about what is asked, nats, (pairs,).

        It is the mutual information H(answer) - E[H(answer | model)], or with `about` "parameters"
        H(answer) - E[H(answer | model and parameters)].
        """
        p_answers = np.zeros((len(self.pairs.task.answers), self.pairs.n_pairs))
        conditional_entropy = np.zeros(self.pairs.n_pairs)  # E[H(answer | ...)]
        first_draws = slice(self._n_compared)

        for name, probability in self.probabilities.items():
            particles = self._particles[name]
            if particles.p_answers is None:  # (answers, draws, pairs)
                log_answers = particles.template.log_answers(particles.x[first_draws])
                particles.p_answers = np.exp(log_answers)
            weights = particles.draws.part(first_draws).shares  # (draws,)
            p_answers_of_model = weights @ particles.p_answers  # (answers, pairs)
            p_answers += probability * p_answers_of_model
            if self.about == MODEL:
                entropy = _entropy(p_answers_of_model)
            else:
                entropy = weights @ _entropy(particles.p_answers)
            conditional_entropy += probability * entropy
        return _entropy(p_answers) - conditional_entropy

    # --- What is known ----------------------------------------------------------------------------

    @property
    def trials(self) -> int:
        """Number of answers so far."""
        return len(self.answers)

    @property
    def subject(self) -> Subject:
        """The answers so far as a subject, which all functions of the package take.

        Raises
        ------
        InputError
            Before the first answer.
        """
        if not self.answers:
            raise InputError("session: no answers yet, allowed after the first one")
        return self._make_subject(self.answers)

    @property
    def probabilities(self) -> dict[str, float]:
        """Posterior probability of each of the four models, by the session's own draws."""
        # The models have the order of MODEL_NAMES, as their prior probabilities have.
        draws = [particles.draws for particles in self._particles.values()]
        models = ModelSet.from_draws(draws, PRIOR_PROBABILITIES)
        return dict(zip(self._particles, models.probabilities.tolist(), strict=True))

    @property
    def order_effect(self) -> OrderEffect:
        """The conclusion on the order effect, as `evidence` gives it for these trials.

        Its scales follow from the pairs that were shown. The scales of the session follow from all
        pairs.

        Raises
        ------
        InputError
            Before the first answer to different stimuli.
        """
        answer, _ = answer_subject(self.subject, self.seed, self.prior)  # without its evidence
        return answer

    # --- Files ------------------------------------------------------------------------------------

    def save(self, path: StrPath, *, overwrite: bool = True) -> Path:
        """Write all that :meth:`resume` needs, whole or not at all.

        It may be called after every trial, so it replaces the file by default.
        """
        content = {
            "format": _FORMAT,
            "task": self.pairs.task.name,
            "pairs": self.pairs.pairs,
            "prior": asdict(self.prior),
            "seed": self.seed,
            "about": self.about,
            "draws": self.draws,
            "answers": self.answers,
        }
        with whole_file(path, overwrite=overwrite) as target:
            target.write_text(json.dumps(content, default=np.generic.item), encoding="utf-8")
        return Path(path)

    @classmethod
    def resume(cls, path: StrPath) -> Adaptive:
        """The session of a file, as it was: every answer is taken in again.

        Raises
        ------
        InputError
            If the file cannot be read or was not written by :meth:`save`.
        """
        try:
            content = json.loads(Path(path).read_text(encoding="utf-8"))
            if content["format"] != _FORMAT:
                raise ValueError(f"format {content['format']!r}, begin a new session")
            prior = Prior(observer=ObserverPrior(**content["prior"]))
            options = {key: content[key] for key in ("seed", "about", "draws", "task")}
            session = cls(content["pairs"], prior, **options)
            for *pair, yes in content["answers"]:
                session.answer(pair, yes)
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise InputError(
                f"{format_path(Path(path))}: not a session that can be read ({error}); "
                "allowed: a file of Adaptive.save"
            ) from error
        return session

    def _make_subject(self, trials: Sequence[Trial]) -> Subject:
        """The subject who has answered these trials."""
        s1, s2, responses = np.array(trials, object).T
        task = self.pairs.task
        n_yes = responses
        n_second = None
        if task.has_three_answers:
            if not set(task.answers).issuperset(responses):
                raise InputError(f"allowed answers are {', '.join(task.answers)}")
            n_yes = responses == task.yes
            n_second = (responses == "second").astype(np.int64)
        return Subject(
            "adaptive",
            s1.astype(np.float64),
            s2.astype(np.float64),
            n_yes.astype(np.int64),
            np.ones(len(trials), np.int64),
            n_second=n_second,
            task=task,
        )


def _design_of_rows(rows: npt.ArrayLike, task: Task) -> StudyDesign:
    """The design that has each row (s1, s2) once."""
    try:
        pairs = np.asarray(rows, np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"pairs: allowed are rows of s1 and s2 ({error})") from error
    if pairs.shape[1:] != (2,):
        raise InputError(f"pairs: found shape {pairs.shape}, allowed: (pairs, 2)")
    return each_once(*pairs.T, task=task)


def _entropy(p_answers: FloatArray) -> FloatArray:
    """Entropy of an answer, -sum p ln p, nats, (answers, ...) -> (...)."""
    return np.asarray(entr(p_answers).sum(axis=0))
