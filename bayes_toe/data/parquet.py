"""Parquet beside CSV: a file whose name ends in .parquet is read into the same cells, so that every check is the same, and tables go out.

Parquet has no header and no text: its schema stands for the one, and each distinct value of a column is read as the text that a CSV file
would have. Row 1 is the first record. A missing value is an empty cell.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bayes_toe.data.cells import Cells, Column, Fault, Header, refuse, stripped, with_zeros
from bayes_toe.data.messages import bare, quoted
from bayes_toe.errors import InputError

if TYPE_CHECKING:
    import pandas as pd

_SUFFIX = ".parquet"
_LEAST = 8  # bytes of a row of the shortest CSV file; a Parquet file that says that it has more is not believed


def is_parquet(path: str | Path) -> bool:
    """Whether a file is one by its name.

    Examples
    --------
    >>> is_parquet("study.Parquet"), is_parquet("study.csv")
    (True, False)
    """
    return Path(path).suffix.lower() == _SUFFIX


def require_parquet(path: str | Path) -> None:
    """Refuse a Parquet file, to be read or written, where there is nothing to do that with; any other file passes.

    Raises
    ------
    InputError
        With what to install.
    """
    if is_parquet(path) and importlib.util.find_spec("pyarrow") is None:
        found = "found a Parquet file and no pyarrow"
        raise InputError(f"{bare(Path(path).name)}: {found}, allowed: pip install 'bayes_toe[parquet]', or a CSV file")


def write_parquet(frame: pd.DataFrame, path: Path) -> None:
    """A frame without its index, with checksums of its pages; missing values are nulls."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    pq.write_table(pa.Table.from_pandas(frame, preserve_index=False), path, write_page_checksum=True)


def parquet_header(source: str, data: bytes, largest: int) -> tuple[Header, Any]:
    """The header that the schema stands for, and the open file, a :class:`pyarrow.parquet.ParquetFile`.

    Raises
    ------
    InputError
        If the file is damaged, or says that it holds more than a file of `largest` bytes can.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    with _reporting(source):
        file = pq.ParquetFile(pa.BufferReader(data), page_checksum_verification=True)
        groups = [file.metadata.row_group(i) for i in range(file.metadata.num_row_groups)]
        rows, size = file.metadata.num_rows, sum(group.total_byte_size for group in groups)
        names = [name.strip() for name in file.schema_arrow.names]
    if rows > largest // _LEAST or size > largest:
        raise InputError(f"{source}: found {rows} rows of {size} bytes, allowed: {largest // _LEAST} rows, {largest} bytes")
    return Header(source, "Parquet", "", names, 0), file


def parquet_cells(header: Header, file: Any, places: Mapping[str, int], problems: Sequence[str]) -> Cells:
    """What :func:`bayes_toe.data.cells.read_cells` gives of a CSV file.

    Raises
    ------
    InputError
        Where the schema has problems, a column holds neither text nor numbers, there is no row, or the file is damaged.
    """
    schema, refused = file.schema_arrow, list(problems)
    for place in places.values():
        if not _readable(schema.field(place).type):
            found = f"found values of type {quoted(str(schema.field(place).type))}"
            refused.append(f"{header.place}, column {bare(header.names[place])}: {found}, allowed: text or numbers")
    refuse(header.source, [Fault(1, ((0, line),)) for line in refused])
    if file.metadata.num_rows == 0:
        raise InputError(f"{header.source}: {header.place}: found no row below it, allowed: at least one row")
    with _reporting(header.source):
        named = {name: schema.field(place).name for name, place in places.items()}
        table = file.read(columns=list(named.values()))
        columns = {name: _column(header.names[places[name]], table[table.schema.get_all_field_indices(named[name])[0]]) for name in named}
    return with_zeros(Cells(header, columns, np.arange(1, table.num_rows + 1), Fault(0, ())))


@contextmanager
def _reporting(source: str) -> Iterator[None]:
    """Turn what the library says of a damaged file into one line."""
    import pyarrow as pa

    try:
        yield
    except InputError:
        raise
    except (pa.ArrowException, OSError, ValueError, KeyError, IndexError, OverflowError, MemoryError) as error:
        said = bare(" ".join(str(error).split())[:200])
        raise InputError(f"{source}: found a damaged Parquet file ({said}), allowed: one that a Parquet writer has finished") from None


def _readable(kind: Any) -> bool:
    """Whether values of a type have a text that a CSV file would have."""
    from pyarrow import types as of

    plain = kind.value_type if of.is_dictionary(kind) else kind
    allowed = (of.is_string, of.is_large_string, of.is_integer, of.is_float32, of.is_float64, of.is_decimal, of.is_boolean, of.is_null)
    return any(is_one(plain) for is_one in allowed)


def _column(name: str, values: Any) -> Column:
    """Distinct texts in the order of appearance, and their places."""
    import pyarrow as pa

    kind = values.type
    if pa.types.is_dictionary(kind):
        values = values.cast(kind.value_type)
    elif pa.types.is_boolean(kind):
        values = values.cast(pa.int8())  # 1 and 0 as answers are written
    encoded = values.combine_chunks().dictionary_encode(null_encoding="encode")
    texts = encoded.dictionary.cast(pa.string()).to_pylist()
    return stripped(name, ("" if text is None else text for text in texts), encoded.indices.to_numpy().astype(np.int64))
