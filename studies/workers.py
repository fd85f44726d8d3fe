# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Independent pieces of work on a few processes; records of them outlive an interruption."""

import json
import os
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor, as_completed
from pathlib import Path
from typing import Any, TypeVar

Task = TypeVar("Task")
Record = dict[str, Any]


def recorded(
    pool: Executor,
    work: Callable[[Task], Record],
    tasks: Mapping[str, Task],
    path: Path,
) -> Iterator[Record]:
    """Give the record of every task: those made before an interruption, then the others.

    Args:
        pool: where the work is done.
        work: makes a record, which JSON can hold.
        tasks: by a key that no other task has.
        path: file of JSON lines; each record is there before it is given.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    done = _read(path)
    yield from (done[key] for key in tasks if key in done)
    with path.open("a", encoding="utf-8") as file:
        waiting = {
            pool.submit(work, task): key
            for key, task in tasks.items()
            if key not in done
        }
        try:
            for future in as_completed(waiting):
                file.write(json.dumps([waiting[future], future.result()]) + "\n")
                file.flush()
                yield future.result()
        finally:
            for future in waiting:
                future.cancel()


def _read(path: Path) -> dict[str, Record]:
    if not path.is_file():
        return {}
    text = path.read_bytes()
    # What stands behind the last line's end was being written at the interruption.
    whole = text[: text.rfind(b"\n") + 1]
    os.truncate(path, len(whole))
    return dict(map(json.loads, whole.splitlines()))
