# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Copies of the project in which mutants live, and the trial of one mutant."""

from __future__ import annotations

import difflib
import hashlib
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from queue import SimpleQueue
from typing import Any

from .mutations import Mutation

ROOT = Path(__file__).resolve().parents[2]
KILLED, SURVIVED, NO_EFFECT = "killed", "survived", "without effect"
# What judges the source text or the speed of the machine, not answers.
_LEFT_OUT = ("test_house_rules.py", "test_speed.py", "test_layers.py")
_ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": "1"}
Reach = dict[str, Any]
"""Of one test file: `seconds` that it takes, and `lines` of each source that it runs."""
_PYTEST = ("-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", "--no-header", "--tb=no")


class Copies:
    """As many copies of the project as trials run side by side.

    Attributes:
        state: twelve digits of all Python files: results of another state do not count.
    """

    def __init__(self, folder: Path, count: int) -> None:
        listed = subprocess.run(
            ["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=True)
        files = [name for name in listed.stdout.decode().split("\0")
                 if name and (ROOT / name).is_file()]
        told = hashlib.sha256()
        for name in sorted(name for name in files if name.endswith((".py", ".toml"))):
            told.update(name.encode() + (ROOT / name).read_bytes())
        self.state = told.hexdigest()[:12]
        self._free: SimpleQueue[Path] = SimpleQueue()
        for number in range(count):
            copy = folder / f"copy-{number}"
            shutil.rmtree(copy, ignore_errors=True)
            for name in files:
                (copy / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(ROOT / name, copy / name)
            self._free.put(copy)

    @contextmanager
    def one(self) -> Iterator[Path]:
        copy = self._free.get()
        try:
            yield copy
        finally:
            self._free.put(copy)


def in_copy(
    copy: Path, arguments: Sequence[str], limit: float | None = None
) -> subprocess.CompletedProcess[str]:
    """Run Python there on the copy's own modules.

    Raises:
        subprocess.TimeoutExpired: after `limit` seconds.
    """
    environment = {**os.environ, **_ONE_THREAD, "PYTHONPATH": str(copy)}
    return subprocess.run([sys.executable, *arguments], cwd=copy, env=environment, timeout=limit,
                          capture_output=True, text=True, check=False)


def reaches(
    copies: Copies, folder: Path, tests: Sequence[str], jobs: int, say: Callable[[str], None]
) -> dict[str, Reach]:
    """Run every test file once and note what it reaches; kept in `folder`.

    Raises:
        RuntimeError: a test fails without any mutant.
    """
    kept = folder / f"reach-{copies.state}.json"
    if not kept.exists():
        names = sorted(str(path.relative_to(ROOT)) for test in tests
                       for path in [ROOT / test, *(ROOT / test).rglob("test_*.py")]
                       if path.is_file() and path.name not in _LEFT_OUT)

        def measure(name: str) -> tuple[str, Reach]:
            with copies.one() as copy:
                found = _measure(copy, name)
            say(f"{name}: {found['seconds']:.0f} s")
            return name, found

        with ThreadPoolExecutor(jobs) as pool:
            kept.write_text(json.dumps(dict(pool.map(measure, names))))
    found: dict[str, Reach] = json.loads(kept.read_text())
    return found


def _measure(copy: Path, name: str) -> Reach:
    start = time.monotonic()
    done = in_copy(copy, ["-m", "coverage", "run", "--source=hmcvt_core", *_PYTEST, name])
    seconds = time.monotonic() - start
    if done.returncode != 0:
        raise RuntimeError(f"{name} fails without any mutant:\n{done.stdout[-2000:]}{done.stderr}")
    report = copy / "coverage.json"
    in_copy(copy, ["-m", "coverage", "json", "-q", "-o", str(report)])
    files = json.loads(report.read_text())["files"] if report.exists() else {}
    return {"seconds": seconds,
            "lines": {path: found["executed_lines"] for path, found in files.items()}}


def changes(copy: Path, reference: Path, limit: float) -> bool:
    """Tell whether the copy gives another answer than the reference, or none."""
    try:
        done = in_copy(copy, ["-m", "studies.mutants.probe", str(reference)], limit)
    except subprocess.TimeoutExpired:
        return True
    return done.returncode != 0 or bool(done.stdout.strip())


def trial(
    copy: Path, mutation: Mutation, reach: dict[str, Reach], reference: Path, probe_seconds: float
) -> dict[str, Any]:
    """Try one mutant: the probe first; what changes an answer, on the quickest test files first."""
    path = copy / mutation.path
    source = path.read_bytes()
    path.write_bytes(mutation.apply(source))
    try:
        start, tests, killer, outcome = time.monotonic(), [], None, NO_EFFECT
        if changes(copy, reference, 60.0 + 10.0 * probe_seconds):
            own = set(range(mutation.lines[0], mutation.lines[1] + 1))
            tests = sorted((name for name, each in reach.items()
                            if not own.isdisjoint(each["lines"].get(mutation.path, ()))),
                           key=lambda name: reach[name]["seconds"])
            limit = 30.0 + 4.0 * sum(reach[name]["seconds"] for name in tests)
            killer = _killer(copy, tests, limit)
            outcome = SURVIVED if killer is None else KILLED
        diff = difflib.unified_diff(
            source.decode().splitlines(), mutation.apply(source).decode().splitlines(),
            mutation.path, mutation.path, lineterm="", n=1)
        return {"key": mutation.key, "outcome": outcome, "killer": killer, "tests": len(tests),
                "seconds": round(time.monotonic() - start, 1), "diff": "\n".join(diff)}
    finally:
        path.write_bytes(source)


def _killer(copy: Path, tests: Sequence[str], limit: float) -> str | None:
    """The test that notices, `timeout`, or None."""
    if not tests:
        return None
    try:
        done = in_copy(copy, [*_PYTEST, "-rfE", *tests], limit)
    except subprocess.TimeoutExpired:
        return "timeout"
    if done.returncode == 0:
        return None
    told = [line.partition(" ")[2].partition(" - ")[0] for line in done.stdout.splitlines()
            if line.startswith(("FAILED ", "ERROR "))]
    return told[0] if told else "the tests do not start"
