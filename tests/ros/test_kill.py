# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Nothing is lost by kill -9: a small edition of `python -m studies.soak.kill_trials`.

In processes of their own, because they fork, which the threads of DDS in this one would not bear.
"""

import subprocess
import sys

import pytest
from cli.running import ROOT

TRIALS = {
    "random": ("--trials", "3", "--no-lines", "--seed", "1"),
    "lines": ("--trials", "0", "--lines", "--changes-only"),
}
pytestmark = [pytest.mark.slow, pytest.mark.timeout(500)]


@pytest.fixture(scope="module")
def tables(environment):
    """Run the trials one by one, for what runs beside; cells of each kind by title of column."""
    found = {}
    for name, arguments in TRIALS.items():
        done = subprocess.run(
            [sys.executable, "-m", "studies.soak.kill_trials", *arguments],
            env=dict(environment),
            cwd=ROOT,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=230,
        )
        assert done.returncode == 0, done.stdout
        lines = [
            [cell.strip() for cell in line.strip("|").split("|")]
            for line in done.stdout.splitlines()
            if line.startswith("|")
        ]
        found[name] = {
            kind: dict(zip(lines[0][1:], map(int, cells), strict=True))
            for kind, *cells in lines[2:]
        }
    return found


def test_kill_at_random_moments_loses_nothing(tables):
    (row,) = tables["random"].values()
    assert row["kills"] == 3 and row["problems"] == 0
    # A kill between two operations would show nothing.
    assert row["amid an operation"] > 0
    assert row["acknowledged"] > 20


def test_kill_after_every_change_of_a_file_loses_nothing(tables):
    assert len(tables["lines"]) == 8
    for row in tables["lines"].values():
        assert row["kills"] > 3 and row["problems"] == 0
