# SPDX-License-Identifier: Apache-2.0
"""Goals that a ratio meets or misses."""

from __future__ import annotations

from studies.soak.goals import Goal

from .record import Spread


def at_least(what: str, found: Spread, limit: float) -> Goal:
    return Goal(what, f"at least {limit:g}", found.text(), found.median >= limit)


def at_most(what: str, found: Spread, limit: float) -> Goal:
    return Goal(what, f"at most {limit:g}", found.text(), found.median <= limit)
