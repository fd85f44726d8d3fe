# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What a measured page says: goals and what was reached, how it was run, on which machine."""

import os
import platform
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined

_TICKS = os.sysconf("SC_CLK_TCK")
_LOOK = 2.0  # s


class Goal(NamedTuple):
    """One line of the first table."""

    what: str
    goal: str
    measured: str
    met: bool


def goal_table(goals: Sequence[Goal]) -> str:
    """Return what was aimed at and what was reached, in Markdown."""
    return table(
        ("", "goal", "measured", ""),
        [(*goal[:3], "met" if goal.met else "**missed**") for goal in goals],
    )


def table(head: Sequence[object], rows: Sequence[Sequence[object]]) -> str:
    """Return a table in Markdown; a bar within a cell would end it."""
    return "\n".join(
        "| " + " | ".join(str(cell).replace("|", "\\|") for cell in row) + " |"
        for row in (head, ["---"] * len(head), *rows)
    )


def render(template: str, folder: Path, /, **context: object) -> str:
    """Return a page of Markdown from a template in a folder."""
    environment = Environment(
        loader=FileSystemLoader(folder),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    return environment.get_template(template).render(context)


class Run(NamedTuple):
    """How the command was run: its line, how long it took [s], the load from others before it."""

    command: str
    seconds: float
    others: float


class Spread(NamedTuple):
    """A figure that was measured several times: median, lowest, highest."""

    median: float
    low: float
    high: float

    def text(self, form: str = ".2f") -> str:
        """Return it with its range."""
        return f"{self.median:{form}} ({self.low:{form}} to {self.high:{form}})"


def spread(values: Sequence[float]) -> Spread:
    """Sum up what was measured."""
    return Spread(float(np.median(values)), min(values), max(values))


def busy_seconds() -> float:
    """Processor time that the whole machine has spent working since it started."""
    user, nice, system, _idle, _wait, *rest = map(
        int, Path("/proc/stat").read_text().splitlines()[0].split()[1:]
    )
    return (user + nice + system + sum(rest[:3])) / _TICKS


def busy_cores() -> float:
    """Look for a while how many cores other programs use."""
    before = busy_seconds()
    time.sleep(_LOOK)
    return (busy_seconds() - before) / _LOOK


def machine() -> str:
    """Say in a line what machine this is."""
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    model = next(
        (
            line.partition(":")[2].strip()
            for line in lines
            if line.startswith("model name")
        ),
        platform.machine(),
    )
    return (
        f"{model}, {os.cpu_count()} cores, {platform.system()} {platform.release()}, "
        f"Python {platform.python_version()}"
    )
