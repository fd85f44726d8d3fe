# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""From a folder of bench logs to the two files of each finished one.

This process reads the logs and writes the files; workers do the study. The parameter file is
written first, the result last. A result that names the SHA-256 of the log, of the settings and of
its parameter file proves that the log is finished.
"""

import hashlib
import json
import pickle
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import AbstractContextManager, closing, contextmanager
from dataclasses import dataclass, fields
from functools import cached_property, partial
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

from hmcvt_core.benches.transmission import Transmission, diagnose
from hmcvt_core.errors import HmcvtError, InputError
from hmcvt_core.files import plain
from hmcvt_core.files.atomic import write_atomically
from hmcvt_core.files.bench import BenchSamples, read_bench
from hmcvt_core.identification import identify
from hmcvt_core.model.model import EfficiencyModel
from hmcvt_core.model.parameter_file import save_model
from hmcvt_core.physics.effects import load_effects
from hmcvt_core.physics.effects.base import Effect
from hmcvt_core.transmission.parameters import PAPER_PARAMETERS
from hmcvt_core.transmission.ranges import EFFICIENCY_STD
from hmcvt_core.transmission.stage import Stage
from hmcvt_core.version import __version__

from .executors import study_all
from .summary import Entry, record, summarise

SCHEMA = "hmcvt-fleet-result/1"
_LOCK = ".hmcvt-fleet.lock"


@dataclass(frozen=True, eq=False)
class Settings:
    """Settings of `identify` and `diagnose`, the same for every log.

    Attributes:
        stages: of the gear train; of several each sample names one in column `stage`.
        formulation: `power_balance` or `published`.
        effects: further effects that act with fixed parameters.
        diagnosed: whether the gap is diagnosed too.
        noise: standard deviation of the efficiency [-]; None for what the log states.
        seed: of every random number.
        gear_efficiencies: of every pair [-], to compare: the one with the lowest objective is kept;
            None for that of the stages.
        effect_sources: modules and files of effects that a worker loads first, see `load_effects`.

    Raises:
        InputError: a setting is out of range, or two do not go together.
    """

    stages: tuple[Stage, ...]
    formulation: str = "power_balance"
    effects: tuple[Effect, ...] = ()
    diagnosed: bool = True
    noise: float | None = None
    seed: int = 0
    gear_efficiencies: tuple[float | None, ...] = (None,)
    effect_sources: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        # Checked once before the work, not with every log.
        for value in self.gear_efficiencies:
            stages = list(self.stages)
            if value is not None:
                stages = [stage.with_gear_efficiency(value) for stage in stages]
            first, *others = stages
            model = EfficiencyModel(
                first,
                PAPER_PARAMETERS[0.98],
                self.formulation,
                self.effects,
                other_stages=tuple(others),
            )
            if self.diagnosed:
                Transmission(model)
        if self.noise is not None:
            EFFICIENCY_STD.check(self.noise, "noise")

    def __reduce__(self) -> tuple[Any, ...]:
        # A worker can unpickle effects only after it has loaded the modules that define them.
        values = {item.name: getattr(self, item.name) for item in fields(self)}
        return _settings_in_worker, (self.effect_sources, pickle.dumps(values))

    @cached_property
    def sha256(self) -> str:
        """Changes with every setting and with the version of hmcvt."""
        return hashlib.sha256(f"{__version__} {self!r}".encode()).hexdigest()


def _settings_in_worker(effect_sources: tuple[str, ...], values: bytes) -> Settings:
    """Return settings in the process of a worker."""
    for source in effect_sources:
        load_effects(source)
    return Settings(**pickle.loads(values))


class Study(NamedTuple):
    """Result of a worker for one log.

    Attributes:
        model: the identified model.
        outcome: identification and diagnosis as plain data.
    """

    model: EfficiencyModel
    outcome: dict[str, Any]


def study(settings: Settings, samples: BenchSamples) -> Study:
    """Identify the parameters of a log and diagnose its gap; equal input gives equal output."""
    tried = []
    for gear_efficiency in settings.gear_efficiencies:
        tried.append(
            identify(
                samples,
                stage=settings.stages,
                formulation=settings.formulation,
                gear_efficiency=gear_efficiency,
                effects=settings.effects,
                seed=settings.seed,
            )
        )
    best = min(tried, key=lambda result: result.objective)
    diagnosis = None
    if settings.diagnosed:
        diagnosis = diagnose(
            best.model, samples, noise=settings.noise, seed=settings.seed
        ).to_dict()
    return Study(best.model, {"identification": best.to_dict(), "diagnosis": diagnosis})


class Log(NamedTuple):
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
        InputError: the folder holds no .csv file, is `out` itself, or two logs would have the
            same files.
        OSError: a folder is missing or cannot be read.
    """
    if folder.resolve() == out.resolve():
        # A logger may leave files of the same names in the folder of its logs.
        raise InputError(
            f"{out}: holds the logs; the results need a folder of their own"
        )
    by_result: dict[Path, Log] = {}
    for path in _csv_files(folder):
        below = path.relative_to(folder)
        log = Log(
            below.as_posix(),
            path,
            (out / below).with_suffix(".yaml"),
            (out / below).with_suffix(".json"),
        )
        other = by_result.setdefault(log.result, log)
        if other is not log:
            raise InputError(
                f"{other.path} and {path} would share {log.result}: rename one"
            )
    if not by_result:
        raise InputError(f"{folder}: holds no .csv file")
    return sorted(by_result.values())


def _csv_files(folder: Path) -> Iterator[Path]:
    # `iterdir` raises for a folder that cannot be read; os.walk would skip it.
    for path in folder.iterdir():
        if path.is_dir():
            if not (path.name.startswith(".") or path.is_symlink()):
                yield from _csv_files(path)
        elif path.suffix.lower() == ".csv" and not path.name.startswith("."):
            yield path


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Make the folder and lock it for this run; the lock ends with the process.

    Raises:
        InputError: another run holds it.
        OSError: it cannot be made or written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / _LOCK).open("a") as file:
        try:
            _hold(file.fileno())
        except (BlockingIOError, PermissionError):
            raise InputError(
                f"{folder}: another hmcvt fleet writes there now"
            ) from None
        yield


def _hold(file: int) -> None:
    try:
        import fcntl
    except ImportError:  # Windows
        msvcrt = import_module("msvcrt")
        msvcrt.locking(file, msvcrt.LK_NBLCK, 1)
    else:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


def run(
    folder: Path,
    out: Path,
    settings: Settings,
    executor: AbstractContextManager[Executor],
    progress: Callable[[Entry, int], None],
) -> dict[str, Any]:
    """Study the logs of a folder and write the files of each as soon as it is finished.

    Logs finished before with the same data and settings are left as they are. An interrupt loses
    the logs under study, none that was finished.

    Args:
        folder: of the logs.
        out: folder for their files.
        settings: for all logs.
        executor: where the work is done.
        progress: called with each entry once its files are written, and how many there will be.

    Returns:
        The fleet, see `summarise`.

    Raises:
        InputError: see `find_logs` and `locked`.
        OSError: the logs cannot be read, or the results not be written.
        HmcvtError: the work cannot be done there, whatever the log.
    """
    # Before the folder for the results is made: a misspelt name must leave nothing behind.
    logs = find_logs(folder, out)
    with locked(out):
        before = []
        to_do = []
        for log in logs:
            entry = finished(log, settings)
            if entry is None:
                to_do.append(log)
            else:
                before.append(entry)
        now: list[Entry] = []

        def finish(entry: Entry) -> None:
            now.append(entry)
            progress(entry, len(to_do))

        def tasks() -> Iterator[tuple[Log, BenchSamples]]:
            for log in to_do:
                try:
                    yield log, _read(log)
                except HmcvtError as error:
                    finish(_broken(log, str(error)))

        if not to_do:  # no cluster is connected
            return summarise(before, now)
        with closing(
            study_all(partial(study, settings), tasks(), executor)
        ) as outcomes:
            for log, outcome in outcomes:
                if isinstance(outcome, str):
                    finish(_broken(log, outcome))
                else:
                    finish(save(log, outcome, settings))
    return summarise(before, now)


def save(log: Log, studied: Study, settings: Settings) -> Entry:
    """Write both files, each whole or not at all; return the record.

    Raises:
        OSError: the folder cannot be written or is full.
    """
    log.parameters.parent.mkdir(parents=True, exist_ok=True)
    if _result(log).get("parameters_sha256") == sha256(log.parameters):
        # An earlier run wrote it and it was not edited since: no copy of it is kept.
        log.parameters.unlink(missing_ok=True)
    # Keeps a copy of what a person may have written.
    save_model(studied.model, log.parameters)
    result: dict[str, Any] = plain(
        {
            "schema": SCHEMA,
            "log": log.name,
            "log_sha256": studied.model.provenance["data_sha256"],
            "settings_sha256": settings.sha256,
            "parameters_sha256": sha256(log.parameters),
            **studied.outcome,
        }
    )
    write_atomically(log.result, json.dumps(result, indent=1, allow_nan=False) + "\n")
    return record(result)


def finished(log: Log, settings: Settings) -> Entry | None:
    """Return the record of a finished log; None if damaged, or of other data or settings."""
    result = _result(log)
    proof = {
        "schema": SCHEMA,
        "settings_sha256": settings.sha256,
        "log_sha256": sha256(log.path),
        "parameters_sha256": sha256(log.parameters),
    }
    for name, value in proof.items():
        if not value or result.get(name) != value:
            return None
    try:
        return record(result)
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


def _read(log: Log) -> BenchSamples:
    if not log.name.isprintable():
        raise InputError("the name cannot be printed: rename the log")
    if log.path.exists() and not log.path.is_file():
        raise InputError("is not a file")  # a pipe would be read for ever
    return read_bench(log.path)


def _broken(log: Log, reason: str) -> Entry:
    """Return the record of a broken log, as text that can be printed."""
    path = str(log.path)
    error = reason if reason.startswith(path) else f"{path}: {reason}"
    return {"log": _printable(log.name), "error": _printable(error)}


def _printable(text: str) -> str:
    return text if text.isprintable() else ascii(text)
