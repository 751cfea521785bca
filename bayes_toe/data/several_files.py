"""A study in several files: the answers of a subject who is in more than one of them are put together, file by file a block."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from bayes_toe.data.answers import Answers, Reading
from bayes_toe.data.messages import MOST_SHOWN, bare, counted, listed
from bayes_toe.data.repeats import copies
from bayes_toe.data.study import Study, Subject
from bayes_toe.errors import InputError


def read_together(paths: Sequence[Any], read: Callable[[Any], Study]) -> Study:
    """The study in several files, or frames, each of which `read` reads.

    Subjects come in the order of their first appearance. What was noted of every file is noted once.

    Raises
    ------
    InputError
        For no file, a file that is given twice, files of which only some have intervals; and the problems of the first files that have any.
    """
    named = [Path(path).absolute() for path in paths if isinstance(path, str | Path)]
    twice = [path for i, path in enumerate(named) if path in named[:i]]
    if not paths or twice:
        raise InputError(f"{bare(twice[0].name)}: found twice, allowed: each file once" if twice else "files: found none, allowed: some")
    studies, faulty = list[Study](), list[list[str]]()
    shared = {path.name for i, path in enumerate(named) if path.name in {one.name for one in (*named[:i], *named[i + 1 :])}}
    for path in paths:
        home = f"{Path(path).absolute().parent.name}/" if isinstance(path, str | Path) and Path(path).name in shared else ""
        try:
            study = read(path)
            studies.append(replace(study, source=home + study.source))
        except InputError as error:
            faulty.append([home + problem for problem in error.problems])
    if faulty:
        raise InputError(_problems(faulty))
    return studies[0] if len(studies) == 1 else _together(studies)


def _problems(faulty: Sequence[list[str]]) -> list[str]:
    """All lines of the first files, of which the last may count what is not shown; then how many more files have problems."""
    shown, rest = list(faulty[0]), 1
    while rest < len(faulty) and len(shown) + len(faulty[rest]) <= MOST_SHOWN:
        shown += faulty[rest]
        rest += 1
    return shown + ([f"... and problems in {counted(len(faulty) - rest, 'more file')}"] if rest < len(faulty) else [])


def _together(studies: Sequence[Study]) -> Study:
    timed = {bool(study.intervals): study.source for study in studies}
    if len(timed) > 1:
        raise InputError(f"{timed[False]}: no column isi, which {timed[True]} has; allowed: in all files or in none")
    parts: dict[str, list[Study]] = {}
    for study in studies:
        for name in study.names:
            parts.setdefault(name, []).append(study)
    subjects = tuple(_subject(name, of) for name, of in parts.items())
    several = [f"{bare(name)} {len(of)}" for name, of in parts.items() if len(of) > 1]
    joined = [f"{counted(len(several), 'subject')} in several files, put together: {listed(several)}"] if several else []
    source = f"{len(studies)} files, {studies[0].source} to {studies[-1].source}"
    return Study(subjects, source, all(study.synthetic for study in studies), (*_notes(studies), *joined), _reading(parts, studies))


def _subject(name: str, of: Sequence[Study]) -> Subject:
    if len(of) == 1:
        return of[0][name]
    found = [study[name] for study in of]
    keys = ("s1", "s2", "n_equal", "n_trials", *(() if found[0].isi is None else ("isi",)))
    return Subject.from_counts(name, **{key: np.concatenate([getattr(one, key) for one in found]) for key in keys})


def _notes(studies: Sequence[Study]) -> list[str]:
    """What was noted, once where files differ in numbers only."""
    found: dict[str, list[tuple[str, str]]] = {}
    for study in studies:
        for note in study.notes:
            found.setdefault(re.sub(r"\d+", "0", note), []).append((study.source, note))
    return [said[0][1] if len({note for _, note in said}) == 1 and len(said) == len(studies) else _such_as(said) for said in found.values()]


def _such_as(said: Sequence[tuple[str, str]]) -> str:
    source, note = said[0]
    return f"{source}: {note}" if len(said) == 1 else f"{len(said)} files, such as {source}: {note}"


def _reading(parts: dict[str, list[Study]], studies: Sequence[Study]) -> Reading:
    known = {name: [(study.source, study.reading.answers.get(name)) for study in of] for name, of in parts.items()}
    answers = {name: _answers([(source, one) for source, one in of if one]) for name, of in known.items() if all(one for _, one in of)}
    read, ignored = (tuple(dict.fromkeys(one for study in studies for one in getattr(study.reading, key))) for key in ("read", "ignored"))
    repeated = (doubt for name, of in known.items() for doubt in copies([(source, one) for source, one in of if one], name))
    return Reading(answers, read, ignored, (*(doubt for study in studies for doubt in study.reading.doubts), *repeated))


def _answers(of: Sequence[tuple[str, Answers]]) -> Answers:
    """Answers in the order of the files, which are blocks or, where they have blocks, are named before these."""
    if len(of) == 1:
        return of[0][1]
    sizes = [len(one.n_trials) for _, one in of]
    names = [tuple(f"{source}: {block}" for block in one.blocks) if one.blocks else (source,) for source, one in of]
    starts = np.cumsum([0, *map(len, names)])
    places = [np.zeros(size, np.int64) if one.block is None else one.block for size, (_, one) in zip(sizes, of, strict=True)]
    block = np.concatenate([start + place for start, place in zip(starts[:-1].tolist(), places, strict=True)])
    keys, k, n = (np.concatenate([getattr(one, key) for _, one in of]) for key in ("keys", "n_equal", "n_trials"))
    return Answers(keys, k, n, block, tuple(name for some in names for name in some), all(one.trials for _, one in of))
