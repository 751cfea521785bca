"""A file of draws as it is written: first what is small, then the draws, subject by subject, and at last a seal.

The seal is the SHA-256 of all that HDF5 does not check itself. The draws lie in chunks with a checksum each (Fletcher-32), one chunk for a
subject, so that the draws of one subject can be read, and checked, without those of the others.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bayes_toe.cluster import aside
from bayes_toe.data.enduring_file import EnduringFile
from bayes_toe.inference.draws_layout import Key, Large, Region

if TYPE_CHECKING:
    import h5netcdf
    import xarray as xr

_MAGIC = b"bayes-toe seal 2"
_COUNT, _DIGEST = 8, 32  # bytes of a number, and of the digest
_PART = 1 << 20


def write_tree(path: Path, tree: xr.DataTree, large: Mapping[Key, Large], parts: Iterable[Region]) -> None:
    """Write a tree without its large variables, then these by their parts, and seal the file.

    Raises
    ------
    OSError
        If the disk is full.
    """
    import h5netcdf
    import h5py

    with closing(_Sink(path, "w+")) as sink:
        with aside():
            sink.write(tree.to_netcdf(engine="h5netcdf", encoding=_checksums(tree)))
        with h5netcdf.File(sink, "r+") as file:
            for key, one in large.items():
                _make(file, key, one)
        with h5py.File(sink, "r+") as file:  # which looks for a variable once, and h5netcdf for each part
            made = {(group, name): file[group][name] for group, name in large}
            for key, where, values in parts:
                made[key][where] = values
                if sink.failed is not None:
                    break
    if sink.failed is not None:
        raise sink.failed
    seal(path)


class _Sink(EnduringFile):
    """What HDF5 writes to: of a write that fails it ends the process, with a segmentation fault."""

    def write(self, data: Any, /) -> int:
        """Write all of it, or drop it."""
        rest = memoryview(data).cast("B")
        size = rest.nbytes
        while rest:
            rest = rest[super().write(rest) :]
        return size

    def truncate(self, size: int | None = None, /) -> int:
        """Set the size; HDF5 makes room with it."""
        wanted = self.tell() if size is None else size
        try:
            super().truncate(wanted)
        except OSError as error:
            self.failed = self.failed or error
        return wanted


def _checksums(tree: xr.DataTree) -> dict[str, dict[str, dict[str, Any]]]:
    """Of all numbers, which reading compares; HDF5 has none for texts."""
    return {
        f"/{group}": {str(name): {"fletcher32": True} for name, one in node.to_dataset().variables.items() if one.dtype.kind not in "UO"}
        for group, node in tree.children.items()
    }


def _make(file: h5netcdf.File, key: Key, one: Large) -> None:
    """A variable without values yet; predicted counts are compressed, to a third: what is random to the last bit hardly shrinks."""
    group, name = key
    packed = {"compression": "gzip", "compression_opts": 1, "shuffle": True} if np.dtype(one.dtype).kind == "i" else {}
    missing = {"fillvalue": np.nan} if np.dtype(one.dtype).kind == "f" else {}
    for dim, length in zip(one.dims, one.shape, strict=True):
        if dim not in file[group].dimensions:  # one without coordinates
            file[group].dimensions[dim] = length
    made = file[group].create_variable(name, one.dims, one.dtype, chunks=one.chunk, fletcher32=True, **packed, **missing)
    made.attrs.update(one.attrs)


# --- The seal -------------------------------------------------------------------------------------


def seal(path: Path) -> None:
    """Put behind the end of a finished file, where HDF5 does not look: where its chunks are, and the SHA-256 of this and all the rest."""
    size, chunks = path.stat().st_size, np.array(_chunks(path), "<u8").reshape(-1, 2)
    table = chunks.tobytes() + len(chunks).to_bytes(_COUNT, "little") + size.to_bytes(_COUNT, "little")
    digest = _digest(path, size, chunks, table)
    with path.open("ab") as file:
        file.write(table + digest + _MAGIC)


def sealed(path: Path) -> bool | None:
    """Whether a file is as it was sealed; None where it has no seal, because something else wrote it, or wrote to it."""
    total, tail = path.stat().st_size, 2 * _COUNT + _DIGEST + len(_MAGIC)
    with path.open("rb") as file:
        file.seek(max(total - tail, 0))
        end = file.read()
        if not end.endswith(_MAGIC) or len(end) < tail:
            return None
        count, size = (int.from_bytes(end[i : i + _COUNT], "little") for i in (0, _COUNT))
        if size + 2 * _COUNT * count + tail != total:
            return False
        file.seek(size)
        table = file.read(2 * _COUNT * count + 2 * _COUNT)
    chunks = np.frombuffer(table, "<u8", 2 * count).reshape(-1, 2)
    return _digest(path, size, chunks, table) == end[2 * _COUNT : 2 * _COUNT + _DIGEST]


def _chunks(path: Path) -> list[tuple[int, int]]:
    """Offset and size of every chunk of the variables that hold draws, in the order of the file."""
    import h5py

    found: list[tuple[int, int]] = []
    with h5py.File(path, "r") as file:
        for group in file.values():
            for one in group.values():
                if one.chunks is not None and one.fletcher32 and one.ndim == 3:
                    one.id.chunk_iter(lambda chunk: found.append((chunk.byte_offset, chunk.size)))
    return sorted(found)


def _digest(path: Path, size: int, chunks: np.ndarray[Any, np.dtype[np.uint64]], table: bytes) -> bytes:
    """SHA-256 of the file but its chunks, and of the table of these."""
    found = hashlib.sha256(table)
    with path.open("rb") as file:
        for start, end in _between(size, chunks):
            file.seek(start)
            while start < end and (part := file.read(min(end - start, _PART))):
                found.update(part)
                start += len(part)
    return found.digest()


def _between(size: int, chunks: np.ndarray[Any, np.dtype[np.uint64]]) -> Iterator[tuple[int, int]]:
    """The parts of a file that are in none of its chunks."""
    start = 0
    for offset, length in chunks.tolist():
        yield start, min(offset, size)
        start = offset + length
    yield start, size
