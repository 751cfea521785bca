"""Work that is under way: how far it is, for whoever has to say so when it is stopped."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Standing:
    """How far the work is whose results a folder keeps.

    Attributes
    ----------
    taken : int
        Results that were there before.
    done, jobs : int
        Results that are there, and how many there will be.
    what : str
        What they are of.
    """

    taken: int
    done: int
    jobs: int
    what: str


#: By folder, as far as this process knows: for whoever has to say so when it is stopped.
under_way: dict[Path, Standing] = {}


def said_kept() -> str:
    """What another call need not compute again; empty where that is nothing."""
    said = [f"{one.done} of {one.jobs} {one.what} kept in {folder}" for folder, one in under_way.items() if one.done]
    return f"{', '.join(said)}, go on with --resume" if said else ""
