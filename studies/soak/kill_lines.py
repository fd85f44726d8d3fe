# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A kill before every single line of the code that writes files.

Random moments rarely meet the short ones, such as that between two renames; this meets them all.
What a kill leaves depends on the files alone, so a short trial takes the lines before which they
have changed.
"""

import functools
import itertools
import os
import shutil
import signal
import sys
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np

import hmcvt_core as hmcvt
from hmcvt_core.files import atomic
from hmcvt_core.model import parameter_file
from hmcvt_ros import bench_log, model_store, state_folder
from hmcvt_ros.bench_log import BenchLog, rows_of
from hmcvt_ros.model_store import ModelStore
from hmcvt_ros.state_folder import StateFolder

_FILES = {module.__file__ for module in (atomic, bench_log, model_store, state_folder)}
_SAVE = parameter_file.save_model.__code__  # the rest of that module touches no file

BASE = hmcvt.data_path("params/paper.yaml")
_LIMIT = 1_000_000
_TORN = b"3.0,0.1,100"


def sample(number: int) -> hmcvt.BenchSamples:
    """Return a bench sample that tells its number twice."""
    return hmcvt.BenchSamples(
        stamp=np.array([float(number)]),
        engine_speed=np.array([100.0 + number % 1000 / 7.0]),
        displacement_ratio=np.array([0.1]),
        load_torque=np.array([200.0]),
        efficiency=np.array([0.8]),
        output_speed=np.array([90.0]),
    )


def model(number: int) -> hmcvt.EfficiencyModel:
    """Return a model that tells its number by its leakage."""
    base = _base()
    return replace(
        base, parameters=replace(base.parameters, leakage=1e-12 * (1 + number))
    )


@functools.cache
def _base() -> hmcvt.EfficiencyModel:
    return hmcvt.load_model(BASE)


def leftovers(folder: Path) -> int:
    """Count the temporary files below a folder."""
    return sum(path.name.endswith(".tmp") for path in folder.rglob(".*"))


def standing(folder: Path) -> tuple[object, ...]:
    """Return what a start finds in a folder: samples, what was damaged, models, the one in service.

    Raises:
        InputError: a file is not what it must be.
    """
    log, store = _log(folder), ModelStore(BASE, folder)
    logged = sorted(
        _logged(folder / "log.csv")
        + [
            number
            for path in folder.glob("log.cleared-*.csv")
            for number in _logged(path)
        ]
    )
    damaged = [
        path.read_bytes().endswith(_TORN) for path in folder.glob("log.damaged-*.csv")
    ]
    saved = {
        path.name: _number(hmcvt.load_model(path))
        for path in folder.glob("model.*yaml")
    }
    for path in folder.glob("models/*.yaml"):
        hmcvt.load_model(path)
    return (
        logged,
        len(log),
        bool(log.recovered),
        any(damaged),
        saved.get("model.yaml"),
        set(saved.values()),
        store.complaint,
        _number(store.in_service.model),
    )


def _logged(path: Path) -> list[int]:
    """Return the numbers of the samples in a log, in order; an empty log has none."""
    if not path.exists() or path.read_bytes().count(b"\n") < 2:
        return []
    read = hmcvt.read_bench(path)
    assert read.stamp is not None
    sent = 100.0 + read.stamp % 1000 / 7.0
    if not np.allclose(read.engine_speed, sent, rtol=1e-13, atol=0.0):
        raise hmcvt.InputError(f"{path}: samples are not as they were sent")
    return list(map(int, read.stamp))


def _number(found: hmcvt.EfficiencyModel) -> int:
    return round(found.parameters.leakage / 1e-12) - 1


# --- operations: what is there before, and what is done ---------------------------------------


def _log(folder: Path) -> BenchLog:
    return BenchLog(folder / "log.csv", _LIMIT)


def _write(folder: Path, *samples: int) -> None:
    for number in samples:
        _log(folder).write(rows_of(sample(number)))


def _write_and_tear(folder: Path) -> None:
    _write(folder, 0, 1, 2)
    with (folder / "log.csv").open("ab") as file:
        file.write(_TORN)


def _save(folder: Path, number: int) -> None:
    hmcvt.save_model(model(number), folder / "model.yaml")


def _refit(folder: Path, *models: int) -> None:
    store = ModelStore(BASE, folder)
    for number in models:
        path = store.new_path()
        hmcvt.save_model(model(number), path)
        store.adopt(path)


Act = Callable[[Path], Any]
STEPS: dict[str, tuple[Act, Act]] = {
    "first sample": (lambda _: None, lambda folder: _write(folder, 0)),
    "another sample": (
        lambda folder: _write(folder, 0, 1, 2),
        lambda folder: _write(folder, 3),
    ),
    "repair of a torn log": (_write_and_tear, _log),
    "log kept under another name": (
        lambda folder: _write(folder, 0, 1, 2),
        lambda folder: _log(folder).set_aside(),
    ),
    "parameter file saved": (lambda _: None, lambda folder: _save(folder, 0)),
    "saved over another": (
        lambda folder: _save(folder, 0),
        lambda folder: _save(folder, 1),
    ),
    "refit adopted": (
        lambda folder: _refit(folder, 0),
        lambda folder: _refit(folder, 1),
    ),
    "refit reverted": (
        lambda folder: _refit(folder, 0, 1),
        lambda folder: ModelStore(BASE, folder).revert(),
    ),
}


def kill_everywhere(
    name: str, folder: Path, changes_only: bool = False
) -> tuple[int, list[str]]:
    """Kill a step before each of its lines; return the count of kills, and what went wrong.

    Wherever it was cut off, there must stand what stood before it or what stands after it.

    Args:
        name: step of `STEPS`.
        folder: new folder to work in.
        changes_only: kill only before the first line and before those lines before which the files
            have changed since the line before.
    """
    template = folder / "before"
    done = folder / "after"
    prepare, act = STEPS[name]
    template.mkdir(parents=True)
    prepare(template)
    act(shutil.copytree(template, done))
    allowed = standing(shutil.copytree(template, folder / "copy")), standing(done)
    lines: Iterable[int] = itertools.count(1)
    if changes_only:
        lines = _lines_with_changes(act, shutil.copytree(template, folder / "traced"))
    problems = list[str]()
    kills = 0
    for line in lines:
        left = shutil.copytree(template, folder / str(line))
        if not _killed_at(line, act, left):
            break
        kills += 1
        try:
            found = standing(left)
            StateFolder(left).close()
            if leftovers(left):
                problems.append(
                    f"{name}, line {line}: {leftovers(left)} temporary files stay"
                )
            act(left)  # it goes on
        except (ValueError, OSError) as error:
            problems.append(f"{name}, line {line}: {error}")
        else:
            if found not in allowed:
                problems.append(
                    f"{name}, line {line}: {found}, not one of {allowed}: {left}"
                )
        if not problems:
            shutil.rmtree(left)
    return kills, problems


def _lines_with_changes(act: Callable[[Path], Any], folder: Path) -> list[int]:
    """Return the numbers of the lines of a step before which the files of a folder have changed."""
    files = _files(folder)
    line = 0
    lines = [1]

    def note() -> None:
        nonlocal files, line
        line += 1
        now = _files(folder)
        if now != files:
            files = now
            lines.append(line)

    sys.settrace(_tracer(note))
    try:
        act(folder)
    finally:
        sys.settrace(None)
    return lines


def _files(folder: Path) -> dict[Path, bytes | None]:
    """Return the content of all files below a folder; None for a folder."""
    return {
        path: path.read_bytes() if path.is_file() else None
        for path in folder.rglob("*")
    }


def _killed_at(line: int, act: Callable[[Path], Any], folder: Path) -> bool:
    """Run a step up to a line; False when it has fewer."""
    child = os.fork()
    if child == 0:
        status = 1
        left = line

        def kill() -> None:
            nonlocal left
            left -= 1
            if left == 0:
                os.kill(os.getpid(), signal.SIGKILL)

        try:
            sys.settrace(_tracer(kill))
            act(folder)
            status = 0
        finally:
            os._exit(status)
    _, status = os.waitpid(child, 0)
    if status != 0 and not os.WIFSIGNALED(status):
        raise hmcvt.HmcvtError(f"the step failed before line {line}")
    return os.WIFSIGNALED(status)


def _tracer(before_line: Callable[[], None]) -> Any:
    """Return a trace function that calls another before each line of the code that writes."""

    def within(frame: FrameType, event: str, _: Any) -> Any:
        if event == "line":
            before_line()
        return within

    def entered(frame: FrameType, event: str, _: Any) -> Any:
        code = frame.f_code
        return within if code.co_filename in _FILES or code is _SAVE else None

    return entered
