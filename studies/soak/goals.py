# SPDX-License-Identifier: Apache-2.0
"""What was aimed at and what was reached, as a table in Markdown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Goal:
    """One line of the first table."""

    what: str
    goal: str
    measured: str
    met: bool


def goal_table(goals: Sequence[Goal]) -> list[str]:
    return table(("", "goal", "measured", ""), [
        (goal.what, goal.goal, goal.measured, "met" if goal.met else "**missed**")
        for goal in goals])


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    return [f"| {' | '.join(row)} |" for row in (head, ["---"] * len(head), *rows)]
