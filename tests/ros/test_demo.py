# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The demonstration of `make demo`."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow
DEMO = Path(__file__).resolve().parents[2] / "examples" / "demo.py"


def processes_with(text: str) -> list[str]:
    """Command lines of running processes that hold a text."""
    found = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            line = path.read_bytes().replace(b"\0", b" ").decode()
        except OSError:
            continue  # it ended meanwhile
        if text in line:
            found.append(line)
    return found


def start(temporary: Path) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, str(DEMO)], stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        text=True, env={**os.environ, "TMPDIR": str(temporary)})


def test_it_shows_that_the_refit_improves_the_node(environment, tmp_path):
    process = start(tmp_path)
    output, _ = process.communicate(timeout=60)
    assert process.returncode == 0, output
    rows = re.findall(r"^ +([1-8])[* ] +[-+]\d\.\d\d .*\|.*\|", output, flags=re.MULTILINE)
    assert rows == list("12345678") * 2
    assert "silent" not in output
    changes = re.findall(r"([\d.]+) %  -> +([\d.]+) %", output)
    assert len(changes) == 2
    for before, after in changes:
        assert float(before) > 20.0 and float(after) < 2.3
    assert processes_with(str(tmp_path)) == []
    assert list(tmp_path.glob("hmcvt-demo-*")) == []


def test_interrupted_it_leaves_nothing_behind(environment, tmp_path):
    process = start(tmp_path)
    while "1. The node runs" not in process.stdout.readline():
        assert process.poll() is None
    assert processes_with(str(tmp_path))
    time.sleep(0.5)
    process.send_signal(signal.SIGINT)
    output, _ = process.communicate(timeout=20)
    assert process.returncode == 130, output
    assert "the node has been stopped" in output
    assert processes_with(str(tmp_path)) == []
    assert list(tmp_path.glob("hmcvt-demo-*")) == []
