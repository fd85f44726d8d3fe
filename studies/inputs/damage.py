# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`python -m studies.inputs.damage --count 1000 --seed 1`: read damaged files of every kind."""

from __future__ import annotations

import argparse
import contextlib
import io
import signal
import tempfile
import traceback
from pathlib import Path
from typing import Any

import numpy as np

from hmcvt_core import load_engine
from hmcvt_core.errors import InputError
from hmcvt_tools.cli import main
from hmcvt_tools.mission import read_cycle
from hmcvt_tools.mission.vehicle import load_vehicle
from studies.recordings.files import random_recording
from studies.tables.truth import random_table

from .cycles import random_cycle
from .engines import random_engine
from .vehicles import random_vehicle

LONGEST = 20
"""A file of a few hundred kB that is not read after this time hangs [s]."""
READERS: dict[str, Any] = {
    "cycle": (random_cycle, read_cycle),
    "engine": (random_engine, load_engine),
    "vehicle": (random_vehicle, load_vehicle),
}
KINDS = ("recording", "recording", "recording", "table", *READERS)


def damaged(rng: np.random.Generator, content: bytes) -> bytes:
    """Return the content of a file with one kind of damage."""
    size = len(content)
    place = int(rng.integers(size))
    kind = int(rng.integers(7))
    if kind == 0:
        return content[:place]
    if kind == 1:
        changed = bytearray(content)
        for bit in rng.integers(8 * size, size=int(rng.integers(1, 20))).tolist():
            changed[bit // 8] ^= 1 << (bit % 8)
        return bytes(changed)
    if kind == 2:
        lost = int(rng.integers(1, max(size // 4, 2)))
        return content[:place] + content[place + lost :]
    if kind == 3:
        return content[:place] + rng.bytes(int(rng.integers(1, 200))) + content[place:]
    if kind == 4:
        return content[:place] + b"\0" * int(rng.integers(1, 400)) + content[place:]
    lines = content.split(b"\n")
    line = int(rng.integers(len(lines)))
    if kind == 5:
        lines[line] = rng.choice(
            np.array([b"", b"NaN,NaN", b"1e999", b"-", b'"', b"\xff\xfe"], dtype=object)
        )
    else:
        lines.insert(line, lines[int(rng.integers(len(lines)))])
    return b"\n".join(lines)


def draw(rng: np.random.Generator, kind: str, folder: Path) -> tuple[Path, list[str]]:
    """Write a file of a kind; return it and the options of its import."""
    if kind == "recording":
        recording = random_recording(rng, folder)
        return recording.path, list(recording.options)
    if kind == "table":
        path = folder / "table.csv"
        random_table(rng).write(path)
        return path, []
    return READERS[kind][0](rng, folder).path, []


def read(kind: str, path: Path, options: list[str]) -> str:
    """Read a file; return what a user may not see: a traceback, or the word that it hangs."""
    signal.alarm(LONGEST)
    quiet = io.StringIO()
    try:
        with contextlib.redirect_stdout(quiet), contextlib.redirect_stderr(quiet):
            if kind in READERS:
                READERS[kind][1](path)
            else:
                out = path.parent / "out.csv"
                main(["import", str(path), "--out", str(out), "--yes", *options])
    except InputError:
        return ""
    except SystemExit as stopped:
        return "" if stopped.code in (0, 2, None) else f"exit code {stopped.code}"
    except Exception:  # what a user would see as a traceback
        return traceback.format_exc(limit=-4)
    finally:
        signal.alarm(0)
    return ""


def _hangs(*_: object) -> None:
    raise TimeoutError(f"hangs for {LONGEST} s")


def run(count: int, seed: int, show: int) -> int:
    """Read damaged files; return how many ended in a traceback or hung.

    Args:
        count: of files.
        seed: of the first one; file i is drawn by seed and i.
        show: of them that are printed.
    """
    signal.signal(signal.SIGALRM, _hangs)
    wrong = 0
    for index in range(count):
        rng = np.random.default_rng([seed, index])
        kind = KINDS[index % len(KINDS)]
        with tempfile.TemporaryDirectory() as name:
            path, options = draw(rng, kind, Path(name))
            path.write_bytes(damaged(rng, path.read_bytes()))
            trouble = read(kind, path, options)
        if trouble:
            wrong += 1
            if wrong <= show:
                print(f"WRONG {index}: {path.name}: {trouble}")
    print(f"{count} damaged files, seed {seed}: {wrong} with a traceback or a hang")
    return wrong


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m studies.inputs.damage")
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--show", type=int, default=5)
    given = parser.parse_args()
    raise SystemExit(1 if run(given.count, given.seed, given.show) else 0)
