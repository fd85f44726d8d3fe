# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Calls that take turns, so that whatever else the machine does meets them all."""

import gc
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from studies.page import Goal, Spread, spread

Times = Mapping[str, Sequence[float]]


class Section(NamedTuple):
    """Fraction of the page: its goals, and what its template names."""

    goals: list[Goal]
    values: dict[str, Any]


def in_turns(turns: int, calls: Mapping[str, Callable[[], Any]], of: int = 1) -> Times:
    """Time calls again and again, each once a turn; an untimed turn comes first.

    Returns:
        Seconds of the processor by name, one for each turn; of one piece of work where a call does
        `of` of them.
    """
    times: dict[str, list[float]] = {name: [] for name in calls}
    for turn in range(turns + 1):
        for name, call in calls.items():
            gc.collect()
            gc.disable()
            start = time.process_time()
            call()
            spent = time.process_time() - start
            gc.enable()
            if turn:
                times[name].append(spent / of)
    return times


def ratio(times: Times, over: str, under: str) -> Spread:
    """How many times the time of another a call takes, turn by turn."""
    return spread(
        [one / other for one, other in zip(times[over], times[under], strict=True)]
    )


def at_most(what: str, found: Spread, limit: float, unit: str = "") -> Goal:
    """Judge a median that should be small."""
    return Goal(
        what,
        f"at most {limit:g}{unit}",
        f"{found.text('.3g')}{unit}",
        found.median <= limit,
    )


def at_least(what: str, found: Spread, limit: float) -> Goal:
    """Judge a median that should be large."""
    return Goal(what, f"at least {limit:g}", found.text(".3g"), found.median >= limit)
