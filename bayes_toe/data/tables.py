"""Tables of results: rows to go through and to look up, as a frame, and as a file.

A CSV file appears whole or not at all. The names of files for subjects are here too: one
stem for each subject that every system takes, whatever the subject is called.
"""

from __future__ import annotations

import hashlib
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Generic, TypeVar

from bayes_toe.arrays import StrPath
from bayes_toe.data.messages import Texts, as_html, join_few, join_quoted, name_from_key
from bayes_toe.data.validation import CONDITION_SEPARATOR, is_formula
from bayes_toe.data.whole_files import whole_file
from bayes_toe.errors import InputError

if TYPE_CHECKING:
    import pandas as pd

#: Names of files that every system takes. Devices under Windows have names such as 'con' and
#: 'com1.csv'; no dot stands at either end.
_PLAIN = re.compile(
    r"(?!(?i:con|prn|aux|nul|com\d|lpt\d)(?:\.|$))(?=.{1,60}$)[\w-]+(?:\.[\w-]+)*", re.ASCII
)
_CONTROL = r"[\x00-\x08\x0b-\x1f\x7f-\x9f]"  # but no tab and no end of a line


Row = TypeVar("Row", bound=Any)


@dataclass(frozen=True, eq=False)
class Table(Generic[Row]):
    """Rows of results in their order, which can also be had as a frame and as a CSV file.

    Attributes
    ----------
    rows : tuple
    short_columns : sequence of str
        The columns that a person reads; empty for all.
    """

    rows: tuple[Row, ...]
    short_columns: ClassVar[Texts] = ()

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        # A dataclass that has a __repr__ gets no other, which would list all rows.
        cls.__repr__ = Table.__repr__  # type: ignore[method-assign]

    def __repr__(self) -> str:
        names = list(dict.fromkeys(str(getattr(row, "subject", "")) for row in self.rows))
        of_subjects = f" of {join_few(names)}" if any(names) else ""
        name = type(self).__name__
        return f"<{name}: {len(self):,} rows{of_subjects}; frame() gives them to pandas>"

    def _repr_html_(self) -> str:
        return as_html(type(self).__name__, self.frame())

    def __iter__(self) -> Iterator[Row]:
        return iter(self.rows)

    def __len__(self) -> int:
        return len(self.rows)

    def frame(self, *, full: bool = False) -> pd.DataFrame:
        """The columns that a person reads; with `full` all columns of the CSV file."""
        frame = self._full_frame()
        if full or not self.short_columns:
            return frame
        return frame[list(self.short_columns)]

    def _full_frame(self) -> pd.DataFrame:
        """The table with the columns of its CSV file; by default these are the fields of rows."""
        import pandas as pd

        return pd.DataFrame(self.rows)

    def save(
        self,
        path: StrPath,
        *,
        overwrite: bool = False,
        units: bool = False,
    ) -> Path:
        """Write the table as a CSV file, whole or not at all.

        With `units`, the rows are units of a subject and a condition, see :func:`write_table`.
        """
        # Nothing random decides a table without a seed.
        seed = getattr(self, "seed", None)
        return write_table(self.frame(full=True), path, seed, overwrite=overwrite, units=units)


def frame_of(rows: Iterable[object], columns: Texts) -> pd.DataFrame:
    """A frame with a column for each of these attributes of the rows."""
    import pandas as pd

    return pd.DataFrame(list(map(attrgetter(*columns), rows)), columns=list(columns))


@dataclass(frozen=True, eq=False)
class SubjectTable(Table[Row]):
    """A table with one row for each subject, looked up by the subject's name.

    An unknown name is an InputError.
    """

    def __getitem__(self, name: str | int) -> Row:
        return of_subject(self._by_name, name, "the table")

    @cached_property
    def _by_name(self) -> dict[str, Row]:
        by_name: dict[str, Row] = {}
        for row in self.rows:
            by_name.setdefault(row.subject, row)
        return by_name


def of_subject(by_name: Mapping[str, Row], name: str | int, home: str) -> Row:
    """The value of a subject by its name, which may be a whole number: 7 means '7'.

    An unknown name is an InputError with the names in the mapping, which is that of `home`.
    """
    subject_name = name_from_key(name)
    if subject_name not in by_name:
        raise InputError(f"no subject {name!r} in {home}; there are: {join_quoted(by_name)}")
    return by_name[subject_name]


def write_table(
    frame: pd.DataFrame,
    path: StrPath,
    seed: int | None = None,
    *,
    overwrite: bool = False,
    units: bool = False,
) -> Path:
    """Write a table as a CSV file.

    The file is UTF-8 with one line per row and no index. Numbers read back to the same bits, and
    missing values are empty. A text that a spreadsheet would run gets an apostrophe, which our
    readers take off the names of subjects. Control characters become escapes.

    A root seed becomes the last column `seed`, which tells tables of two runs apart. With `units`,
    subjects are units such as S01@left, which become columns subject and condition.

    Raises
    ------
    OutputError
        If the file cannot be written, or exists and may not be replaced.
    """
    if units:
        parts = frame["subject"].str.partition(CONDITION_SEPARATOR)  # subject, @, condition
        frame = frame.assign(subject=parts[0])
        frame.insert(list(frame).index("subject") + 1, "condition", parts[2])

    if seed is not None:
        frame = frame.assign(seed=seed)
    frame = frame.map(_inert).rename(columns=_inert)
    with whole_file(path, overwrite=overwrite) as temporary:
        frame.to_csv(temporary, index=False, encoding="utf-8", lineterminator="\n", na_rep="")
    return Path(path)


def _inert(value: object) -> object:
    """A cell that neither a spreadsheet nor a terminal obeys: '=1+1' -> "'=1+1"."""
    if not isinstance(value, str):
        return value
    # A control character becomes its escape, without the quotes around it.
    text = re.sub(_CONTROL, lambda match: repr(match[0])[1:-1], value)
    return f"'{text}" if is_formula(text) else text


def file_stems(names: Texts) -> dict[str, str]:
    """A file name without suffix for each subject, safe and distinct on every system.

    ASCII letters, digits, ``-``, ``_`` and ``.`` only, 60 characters at most. A name that had to be
    changed, or that differs from another one in case only, carries 8 hexadecimal digits of its
    SHA-256.

    Examples
    --------
    >>> file_stems(["S01", "../S02"])
    {'S01': 'S01', '../S02': '_S02-58c1dce7'}
    """
    n_alike = Counter(name.lower() for name in set(names))
    stems = {}
    for name in names:
        if _PLAIN.fullmatch(name) and n_alike[name.lower()] == 1:
            stems[name] = name
            continue
        digest = hashlib.sha256(name.encode("utf-8", "surrogatepass")).hexdigest()
        stem = re.sub("[^A-Za-z0-9-]+", "_", name)
        stems[name] = f"{stem[:51]}-{digest[:8]}"  # 60 characters at most
    return stems
