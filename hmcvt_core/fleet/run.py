# SPDX-License-Identifier: Apache-2.0
"""From logs to results: logs are read, studied elsewhere, and their files written here."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing

from ..errors import HmcvtError, InputError
from ..files.bench import read_bench
from .executors import Place, study_all
from .results import Log, finished, save
from .study import Broken, Settings, Task
from .summary import BrokenLog, Row

Entry = Row | BrokenLog


def split(logs: Iterable[Log], settings: Settings) -> tuple[list[Log], list[Row]]:
    """Tell the logs to be studied from those finished before with the same data and settings.

    Returns:
        The first, in their order, and the rows of the others.
    """
    rows = {log: finished(log, settings) for log in logs}
    return ([log for log, row in rows.items() if row is None],
            [row for row in rows.values() if row is not None])


def run(
    todo: Sequence[Log], settings: Settings, place: Place, progress: Callable[[Entry], None]
) -> list[Entry]:
    """Study logs and write the files of each as soon as it is finished.

    An interrupt loses the logs in hand, none that was finished.

    Args:
        todo: logs to be studied.
        settings: for all of them.
        place: where the work is done.
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

    with closing(study_all(tasks(), settings, place)) as outcomes:
        for name, outcome in outcomes:
            log = logs[name]
            finish(_broken(log, outcome.reason) if isinstance(outcome, Broken)
                   else save(log, outcome, settings))
    return entries


def _read(log: Log) -> Task:
    if not log.name.isprintable():
        raise InputError("the name cannot be printed: rename the log")
    if log.path.exists() and not log.path.is_file():
        raise InputError("is not a file")  # a pipe would be read for ever
    return Task(log.name, read_bench(log.path))


def _broken(log: Log, reason: str) -> BrokenLog:
    path = str(log.path)
    reason = reason if reason.startswith(path) else f"{path}: {reason}"
    return BrokenLog(_printable(log.name), _printable(reason))


def _printable(text: str) -> str:
    return text if text.isprintable() else ascii(text)
