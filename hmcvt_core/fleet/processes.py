# SPDX-License-Identifier: Apache-2.0
"""Many logs on this machine: worker processes, each with one log in hand.

A worker that dies takes down nothing but itself, and it is known which log it had.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
from collections import Counter, deque
from collections.abc import Iterator
from multiprocessing.connection import Pipe, wait

from .settings import Settings
from .study import Broken, Outcome, Outcomes, Task
from .threads import ONE_BLAS_THREAD

MOST_DEATHS = 2
"""A log that has killed as many workers is broken."""

_LAST_WORDS = 5.0  # seconds for a worker whose connection broke to end by its own cause
_START = "import sys; from hmcvt_core.fleet.worker import serve; serve(int(sys.argv[1]))"


def on_processes(tasks: Iterator[Task], settings: Settings, *, processes: int) -> Outcomes:
    """Study tasks in worker processes; see `study.Execute`."""
    crew = _Crew(tasks, settings, processes)
    finished: list[tuple[str, Outcome]] = []
    try:
        while True:
            crew.fill()  # first, so that nobody waits while results are written
            yield from finished
            if not crew.busy():
                return
            finished = crew.collect()
    finally:
        crew.dismiss()


class _Crew:
    """The workers, the log that each has in hand, and the logs to try again."""

    def __init__(self, tasks: Iterator[Task], settings: Settings, processes: int) -> None:
        self.tasks, self.settings, self.processes = tasks, settings, processes
        self.workers: list[_Worker] = []
        self.again: deque[Task] = deque()
        self.deaths: Counter[str] = Counter()

    def busy(self) -> list[_Worker]:
        """Workers with a log in hand."""
        return [worker for worker in self.workers if worker.task is not None]

    def fill(self) -> None:
        """Give a log to everybody who has none."""
        idle = [worker for worker in self.workers if worker.task is None]
        for worker in [worker for worker in idle if not worker.alive()]:
            # Killed between two logs: no log of ours is to blame.
            idle.remove(worker)
            self.workers.remove(worker)
            worker.end()
        for _ in range(self.processes - len(self.busy())):
            task = self._next()
            if task is None:
                return
            worker = idle.pop() if idle else self._hire()
            worker.give(task, self.settings)

    def collect(self) -> list[tuple[str, Outcome]]:
        """Wait until somebody is done or dead; return what is finished."""
        finished: list[tuple[str, Outcome]] = []
        busy = self.busy()
        ready = wait([worker.connection for worker in busy])
        for worker in busy:
            if worker.connection not in ready:
                continue
            task, outcome = worker.take()
            if outcome is None:
                outcome = self._bury(worker, task)
            if outcome is not None:
                finished.append((task.name, outcome))
        return finished

    def dismiss(self) -> None:
        """End every worker at once; none of them writes files."""
        for worker in self.workers:
            worker.end()

    def _next(self) -> Task | None:
        # Logs to try again come last: what they do to a machine hurts fewest then.
        task = next(self.tasks, None)
        return self.again.popleft() if task is None and self.again else task

    def _hire(self) -> _Worker:
        worker = _Worker()
        self.workers.append(worker)
        return worker

    def _bury(self, worker: _Worker, task: Task) -> Broken | None:
        self.workers.remove(worker)
        cause = worker.end(_LAST_WORDS)
        self.deaths[task.name] += 1
        if self.deaths[task.name] < MOST_DEATHS:
            self.again.append(task)
            return None
        return Broken(f"killed its worker {MOST_DEATHS} times ({cause})")


class _Worker:
    """A worker process, and the log it has in hand."""

    def __init__(self) -> None:
        self.connection, theirs = Pipe()
        self.task: Task | None = None
        # PYTHONSAFEPATH: a file random.py where the command is run must not become a module.
        environment = {**os.environ, **ONE_BLAS_THREAD, "PYTHONSAFEPATH": "1",
                       "PYTHONPATH": os.pathsep.join(sys.path)}
        with theirs:
            # In a session of its own, so that Ctrl-C reaches the run alone, which ends its workers.
            self.process = subprocess.Popen(
                [sys.executable, "-c", _START, str(theirs.fileno())], env=environment,
                pass_fds=(theirs.fileno(),), start_new_session=True,
                stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL)

    def give(self, task: Task, settings: Settings) -> None:
        """Hand over a log."""
        self.task = task
        with contextlib.suppress(OSError):  # dead: `take` will notice
            self.connection.send((task, settings))

    def take(self) -> tuple[Task, Outcome | None]:
        """Take back the log with its outcome, None when the worker died over it."""
        task, self.task = self.task, None
        assert task is not None
        try:
            return task, self.connection.recv()
        except (EOFError, OSError):
            return task, None

    def alive(self) -> bool:
        """Tell whether the process is there."""
        return self.process.poll() is None

    def end(self, grace: float = 0.0) -> str:
        """Make sure that the process is gone, at once or after `grace` s; tell what it died of."""
        self.connection.close()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.process.wait(grace)
        self.process.kill()
        code = self.process.wait()
        return f"exit code {code}" if code >= 0 else f"signal {-code}: {signal.strsignal(-code)}"
