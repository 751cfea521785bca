"""Study files: TOML with the data files of a study and the options to read them.

`read_study_file` reads one, and `StudySource.text` makes one. `table_files` replaces a folder by
the tables in it.
"""

from __future__ import annotations

import json
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from bayes_toe.arrays import StrPath
from bayes_toe.data.messages import display_name, join_names, join_words, plural, quoted
from bayes_toe.data.options import ReadOptions
from bayes_toe.data.read_table import TABLE_SUFFIXES, toml_table
from bayes_toe.errors import InputError

SUFFIX = ".toml"
_FORM = 'files = ["FILE.csv"] and options of `check`, as in second_code = "j"'
_LISTS = ("files", "ignore", "missed", "swap", "exclude")
_KINDS = {
    list: "a list of texts",
    dict: "a section of lines NAME = TEXT",
    bool: "true or false",
    float: "a number",
    str: "a text",
}
#: The options that a file may have, with their defaults.
_DEFAULTS = {field.name: getattr(ReadOptions(), field.name) for field in fields(ReadOptions)}


@dataclass(frozen=True)
class StudySource:
    """The files of a study, how they are read, and what is swapped or excluded.

    Attributes
    ----------
    files : tuple of Path
    options : ReadOptions
    swap, exclude : tuple of str
        Each SUBJECT or SUBJECT:BLOCK,BLOCK.
    """

    files: tuple[Path, ...]
    options: ReadOptions
    swap: tuple[str, ...] = ()
    exclude: tuple[str, ...] = ()

    def text(self, folder: Path) -> str:
        """The content of a study file in this folder, from which the files are named.

        Examples
        --------
        >>> source = StudySource((Path("a.csv"),), ReadOptions(second_code="j"))
        >>> print(source.text(Path()))
        files = ["a.csv"]
        second_code = "j"
        <BLANKLINE>
        """
        files, _ = table_files(self.files)
        names = [os.path.relpath(file, folder).replace(os.sep, "/") for file in files]
        values: dict[str, Any] = {"files": names, "swap": self.swap, "exclude": self.exclude}
        for key, default in _DEFAULTS.items():
            value = getattr(self.options, key)
            if value != default:
                values[key] = value
        lines, sections = [], []
        for key, value in values.items():
            if isinstance(value, Mapping):
                sections += ["", f"[{key}]"]
                sections += [f"{_toml(name)} = {_toml(text)}" for name, text in value.items()]
            elif value:
                lines.append(f"{key} = {_toml(value)}")
        return "\n".join([*lines, *sections, ""])


def table_files(paths: Sequence[Any]) -> tuple[list[Any], list[str]]:
    """The files and frames of a study, with the tables of a folder in place of the folder.

    The second value is a note for each folder.

    Raises
    ------
    InputError
        If a folder has no tables, or tables of several suffixes.
    """
    files, notes = list[Any](), list[str]()
    for path in paths:
        if not isinstance(path, StrPath) or not os.path.isdir(path):
            files.append(path)
            continue
        tables = sorted(Path(path).glob("sub-*/**/*_events.tsv"))  # BIDS
        if not tables:
            tables = sorted(filter(_is_table, Path(path).glob("*")))
        counts = Counter(file.suffix.lower() for file in tables)
        finding = join_words([plural(n, f"{suffix} file") for suffix, n in counts.items()])
        if len(counts) != 1:
            commonest = max(counts, key=counts.__getitem__, default=".csv")
            problem = f"{display_name(str(path))}: found {finding or 'no table'}"
            rule = f"tables of one suffix, such as {display_name(f'{path}/*{commonest}')}"
            raise InputError(f"{problem}, allowed: {rule}")
        files += tables
        notes.append(f"folder {display_name(str(path))}: {finding} read")
    return files, notes


def _is_table(file: Path) -> bool:
    """Whether a file of a folder may be a table, and not the mark of an open one: ~$a.xlsx."""
    return file.suffix.lower() in TABLE_SUFFIXES and not file.name.startswith((".", "~$"))


def _toml(value: object) -> str:
    """A text, a number, a truth value or a list of texts.

    JSON writes them as TOML does, but for the character DEL.
    """
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def study_source(paths: Sequence[Any], options: ReadOptions) -> StudySource | None:
    """The source that a study file among the paths names; None if there is none.

    Raises
    ------
    InputError
        If there are other files too, or options that the file should have.
    """
    names = [str(path) for path in paths if isinstance(path, StrPath)]
    files = [name for name in names if name.lower().endswith(SUFFIX)]
    if not files:
        return None
    if len(paths) > 1:
        raise InputError(f"{files[0]}: found with other files, allowed: a study file alone")
    if options != ReadOptions():
        raise InputError(
            f"{files[0]}: found with options for files in another layout, allowed: a study file "
            "with these options in it"
        )
    return read_study_file(files[0])


def read_study_file(path: StrPath) -> StudySource:
    """The source that a study file names; files are relative to its folder.

    Raises
    ------
    InputError
        If the file cannot be read, has unknown keys or values of another kind, or names no files.
    """
    table = toml_table(path, _FORM)
    problems = []
    for key, value in table.items():
        if key not in (*_DEFAULTS, *_LISTS):
            rule = join_names([*dict.fromkeys((*_LISTS, *_DEFAULTS))], 40)
            problems.append(f"{path}: key {quoted(key)}: unknown, allowed: {rule}")
        elif not _has_kind(value, _kind(key)):
            rule = _KINDS[_kind(key)]
            problems.append(f"{path}: key {key}: found {quoted(str(value))}, allowed: {rule}")
    if problems:
        raise InputError(problems)
    for file in table.get("files", ()):
        if file.lower().endswith(SUFFIX):
            problems.append(f"{path}: key files: found {quoted(file)}, allowed: data files")
    if not table.get("files"):
        problems.append(f"{path}: found no files, allowed: {_FORM}")
    if problems:
        raise InputError(problems)
    options = {key: value for key, value in table.items() if key in _DEFAULTS}
    folder = Path(path).parent
    return StudySource(
        tuple(folder / file for file in table["files"]),
        ReadOptions(**options),
        tuple(table.get("swap", ())),
        tuple(table.get("exclude", ())),
    )


def _kind(key: str) -> type:
    """The kind of value that a key has."""
    if key in _LISTS:
        return list
    if key == "intensity":
        return float
    default = _DEFAULTS[key]
    return str if default is None else type(default)


def _has_kind(value: object, kind: type) -> bool:
    if kind is float and type(value) is int:
        return True
    if type(value) is not kind:
        return False
    texts: list[object] = []
    if isinstance(value, list):
        texts = value
    elif isinstance(value, dict):
        texts = list(value.values())
    return all(isinstance(text, str) for text in texts)
