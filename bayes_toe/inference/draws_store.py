"""A store of draws: a folder in Zarr's format 3 with the groups of the file, for object stores and for many readers at once.

The draws of one subject are one chunk of each variable: a file of its own, with a checksum (CRC-32C). What there is stands in one document
at the top, with its SHA-256: shapes, attributes, and the order of the variables.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import warnings
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bayes_toe.data.messages import quoted
from bayes_toe.data.stores import DOCUMENT, SEAL, store_document
from bayes_toe.errors import InputError
from bayes_toe.inference.draws_layout import MOST_INFLATED, Key, Large, Region, load_small

if TYPE_CHECKING:
    import xarray as xr

_CODECS = {"bytes", "vlen-utf8", "zstd", "crc32c"}  # others may be programs
_ITEM_BYTES = {"string": 4, "int8": 1, "int32": 4, "int64": 8, "float32": 4, "float64": 8}


def require_library() -> None:
    """Refuse a store now that could not be written or read.

    Raises
    ------
    InputError
        If Zarr is not installed, or is too old.
    """
    try:
        from zarr.codecs import Crc32cCodec  # noqa: F401
    except ImportError:
        raise InputError("Zarr 3 is not installed: pip install 'bayes_toe[zarr]'") from None


def write_store(path: Path, tree: xr.DataTree, large: Mapping[Key, Large], parts: Iterable[Region]) -> None:
    """Write a tree without its large variables, then these by their parts, and seal the store.

    Raises
    ------
    InputError
        If Zarr is not installed.
    OSError
        If the disk is full.
    """
    require_library()
    import zarr
    from zarr.codecs import Crc32cCodec

    small = tree.map_over_datasets(_with_texts, object)  # Zarr has no texts of one length
    checked = {f"/{group}": {key: {"compressors": [Crc32cCodec()]} for key in node.variables} for group, node in small.children.items()}
    with _every_chunk():
        small.to_zarr(path, mode="w-", encoding=checked, zarr_format=3, consolidated=False)
        root = zarr.open_group(path, mode="r+")
        made = {key: _array(root, key, one) for key, one in large.items()}
        for key, where, values in parts:
            made[key][where] = values
        zarr.consolidate_metadata(path)
    ordered = {group: (*node.variables, *(name for of, name in large if of == group)) for group, node in sorted(small.children.items())}
    _seal(path, [f"{group}/{name}" for group, names in ordered.items() for name in names])


def opened_store(path: Path) -> xr.DataTree:
    """All groups of a store without :func:`dangers`, with what is small; draws are read when they are asked for, and none but those."""
    import xarray as xr

    tree = xr.open_datatree(path, engine="zarr", zarr_format=3, consolidated=True, chunks=None, decode_times=False)
    del tree.attrs[SEAL]
    load_small(tree)
    for node in tree.children.values():
        for variable in node.variables.values():
            variable.encoding["source"] = str(path)
        node.dataset = _with_texts(node.to_dataset(), np.str_)  # as they come from a file
    return tree


# --- Writing --------------------------------------------------------------------------------------


@contextmanager
def _every_chunk() -> Iterator[None]:
    """Zarr leaves out chunks that hold nothing but one value; here a chunk that is missing was lost."""
    from zarr import config

    with config.set({"array.write_empty_chunks": True}), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Consolidated metadata", UserWarning)  # may change in the future; xarray has it as its default
        yield


def _with_texts(group: xr.Dataset, dtype: type) -> xr.Dataset:
    """The same with its texts as another of NumPy's types; between some of them it knows only the way over objects."""
    return group.assign({name: one.astype(object).astype(dtype) for name, one in group.variables.items() if one.dtype.kind in "UT"})


def _array(root: Any, key: Key, one: Large) -> Any:
    """A variable without values yet; predicted counts are compressed, to a third: what is random to the last bit hardly shrinks."""
    from zarr.codecs import Crc32cCodec, ZstdCodec

    group, name = key
    whole_numbers = np.dtype(one.dtype).kind == "i"
    return root[group].create_array(
        name,
        shape=one.shape,
        chunks=one.chunk,
        dtype=one.dtype,
        compressors=[*([ZstdCodec(level=1)] if whole_numbers else []), Crc32cCodec()],
        fill_value=0 if whole_numbers else np.nan,
        dimension_names=one.dims,
        attributes=dict(one.attrs),
    )


def _seal(path: Path, order: list[str]) -> None:
    """Put the variables of the document in their order, and its SHA-256 among its attributes."""
    document = store_document(path)
    found = document["consolidated_metadata"]["metadata"]
    document["consolidated_metadata"]["metadata"] = {name: found[name] for name in (*(one for one in found if "/" not in one), *order)}
    document["attributes"][SEAL] = _digest(document)
    (path / DOCUMENT).write_text(json.dumps(document, indent=1), encoding="utf-8")


def _digest(document: Any) -> str:
    """SHA-256 of a document without its seal."""
    attributes = {name: value for name, value in document["attributes"].items() if name != SEAL}
    return hashlib.sha256(json.dumps(document | {"attributes": attributes}).encode()).hexdigest()


# --- Before it is read: what Zarr would do --------------------------------------------------------


def dangers(path: Path) -> Iterator[str]:
    """What must not be in a store: another document than was sealed, groups in groups, codecs that run programs, links, chunks lost.

    Of a damaged one the libraries raise anything.
    """
    if not (path / DOCUMENT).is_file():
        yield "not a store of draws" if os.path.lexists(path) else "no such folder"
    document = store_document(path)
    if SEAL not in document["attributes"]:
        yield "not a store of draws"
    if document["attributes"][SEAL] != _digest(document):
        yield "damaged: it does not fit its checksum"
    members = document["consolidated_metadata"]["metadata"]
    yield from (f"{quoted(name)} is not a group or a variable of its own" for name, one in members.items() if not _in_place(name, one))
    yield from _kept(path, {name: one for name, one in members.items() if one["node_type"] == "array"})


def _in_place(name: str, one: Any) -> bool:
    """Whether a group stands at the top, and a variable in a group."""
    parts = name.split("/")
    plain = all(part not in ("", ".", "..") and "\\" not in part for part in parts)
    return plain and one["zarr_format"] == 3 and one["node_type"] == {1: "group", 2: "array"}.get(len(parts))


def _kept(path: Path, arrays: Mapping[str, Any]) -> Iterator[str]:
    """What is wrong with where and how variables are kept."""
    total = stored = 0
    for name, one in arrays.items():
        yield from (f"{quoted(name)} {what}" for what in _encoding(one))
        chunks = dict(_files(path / name / "c", ""))
        if None in chunks.values():
            yield f"{quoted(name)} is kept in another place"
        if not _all_there(one, chunks):
            yield f"{quoted(name)} is not all there"
        total += math.prod(one["shape"]) * _ITEM_BYTES[one["data_type"]]
        stored += sum(size for size in chunks.values() if size is not None)
    if total > MOST_INFLATED * stored:
        yield f"{total:,} bytes of variables in a store of {stored:,}"


def _encoding(array: Any) -> Iterator[str]:
    """What is wrong with how a variable is kept."""
    if array["data_type"] not in _ITEM_BYTES:
        yield "is of a type that draws have not"
    codecs = [codec["name"] for codec in array["codecs"]]
    if not set(codecs) <= _CODECS or codecs[-1] != "crc32c" or array["storage_transformers"]:
        yield f"has other codecs than {', '.join(sorted(_CODECS))}, or no checksum"
    if array["chunk_grid"]["name"] != "regular" or array["chunk_key_encoding"] != {"name": "default", "configuration": {"separator": "/"}}:
        yield "has chunks of another kind"


def _all_there(array: Any, chunks: Mapping[str, int | None]) -> bool:
    """Whether every chunk has a file."""
    parts = array["chunk_grid"]["configuration"]["chunk_shape"]
    grid = [-(-length // part) for length, part in zip(array["shape"], parts, strict=True)]
    return math.prod(grid) <= len(chunks) and all("".join(f"/{i}" for i in place) in chunks for place in np.ndindex(*grid))


def _files(folder: Path | str, below: str) -> Iterator[tuple[str, int | None]]:
    """Names and sizes of the files below a folder; no size where it is a link."""
    with os.scandir(folder) as found:
        for one in found:
            name = f"{below}/{one.name}"
            if one.is_dir(follow_symlinks=False):
                yield from _files(one.path, name)
            else:
                yield name, None if one.is_symlink() else one.stat().st_size
