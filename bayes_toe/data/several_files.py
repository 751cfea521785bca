"""A study in several files: the answers of a subject who is in more than one of them are put together, file by file a block."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from bayes_toe.data.answers import Answers, Reading
from bayes_toe.data.messages import MOST_SHOWN, TWICE, bare, counted, listed
from bayes_toe.data.study import Study, Subject, pooled
from bayes_toe.errors import InputError

_FEWEST = 20  # answers to one sequence of pairs that are not the same by chance

#: Files with the same problem that are named.
_FILES_SHOWN = 2


def read_together(paths: Sequence[Any], read: Callable[[Any], Study]) -> Study:
    """The study in several files, or frames, each of which `read` reads.

    What was noted of every file is noted once.

    An InputError for no file, a file given twice, files of which only some have intervals; and with
    the problems of the first files.
    """
    named = [Path(path).absolute() for path in paths if isinstance(path, str | Path)]
    if not paths:
        raise InputError("files: found none, allowed: some")
    for i, path in enumerate(named):
        if path in named[:i]:
            raise InputError(f"{bare(path.name)}: found twice, allowed: each file once")
    file_names = [path.name for path in named]
    studies: list[Study] = []
    faulty: list[InputError] = []
    for path in paths:
        folder = ""
        if isinstance(path, str | Path) and file_names.count(Path(path).name) > 1:
            folder = f"{Path(path).absolute().parent.name}/"
        try:
            study = read(path)
            studies.append(replace(study, source=folder + study.source))
        except InputError as error:
            problems = [folder + problem for problem in error.problems]
            faulty.append(InputError(problems, error.remedies))
    if faulty:
        raise _of_all_files(faulty)
    return studies[0] if len(studies) == 1 else _together(studies)


def _of_all_files(faulty: Sequence[InputError]) -> InputError:
    """The problems of the first files; what many files have alike is said once."""
    groups: dict[tuple[str, ...], list[InputError]] = {}
    for error in faulty:
        without_file = tuple(problem.partition(": ")[2] for problem in error.problems)
        groups.setdefault(without_file, []).append(error)
    shown: list[str] = []
    remaining = len(faulty)
    for alike in groups.values():
        is_repeated = len(alike) > _FILES_SHOWN
        told = alike[:1] if is_repeated else alike
        problems = [problem for error in told for problem in error.problems]
        if shown and len(shown) + len(problems) > MOST_SHOWN:
            break
        shown += problems
        remaining -= len(alike)
        if is_repeated:
            shown.append(f"... and the same in {counted(len(alike) - 1, 'more file')}")
    if remaining:
        shown.append(f"... and problems in {counted(remaining, 'more file')}")
    return InputError(shown, faulty[0].remedies)


def _together(studies: Sequence[Study]) -> Study:
    asked = {study.task.name: study.source for study in studies}
    if len(asked) > 1:
        (one, first), (other, second) = asked.items()
        raise InputError(f"{second}: asked {other}, and {first} {one}; allowed: files of one task")
    timed = {bool(study.intervals): study.source for study in studies}
    if len(timed) > 1:
        raise InputError(
            f"{timed[False]}: no column isi, which {timed[True]} has; allowed: in all files or in "
            "none"
        )
    parts: dict[str, list[Study]] = {}
    for study in studies:
        for name in study.names:
            parts.setdefault(name, []).append(study)
    subjects, doubts = (
        list[Subject](),
        [doubt for study in studies for doubt in study.reading.doubts],
    )
    for name, of in parts.items():
        rows = [(study.source, study[name].answers) for study in of]
        known = [(source, one) for source, one in rows if one is not None]
        doubts += _copies(name, known)
        if len(of) == 1:
            subjects.append(of[0][name])
        elif len(known) == len(of):
            subjects.append(Subject.from_answers(name, _joined(known), of[0].task))
        else:
            subjects.append(pooled([study[name] for study in of]))
    several = [f"{bare(name)} {len(of)}" for name, of in parts.items() if len(of) > 1]
    joined = (
        [f"{counted(len(several), 'subject')} in several files, put together: {listed(several)}"]
        if several
        else []
    )
    read, ignored = (
        tuple(dict.fromkeys(one for study in studies for one in getattr(study.reading, key)))
        for key in ("read", "ignored")
    )
    source = f"{len(studies)} files, {studies[0].source} to {studies[-1].source}"
    reading = Reading(read, ignored, tuple(doubts))
    return Study(
        tuple(subjects),
        source,
        all(study.synthetic for study in studies),
        (*_common_notes(studies), *joined),
        reading,
    )


def _copies(name: str, of: Sequence[tuple[str, Answers]]) -> Iterable[str]:
    """What is said of files that have the same answers of a subject, trial by trial."""
    found: dict[tuple[bytes, bytes], str] = {}
    for source, one in of:
        earlier = found.setdefault((one.keys.tobytes(), one.n_yes.tobytes()), source)
        if earlier != source and one.trials and len(one.n_yes) >= _FEWEST:
            what = f"{source} has the same {len(one.n_yes)} trials of subject {bare(name)} as {earlier}"
            yield f"{what}: {TWICE}, remove one file"


def _joined(of: Sequence[tuple[str, Answers]]) -> Answers:
    """Answers in the order of the files, which are blocks or, where they have blocks, are named before these."""
    columns = {
        key: [getattr(one, key) for _, one in of]
        for key in ("keys", "n_yes", "n_trials", "place", "iti")
    } | {"block": []}
    names, begin = list[str](), 0
    for at, (source, one) in enumerate(of):
        columns["block"].append(
            len(names) + (np.zeros(len(one.n_trials), np.int64) if one.block is None else one.block)
        )
        names += [f"{source}: {block}" for block in one.blocks] or [source]
        if one.place is not None:
            columns["place"][at] = one.place - one.place[0] + begin
            begin = columns["place"][at][-1] + 2
    whole: dict[str, Any] = {
        key: np.concatenate(some)
        for key, some in columns.items()
        if not any(one is None for one in some)
    }
    return Answers(**whole, blocks=tuple(names), trials=all(one.trials for _, one in of))


def _common_notes(studies: Sequence[Study]) -> Iterable[str]:
    """What was noted, once where files differ in numbers only."""
    found: dict[str, list[tuple[str, str]]] = {}
    for study in studies:
        for note in study.notes:
            found.setdefault(re.sub(r"\d+", "0", note), []).append((study.source, note))
    for said in found.values():
        source, note = said[0]
        everywhere = len({note for _, note in said}) == 1 and len(said) == len(studies)
        such = source if len(said) == 1 else f"{len(said)} files, such as {source}"
        yield note if everywhere else f"{such}: {note}"
