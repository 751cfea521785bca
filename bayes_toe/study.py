"""Who answered what: the counts of each subject, validated once and immutable.

The likelihood needs only how often each ordered pair of stimuli was called 'equal', so trials are grouped on the way in: a
million trials cost what their distinct pairs cost.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from bayes_toe.errors import InputError

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
#: Beyond it, whole numbers are not exact in the floating point of the likelihood.
LARGEST_COUNT = 2**53


def _frozen(values: npt.ArrayLike, dtype: type) -> npt.NDArray[Any]:
    """A read-only copy, one-dimensional."""
    array: npt.NDArray[Any] = np.array(values, dtype=dtype, ndmin=1, copy=True)
    array.setflags(write=False)
    return array


@dataclass(frozen=True, eq=False)
class Subject:
    """Counts of one subject, one entry per ordered pair of stimuli, sorted by (s1, s2).

    Parameters
    ----------
    name : str
        The identifier as the file had it: any text.
    s1, s2 : array_like, shape (pairs,)
        Natural-log intensities of the first and the second stimulus.
    n_equal, n_trials : array_like of int, shape (pairs,)
        How often the pair was called 'equal', and how often it was answered.

    Raises
    ------
    InputError
        If shapes differ, a value is not finite, a pair is repeated, or counts are outside 0 <= n_equal <= n_trials, n_trials >= 1.

    Examples
    --------
    >>> Subject("S01", [0.0, 0.0], [0.0, 0.3], [49, 20], [50, 50]).fraction_equal
    0.69
    """

    name: str
    s1: FloatArray
    s2: FloatArray
    n_equal: IntArray
    n_trials: IntArray

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name:
            raise InputError(f"subject name {self.name!r} must be a non-empty text")
        for key in ("n_equal", "n_trials"):
            _require_counts(self.name, key, getattr(self, key))
        s1, s2 = _frozen(_stimuli(self.name, self.s1), np.float64), _frozen(_stimuli(self.name, self.s2), np.float64)
        k, n = _frozen(self.n_equal, np.int64), _frozen(self.n_trials, np.int64)
        _require_valid(self.name, s1, s2, k, n)
        order = np.lexsort((s2, s1))  # one order whatever the file's, so results agree to the bit
        for key, values in (("s1", s1), ("s2", s2), ("n_equal", k), ("n_trials", n)):
            object.__setattr__(self, key, _frozen(values[order], values.dtype.type))

    @classmethod
    def from_counts(cls, name: str, s1: npt.ArrayLike, s2: npt.ArrayLike, n_equal: npt.ArrayLike, n_trials: npt.ArrayLike) -> Subject:
        """A subject from rows of counts: repeated pairs are added up, pairs never answered are left out.

        Examples
        --------
        >>> Subject.from_counts("S01", [0.0, 0.0], [0.3, 0.3], [1, 2], [5, 5]).n_equal.tolist()
        [3]
        """
        for key, values in (("n_equal", n_equal), ("n_trials", n_trials)):
            _require_counts(name, key, values)
        k, n = np.asarray(n_equal, np.int64).ravel(), np.asarray(n_trials, np.int64).ravel()
        first, second = _stimuli(name, s1), _stimuli(name, s2)
        if not first.shape == second.shape == k.shape == n.shape:
            raise InputError(f"subject {name!r}: s1, s2, n_equal and n_trials must have one common length")
        if np.any((k < 0) | (k > n)):  # checked before adding up, where two wrongs could cancel
            raise InputError(f"subject {name!r}: every n_equal must lie in 0..n_trials")
        answered = n > 0
        pairs, index = np.unique(np.column_stack([first, second])[answered], axis=0, return_inverse=True)
        k_sum, n_sum = (np.zeros(len(pairs), np.int64) for _ in range(2))
        np.add.at(k_sum, index.ravel(), k[answered])
        np.add.at(n_sum, index.ravel(), n[answered])
        return cls(name, pairs[:, 0], pairs[:, 1], k_sum, n_sum)

    @classmethod
    def from_trials(cls, name: str, s1: npt.ArrayLike, s2: npt.ArrayLike, equal: npt.ArrayLike) -> Subject:
        """A subject from single trials; `equal` is True where the answer was 'equal'.

        Examples
        --------
        >>> Subject.from_trials("S01", [0, 0, 0], [0.3, 0.3, 0.3], [True, False, True]).n_trials.tolist()
        [3]
        """
        given = np.asarray(equal).ravel()
        # Words would all count as True: only truth values, or the numbers 1 and 0, say which answer was given.
        if given.dtype.kind not in "biuf" or not np.isin(given, (0, 1)).all():
            raise InputError(f"subject {name!r}: equal must hold True or False (or 1 or 0), found {given[:3].tolist()}")
        answers = given.astype(np.int64)
        return cls.from_counts(name, s1, s2, answers, np.ones_like(answers))

    @property
    def n_pairs(self) -> int:
        """Number of distinct ordered pairs."""
        return len(self.s1)

    @property
    def total_trials(self) -> int:
        """Number of answered trials."""
        return int(self.n_trials.sum())

    @property
    def fraction_equal(self) -> float:
        """Share of trials answered 'equal', in 0..1."""
        return float(self.n_equal.sum() / self.n_trials.sum())


@dataclass(frozen=True, eq=False)
class Study:
    """Subjects of one experiment, with where they came from.

    Parameters
    ----------
    subjects : sequence of Subject
        At least one; names are unique (case matters).
    source : str
        What reports call the study.
    synthetic : bool
        True where the data were simulated; shown wherever the study is shown.
    notes : sequence of str
        What reading the study detected, merged or dropped.

    Examples
    --------
    >>> study = Study([Subject("S01", [0.0], [0.3], [2], [5])], source="pilot")
    >>> study["S01"].n_pairs, study.names
    (1, ('S01',))
    """

    subjects: tuple[Subject, ...]
    source: str = "study"
    synthetic: bool = False
    notes: tuple[str, ...] = field(default=())

    def __post_init__(self) -> None:
        subjects = tuple(self.subjects)
        names = [subject.name for subject in subjects]
        repeated = sorted({name for name in names if names.count(name) > 1}) if len(set(names)) < len(names) else []
        if not subjects:
            raise InputError("a study needs at least one subject")
        if repeated:
            raise InputError(f"subject names must be unique, repeated: {', '.join(map(repr, repeated))}")
        object.__setattr__(self, "subjects", subjects)
        object.__setattr__(self, "notes", tuple(self.notes))

    @property
    def names(self) -> tuple[str, ...]:
        """Subject identifiers, in the order of the study."""
        return tuple(subject.name for subject in self.subjects)

    def __len__(self) -> int:
        return len(self.subjects)

    def __iter__(self) -> Iterator[Subject]:
        return iter(self.subjects)

    def __getitem__(self, name: str) -> Subject:
        for subject in self.subjects:
            if subject.name == name:
                return subject
        raise InputError(f"no subject {name!r} in {self.source}; there are: {', '.join(map(repr, self.names))}")

    def select(self, names: Sequence[str]) -> Study:
        """The same study with only these subjects, in the order asked for."""
        return Study(tuple(self[name] for name in names), self.source, self.synthetic, self.notes)


def _require_counts(name: str, key: str, values: npt.ArrayLike) -> None:
    """Counts must be whole numbers before they are stored as such: 2.5 never becomes 2."""
    array = np.asarray(values)
    if array.dtype.kind not in "iuf" or np.any(array != np.floor(array)):
        raise InputError(f"subject {name!r}: {key} must be whole numbers, found {array.ravel()[:3].tolist()}")
    if np.sum(np.abs(array), dtype=np.float64) > LARGEST_COUNT:
        raise InputError(f"subject {name!r}: {key} must add up to no more than 2**53 (larger counts are not exact)")


def _stimuli(name: str, values: npt.ArrayLike) -> FloatArray:
    try:
        return np.asarray(values, np.float64).ravel()
    except (TypeError, ValueError) as error:
        raise InputError(f"subject {name!r}: s1 and s2 must be numbers ({error})") from error


def _require_valid(name: str, s1: FloatArray, s2: FloatArray, k: IntArray, n: IntArray) -> None:
    """The promises that every other module builds on."""
    if not s1.shape == s2.shape == k.shape == n.shape or s1.ndim != 1:
        raise InputError(f"subject {name!r}: s1, s2, n_equal and n_trials must be one-dimensional and of one length")
    if len(s1) == 0:
        raise InputError(f"subject {name!r}: no answered trial")
    if not (np.isfinite(s1).all() and np.isfinite(s2).all()):
        raise InputError(f"subject {name!r}: s1 and s2 must be finite numbers")
    if np.any(n < 1) or np.any(k < 0) or np.any(k > n):
        raise InputError(f"subject {name!r}: every pair needs n_trials >= 1 and n_equal in 0..n_trials")
    if len(np.unique(np.column_stack([s1, s2]), axis=0)) < len(s1):
        raise InputError(f"subject {name!r}: a pair of stimuli is repeated; Subject.from_counts adds repeats up")
