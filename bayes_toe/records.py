"""Results as bytes in NumPy's npz format: records of arrays, numbers and texts, exact to the bit; nothing in them can be run.

Records are the package's own dataclasses and named tuples. They are stored as what they are made from, and are made again from that.
"""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import partial
from importlib import import_module
from types import ModuleType
from typing import Any

import numpy as np
import numpy.typing as npt

from bayes_toe.errors import InputError

_OURS = "bayes_toe."


def packed(value: object) -> bytes:
    """A record, or a tuple, list or dict of such, as bytes with the checksums of the format.

    Raises
    ------
    TypeError
        If something in it is neither a record nor an array, a number, a text or None.

    Examples
    --------
    >>> unpacked(packed({"mean": np.float32(0.1), "draws": np.arange(3.0), "note": None}))
    {'mean': np.float32(0.1), 'draws': array([0., 1., 2.]), 'note': None}
    """
    arrays: list[npt.NDArray[Any]] = []
    text = json.dumps(_plain(value, arrays, _refuse))
    content = io.BytesIO()
    np.savez(
        content,
        allow_pickle=False,
        text=np.array(text),
        **{f"a{i}": array for i, array in enumerate(arrays)},
    )
    return content.getvalue()


def unpacked(content: bytes) -> Any:
    """The inverse of :func:`packed`; of bytes that are not whole NumPy says anything.

    Raises
    ------
    InputError
        If they hold something else than records of this package.
    """
    with np.load(io.BytesIO(content), allow_pickle=False) as members:
        return _made(json.loads(str(members["text"])), members)


def fingerprint(value: object) -> str:
    """SHA-256 of everything that a value is made of, hexadecimal; functions, and calls still to be made, count by name and arguments.

    Examples
    --------
    >>> fingerprint(partial(max, 1, 2)) == fingerprint(partial(max, 1, 2)) != fingerprint(partial(max, 1, 3))
    True
    """
    arrays: list[npt.NDArray[Any]] = []
    found = hashlib.sha256(json.dumps(_plain(value, arrays, _named), sort_keys=True).encode())
    for array in arrays:
        found.update(
            f"{array.dtype.str}{array.shape}".encode() + np.ascontiguousarray(array).tobytes()
        )
    return found.hexdigest()


def _plain(
    value: object, arrays: list[npt.NDArray[Any]], other: Callable[[object], object]
) -> object:
    """A value as JSON has it, its arrays aside."""
    inner = partial(_plain, arrays=arrays, other=other)
    if value is None or (
        isinstance(value, bool | int | float | str) and not isinstance(value, Enum)
    ):
        return value
    if isinstance(value, np.ndarray | np.generic):
        arrays.append(np.asarray(value))
        return {"array" if isinstance(value, np.ndarray) else "scalar": len(arrays) - 1}
    if isinstance(value, list):
        return [inner(one) for one in value]
    if isinstance(value, Mapping):
        return {"dict": [[inner(key), inner(one)] for key, one in value.items()]}
    kind = type(value)
    if isinstance(value, Enum):
        return {"enum": f"{kind.__module__}:{kind.__qualname__}", "value": value.value}
    names = _fields(value)
    if names is not None:
        return {
            "record": f"{kind.__module__}:{kind.__qualname__}",
            "fields": {name: inner(getattr(value, name)) for name in names},
        }
    if isinstance(value, tuple):
        return {"tuple": [inner(one) for one in value]}
    return inner(other(value))


def _fields(value: object) -> tuple[str, ...] | None:
    """What a record is made from; None where a value is none."""
    if is_dataclass(value) and not isinstance(value, type):
        return tuple(one.name for one in fields(value) if one.init)
    return getattr(value, "_fields", None) if isinstance(value, tuple) else None


def _refuse(value: object) -> object:
    raise TypeError(f"{type(value).__name__} cannot be kept")


def _named(value: object) -> object:
    """A function by its name, a call that is still to be made by what it calls with what."""
    if isinstance(value, partial):
        return value.func, value.args, value.keywords
    if not callable(value) or "<" in getattr(value, "__qualname__", "<"):
        _refuse(value)
    own = getattr(value, "__self__", None)  # a method counts with the object it belongs to
    name = f"{value.__module__}:{value.__qualname__}"  # type: ignore[attr-defined]
    return name, None if isinstance(own, type | ModuleType) else own


def _made(plain: Any, members: Mapping[str, npt.NDArray[Any]]) -> Any:
    """The inverse of :func:`_plain`."""
    inner = partial(_made, members=members)
    match plain:
        case list():
            return [inner(one) for one in plain]
        case {"array": index}:
            return members[f"a{index}"]
        case {"scalar": index}:
            return members[f"a{index}"][()]
        case {"tuple": values}:
            return tuple(map(inner, values))
        case {"dict": pairs}:
            return {inner(key): inner(one) for key, one in pairs}
        case {"enum": name, "value": member}:
            return _class(name)(member)
        case {"record": name, "fields": values}:
            return _class(name)(**{key: inner(one) for key, one in values.items()})
    return plain


def _class(name: str) -> Any:
    """A record of this package; anything else is refused."""
    module, _, qualified = name.partition(":")
    found = getattr(import_module(module), qualified, None) if module.startswith(_OURS) else None
    is_record = is_dataclass(found) or hasattr(found, "_fields")
    if not isinstance(found, type) or not (is_record or issubclass(found, Enum)):
        raise InputError(f"{name} is not a record of this package")
    return found
