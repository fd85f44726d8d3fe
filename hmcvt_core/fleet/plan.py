# SPDX-License-Identifier: Apache-2.0
"""Which logs there are, and which of them are finished already."""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

from ..errors import InputError
from .results import Log, finished
from .settings import Settings
from .summary import Row


@dataclass(frozen=True)
class Plan:
    """Logs of a fleet.

    Attributes:
        todo: to be studied, in the order of their names.
        done: rows of those finished before with the same data and settings.
    """

    todo: tuple[Log, ...]
    done: tuple[Row, ...]


def plan(logs: Iterable[Log], settings: Settings) -> Plan:
    """Tell finished logs from those to be studied."""
    todo, done = [], []
    for log in logs:
        row = _row(log, settings)
        if row is None:
            todo.append(log)
        else:
            done.append(row)
    return Plan(tuple(todo), tuple(done))


def find_logs(folder: Path, out: Path) -> list[Log]:
    """Return the .csv files of a folder and of the folders in it, by name.

    Hidden files and folders are left out, and links to folders are not followed. The files of a
    log lie under `out` as the log lies under `folder`.

    Raises:
        InputError: the folder is missing or holds no .csv file, is `out` itself, or two logs
            would have the same files.
        OSError: a folder cannot be read.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: " + ("is not a folder" if folder.exists()
                                          else "No such file or directory"))
    if folder.resolve() == out.resolve():
        # A logger may leave files of the same names beside its logs.
        raise InputError(f"{out}: holds the logs; the results need a folder of their own")
    found: dict[Path, Log] = {}
    for path in _csv_files(folder):
        below = path.relative_to(folder)
        log = Log(below.as_posix(), path, (out / below).with_suffix(".yaml"),
                  (out / below).with_suffix(".json"))
        other = found.setdefault(log.result, log)
        if other is not log:
            raise InputError(f"{other.path} and {path} would share {log.result}: rename one")
    if not found:
        raise InputError(f"{folder}: holds no .csv file")
    return sorted(found.values(), key=lambda log: log.name)


def _csv_files(folder: Path) -> list[Path]:
    def stop(error: OSError) -> NoReturn:
        raise error  # os.walk would pass over a folder that it cannot read

    found = []
    for place, folders, files in os.walk(folder, onerror=stop):
        folders[:] = [name for name in folders if not name.startswith(".")]
        found += [Path(place, name) for name in files
                  if name.lower().endswith(".csv") and not name.startswith(".")]
    return found


def _row(log: Log, settings: Settings) -> Row | None:
    result = finished(log, settings)
    try:
        return None if result is None else Row.of(result)
    except (KeyError, TypeError, IndexError):
        return None  # edited by hand: made again
