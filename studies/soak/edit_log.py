# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Random edits of the bench log, as a person, a spreadsheet or a restore makes them.

    python -m studies.soak.edit_log [--edits N] [--rows N] [--seconds S]

Each round makes some edits of a log and lets the node's reader repair it. The sound rows must stay,
each once and in order, and every lost one must be named.
"""

import json
import resource
import sys
import tempfile
import time
import tracemalloc
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import click
import numpy as np
from numpy.random import Generator

import hmcvt_core as hmcvt
from hmcvt_ros.bench_log import BenchLog, rows_of

from .kill_lines import sample

Lines = list[bytes]
EDITS_AT_ONCE = 20
"""Most edits between two repairs."""
MAX_SECONDS = 2.0
MAX_BYTES = 200e6
"""Bounds of a repair."""


class Result(NamedTuple):
    """What a trial measured.

    Attributes:
        edits: count of edits.
        repairs: count of repairs.
        longest: longest repair, with its check, in processor time [s].
        peak: most memory of a repair [bytes]; 0 where it was not traced.
        problems: what went wrong.
    """

    edits: int
    repairs: int
    longest: float
    peak: float
    problems: list[str]


# --- edits ----------------------------------------------------------------------------------------


def _delete(lines: Lines, at: int, other: int, rng: Generator) -> None:
    del lines[at]


def _delete_block(lines: Lines, at: int, other: int, rng: Generator) -> None:
    del lines[at : at + 1 + int(rng.integers(1 + len(lines) // 10))]


def _double(lines: Lines, at: int, other: int, rng: Generator) -> None:
    lines.insert(at, lines[other])


def _double_block(lines: Lines, at: int, other: int, rng: Generator) -> None:
    lines.extend(lines[at : at + 50])


def _swap(lines: Lines, at: int, other: int, rng: Generator) -> None:
    lines[at], lines[other] = lines[other], lines[at]


def _cut(lines: Lines, at: int, other: int, rng: Generator) -> None:
    lines[at] = lines[at][: int(rng.integers(len(lines[at]) + 1))]


def _cut_end(lines: Lines, at: int, other: int, rng: Generator) -> None:
    del lines[max(1, len(lines) - 1 - int(rng.integers(1 + len(lines) // 20))) :]


def _change(lines: Lines, at: int, other: int, rng: Generator) -> None:
    cells = lines[at].split(b",")
    cells[int(rng.integers(len(cells)))] += b"e1"
    lines[at] = b",".join(cells)


def _mix(lines: Lines, at: int, other: int, rng: Generator) -> None:
    """Put a cell of one row into another."""
    cells, others = lines[at].split(b","), lines[other].split(b",")
    column = int(rng.integers(min(len(cells), len(others))))
    cells[column] = others[column]
    lines[at] = b",".join(cells)


def _sort(lines: Lines, at: int, other: int, rng: Generator) -> None:
    lines.sort(reverse=bool(rng.integers(2)))


def _end_line(lines: Lines, at: int, other: int, rng: Generator) -> None:
    lines[at] += b"\r"


def _quote(lines: Lines, at: int, other: int, rng: Generator) -> None:
    lines[at] = b'"' + lines[at].replace(b",", b'","') + b'"'


def _comment(lines: Lines, at: int, other: int, rng: Generator) -> None:
    lines.insert(at, rng.choice([b"", b"# checked", b",,,,", b"\xff\x00;;"]))


def _resave(lines: Lines, at: int, other: int, rng: Generator) -> None:
    """Save all as a spreadsheet does: 15 digits, its own mark, quotes and ends of lines."""
    mark = rng.choice([b",", b";", b"\t"])
    end = rng.choice([b"", b"\r"])
    for number, line in enumerate(lines):
        cells = [_saved(cell) for cell in line.replace(b'"', b"").split(b",")]
        text = mark.join(cells)
        if mark != b",":
            text = text.replace(b".", b",")
        lines[number] = text.rstrip(b"\r") + end


def _saved(cell: bytes) -> bytes:
    try:
        return f"{float(cell):.15g}".encode()
    except ValueError:
        return cell


EDITS = (
    _delete,
    _delete_block,
    _double,
    _double_block,
    _swap,
    _cut,
    _cut_end,
    _change,
    _mix,
    _sort,
    _end_line,
    _quote,
    _comment,
)
"""Edits of lines. `_resave` comes last, because the other edits split at commas."""


def damage(lines: Lines, rng: Generator) -> None:
    """Make one edit of the lines of a log."""
    if len(lines) == 1:
        return
    at = int(rng.integers(1, len(lines)))
    other = int(rng.integers(1, len(lines)))
    EDITS[int(rng.integers(len(EDITS)))](lines, at, other, rng)


# --- trial ----------------------------------------------------------------------------------------


def edited(path: Path, rng: Generator, edits: int) -> Iterator[str]:
    """Edit a log, repair it, and yield what went wrong.

    Args:
        path: log without damage, of samples of `kill_lines`, whose end has been noted.
        rng: source of the edits.
        edits: count of edits.
    """
    whole = path.read_bytes().splitlines()
    BenchLog(path, len(whole))  # notes the last number
    lines = list(whole)
    for _ in range(edits):
        damage(lines, rng)
    sound = {line.strip(b"\r").replace(b'"', b"") for line in lines} & set(whole[1:])
    if rng.integers(4) == 0:
        _resave(lines, 0, 0, rng)
    raw = b"\n".join(lines) + b"\n"
    path.write_bytes(raw)
    log = BenchLog(path, len(whole))
    kept = path.read_bytes().splitlines()[1:]
    expected = [line for line in whole[1:] if line in sound]
    if kept != expected or len(log) != len(expected):
        yield f"{len(kept)} rows stay, {len(expected)} are sound"
    gone = {_number(line) for line in whole[1:]} - {_number(line) for line in expected}
    named = _named(path.with_suffix(".json"))
    if gone != named or bool(gone) != ("gone are samples number" in log.recovered):
        yield f"gone are {gone}, named are {named}, and it says: {log.recovered}"
    copies = list(path.parent.glob("*.damaged-*"))
    if ("damaged lines" in log.recovered) != bool(copies):
        yield f"{len(copies)} copies are kept, and it says: {log.recovered}"
    for copy in copies:
        if copy.read_bytes() != raw:
            yield f"{copy.name} is not the file as it was"
        copy.unlink()


def _number(line: bytes) -> int:
    return int(line.split(b",")[0])


def _named(path: Path) -> set[int]:
    """Return the numbers of the samples that are gone, by the file beside the log."""
    named = set[int]()
    for run in filter(None, json.loads(path.read_text())["gone"].split(", ")):
        first, _, last = run.partition(" to ")
        named.update(range(int(first), int(last or first) + 1))
    return named


def trial(
    path: Path,
    rows: int,
    edits: int,
    seed: int,
    seconds: float = float("inf"),
    traced: bool = False,
) -> Result:
    """Edit a log again and again, and let it be repaired.

    Args:
        path: file of the log.
        rows: samples in it.
        edits: edits in all.
        seed: seed of the edits.
        seconds: time after which no more edits are made [s].
        traced: whether the memory is measured, which takes time.
    """
    rng = np.random.default_rng(seed)
    log = BenchLog(path, rows)
    log.write([row for number in range(rows) for row in rows_of(sample(number))])
    whole = path.read_bytes()
    longest = 0.0
    peak = 0.0
    made = 0
    repairs = 0
    problems: list[str] = []
    begin = time.perf_counter()
    while made < edits and time.perf_counter() - begin < seconds:
        path.write_bytes(whole)
        count = min(int(rng.integers(1, EDITS_AT_ONCE + 1)), edits - made)
        if traced:
            tracemalloc.start()
        start = (
            time.process_time()
        )  # of this process, whatever the machine does besides
        problems += edited(path, rng, count)
        longest = max(longest, time.process_time() - start)
        if traced:
            peak = max(peak, tracemalloc.get_traced_memory()[1])
            tracemalloc.stop()
        made += count
        repairs += 1
    hmcvt.read_bench(path)
    return Result(made, repairs, longest, peak, problems)


@click.command("edit_log")
@click.option("--edits", type=click.IntRange(1), default=10_000, show_default=True)
@click.option("--rows", type=click.IntRange(1), default=10_000, show_default=True)
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True)
@click.option(
    "--seconds", type=float, default=float("inf"), help="Make no more edits after it."
)
def command(edits: int, rows: int, seed: int, seconds: float) -> None:
    """Edit a bench log at random and check its repair."""
    with tempfile.TemporaryDirectory() as folder:
        result = trial(Path(folder) / "log.csv", rows, edits, seed, seconds)
    for problem in result.problems:
        click.echo(problem[:1000])
    memory = 1024.0 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    click.echo(
        f"{result.edits} edits of {rows} rows, {result.repairs} repairs: "
        f"longest {result.longest:.2f} s of processor time with its check, "
        f"at most {memory / 1e6:.0f} MB in all, {len(result.problems)} problems"
    )
    too_much = memory > MAX_BYTES or result.longest > MAX_SECONDS
    sys.exit(bool(result.problems or too_much))


if __name__ == "__main__":
    command()
