# SPDX-License-Identifier: Apache-2.0
"""Processes that log, save and adopt as fast as they can, killed at random moments.

Each tells over a pipe what it begins and, once the call has returned, what is done: from then on
that must be there, whenever the kill comes.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

import hmcvt_core as hmcvt
from hmcvt_ros.bench_log import BenchLog
from hmcvt_ros.model_store import ModelStore
from hmcvt_ros.state_folder import StateFolder

BASE = hmcvt.data_path("params/paper.yaml")
LIMIT = 1_000_000
_LONGEST = 0.08  # seconds from the first sign of life to the kill
_PER_LOG = 25  # samples before a log is set aside

Tell = Callable[..., None]


@dataclass(frozen=True)
class Outcome:
    """What a kill left.

    Attributes:
        acknowledged: operations that had been acknowledged since the start of the process.
        midway: whether one was under way.
        leftovers: temporary files found.
        problems: broken promises.
    """

    acknowledged: int
    midway: bool
    leftovers: int
    problems: tuple[str, ...]


def sample(number: int) -> hmcvt.BenchSamples:
    """Return a bench sample that tells its number twice."""
    return hmcvt.BenchSamples(
        stamp=np.array([float(number)]), engine_speed=np.array([100.0 + number % 1000 / 7.0]),
        displacement_ratio=np.array([0.1]), load_torque=np.array([200.0]),
        efficiency=np.array([0.8]), output_speed=np.array([90.0]))


def model(number: int) -> hmcvt.EfficiencyModel:
    """Return a model that tells its number by its leakage."""
    base = hmcvt.load_model(BASE)
    return replace(base, parameters=replace(base.parameters, leakage=1e-12 * (1 + number)))


def number_of(found: hmcvt.EfficiencyModel) -> int:
    """Return the number of a model."""
    return round(found.parameters.leakage / 1e-12) - 1


def numbers(logs: Iterable[Path]) -> list[int]:
    """Return the numbers of the samples in logs, in order; an empty log has none.

    Raises:
        InputError: a log is no bench log.
    """
    found: list[int] = []
    for path in logs:
        if path.read_bytes().count(b"\n") > 1:
            read = hmcvt.read_bench(path)
            assert read.stamp is not None
            expected = 100.0 + read.stamp % 1000 / 7.0
            if not np.array_equal(read.engine_speed, expected):
                raise hmcvt.InputError(f"{path}: samples are not as they were sent")
            found += read.stamp.astype(int).tolist()
    return found


def leftovers(folder: Path) -> int:
    """Count the temporary files below a folder."""
    return sum(path.name.endswith(".tmp") for path in folder.rglob(".*"))


# --- what is killed -------------------------------------------------------------------------------


def _append(folder: Path, tell: Tell) -> None:
    tell("open")
    state = StateFolder(folder)
    log = BenchLog(folder / "bench_samples.csv", LIMIT)
    number = len(numbers(_logs(folder)))
    while state.writable:
        tell("begin", number)
        log.append(sample(number))
        tell("done", number)
        number += 1
        if len(log) >= _PER_LOG:
            log.set_aside()


def _save(folder: Path, tell: Tell) -> None:
    folder.mkdir()
    path = folder / "model.yaml"
    for number in range(LIMIT):
        tell("begin", number)
        hmcvt.save_model(model(number), path)
        tell("done", number)


def _adopt(folder: Path, tell: Tell) -> None:
    StateFolder(folder)
    store = ModelStore(BASE, folder)
    stack: list[int] = []
    for number in range(LIMIT):
        # Two steps forward, one back.
        expected = [*stack, number] if number % 3 < 2 else stack[:-1]
        tell("begin", expected[-1])
        if len(expected) > len(stack):
            path = store.new_path()
            hmcvt.save_model(model(number), path)
            store.adopt(path)
        else:
            store.revert()
        stack = expected
        tell("done", stack[-1])


# --- what must be left ----------------------------------------------------------------------------


def log_trial(folder: Path, rng: np.random.Generator) -> Outcome:
    """Kill a process that logs; the next trial goes on in what this one left.

    Before every other start the log gets what a power cut in the middle of a sample leaves, which
    a kill cannot: its rows are written by one call.
    """
    path = folder / "bench_samples.csv"
    if path.exists() and rng.random() < 0.5:
        row = f"{len(numbers(_logs(folder)))}.0,0.1,100.0,200.0,0.8,90.0".encode()
        with path.open("ab") as file:
            file.write(row[:rng.integers(1, len(row))] if rng.random() < 0.7 else b"\0" * 40)
    told = _killed(_append, folder, rng)
    left = leftovers(folder)
    StateFolder(folder).close()
    BenchLog(path, LIMIT)  # repairs what was torn by hand, if the kill came first
    found = numbers(_logs(folder))
    problems = []
    if found != list(range(len(found))):
        problems.append(f"{folder}: samples lost or doubled: {found}")
    if found and told.begun is not None and not told.done <= found[-1] <= told.begun:
        problems.append(f"{folder}: last sample {found[-1]}, acknowledged {told.done}")
    return _outcome(folder, told, left, problems)


def save_trial(folder: Path, rng: np.random.Generator) -> Outcome:
    """Kill a process that saves one model after the other to one file."""
    told = _killed(_save, folder, rng)
    path, left, problems = folder / "model.yaml", leftovers(folder), []
    last = number_of(hmcvt.load_model(path)) if path.exists() else -1
    if last not in (told.done, told.begun):
        problems.append(f"{path}: model {last}, acknowledged {told.done}")
    kept = {number_of(hmcvt.load_model(name)) for name in folder.glob("model.previous-*.yaml")}
    if not set(range(last)) <= kept:
        problems.append(f"{folder}: previous versions {sorted(kept)}, needs all up to {last - 1}")
    return _outcome(None, told, left, problems)


def adopt_trial(folder: Path, rng: np.random.Generator) -> Outcome:
    """Kill a process that adopts and reverts models."""
    told = _killed(_adopt, folder, rng)
    left, problems = leftovers(folder), []
    StateFolder(folder).close()
    store = ModelStore(BASE, folder)
    found = number_of(store.model) if store.path != store.base else -1
    if found not in (told.done, told.begun) or store.complaint:
        problems.append(f"{folder}: model {found} in service, acknowledged {told.done}; "
                        f"{store.complaint}")
    state = folder / "in_service.json"
    for _ in json.loads(state.read_text())["in_service"] if state.exists() else ():
        store.revert()
    for path in folder.glob("models/*.yaml"):
        hmcvt.load_model(path)
    return _outcome(folder, told, left, problems)


TRIALS: dict[str, Callable[[Path, np.random.Generator], Outcome]] = {
    "bench log": log_trial, "parameter file": save_trial, "adopt and revert": adopt_trial}
CHAINED = ("bench log",)
"""Kinds of which all trials share one folder."""


def run(kind: str, folder: Path, rng: np.random.Generator) -> Outcome:
    """Run a trial; a file that cannot be read is a problem, too."""
    try:
        outcome = TRIALS[kind](folder, rng)
    except (ValueError, OSError) as error:
        return Outcome(0, True, 0, (f"{kind}: {error}",))
    if kind not in CHAINED and not outcome.problems:
        shutil.rmtree(folder)
    return outcome


# --- helpers --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Told:
    """What a killed process had told; -1 for nothing done, None for nothing begun."""

    count: int
    done: int
    begun: int | None
    midway: bool


def _killed(work: Callable[[Path, Tell], None], folder: Path, rng: np.random.Generator) -> _Told:
    """Run work in a process of its own and kill it at a random moment."""
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            os.close(reading)
            work(folder, lambda *words: _write(writing, words))
        except BaseException as error:
            _write(writing, ("failed", repr(error)))
        finally:
            os._exit(1)
    os.close(writing)
    with os.fdopen(reading) as pipe:
        lines = [pipe.readline()]
        time.sleep(rng.uniform(0.0, _LONGEST))
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        lines += pipe.readlines()
    words = [line.split(maxsplit=1) for line in lines]
    if words[-1][0] == "failed":
        raise hmcvt.HmcvtError(words[-1][1])
    done = [int(each[1]) for each in words if each[0] == "done"]
    begun = [int(each[1]) for each in words if each[0] == "begin"]
    return _Told(len(done), done[-1] if done else -1, begun[-1] if begun else None,
                 words[-1][0] != "done")


def _write(pipe: int, words: Iterable[Any]) -> None:
    os.write(pipe, (" ".join(map(str, words)) + "\n").encode())


def _logs(folder: Path) -> list[Path]:
    cleared = sorted(folder.glob("bench_samples.cleared-*.csv"),
                     key=lambda path: int(path.stem.rpartition("-")[2]))
    return [*cleared, *folder.glob("bench_samples.csv")]


def _outcome(folder: Path | None, told: _Told, left: int, problems: list[str]) -> Outcome:
    if folder is not None and (more := leftovers(folder)):
        problems.append(f"{folder}: {more} temporary files after a start")
    return Outcome(told.count, told.midway, left, tuple(problems))
