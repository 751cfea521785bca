"""Every method on one subject, their runs interleaved, so that a machine that slows down slows all of them down."""

from __future__ import annotations

import gc
import time
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from importlib.util import find_spec

import numpy as np

from bayes_toe.inference.diagnostics import convergence
from bayes_toe.seeds import stream
from speed.cases import HARD, Case
from speed.method import Method, Prepared
from speed.outcome import DoesNotExistError, Outcome
from speed.score import Score, score

OK, PARTLY, FAILED, NO_RESULT, NOT_RUN = "ok", "partly failed", "failed", "does not exist", "not run"


@dataclass(frozen=True)
class Rules:
    """What holds for the whole race.

    Parameters
    ----------
    seed : int
        Root of all random streams.
    peers : bool
        Whether methods that need other libraries run at all.
    peer_hard_cases : tuple of str
        Hard cases on which they do.
    shrink : int
        Efforts are divided by this: 1 in earnest, more in tests.
    most_runs : int
        Upper limit on the runs of every method.
    patience_s : float
        A method whose run took longer is not run again on that subject and effort.
    """

    seed: int
    peers: bool = True
    peer_hard_cases: tuple[str, ...] = ()
    shrink: int = 1
    most_runs: int = 100
    patience_s: float = 20.0

    def why_not(self, method: Method, case: Case) -> str:
        """Why a method does not run on a case; empty where it does."""
        if not method.library:
            return ""
        if not self.peers:
            return "other libraries were switched off by --no-peers"
        if find_spec(method.library) is None:
            return f"{method.library} is not installed"
        if case.kind == HARD and case.name not in self.peer_hard_cases:
            return "other libraries ran on some of the hard cases only, for time (--peer-hard-cases)"
        return ""

    def runs(self, method: Method, case: Case) -> int:
        """Independent runs: half as many on hard cases, for time."""
        return min(self.most_runs, -(-method.runs // 2) if case.kind == HARD else method.runs)


@dataclass(eq=False)
class Entry:
    """One row of the race while it is being filled: a method at one effort on one subject."""

    case: Case
    method: Method
    effort: int
    runs: int
    reason: str = ""
    no_result: bool = False
    prepared: Prepared | None = None
    compile_s: float | None = None
    scores: list[Score] = field(default_factory=list)
    failures: list[str] = field(default_factory=list)
    over: bool = False

    @property
    def status(self) -> str:
        """How it went, in two words."""
        if self.scores:
            return PARTLY if self.failures else OK
        if self.failures:
            return NO_RESULT if self.no_result else FAILED
        return NOT_RUN

    def close(self) -> None:
        """Leave the model to the garbage collector: compiled ones are large.

        What compiled in its first run took what that run was longer than the others; nothing, where it was not longer.
        """
        if self.prepared is not None and self.prepared.first_run and self.compile_s is not None and self.scores:
            self.compile_s = max(0.0, self.compile_s - float(np.median([entry.wall_s for entry in self.scores])))
        self.prepared = None

    def fail(self, error: Exception) -> None:
        """Keep what went wrong; a method that has no result will not have one in the next run either."""
        first_line = (str(error).strip().splitlines() or [""])[0][:200]
        self.no_result = isinstance(error, DoesNotExistError)
        self.failures.append(first_line if self.no_result else f"{type(error).__name__}: {first_line}")
        self.reason, self.over = self.failures[0], self.over or self.no_result


def warm_up() -> None:
    """Load what loads at first use, so that no method pays for it."""
    import emcee  # noqa: F401

    convergence(np.random.default_rng(0).standard_normal((4, 100)))


def race(case: Case, methods: Sequence[Method], rules: Rules) -> list[Entry]:
    """All methods on one case; failures are entries with their reason."""
    entries = _entries(case, methods, rules)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # what libraries warn of shows in the numbers
        _prepare([entry for entry in entries if not entry.reason], rules)
        most = max((entry.runs for entry in entries), default=0)
        for turn in range(most):
            gc.collect()
            for entry in _due(entries, turn, most):
                _timed(entry, _seed(rules, entry, turn), rules)
    for entry in entries:
        entry.close()
    return entries


def lost(case: Case, methods: Sequence[Method], rules: Rules, reason: str) -> list[Entry]:
    """The entries of a race of which nothing is left: all that would have run failed for one reason."""
    entries = _entries(case, methods, rules)
    for entry in entries:
        if not entry.reason:
            entry.failures.append(reason)
            entry.reason = reason
    return entries


def _entries(case: Case, methods: Sequence[Method], rules: Rules) -> list[Entry]:
    return [
        Entry(case, method, max(1, effort // rules.shrink), rules.runs(method, case), rules.why_not(method, case))
        for method in methods
        for effort in method.efforts
    ]


def _prepare(entries: list[Entry], rules: Rules) -> None:
    """Build, check and compile; the efforts of one method share their model."""
    made: dict[str, Prepared | Exception] = {}
    for entry in entries:
        if entry.method.key not in made:
            try:
                made[entry.method.key] = entry.method.prepare(entry.case)
            except Exception as error:  # whatever another library raises becomes a row that says so
                made[entry.method.key] = error
        prepared = made[entry.method.key]
        if isinstance(prepared, Exception):
            entry.fail(prepared)
            continue
        entry.prepared, entry.compile_s = prepared, prepared.compile_s
        if prepared.first_run:
            _first(entry, _seed(rules, entry, -1))


def _first(entry: Entry, seed: int) -> None:
    try:
        entry.compile_s = _run(entry, seed)[1]
    except Exception as error:
        entry.fail(error)
        entry.over = True


def _due(entries: list[Entry], turn: int, most: int) -> Iterator[Entry]:
    """Entries whose turn it is: each one's runs are spread evenly over all the turns."""
    for entry in entries:
        spread = (turn + 1) * entry.runs // most > turn * entry.runs // most
        if spread and entry.prepared is not None and not entry.over:
            yield entry


def _timed(entry: Entry, seed: int, rules: Rules) -> None:
    try:
        outcome, wall_s = _run(entry, seed)
        entry.scores.append(score(outcome, entry.case.reference, wall_s))
        entry.over = wall_s > rules.patience_s
    except Exception as error:
        entry.fail(error)


def _run(entry: Entry, seed: int) -> tuple[Outcome, float]:
    if entry.prepared is None:
        raise ValueError(f"{entry.method.key} was not prepared")
    began = time.perf_counter()
    outcome = entry.prepared.run(entry.effort, seed)
    return outcome, time.perf_counter() - began


def _seed(rules: Rules, entry: Entry, turn: int) -> int:
    """A seed below 2^31: every library takes it."""
    sequence = stream(rules.seed, entry.case.name, entry.method.key, entry.effort, turn)
    return int(sequence.generate_state(1)[0]) >> 1
