# SPDX-License-Identifier: Apache-2.0
"""Nothing is lost by kill -9: a small edition of `python -m studies.soak.kill_trials`.

In a process of its own, because it forks, which the threads of DDS in this one would not bear.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
pytestmark = pytest.mark.slow


def table(environment, *arguments):
    """Run the trials; return the cells of each kind by the title of their column."""
    done = subprocess.run(
        [sys.executable, "-m", "studies.soak.kill_trials", *arguments], env=dict(environment),
        cwd=ROOT, capture_output=True, text=True, timeout=110)
    assert done.returncode == 0, done.stdout + done.stderr
    lines = [[cell.strip() for cell in line.strip("|").split("|")]
             for line in done.stdout.splitlines() if line.startswith("|")]
    return {name: dict(zip(lines[0][1:], map(int, cells), strict=True))
            for name, *cells in lines[2:]}


def test_kill_at_random_moments_loses_nothing(environment):
    found = table(environment, "--trials", "33", "--node-trials", "3", "--no-lines", "--seed", "1")
    assert len(found) == 6
    assert sum(row["kills"] for row in found.values()) == 33
    for row in found.values():
        assert row["problems"] == 0
        # A kill between two operations would show nothing.
        assert row["amid an operation"] >= row["kills"] // 2
    assert sum(row["acknowledged"] for row in found.values()) > 20


def test_kill_before_every_line_loses_nothing(environment):
    found = table(environment, "--trials", "0", "--lines")
    assert len(found) == 8
    for row in found.values():
        assert row["kills"] > 20 and row["problems"] == 0
