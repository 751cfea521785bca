"""Whether saved draws are those that somebody means, and tables beside them theirs: of this study, prior, model and seed."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from bayes_toe.data.messages import listed, quoted
from bayes_toe.data.study import Study, Subject
from bayes_toe.errors import InputError
from bayes_toe.inference.draws import Draws
from bayes_toe.model.models import describe_prior, stored_model
from bayes_toe.model.paper_model import PAPER_MODEL
from bayes_toe.model.prior import Prior

_COLUMNS = ("s1", "s2", "isi", "n_yes", "n_trials")


def require_belonging(
    draws: Draws,
    where: str,
    *,
    study: Study | None = None,
    prior: Prior | None = None,
    seed: int | None = None,
    model: str | None = None,
) -> None:
    """Refuse draws that belong to something else; what is not given is not asked for. `where` is what a message calls the draws.

    The study must have the same subjects with the same counts, in any order; subjects that failed have no draws.
    """
    if model is not None and draws.model != model:
        raise InputError(f"{where}: found draws of the model {draws.model!r}, allowed: {model!r}")
    if study is not None and (wrong := _other_study(draws, study)):
        made = (
            ""
            if draws.study.changes == study.changes
            else f", read with {' '.join(draws.study.changes) or 'no change'}"
        )
        raise InputError(f"{where}: {wrong}{made}; allowed: the posterior of {study.source}")
    if prior is not None and not _same_prior(draws, prior):
        raise InputError(
            f"{where}: found draws under {draws.described_prior()}; allowed: that prior, or none, "
            f"given {describe_prior(stored_model(draws.model, draws.task), prior, draws.task)}"
        )
    if seed is not None and draws.seed != seed:
        raise InputError(
            f"{where}: found draws of seed {draws.seed}, allowed: that seed, or none, given {seed}"
        )


def require_update(draws: Draws, what: str) -> None:
    """Refuse draws of another model than the predictive update, for what knows no other."""
    require_belonging(draws, what, model=PAPER_MODEL)


def require_subjects(source: str, names: Iterable[str], draws: Draws) -> None:
    """Refuse a table that is not of the draws' subjects; those that failed may be in it or not."""
    others = (set(names) ^ set(draws.names)) - draws.failed.keys()
    if others:
        whom = listed([*map(quoted, sorted(others))], 3)
        raise InputError(
            f"{source}: found other subjects than the draws have, {whom}, allowed: one study"
        )


def require_said_prior(source: str, said: str, wanted: str) -> None:
    """Refuse a table that says another prior, in words, than that of the draws."""
    if said != wanted:
        raise InputError(
            f"{source}, column prior: found {quoted(said)}, allowed: that of the draws, {wanted}"
        )


def _same_prior(draws: Draws, prior: Prior) -> bool:
    """Whether the model's parameters have the same prior; what only other models have does not count."""
    own = draws.prior
    if draws.model != PAPER_MODEL:
        return own.observer == prior.observer
    used = {"interval", *prior.of_h1(draws.task), *own.of_h1(draws.task)}
    same = (
        getattr(own, one.name) == getattr(prior, one.name)
        for one in own.declared()
        if one.parameter in used
    )
    return type(prior) is type(own) and all(same)


def _other_study(draws: Draws, study: Study) -> str:
    """What is not the same; nothing where all is."""
    known = {*draws.names, *draws.failed}
    absent, others = (
        [name for name in study.names if name not in known],
        sorted(known.difference(study.names)),
    )
    different = (
        []
        if absent or others
        else [name for name in draws.names if not same_answers(draws.subject(name), study[name])]
    )
    who = f"subject {listed([quoted(name) for name in absent or others or different], 3)}"
    if absent:
        return f"found no draws of {who}"
    if others:
        return f"found draws of {who}, whom {study.source} does not have"
    return f"found draws of {who} from other answers" if different else ""


def same_answers(one: Subject, other: Subject) -> bool:
    """Whether both have the same counts of the same pairs."""
    pairs = [(getattr(one, name), getattr(other, name)) for name in _COLUMNS]
    return all(
        mine is theirs is None if mine is None or theirs is None else np.array_equal(mine, theirs)
        for mine, theirs in pairs
    )
