# SPDX-License-Identifier: Apache-2.0
"""Bench logs, the two files of a finished one, and the lock of the folder that holds them.

The parameter file is written first, the result last: a result that names the SHA-256 of the log,
of the settings and of the parameter file beside it proves that the log is finished.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

from ..errors import InputError
from ..files.atomic import write_atomically
from ..files.strict_json import plain
from ..model.model import EfficiencyModel
from ..model.parameter_file import save_model
from .study import Settings, Study
from .summary import Row

SCHEMA = "hmcvt-fleet-result/1"
_LOCK = ".hmcvt-fleet.lock"


@dataclass(frozen=True)
class Log:
    """A bench log and its files.

    Attributes:
        name: path below the folder of logs, parts separated by "/".
        path: of the log.
        parameters: path of its parameter file.
        result: path of its result.
    """

    name: str
    path: Path
    parameters: Path
    result: Path


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


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Make the folder and hold it for this run alone; a run that dies lets it go.

    Raises:
        InputError: another run holds it.
        OSError: it cannot be made or written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / _LOCK).open("a") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InputError(f"{folder}: another hmcvt fleet writes there now") from None
        yield


def save(log: Log, study: Study, settings: Settings) -> Row:
    """Write both files, each whole or not at all; return the row.

    Raises:
        OSError: the folder cannot be written or is full.
    """
    log.parameters.parent.mkdir(parents=True, exist_ok=True)
    _save_parameters(log, study.model)
    result: dict[str, Any] = plain({
        "schema": SCHEMA, "log": log.name, "log_sha256": study.log_sha256,
        "settings_sha256": settings.sha256, "parameters_sha256": sha256(log.parameters),
        "identification": study.identification, "diagnosis": study.diagnosis})
    write_atomically(log.result, json.dumps(result, indent=1, allow_nan=False) + "\n")
    return Row.of(result)


def _save_parameters(log: Log, model: EfficiencyModel) -> None:
    if not _superseded(log):
        save_model(model, log.parameters)  # keeps what a person may have put there
        return
    fresh = log.parameters.with_name(f".{log.parameters.name}.new")
    fresh.unlink(missing_ok=True)
    save_model(model, fresh)
    fresh.replace(log.parameters)


def _superseded(log: Log) -> bool:
    """Tell whether the parameter file is one that an earlier run wrote and nobody has touched."""
    return _result(log).get("parameters_sha256") == sha256(log.parameters)


def finished(log: Log, settings: Settings) -> Row | None:
    """Return the row of a finished log, None when it is damaged, or of other data or settings."""
    result = _result(log)
    proof = {"schema": SCHEMA, "settings_sha256": settings.sha256, "log_sha256": sha256(log.path),
             "parameters_sha256": sha256(log.parameters)}
    if any(not value or result.get(name) != value for name, value in proof.items()):
        return None
    try:
        return Row.of(result)
    except (KeyError, TypeError, IndexError):
        return None  # edited by hand


def _result(log: Log) -> dict[str, Any]:
    try:
        result = json.loads(log.result.read_bytes())
    except (OSError, ValueError, RecursionError):
        return {}
    return result if isinstance(result, dict) else {}


def sha256(path: Path) -> str:
    """Return the SHA-256 of a file; empty when there is none that can be read."""
    try:
        # A pipe would be read for ever.
        return hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else ""
    except OSError:
        return ""
