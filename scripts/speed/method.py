"""A method of the race: its name, its coordinates, how much effort it is given, and how a subject is prepared for it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from speed.cases import Case
from speed.outcome import Outcome

NATURAL, IDENTIFIED = "natural", "identified"


@dataclass(frozen=True)
class Prepared:
    """One subject, ready to be timed.

    Attributes
    ----------
    run : callable
        `run(effort, seed)`.
    compile_s : float, optional
        Seconds that compiling took; None where nothing is compiled.
    first_run : bool
        True where compiling happens in the first run: that run is then made apart, and is not among those counted.
    """

    run: Callable[[int, int], Outcome]
    compile_s: float | None = None
    first_run: bool = False


@dataclass(frozen=True)
class Method:
    """One row of the race.

    Attributes
    ----------
    name, coordinates : str
        Together they are unique.
    effort_unit : str
        What the efforts count.
    efforts : tuple of int
        One row each.
    runs : int
        Independent runs of each effort.
    prepare : callable
        Builds, checks and compiles the model of a case.
    library : str
        What must be installed, empty where the package's own requirements do.
    """

    name: str
    coordinates: str
    effort_unit: str
    efforts: tuple[int, ...]
    runs: int
    prepare: Callable[[Case], Prepared]
    library: str = ""

    @property
    def key(self) -> str:
        """Name and coordinates, for people."""
        return f"{self.name} ({self.coordinates})"
