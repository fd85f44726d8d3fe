# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Random edits of the bench log, as a person, a spreadsheet or a restore makes them.

    python -m studies.soak.edit_log [EDITS] [ROWS]

Each round makes some edits of a log and lets the node's reader repair it. The sound rows must stay,
each once and in order, and the message must name the rest.
"""

import re
import resource
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.random import Generator

import hmcvt_core as hmcvt
from hmcvt_ros.bench_log import BenchLog, rows_of

from .kill_lines import sample

Lines = list[bytes]
EDITS_AT_ONCE = 20
"""Edits between two repairs."""


def damage(lines: Lines, rng: Generator) -> None:
    """Make one edit: delete, double, swap, cut, change, sort or save anew."""
    at = int(rng.integers(1, len(lines)))
    other = int(rng.integers(1, len(lines)))
    kind = rng.integers(9)
    if kind == 0:
        del lines[at]
    elif kind == 1:
        lines.insert(at, lines[other])
    elif kind == 2:
        lines[at], lines[other] = lines[other], lines[at]
    elif kind == 3:
        lines[at] = lines[at][: int(rng.integers(len(lines[at]) + 1))]
    elif kind == 4:
        cells = lines[at].split(b",")
        cells[int(rng.integers(len(cells)))] += b"e1"
        lines[at] = b",".join(cells)
    elif kind == 5:
        lines.sort(reverse=bool(rng.integers(2)))
    elif kind == 6:
        lines[at] = lines[at] + b"\r"
    elif kind == 7:
        count = min(50, len(lines) - at)
        lines.extend(lines[at : at + count])
    else:
        lines[at] = b'"' + lines[at].replace(b",", b'","') + b'"'


def edited(path: Path, rng: Generator, edits: int) -> Iterator[str]:
    """Edit a log, repair it, and yield what went wrong.

    Args:
        path: log without damage, of samples of `kill_lines`.
        rng: source of the edits.
        edits: count of edits.
    """
    whole = path.read_bytes().splitlines()
    lines = list(whole)
    for _ in range(edits):
        damage(lines, rng)
    path.write_bytes(b"\n".join(lines) + b"\n")
    sound = {line.strip(b"\r").replace(b'"', b"") for line in lines} & set(whole[1:])
    log = BenchLog(path, len(whole))
    kept = path.read_bytes().splitlines()[1:]
    expected = [line for line in whole[1:] if line in sound]
    if kept != expected or len(log) != len(expected):
        yield f"{len(kept)} rows stay, {len(expected)} are sound"
    numbers = [int(line.split(b",")[0]) for line in whole[1:]]
    last = max((int(line.split(b",")[0]) for line in expected), default=0)
    gone = {number for number in numbers if number < last}
    gone -= {int(line.split(b",")[0]) for line in expected}
    if gone - _named(log.recovered):
        yield f"samples {gone} are gone, and it says: {log.recovered}"


def _named(text: str) -> set[int]:
    """Return the numbers of samples that a message names; all where it counts some."""
    _, _, words = text.partition("gone are samples number ")
    if " more" in words:
        return set(range(1_000_000))
    named = set[int]()
    for first, last in re.findall(r"(\d+)(?: to (\d+))?", words):
        named.update(range(int(first), int(last or first) + 1))
    return named


def trial(path: Path, rows: int, edits: int, seed: int) -> tuple[float, list[str]]:
    """Edit a log again and again; return the longest repair [s], and what went wrong.

    Args:
        path: file of the log.
        rows: samples in it.
        edits: edits in all.
        seed: seed of the edits.
    """
    rng = np.random.default_rng(seed)
    log = BenchLog(path, rows)
    log.write([row for number in range(rows) for row in rows_of(sample(number))])
    whole = path.read_bytes()
    longest = 0.0
    problems = []
    for _ in range(edits // EDITS_AT_ONCE):
        path.write_bytes(whole)
        start = time.perf_counter()
        problems += edited(path, rng, EDITS_AT_ONCE)
        longest = max(longest, time.perf_counter() - start)
        for kept in path.parent.glob("*.damaged-*"):
            kept.unlink()
    hmcvt.read_bench(path)
    return longest, problems


def main() -> int:
    """Run a trial; the exit code is 1 when something went wrong."""
    numbers = [int(text) for text in sys.argv[1:]]
    edits, rows = (*numbers, *(10_000, 10_000)[len(numbers) :])
    with tempfile.TemporaryDirectory() as folder:
        seconds, problems = trial(Path(folder) / "log.csv", rows, edits, seed=0)
    for problem in problems:
        print(problem)
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    print(
        f"{edits} edits of {rows} rows: longest repair {seconds:.2f} s, "
        f"at most {memory:.0f} MiB, {len(problems)} problems"
    )
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
