"""The race of one subject in a process of its own: what a compiler leaves behind, or breaks, is gone with it."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context

from speed.cases import Case
from speed.method import Method
from speed.methods import METHODS
from speed.race import Rules, lost, race, warm_up
from speed.table import Row, row_of

_ENDED = "its process ended without an answer"


def rows_of(case: Case, rules: Rules, keys: Sequence[str] | None = None) -> list[Row]:
    """The table's rows of one subject, of the methods with these keys (all without).

    All methods take turns in one process. Where that ends without an answer (a compiler that crashes, too little memory), each
    method runs again in a process of its own, and the one that ends it says so in its rows.
    """
    keys = [method.key for method in METHODS] if keys is None else keys
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as executor:
        try:
            return executor.submit(_raced, case, rules, keys).result()
        except BrokenProcessPool:
            pass
    if len(keys) > 1:
        return [row for key in keys for row in rows_of(case, rules, [key])]
    return [row_of(entry) for entry in lost(case, _methods(keys), rules, _ENDED)]


def _raced(case: Case, rules: Rules, keys: Sequence[str]) -> list[Row]:
    """In that process. Methods are found by their keys: what prepares them cannot be sent."""
    warm_up()
    return [row_of(entry) for entry in race(case, _methods(keys), rules)]


def _methods(keys: Sequence[str]) -> list[Method]:
    return [method for method in METHODS if method.key in keys]
