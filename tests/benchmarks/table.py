# SPDX-License-Identifier: Apache-2.0
"""Goals, and tables in Markdown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from .record import Spread


@dataclass(frozen=True)
class Goal:
    """One line of the first table."""

    what: str
    goal: str
    measured: str
    met: bool

    def row(self) -> list[str]:
        return [self.what, self.goal, self.measured, "met" if self.met else "**missed**"]


def at_least(what: str, found: Spread, limit: float) -> Goal:
    return Goal(what, f"at least {limit:g}", found.text(), found.median >= limit)


def at_most(what: str, found: Spread, limit: float) -> Goal:
    return Goal(what, f"at most {limit:g}", found.text(), found.median <= limit)


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    return [f"| {' | '.join(row)} |" for row in (head, ["---"] * len(head), *rows)]
