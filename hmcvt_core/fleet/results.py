# SPDX-License-Identifier: Apache-2.0
"""The two files of a finished log, and the lock of the folder that holds them.

The parameter file is written first, the result last: a result that names the SHA-256 of the log,
of the settings and of the parameter file beside it proves that the log is finished.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..errors import InputError
from ..files.atomic import write_atomically
from ..files.strict_json import plain
from ..model.model import EfficiencyModel
from ..model.parameter_file import save_model
from .settings import Settings
from .study import Study

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


def save(log: Log, study: Study, settings: Settings) -> dict[str, Any]:
    """Write both files, each whole or not at all; return the result.

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
    return result


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
    try:
        result = json.loads(log.result.read_bytes())
        return bool(result["parameters_sha256"] == sha256(log.parameters))
    except (OSError, ValueError, RecursionError, LookupError, TypeError):
        return False


def finished(log: Log, settings: Settings) -> dict[str, Any] | None:
    """Return the result of a log, None when it is missing, damaged, or of other data."""
    if not log.path.is_file():
        return None
    try:
        result = json.loads(log.result.read_bytes())
        proof = {"schema": SCHEMA, "log_sha256": sha256(log.path),
                 "settings_sha256": settings.sha256, "parameters_sha256": sha256(log.parameters)}
    except (OSError, ValueError, RecursionError):
        return None
    if not isinstance(result, dict):
        return None
    return result if all(result.get(name) == value for name, value in proof.items()) else None


def sha256(path: Path) -> str:
    """Return the SHA-256 of a file."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while part := file.read(1 << 20):
            digest.update(part)
    return digest.hexdigest()
