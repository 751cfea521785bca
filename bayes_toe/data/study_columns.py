"""Which columns of a file a study is read from, and which of its rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from bayes_toe.data.cells import Cells, Header
from bayes_toe.data.messages import bare, listed, quoted
from bayes_toe.data.read_options import COLUMNS, LOOKED_AT, ReadOptions, looks_like, subject_in
from bayes_toe.errors import InputError

SYNTHETIC, ISI = "synthetic", "isi"


def study_columns(header: Header, options: ReadOptions) -> tuple[dict[str, int], list[str]]:
    """Where each column that we read is, and what is wrong with the header."""
    named = {ours: options.columns.get(ours, ours) for ours in COLUMNS}
    needed = _needed(header.names, named, options)
    lines = [*_conflict(named, needed), *_read_twice(named, needed), *_where_problems(header, options)]
    if options.subject_from is not None:
        needed.remove("subject")
        if named["subject"] in header.names:
            lines.append(f"column {bare(named['subject'])}: found together with --subject-from, allowed: one of them")
    for ours in COLUMNS:
        count = header.names.count(named[ours])
        if count == 0 and (ours in needed or ours in options.columns):
            lines.append(_missing(header, named, ours))
        elif count > 1 and ours in needed:
            lines.append(f"column {bare(named[ours])}: found {count} columns of this name, allowed: one")
    places = {ours: header.names.index(named[ours]) for ours in needed if named[ours] in header.names}
    marked = {SYNTHETIC: header.names.index(SYNTHETIC)} if SYNTHETIC in header.names else {}
    asked = {_asked(name): header.names.index(name) for name in options.where if name in header.names}
    return places | marked | asked, [f"{header.place}, {line}" for line in lines]


def _where_problems(header: Header, options: ReadOptions) -> list[str]:
    found, missing = listed([quoted(name) for name in header.names]), [name for name in options.where if header.names.count(name) != 1]
    return [f"column {bare(name)}: --where needs one column of this name, found {found}, allowed: one of these" for name in missing]


def _asked(name: str) -> str:
    """The key of a column by which rows are chosen; no column of ours has such a name."""
    return f"where {name}"


def subject_of_file(header: Header, path: object, options: ReadOptions) -> str | None:
    """The subject where the name of the file tells it; None where a column does."""
    if options.subject_from is None:
        return None
    found = None if header.python else subject_in(Path(str(path)), options.subject_from)
    if found is None:
        raise InputError(f"{header.source}: found no subject in its name, allowed: a file named as --subject-from {options.subject_from}")
    return found


def rows_asked_for(cells: Cells, options: ReadOptions) -> Cells:
    """The rows that are to be read; all but them are left out before anything is checked.

    Raises
    ------
    InputError
        Where a column has the text that is asked for in no row.
    """
    kept = np.ones(len(cells.rows), np.bool_)
    columns = dict(cells.columns)
    for name, text in options.where.items():
        column = columns.pop(_asked(name))
        if text not in column.texts:
            found = listed([*map(quoted, column.texts)])
            raise InputError(
                f"{cells.header.source}: column {bare(name)}: found {found}, allowed: {quoted(text)}, as --where has it, in some row"
            )
        kept &= column.spread([one == text for one in column.texts], np.bool_)
    if options.where and not kept.any():
        raise InputError(f"{cells.header.source}: found no row that is as --where has it in all of {', '.join(options.where)}")
    return (
        cells
        if not options.where
        else Cells(cells.header, {ours: one.only(kept) for ours, one in columns.items()}, cells.rows[kept], cells.fault)
    )


def _needed(names: Sequence[str], named: Mapping[str, str], options: ReadOptions) -> list[str]:
    """Our names of the columns that this header calls for, and of those that it may have."""
    extra = [ISI] if named[ISI] in names else []
    # No inference reads these: twice in the header or named as something else, they are left out like any other column.
    others = [named[ours] for ours in COLUMNS if ours not in LOOKED_AT]
    extra += [ours for ours in LOOKED_AT if named[ours] not in others and names.count(named[ours]) == 1]
    counts = [ours for ours in ("n_equal", "n_trials") if named[ours] in names]
    if named["response"] in names:
        return ["subject", *stimuli(options), "response", *counts, *extra]
    return ["subject", *stimuli(options), *(("n_equal", "n_trials") if counts else ("response",)), *extra]


def stimuli(options: ReadOptions) -> tuple[str, str]:
    """Our names of the columns of the two stimuli."""
    return ("s1", "s2") if options.intensity is None else ("i1", "i2")


def _conflict(named: Mapping[str, str], needed: Sequence[str]) -> list[str]:
    counts = [bare(named[ours]) for ours in needed if ours in ("n_equal", "n_trials")]
    if "response" not in needed or not counts:
        return []
    response, both = bare(named["response"]), f"{bare(named['n_equal'])} and {bare(named['n_trials'])}"
    allowed = f"{response} alone (one row per trial) or {both} alone (one row per pair)"
    return [f"column {response}: found together with {' and '.join(counts)}, allowed: {allowed}"]


def _missing(header: Header, named: Mapping[str, str], ours: str) -> str:
    """What is said about a column that the header lacks, with the way out that fits."""
    names, found = header.names, listed([quoted(name) for name in header.names])
    theirs = next((bare(name) for name in names if name not in named.values() and looks_like(name, ours)), "NAME")
    hint = "a column of this name, or " + (
        f"ReadOptions(columns={{{ours!r}: {theirs!r}}})" if header.python else f"--columns {ours}={theirs}"
    )
    if ours in ("s1", "s2") and any(named[other] in names for other in ("i1", "i2")):
        hint += f"; the amplitudes {bare(named['i1'])}, {bare(named['i2'])} need " + (
            "ReadOptions(intensity=REF)" if header.python else "--intensity REF"
        )
    if ours in ("i1", "i2") and any(named[other] in names for other in ("s1", "s2")):
        hint += f"; the log intensities {bare(named['s1'])}, {bare(named['s2'])} are read without " + (
            "intensity" if header.python else "--intensity"
        )
    if ours == "subject" and theirs == "NAME" and not header.python:
        hint += "; or --subject-from '{}.csv', where the name of the file tells it"
    if ours == "response":
        hint += f"; or counts in {bare(named['n_equal'])} and {bare(named['n_trials'])}"
    return f"column {bare(named[ours])}: missing, found {found}, allowed: {hint}"


def _read_twice(named: Mapping[str, str], needed: Sequence[str]) -> list[str]:
    """Columns of the file that --columns would have stand for two of ours."""
    lines = []
    for theirs in dict.fromkeys(named[ours] for ours in needed):
        roles = [ours for ours in needed if named[ours] == theirs]
        if len(roles) > 1:
            lines.append(f"column {bare(theirs)}: found as {' and as '.join(roles)}, allowed: one meaning per column")
    return lines
