"""Random streams keyed by root seed, subject and purpose.

A stream gives the same numbers in any order of the jobs and on any number of workers.
"""

from __future__ import annotations

import hashlib
import secrets

import numpy as np

from bayes_toe.errors import require_number

#: The largest integer that a NetCDF file keeps.
LARGEST_SEED = 2**63 - 1


def root_seed(seed: int | None) -> int:
    """The seed as an integer; None gives a fresh seed, which results then report.

    An InputError if it is not in 0 to 2**63 - 1.
    """
    if seed is None:
        return secrets.randbits(32)
    return require_seed(seed)


def require_seed(seed: int) -> int:
    """The seed as an integer; an InputError if it is not in 0 to 2**63 - 1."""
    require_number("seed", seed, smallest=0, largest=LARGEST_SEED)
    return int(seed)  # an integer of NumPy becomes an integer of Python


def stream(seed: int, *keys: str | int) -> np.random.SeedSequence:
    """Seed sequence of one purpose, which the keys name: the same for the same seed and keys.

    Do not spawn from it, because spawning changes its state.
    """
    # Each key follows its length, because ("ab", "c") and ("a", "bc") would else be one text. A
    # name may have characters that UTF-8 cannot write, hence "surrogatepass".
    text = "".join(f"{len(str(key))}:{key};" for key in keys)
    digest = hashlib.sha256(text.encode("utf-8", "surrogatepass")).digest()
    words = np.frombuffer(digest, np.uint32)  # NumPy seeds with words of 32 bits
    return np.random.SeedSequence([require_seed(seed), *words.tolist()])


def generator(seed: int, *keys: str | int) -> np.random.Generator:
    """Random generator with the :func:`stream` of this seed and these keys."""
    return np.random.default_rng(stream(seed, *keys))
