# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Copies of the project in which mutants live, and the trial of one mutant."""

import difflib
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
# What judges the source text or the speed of the machine, not answers; what needs tables of makers.
_LEFT_OUT = ("test_house_rules.py", "test_speed.py", "test_layers.py", "test_real.py")
_ONE_THREAD = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "PYTHONDONTWRITEBYTECODE": "1",
}
_PYTEST = (
    "-m",
    "pytest",
    "-x",
    "-q",
    "-p",
    "no:cacheprovider",
    "--no-header",
    "--tb=no",
)
Reach = dict[str, Any]
"""Of one test file: `seconds` that it takes, and `lines` of each source that it runs."""


class Copies:
    """As many copies of the project, uncommitted edits among it, as trials run side by side.

    Attributes:
        state: twelve digits of what is in them: results of another state do not count.
    """

    def __init__(self, folder: Path, count: int) -> None:
        commit = _git("stash", "create") or "HEAD"
        self.state = _git("rev-parse", "--short=12", f"{commit}^{{tree}}")
        self._free: SimpleQueue[Path] = SimpleQueue()
        whole = folder / "project.tar"
        _git("archive", f"--output={whole}", commit)
        for number in range(count):
            copy = folder / f"copy-{number}"
            shutil.rmtree(copy, ignore_errors=True)
            shutil.unpack_archive(whole, copy)
            self._free.put(copy)

    @contextmanager
    def one(self) -> Iterator[Path]:
        copy = self._free.get()
        try:
            yield copy
        finally:
            self._free.put(copy)


def _git(*arguments: str) -> str:
    return subprocess.run(
        ["git", *arguments], cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True
    ).stdout.strip()


def in_copy(
    copy: Path, arguments: Sequence[str], limit: float | None = None
) -> subprocess.CompletedProcess[str]:
    """Run Python there on the copy's own modules; after `limit` seconds it has failed."""
    environment = {**os.environ, **_ONE_THREAD, "PYTHONPATH": str(copy)}
    command = [sys.executable, *arguments]
    try:
        return subprocess.run(
            command,
            cwd=copy,
            env=environment,
            timeout=limit,
            capture_output=True,
            text=True,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return subprocess.CompletedProcess(command, -1, "", f"no end after {limit} s")


def reaches(
    copies: Copies,
    folder: Path,
    tests: Sequence[str],
    jobs: int,
    say: Callable[[str], None],
) -> dict[str, Reach]:
    """Run every test file once and note what it reaches; kept in `folder`.

    Raises:
        RuntimeError: a test fails without any mutant.
    """
    kept = folder / f"reach-{copies.state}.json"
    if not kept.exists():
        names = sorted(
            str(path.relative_to(ROOT))
            for test in tests
            for path in [ROOT / test, *(ROOT / test).rglob("test_*.py")]
            if path.is_file() and path.name not in _LEFT_OUT
        )

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
    done = in_copy(
        copy, ["-m", "coverage", "run", "--source=hmcvt_core", *_PYTEST, name]
    )
    seconds = time.monotonic() - start
    if done.returncode != 0:
        raise RuntimeError(
            f"{name} fails without any mutant:\n{done.stdout[-2000:]}{done.stderr}"
        )
    told = in_copy(copy, ["-m", "coverage", "json", "-q", "-o", "-"]).stdout
    files = json.loads(told)["files"] if told.startswith("{") else {}
    return {
        "seconds": seconds,
        "lines": {path: found["executed_lines"] for path, found in files.items()},
    }


def trial(
    copy: Path,
    mutation: Mutation,
    reach: dict[str, Reach],
    reference: Path,
    probe_seconds: float,
) -> dict[str, Any]:
    """Try one mutant: the probe first; what changes an answer, on the quickest test files first."""
    path, own = (
        copy / mutation.path,
        set(range(mutation.lines[0], mutation.lines[1] + 1)),
    )
    source = path.read_bytes()
    wrong = mutation.apply(source)
    path.write_bytes(wrong)
    try:
        probe = in_copy(
            copy,
            ["-m", "studies.mutants.probe", str(reference)],
            60.0 + 10.0 * probe_seconds,
        )
        outcome, tests = NO_EFFECT, []
        if probe.returncode != 0 or probe.stdout.strip():
            tests = sorted(
                (
                    name
                    for name, each in reach.items()
                    if not own.isdisjoint(each["lines"].get(mutation.path, ()))
                ),
                key=lambda name: reach[name]["seconds"],
            )
            limit = 30.0 + 4.0 * sum(reach[name]["seconds"] for name in tests)
            noticed = tests and in_copy(copy, [*_PYTEST, *tests], limit).returncode != 0
            outcome = KILLED if noticed else SURVIVED
    finally:
        path.write_bytes(source)
    diff = difflib.unified_diff(
        source.decode().splitlines(),
        wrong.decode().splitlines(),
        mutation.path,
        mutation.path,
        lineterm="",
        n=1,
    )
    return {
        "key": mutation.key,
        "outcome": outcome,
        "tests": len(tests),
        "diff": "\n".join(diff),
    }
