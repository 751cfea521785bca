"""Saved draws in the place of sampling: opened, and refused where they belong to something else than the command was given."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from bayes_toe.cli.options import StudyFileOrExample
from bayes_toe.cli.task import ModelTask

if TYPE_CHECKING:
    from bayes_toe.inference.draws import Draws


def saved_draws(posterior: Path, study: StudyFileOrExample, task: ModelTask) -> Draws:
    """Draws of the predictive update, said; of the study, the prior and the seed, where these are given.

    Raises
    ------
    InputError
        In one line, where they are of others.
    """
    draws = belonging_draws(posterior, study, task, "predictive update", task.seed)
    task.introduce(draws.study, draws.prior)
    return draws


def belonging_draws(posterior: Path, study: StudyFileOrExample, task: ModelTask, model: str, seed: int | None = None) -> Draws:
    """Draws of a model; of the study, the prior and the seed, where these are given."""
    from bayes_toe.data.places import shown
    from bayes_toe.inference.belonging import require_belonging
    from bayes_toe.inference.draws import load
    from bayes_toe.model.prior_file import preset_or_file
    from bayes_toe.model.study_prior import prior_for

    given = None if task.prior is None else preset_or_file(task.prior)
    draws, read = load(posterior), study.read() if study.files else None
    prior = None if given is None else prior_for(draws.study, given)
    require_belonging(draws, shown(posterior), study=read, prior=prior, seed=seed, model=model)
    return draws
