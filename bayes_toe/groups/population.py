"""The verb: what a group of subjects has in common, how far they scatter, and each subject in the light of the others."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from numbers import Integral
from pathlib import Path

import numpy as np
import pandas as pd

from bayes_toe.arrays import FloatArray
from bayes_toe.data.conditions import by_person, mean_first
from bayes_toe.data.covariates import Covariates, read_covariates
from bayes_toe.data.messages import as_html, shown
from bayes_toe.data.study import Study, pooled, require_study
from bayes_toe.data.tasks import Task
from bayes_toe.errors import ConvergenceWarning, InputError, WorkerError, require_kind
from bayes_toe.groups.chains import GroupChains, chain_count, sample_group
from bayes_toe.groups.differences import ConditionLikelihood, Differences
from bayes_toe.groups.hyperprior import Hyperprior, hyperprior_of
from bayes_toe.groups.joint import Joint, Likelihood, scatter_named
from bayes_toe.groups.population_file import save_population
from bayes_toe.groups.population_table import PopulationTable, pooled_subjects, population_table
from bayes_toe.groups.regressors import Regressors, regressors
from bayes_toe.groups.subjects import (
    GroupLikelihood,
    NormalApproximation,
    Unpooled,
    centre_of,
    funnel_of,
    unpooled,
    unpooled_from_draws,
    unpooled_posterior,
)
from bayes_toe.inference.belonging import require_belonging
from bayes_toe.inference.draws import Draws
from bayes_toe.inference.predictive_checks import summarise_fit
from bayes_toe.kept import Kept, keeping
from bayes_toe.model.ladder import model_named
from bayes_toe.model.posterior import Posterior
from bayes_toe.model.prior import Prior
from bayes_toe.model.record import Model
from bayes_toe.model.study_prior import prior_for
from bayes_toe.seeds import generator
from bayes_toe.workers import Progress, Workers

#: Subjects, and trials of each, from which on correlations between parameters are asked for.
MANY, LONG = 30, 500
_FEWEST, _MOST_DRAWS = 2, 100_000
_JUDGING, _JUDGED_BY = (
    20_000,
    1000,
)  # draws: of a subject alone, and of a predictive check of its fit
_MOST_DIVERGENT = 1e-3  # of all trajectories, that say nothing


@dataclass(frozen=True)
class GroupSettings:
    """Everything that decides the numbers, stored with the results.

    The prior is that of single subjects: from their own posteriors chains start, and their reference interval holds for the group. It does
    not enter the joint posterior.
    """

    seed: int
    model: str
    prior: Prior
    hyperprior: Hyperprior
    scatter: str = "normal"  # or "t"
    draws: int = 2000  # bulk and tail effective ones of all hyperparameters and of every subject's parameters
    correlations: bool = False  # whether parameters may be correlated between subjects

    def __post_init__(self) -> None:
        scatter_named(self.scatter)
        require_kind("draws", self.draws, Integral, f"a whole number from 1 to {_MOST_DRAWS}")
        if not 1 <= self.draws <= _MOST_DRAWS:
            raise InputError(f"population: draws={self.draws} must be in 1..{_MOST_DRAWS}")


@dataclass(frozen=True, eq=False, repr=False)
class Population:
    """The posterior of a group: draws, with everything that is needed to read them.

    Attributes
    ----------
    study : Study
        The subjects in it, in order.
    settings : GroupSettings
    names : tuple of str
        The k group parameters, see :data:`bayes_toe.groups.hyperprior.GROUP_PARAMETERS`.
    centre : float
        Mean first stimulus of the study, natural-log intensity. An offset counts from it where the prior mean mu1 is in the model, which
        all subjects share, and else from each subject's own mean: a constant error of 0 then means none, whatever its stimuli were.
    regressors : Regressors
    chains : GroupChains
        Draws on the group scales.
    unpooled : array, shape (draws, N, k)
        Draws of each subject's own posterior, without the group, on the same scales; independent between subjects.
    left_out : mapping of str to str
        Subjects of the study that are not in the group, and why.
    rough : tuple of str
        Subjects of which too few of the draws behind `unpooled` count. What is said of the group does not rest on these.
    differences : Differences, optional
        What differs between conditions within subjects; everything else is then of a subject at the middle of the conditions.
    """

    study: Study
    settings: GroupSettings
    names: tuple[str, ...]
    centre: float
    regressors: Regressors
    chains: GroupChains
    unpooled: FloatArray
    left_out: Mapping[str, str]
    rough: tuple[str, ...] = ()
    differences: Differences | None = None

    @property
    def model(self) -> Model:
        """Record of the model of every subject."""
        return _model(self.settings.model, self.study.task)

    @property
    def converged(self) -> bool:
        """Whether everything has the effective draws asked for and chains agree."""
        return self.chains.converged

    @property
    def problems(self) -> tuple[str, ...]:
        """What to know before any number is believed, in words: who is left out, then :attr:`shortfalls`."""
        return (
            *(f"subject {name!r} is left out: {reason}" for name, reason in self.left_out.items()),
            *self.shortfalls,
        )

    @cached_property
    def not_described(self) -> tuple[str, ...]:
        """Subjects, or units, whose answers the model does not describe, with their parameters in the group: the rule of all fits."""
        names, k = list[str](), len(self.names)
        for i, name in enumerate(self.study.names):
            middle = self.chains.eta[:, :, i].reshape(-1, k)
            parts = [(name, self.posterior(name), middle)]
            if self.differences is not None:
                away = self.differences.drawn.eta[:, :, i].reshape(len(middle), -1)
                units = (
                    (one, replace(parts[0][1], subject=one)) for one in self.differences.units[name]
                )
                parts = [
                    (one.name, of, middle + away @ self.differences.at(one.condition, self.names))
                    for one, of in units
                ]
            for said, posterior, eta in parts:
                fit = summarise_fit(
                    posterior, posterior.from_group(eta)[0], self.settings.seed, most=_JUDGED_BY
                )
                names += [said] if fit.misfit else []
        return tuple(names)

    @property
    def shortfalls(self) -> tuple[str, ...]:
        """What was not reached, what diverged, and which subjects are known badly alone, in words."""
        found = [
            f"subject {name!r} alone: few of the draws count, so that its columns alone_ are rough"
            for name in self.rough
        ]
        if self.chains.reason:
            found.append(f"the group's chains did not converge: {self.chains.reason}")
        if self.chains.divergent > _MOST_DIVERGENT * self.chains.mean[..., 0].size:
            found.append(
                f"{self.chains.divergent} of {self.chains.mean[..., 0].size} trajectories diverged: the tails may be too thin"
            )
        return tuple(found)

    def posterior(self, subject: str) -> Posterior:
        """A subject's posterior with its centre in the group: what turns group parameters into quantities and answers."""
        own = self.study[subject]
        return Posterior(
            own, self.model, self.settings.prior, centre=centre_of(self.model, own, self.centre)
        )

    @cached_property
    def typical(self) -> Posterior:
        """That of a subject at the mean or a further one, who meets everybody's stimuli, as far from the centre as they are for each."""
        away = [centre_of(self.model, one, self.centre) - self.centre for one in self.study]
        met = [
            replace(one, s1=one.s1 - far, s2=one.s2 - far, answers=None)
            for one, far in zip(self.study, away, strict=True)
        ]
        return Posterior(pooled(met), self.model, self.settings.prior, centre=self.centre)

    def quantities(self, eta: FloatArray) -> dict[str, FloatArray]:
        """Every named quantity of parameters on their group scales, (..., k) -> (...) each; a gain's pull, 1 - gain, too."""
        x, _ = self.typical.from_group(eta.reshape(-1, eta.shape[-1]))
        found = {
            name: values.reshape(eta.shape[:-1])
            for name, values in self.typical.quantities(x).items()
        }
        return (
            found
            if "pull" in found or "gain" not in found
            else {**found, "pull": 1.0 - found["gain"]}
        )

    def new_subject(self, x: FloatArray | None = None) -> FloatArray:
        """A draw of a further subject for every draw of the hyperparameters, shape (chains, draws, k).

        Parameters
        ----------
        x : array, shape (r,) or (chains, draws, r), optional
            Its regressors, one for all draws or one for each; 0 by default: of categories the reference, of numbers the mean.
        """
        rng = generator(self.settings.seed, "population", "new subject")
        score = scatter_named(self.settings.scatter).sample(rng, self.chains.mean.shape)
        made = (
            self.chains.mean + self.chains.scatter * (self.chains.root @ score[..., None])[..., 0]
        )
        return np.asarray(
            made if x is None else made + np.einsum("...r,...rk->...k", x, self.chains.effects)
        )

    @cached_property
    def table(self) -> PopulationTable:
        """What is said of the population: the rows of population.csv."""
        return population_table(self)

    def __repr__(self) -> str:
        missed = "" if self.converged else "; NOT CONVERGED"
        whose = f"{self.study.source!r} under {self.model.name!r}"
        return f"<Population of {whose}: {len(self.study):,} subjects, seed {self.settings.seed}{missed}>"

    def _repr_html_(self) -> str:
        return as_html(repr(self)[1:-1], self.summary())

    def summary(self) -> pd.DataFrame:
        """The same as a frame: means, sds between subjects, effects of covariates, a further subject."""
        return self.table.frame()

    def subjects(self) -> pd.DataFrame:
        """The rows of population_subjects.csv: quantities of every subject in the group, and of the same subject alone."""
        return pooled_subjects(self).frame()

    def save(self, path: str | Path, *, overwrite: bool = False) -> Path:
        """Write population.nc, which ArviZ opens and :func:`bayes_toe.load` reads; whole or not at all, else an OutputError."""
        return save_population(self, path, overwrite=overwrite)


def population(  # noqa: PLR0913  # each is a choice of its own, and has a default
    study: Study,
    *,
    covariates: Covariates | str | Path | None = None,
    categorical: tuple[str, ...] = (),
    model: str = "free weighting",
    draws: int = 2000,
    seed: int | None = None,
    prior: Prior | str | None = None,
    posterior: Draws | None = None,
    hyperprior: Hyperprior | str | Path | None = None,
    scatter: str = "normal",
    correlations: bool | None = None,
    workers: Workers = None,
    progress: Progress | None = None,
    keep: str | Path | None = None,
) -> Population:
    """The exact joint posterior of all subjects and of the population that they are drawn from.

    Parameters
    ----------
    study : Study
        At least two subjects.
    covariates : Covariates or path, optional
        Or a CSV file of them. What may move subjects; those that lack one are left out and named.
    categorical : tuple of str
        Covariates whose numbers are names of levels.
    model : str
        A model by its name or composition. By default free weighting: a pull and a constant error, either of which may be none, or of
        opposite signs in different subjects. The paper's model (H1) is "predictive update".
    draws : int
        Bulk and tail effective draws to reach for everything.
    seed, prior, workers, progress, keep
        As in :func:`bayes_toe.analysis.sample`; the prior is that of subjects alone and does not enter the joint posterior. `keep` keeps
        these, and progress is told the name of every subject whose own posterior is done.
    posterior : Draws, optional
        Draws of the subjects' own posteriors (:func:`bayes_toe.analysis.sample`), whose prior and, by default, seed are taken. Where they
        are under that model, subjects are not sampled again: the columns `alone_` are of these, and the group's chains take from them
        where they start and on which scales. The joint posterior is the same.
    hyperprior : Hyperprior or path, optional
        Or a TOML file of one.
    scatter : {"normal", "t"}
        How subjects scatter about their mean; t has 4 degrees of freedom, so that single subjects may be far away.
    correlations : bool, optional
        Whether parameters may be correlated between subjects; by default where 30 subjects or more have 500 trials or more each.

    Raises
    ------
    InputError
        If there are fewer than two subjects, a word or number is not allowed, covariates do not fit, or the posterior is of another study
        or prior.

    Warns
    -----
    ConvergenceWarning
        If effective draws or R-hat were not reached, for trajectories that diverged, and for subjects that are left out.

    Examples
    --------
    >>> from bayes_toe.data.read_study import example_study
    >>> found = population(example_study().select(["S01", "S02", "S03", "S04", "S05"]), draws=200, seed=1, workers=1)
    >>> found.names, found.converged
    (('offset', 'gain', 'width', 'q0'), True)
    """
    require_study(study)
    record = _model(model, study.task)
    if posterior is not None:
        where, given = (
            "posterior" if posterior.file is None else shown(posterior.file),
            None if prior is None else prior_for(study, prior),
        )
        require_belonging(posterior, where, study=study, prior=given)
        seed, prior = posterior.seed if seed is None else seed, posterior.prior
        posterior = posterior if posterior.model == record.name else None
    people = None if covariates is None else read_covariates(covariates)
    apart = None
    if study.conditions is not None:
        if people is not None or posterior is not None or correlations:
            raise InputError(
                "population: found a condition, allowed without covariates, posterior and correlations; --ignore condition"
            )
        apart = Differences.of(study.conditions, by_person(study), record)
        study, correlations = study.without_conditions(), False
    with keeping(keep) as kept:
        numbers = prior_for(study, prior), hyperprior_of(hyperprior).for_study(study)
        who = (
            Regressors.none(study.names)
            if people is None
            else regressors(people, study.names, categorical=categorical)
        )
        if (
            correlations is None
        ):  # of fewer subjects, or trials, answers tell less of them, and sampling them costs many times as much
            correlations = (
                sum(one.total_trials >= LONG for one in study.select(who.subjects)) >= MANY
            )
        settings = GroupSettings(kept.seed(seed), model, *numbers, scatter, draws, correlations)
        if len(who.subjects) < _FEWEST:
            raise InputError(
                f"population: found {len(who.subjects)} subject, allowed: {_FEWEST} and more"
            )
        alone, failed = _unpooled(
            study, settings, who, posterior, apart, workers=workers, progress=progress, kept=kept
        )
        if len(alone) < _FEWEST:
            raise WorkerError("\n".join(f"{name}: {reason}" for name, reason in failed.items()))
        made = _sampled(study, settings, who.without(failed), alone, failed, apart)
    for problem in made.problems:
        warnings.warn(problem, ConvergenceWarning, stacklevel=2)
    return made


def _unpooled(
    study: Study,
    settings: GroupSettings,
    who: Regressors,
    posterior: Draws | None,
    apart: Differences | None,
    *,
    workers: Workers,
    progress: Progress | None,
    kept: Kept,
) -> tuple[list[Unpooled], dict[str, str]]:
    """Every subject without the group, sampled or from draws that are there already, and whose work was lost."""
    model, centre, seed = _model(settings.model, study.task), mean_first(*study), settings.seed
    if posterior is None:
        jobs = [
            partial(unpooled, study[name], model, settings.prior, centre, _JUDGING, seed)
            for name in who.subjects
        ]
        if apart is not None:
            targets = [
                apart.posterior(name, study[name], model, settings.prior, centre)
                for name in who.subjects
            ]
            jobs = [partial(unpooled_posterior, target, _JUDGING, seed) for target in targets]
        done = kept.work(jobs, workers, progress, [(name,) for name in who.subjects])
        return list(done), {
            who.subjects[index]: one.reason for index, one in sorted(done.failed.items())
        }
    found = []
    for name in who.subjects:
        if name not in posterior.failed:
            found.append(unpooled_from_draws(posterior, name, model, centre, seed))
            if progress is not None:
                progress(name)
    return found, dict(posterior.failed)


def _sampled(
    study: Study,
    settings: GroupSettings,
    who: Regressors,
    alone: Sequence[Unpooled],
    failed: Mapping[str, str],
    apart: Differences | None,
) -> Population:
    """The group, with the coordinates and starts that its subjects' own posteriors suggest."""
    model, centre, group = (
        _model(settings.model, study.task),
        mean_first(*study),
        study.select(who.subjects),
    )
    precision, location = (
        np.stack([one.log_precision for one in alone]),
        np.stack([one.location for one in alone]),
    )
    about = NormalApproximation(precision, location, funnel_of(model, centre))
    scatter, numbers, chains = (
        scatter_named(settings.scatter),
        settings.hyperprior.numbers(model.group),
        chain_count(len(group)),
    )
    likelihood: Likelihood = GroupLikelihood(model, settings.prior, group.subjects, centre, chains)
    names = model.group
    if apart is not None:
        likelihood = ConditionLikelihood(
            model, settings.prior, group.subjects, apart, centre, chains
        )
        numbers = apart.numbers(numbers, settings.prior.at(*group))
        names += tuple(f"difference in {name}" for name in apart.names)
    joint = Joint(likelihood, numbers, who.x, about, scatter, settings.correlations)
    found = sample_group(
        joint,
        names,
        group.names,
        settings.draws,
        generator(settings.seed, model.name, "population"),
    )
    if apart is not None:
        found, apart = apart.split(found)
    own = np.stack([one.eta[:, : len(model.group)] for one in alone], axis=1)
    rough = tuple(one.name for one in alone if not one.trusted)
    return Population(
        group,
        settings,
        model.group,
        centre,
        who,
        found,
        own,
        {**who.left_out, **failed},
        rough,
        apart,
    )


def _model(name: str, task: Task) -> Model:
    found = model_named(name, task)
    if not isinstance(found, Model):
        raise InputError(
            f"population: model {name!r} has no parameters that subjects share; allowed: a composition of parts"
        )
    return found
