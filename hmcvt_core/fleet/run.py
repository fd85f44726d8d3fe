# SPDX-License-Identifier: Apache-2.0
"""From the plan to the results: logs are read, studied elsewhere, and their files written here."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import closing

from ..errors import HmcvtError, InputError
from ..files.bench import read_bench
from .results import Log, save
from .settings import Settings
from .study import Broken, Execute, Outcome, Task
from .summary import BrokenLog, Row

Entry = Row | BrokenLog


def run(
    todo: Sequence[Log], settings: Settings, execute: Execute, progress: Callable[[Entry], None]
) -> list[Entry]:
    """Study logs and write the files of each as soon as it is finished.

    An interrupt loses the logs in hand, none that was finished.

    Args:
        todo: logs to be studied.
        settings: for all of them.
        execute: where the work is done.
        progress: called with each entry once its files are written.

    Raises:
        OSError: the results cannot be written.
        HmcvtError: the work cannot be done there, whatever the log.
    """
    entries: list[Entry] = []
    logs = {log.name: log for log in todo}

    def finish(entry: Entry) -> None:
        entries.append(entry)
        progress(entry)

    def tasks() -> Iterator[Task]:
        for log in todo:
            try:
                task = _read(log)
            except HmcvtError as error:
                finish(_broken(log, str(error)))
            else:
                yield task

    with closing(execute(tasks(), settings)) as outcomes:
        for name, outcome in outcomes:
            finish(_entry(logs[name], outcome, settings))
    return entries


def _read(log: Log) -> Task:
    if not log.name.isprintable():
        raise InputError("the name cannot be printed: rename the log")
    if log.path.exists() and not log.path.is_file():
        raise InputError("is not a file")  # a pipe would be read for ever
    return Task(log.name, read_bench(log.path))


def _entry(log: Log, outcome: Outcome, settings: Settings) -> Entry:
    if isinstance(outcome, Broken):
        return _broken(log, outcome.reason)
    return Row.of(save(log, outcome, settings))


def _broken(log: Log, reason: str) -> BrokenLog:
    path = str(log.path)
    reason = reason if reason.startswith(path) else f"{path}: {reason}"
    return BrokenLog(_printable(log.name), _printable(reason))


def _printable(text: str) -> str:
    return text if text.isprintable() else ascii(text)
