# SPDX-License-Identifier: Apache-2.0
"""Independent pieces of work on a few processes; the results do not depend on how many."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from types import TracebackType
from typing import TypeVar

from hmcvt_core.fleet.threads import ONE_BLAS_THREAD

Task = TypeVar("Task")
Result = TypeVar("Result")
Progress = Callable[[str], None]


class Workers:
    """Processes that are spawned when first needed, with one BLAS thread each.

    Args:
        jobs: processes side by side; 1 works in this one.
        progress: called with a line of text after each task.
    """

    def __init__(self, jobs: int, progress: Progress | None = None) -> None:
        self.jobs, self.progress = jobs, progress
        self._before: dict[str, str | None] = {}
        self._pool: ProcessPoolExecutor | None = None

    def __enter__(self) -> Workers:
        # NumPy reads these when a worker imports it; this process has long done so.
        self._before = {name: os.environ.get(name) for name in ONE_BLAS_THREAD}
        if self.jobs > 1:
            os.environ.update(ONE_BLAS_THREAD)
            self._pool = ProcessPoolExecutor(
                self.jobs, mp_context=get_context("spawn"), initializer=_leave_interrupts)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._pool is not None:
            self._pool.shutdown(wait=True, cancel_futures=True)
        for name, text in self._before.items():
            if text is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = text

    def map(
        self, function: Callable[[Task], Result], tasks: Sequence[Task], what: str
    ) -> list[Result]:
        """Return the results in the order of the tasks; `what` names them in the progress."""
        results = []
        found = map(function, tasks) if self._pool is None else self._pool.map(function, tasks)
        for number, result in enumerate(found, 1):
            results.append(result)
            self.tell(f"{what}, {number} of {len(tasks)}")
        return results

    def tell(self, text: str) -> None:
        """Show how far the work is."""
        if self.progress is not None:
            self.progress(text)


def _leave_interrupts() -> None:
    """Ctrl-C goes to every process of the terminal; the first one tells the others to end."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
