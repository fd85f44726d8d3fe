# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A kill before every single line of the code that writes files.

Random moments rarely meet the short ones, such as that between two renames; this meets them all.
"""

from __future__ import annotations

import os
import shutil
import signal
import sys
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from types import FrameType
from typing import Any, NamedTuple

import numpy as np

import hmcvt_core as hmcvt
from hmcvt_core.files import atomic
from hmcvt_core.model import parameter_file
from hmcvt_ros import bench_log, model_store, state_folder
from hmcvt_ros.bench_log import BenchLog, rows_of
from hmcvt_ros.model_store import ModelStore
from hmcvt_ros.state_folder import StateFolder

_FILES = {module.__file__ for module in (
    atomic, bench_log, model_store, state_folder)}

_SAVE = parameter_file.save_model.__code__  # the rest of that module touches no file

BASE = hmcvt.data_path("params/paper.yaml")
_LIMIT = 1_000_000


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


class Step(NamedTuple):
    """An operation: what is there before, what is done, what must hold wherever it was cut off."""

    before: Callable[[Path], Any]
    act: Callable[[Path], Any]
    holds: Callable[[Path], bool]


def _log(folder: Path) -> BenchLog:
    return BenchLog(folder / "log.csv", _LIMIT)


def _three_samples(folder: Path) -> None:
    for number in range(3):
        _log(folder).write(rows_of(sample(number)))


def _three_and_torn(folder: Path) -> None:
    _three_samples(folder)
    with (folder / "log.csv").open("ab") as file:
        file.write(b"3.0,0.1,100")


def _logged(folder: Path, *counts: int, recovered: bool = False) -> bool:
    log = _log(folder)
    found = numbers(folder.glob("log.csv"))
    return (found == list(range(len(log))) and len(log) in counts
            and (recovered or not log.recovered))


def _repaired(folder: Path) -> bool:
    return (_logged(folder, 3, recovered=True)
            and any(b"\n3.0,0.1,100" in path.read_bytes() for path in folder.glob("*damaged*")))


def _set_aside(folder: Path) -> bool:
    return numbers([*folder.glob("*.cleared-1.csv"), *folder.glob("log.csv")]) == [0, 1, 2]


def _save(folder: Path, number: int) -> None:
    hmcvt.save_model(model(number), folder / "model.yaml")


def _saved(folder: Path, *versions: int) -> bool:
    found = number_of(hmcvt.load_model(folder / "model.yaml"))
    kept = [number_of(hmcvt.load_model(path)) for path in folder.glob("model.previous-*")]
    return found in versions and set(versions) >= {found, *kept} >= set(range(found + 1))


def _refit(folder: Path, number: int) -> None:
    store = ModelStore(BASE, folder)
    path = store.new_path()
    hmcvt.save_model(model(number), path)
    store.adopt(path)


def _in_service(folder: Path, *allowed: int) -> bool:
    store = ModelStore(BASE, folder)
    for path in folder.glob("models/*.yaml"):
        hmcvt.load_model(path)
    return not store.complaint and number_of(store.in_service.model) in allowed


STEPS = {
    "first sample": Step(lambda _: None, lambda folder: _log(folder).write(rows_of(sample(0))),
                         lambda folder: not (folder / "log.csv").exists()
                         or _logged(folder, 0, 1)),
    "another sample": Step(_three_samples, lambda folder: _log(folder).write(rows_of(sample(3))),
                           lambda folder: _logged(folder, 3, 4)),
    "repair of a torn log": Step(_three_and_torn, _log, _repaired),
    "log set aside": Step(_three_samples, lambda folder: _log(folder).set_aside(), _set_aside),
    "parameter file saved": Step(
        lambda _: None, lambda folder: _save(folder, 0),
        lambda folder: not (folder / "model.yaml").exists() or _saved(folder, 0)),
    "saved over another": Step(
        lambda folder: _save(folder, 0), lambda folder: _save(folder, 1),
        lambda folder: _saved(folder, 0, 1)),
    "refit adopted": Step(lambda folder: _refit(folder, 0), lambda folder: _refit(folder, 1),
                          lambda folder: _in_service(folder, 0, 1)),
    "refit reverted": Step(lambda folder: [_refit(folder, number) for number in (0, 1)],
                           lambda folder: ModelStore(BASE, folder).revert(),
                           lambda folder: _in_service(folder, 0, 1)),
}


def kill_everywhere(name: str, folder: Path) -> tuple[int, list[str]]:
    """Kill a step before each of its lines; return how many there are, and what went wrong."""
    step, problems = STEPS[name], []
    template = folder / "before"
    template.mkdir(parents=True)
    step.before(template)
    line = 1
    while _killed_at(line, step.act, shutil.copytree(template, folder / str(line))):
        left = folder / str(line)
        try:
            good = step.holds(left)
            StateFolder(left).close()
            if leftovers(left):
                problems.append(f"{name}, line {line}: {leftovers(left)} temporary files stay")
            step.act(left)  # it goes on
        except (ValueError, OSError) as error:
            problems.append(f"{name}, line {line}: {error}")
        else:
            if not good:
                problems.append(f"{name}, line {line}: not as it must be: {left}")
        if not problems:
            shutil.rmtree(left)
        line += 1
    return line - 1, problems


def _killed_at(line: int, act: Callable[[Path], Any], folder: Path) -> bool:
    """Run a step up to a line; False when it has fewer."""
    child = os.fork()
    if child == 0:
        status = 1
        try:
            sys.settrace(_executioner(line))
            act(folder)
            status = 0
        finally:
            os._exit(status)
    _, status = os.waitpid(child, 0)
    if status != 0 and not os.WIFSIGNALED(status):
        raise hmcvt.HmcvtError(f"the step failed before line {line}")
    return os.WIFSIGNALED(status)


def _executioner(line: int) -> Any:
    left = line

    def within(frame: FrameType, event: str, _: Any) -> Any:
        nonlocal left
        left -= event == "line"
        if left == 0:
            os.kill(os.getpid(), signal.SIGKILL)
        return within

    def entered(frame: FrameType, event: str, _: Any) -> Any:
        code = frame.f_code
        return within if code.co_filename in _FILES or code is _SAVE else None

    return entered
