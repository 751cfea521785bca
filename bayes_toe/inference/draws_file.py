"""The file of draws, looked at before it is believed: whole, of two levels, without links, of bounded size, with the layout of draws.

HDF5 follows links and external storage to other files, runs in circles, and makes memory of what was never stored. A file that was damaged,
or that somebody else wrote, is refused in one line instead. Draws carry Fletcher-32 checksums, all else in the file a SHA-256.
"""

from __future__ import annotations

import json
import math
import subprocess
import sys
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bayes_toe.data.messages import quoted
from bayes_toe.data.places import shown
from bayes_toe.data.stores import named_store
from bayes_toe.data.study import LARGEST_COUNT
from bayes_toe.errors import InputError
from bayes_toe.inference.draws_layout import BY_PAIR, BY_SUBJECT, MOST_INFLATED, load_small
from bayes_toe.inference.draws_store import dangers, opened_store, require_library
from bayes_toe.inference.draws_writer import sealed

if TYPE_CHECKING:
    import h5py
    import xarray as xr

ALLOWED = "allowed: a posterior.nc or posterior.zarr written by bayes-toe"
AT_ONCE = 2**28  # bytes of the largest file whose draws are read at once and not when they are asked for
_PATIENCE = 60.0  # seconds to open a file without a seal, and one more for each megabyte
_REHEARSAL = "import sys; from bayes_toe.inference.draws_file import opened; opened('', sys.argv[1])"
_MOST_NAMES = 10_000  # a model without parameters of its own has a quantity for every pair
_FILTERS = {1, 2, 3}  # deflate, shuffle, Fletcher-32; others are programs that HDF5 would load
_LONG = {"subject": (("obs",), "UO"), "s1": (("obs",), "f"), "s2": (("obs",), "f")}
#: Of each group the variables that it must have: dimensions, and kinds of NumPy's types.
_LAYOUT: dict[str, dict[str, tuple[tuple[str, ...], str]]] = {
    "posterior": {"chain": (("chain",), "i"), "draw": (("draw",), "i"), "subject": (("subject",), "UO")},
    "sample_stats": {
        "subject": (("subject",), "UO"),
        "lp": (BY_SUBJECT, "f"),
        "converged": (("subject",), "ib"),
        "shortfall": (("subject",), "UO"),
        **{name: (("subject",), "f") for name in ("min_ess", "max_r_hat")},
    },
    "observed_data": {**_LONG, "n_equal": (("obs",), "i")},
    "constant_data": {**_LONG, "n_trials": (("obs",), "i")},
}
#: The same of groups and variables that it may have.
_OPTIONAL: dict[str, dict[str, tuple[tuple[str, ...], str]]] = {
    "posterior": {"walker": (("draw",), "i")},
    "sample_stats": {"acceptance_rate": (("chain", "subject"), "f"), **{name: (("subject",), "if") for name in ("thin", "steps")}},
    "observed_data": {"isi": (("obs",), "f")},
    "constant_data": {"isi": (("obs",), "f")},
    "log_likelihood": {**_LONG, "n_equal": (BY_PAIR, "f")},
    "posterior_predictive": {**_LONG, "n_equal": (BY_PAIR, "i")},
}
_TEXTS, _WHOLE = ("model", "settings"), ("seed", "synthetic")


def read_tree(path: str | Path) -> xr.DataTree:
    """All groups of a file or store of draws, with the layout of draws.

    Those of a file are in memory, and it is closed; of a store, and of a large file that has its seal, draws are read when asked for.

    Raises
    ------
    InputError
        If it is missing, damaged, reaches outside itself, is too large for what it says or has another layout.
    """
    name = shown(Path(path))
    try:
        tree, at_once = _read_store(name, Path(path)) if named_store(Path(path)) or Path(path).is_dir() else _read_file(name, Path(path))
    except InputError:
        raise
    except Exception as error:  # of a damaged file the libraries say anything, from KeyError to RuntimeError
        raise unreadable(name, error) from error
    _refuse(name, _misfits(tree, at_once))
    return tree


def _read_file(name: str, path: Path) -> tuple[xr.DataTree, bool]:
    """A file's groups, and whether they are in memory."""
    whole = _sealed(name, path)
    if not whole:
        _rehearse(name, path)
    at_once = not whole or path.stat().st_size <= AT_ONCE
    return opened(name, path, at_once=at_once), at_once


def _read_store(name: str, path: Path) -> tuple[xr.DataTree, bool]:
    """A store's groups, which are not in memory."""
    require_library()
    _refuse(name, dangers(path))
    return opened_store(path), False


def _refuse(name: str, problems: Iterable[str]) -> None:
    """Raise the first problem, if there is one; later ones may rest on it."""
    for problem in problems:
        raise InputError(f"{name}: {problem}; {ALLOWED}")


def unreadable(name: str, error: Exception) -> InputError:
    """What is raised where the libraries cannot read a file or a store, or a part of it."""
    kind = "store of draws" if named_store(Path(name)) else "NetCDF file"
    damaged = any(word in str(error) for word in ("filter", "checksum"))  # as HDF5 and as Zarr say it
    reason = "damaged: its numbers do not fit their checksums" if damaged else f"not a {kind} that can be read"
    return InputError(f"{name}: {reason}; {ALLOWED}")


def opened(name: str, path: str | Path, *, at_once: bool = True) -> xr.DataTree:
    """All groups of a file that does nothing dangerous; raises InputError, or whatever the libraries say of a damaged file."""
    import h5py
    import xarray as xr

    with h5py.File(path, "r") as file:
        _refuse(name, _dangers(file, Path(path).stat().st_size))
    lazy = xr.open_datatree(path, engine="h5netcdf", decode_times=False)  # no units are times
    if at_once:
        with lazy:  # closed: an open tree keeps the file locked
            return lazy.load()
    load_small(lazy)
    return lazy


# --- Before it is read: what HDF5 would do --------------------------------------------------------


def _sealed(name: str, path: Path) -> bool:
    """Whether a file is as it was sealed; what something else wrote, or wrote to, has no seal. Raises InputError where it is another."""
    if not path.is_file():
        raise InputError(f"{name}: {'not a file' if path.exists() else 'no such file'}; {ALLOWED}")
    whole = sealed(path)
    if whole is False:
        raise InputError(f"{name}: damaged: it does not fit its checksum; {ALLOWED}")
    return whole is True


def _rehearse(name: str, path: str | Path) -> None:
    """Open a file without a seal in another process first: of some damage HDF5 crashes, or never ends."""
    limit = _PATIENCE + Path(path).stat().st_size / 1e6
    try:
        ended = subprocess.run([sys.executable, "-c", _REHEARSAL, str(path)], capture_output=True, timeout=limit, check=False).returncode
    except subprocess.TimeoutExpired:
        ended = None
    if ended not in (0, 1):  # 1 is an error in Python, which comes again here
        raise InputError(f"{name}: damaged: HDF5 {'does not end' if ended is None else 'crashes'} on it; {ALLOWED}")


def _dangers(file: h5py.File, size: int) -> Iterator[str]:
    """What must not be in the file: groups in groups, links, storage elsewhere or missing, more than the file can hold."""
    import h5py

    seen, total = {_address(file)}, 0
    for group, one in _members(file):
        if not isinstance(one, h5py.Group) or _address(one) in seen:
            yield f"{quoted(group)} is not a group of its own"
        seen.add(_address(one))
        for name, dataset in _members(one):
            where = quoted(f"{group}/{name}")
            if not isinstance(dataset, h5py.Dataset) or _address(dataset) in seen:
                yield f"{where} is not a variable of its own"
            seen.add(_address(dataset))
            yield from (f"{where} {what}" for what in _storage(dataset))
            total += dataset.nbytes
    if total > MOST_INFLATED * size:
        yield f"{total:,} bytes of variables in a file of {size:,}"


def _members(group: h5py.Group) -> Iterator[tuple[str, Any]]:
    """Names and objects of a group."""
    import h5py

    if len(group) > _MOST_NAMES:
        raise OSError("more members than any file of draws has")
    for name in group:
        if not isinstance(group.get(name, getlink=True), h5py.HardLink):
            raise OSError("a link to elsewhere")
        yield name, group[name]


def _address(one: h5py.HLObject) -> int:
    import h5py

    return int(h5py.h5o.get_info(one.id).addr)


def _storage(dataset: h5py.Dataset) -> Iterator[str]:
    """What is wrong with where a variable is kept."""
    plist = dataset.id.get_create_plist()
    if dataset.external or dataset.is_virtual:
        yield "is kept in another file"
    elif any(plist.get_filter(i)[0] not in _FILTERS for i in range(plist.get_nfilters())):
        yield "has a filter that is not gzip, shuffle or fletcher32"
    elif dataset.attrs.get("CLASS") == b"DIMENSION_SCALE" and dataset.id.get_storage_size() == 0:
        return  # a dimension without coordinates: a length, of which nothing is stored
    elif dataset.chunks is None and dataset.id.get_storage_size() < dataset.nbytes:
        yield "is not all there"
    elif dataset.chunks is not None:
        masks: list[int] = []
        dataset.id.chunk_iter(lambda chunk: masks.append(chunk.filter_mask))
        if len(masks) != math.prod(-(-length // part) for length, part in zip(dataset.shape, dataset.chunks, strict=True)):
            yield "is not all there"
        elif any(masks):
            yield "has parts without the filters of the others"  # these may skip the checksum


# --- After it was read: the layout of draws -------------------------------------------------------


def _misfits(tree: xr.DataTree, at_once: bool) -> Iterator[str]:
    """What differs from the layout of draws, in an order in which each rests on those before; not of draws that are read later."""
    yield from _attributes(tree.attrs)
    missing = [group for group in _LAYOUT if group not in tree.children]
    if missing:
        yield f"no group {', '.join(missing)}"
    for group, node in tree.children.items():
        optional = _OPTIONAL.get(group, {})
        yield from _variables(group, node.to_dataset(), _LAYOUT.get(group, optional), optional)
    yield from _sizes(tree)
    yield from _subjects(tree)
    yield from _counts(tree["observed_data"].to_dataset(), tree["constant_data"]["n_trials"].values)
    if at_once:
        yield from _draws(tree)


def _attributes(attrs: Mapping[Any, Any]) -> Iterator[str]:
    yield from (f"no attribute {name}" for name in (*_TEXTS, *_WHOLE) if name not in attrs)
    yield from (f"attribute {name} is not a text" for name in _TEXTS if not isinstance(attrs[name], str))
    yield from (f"attribute {name} is not a whole number" for name in _WHOLE if not isinstance(attrs[name], int | np.integer))
    try:
        prior = json.loads(attrs["settings"])["prior"]
        good = all(value is None or type(value) in (int, float, str) for value in prior.values())
    except (ValueError, LookupError, TypeError, AttributeError, RecursionError):
        good = False
    if not good:
        yield "attribute settings does not hold a prior"


def _variables(group: str, found: xr.Dataset, needed: Mapping[str, Any], allowed: Mapping[str, Any]) -> Iterator[str]:
    """Variables that are missing, or have other dimensions or another type than draws have."""
    for name in (*needed, *(other for other in allowed if other in found.variables and other not in needed)):
        if name not in found.variables:
            yield f"no variable {group}/{name}"
            continue
        dims, kinds = needed.get(name) or allowed[name]
        one = found.variables[name]
        if one.dims != dims or one.dtype.kind not in kinds:
            yield f"{group}/{name} is {one.dtype} over ({', '.join(map(str, one.dims))}), not over ({', '.join(dims)})"
        elif kinds == "UO" and not all(isinstance(text, str) for text in one.values):
            yield f"{group}/{name} has cells that are no text"
    if group == "posterior":
        odd = [str(name) for name, one in found.data_vars.items() if one.dims != BY_SUBJECT or one.dtype.kind != "f"]
        yield from (f"{quoted(name)} is not a number over ({', '.join(BY_SUBJECT)})" for name in odd)
    if group == "sample_stats":
        odd = [str(name) for name, one in found.data_vars.items() if not set(one.dims) <= set(BY_SUBJECT) or one.dtype.kind not in "ifbUO"]
        yield from (f"sample_stats/{quoted(name)} is not over ({', '.join(BY_SUBJECT)})" for name in odd)


def _sizes(tree: xr.DataTree) -> Iterator[str]:
    """Dimensions that are empty, or longer in one group than in another; values of every pair are of fewer draws."""
    lengths: dict[tuple[str, bool], int] = {}
    for group, node in tree.children.items():
        for dim, length in node.to_dataset().sizes.items():
            key = str(dim), dim == "draw" and group in ("log_likelihood", "posterior_predictive")
            if length == 0 or lengths.setdefault(key, length) != length:
                yield f"{length} values over {quoted(str(dim))} in {group}, and {lengths.get(key, 'at least one')} in another group"


def _subjects(tree: xr.DataTree) -> Iterator[str]:
    """Names that are empty, are repeated, or differ between the groups."""
    first = tree["observed_data"].to_dataset()
    names, others = (tree[group].to_dataset()["subject"].values.tolist() for group in ("posterior", "sample_stats"))
    if len(set(names)) < len(names) or "" in names:
        yield "names of subjects are empty or repeated"
    if others != names:
        yield "posterior and sample_stats are of other subjects"
    if list(dict.fromkeys(first["subject"].values.tolist())) != names:
        yield "posterior and observed_data are of other subjects"
    keys = [name for name in ("subject", "s1", "s2", "isi") if name in first.coords]
    for group in [name for name in ("constant_data", "log_likelihood", "posterior_predictive") if name in tree.children]:
        other = tree[group].to_dataset()
        if any(name not in other.coords or not np.array_equal(first[name].values, other[name].values) for name in keys):
            yield f"observed_data and {group} are of other pairs"


def _counts(observed: xr.Dataset, trials: Any) -> Iterator[str]:
    """Counts and stimuli that no study has."""
    equal, numbers = observed["n_equal"].values, [observed[name].values for name in ("s1", "s2", "isi") if name in observed.coords]
    if not ((equal >= 0) & (equal <= trials) & (trials >= 1) & (trials <= LARGEST_COUNT)).all():
        yield "counts outside 0 <= n_equal <= n_trials, n_trials >= 1"
    if not all(np.isfinite(values).all() for values in numbers) or ("isi" in observed.coords and not (observed["isi"].values > 0).all()):
        yield "stimuli or intervals that are no numbers"
    owner = np.unique(observed["subject"].values.astype(str), return_inverse=True)[1]
    if len(np.unique(np.column_stack([owner.ravel(), *numbers]), axis=0)) < len(owner):
        yield "a pair of a subject is repeated"


def _draws(tree: xr.DataTree) -> Iterator[str]:
    """Draws that are no numbers; a quantity that a subject does not have is NaN in all its draws."""
    for name, one in tree["posterior"].to_dataset().data_vars.items():
        good, absent = np.isfinite(one.values).all(axis=(0, 1)), np.isnan(one.values).all(axis=(0, 1))
        if not (good | absent).all():
            yield f"draws of {quoted(str(name))} are no numbers"
    if not np.isfinite(tree["sample_stats"].to_dataset()["lp"].values).all():
        yield "log densities are no numbers"
