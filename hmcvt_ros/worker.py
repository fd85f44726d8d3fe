# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A process beside the node for heavy work, so that lookups keep their latency meanwhile.

One process for all jobs, started for the first: a start in itself costs the neighbours more time
than a refit. It can be killed, and it does not outlive a node that was. This module is the first
that the process loads, and at full priority: nothing but the standard library.
"""

import os
import resource
import signal
import threading
from collections.abc import Callable, Mapping
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from multiprocessing import active_children, get_context, parent_process
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

_YIELD = 5e-4  # seconds; about what an answer takes


class Worker:
    """An executor of one process, replaced when it has died; the only child of this process."""

    def __init__(self) -> None:
        self._pool: ProcessPoolExecutor | None = None
        self._processes: list[BaseProcess] = []

    def submit(
        self, job: Callable[..., Any], memory: int, **options: Any
    ) -> Future[Any]:
        """Start a job that may take so much memory [MiB].

        The future raises `BrokenProcessPool` when the process dies meanwhile, and `MemoryError`.

        Raises:
            OSError: no process can be started.
        """
        if self._pool is None:
            self._pool = ProcessPoolExecutor(1, get_context("spawn"), _begin)
        try:
            return self._pool.submit(_limited, job, memory, options)
        except BrokenProcessPool:  # it has died while it had nothing to do
            self.kill()
            return self.submit(job, memory, **options)
        except OSError:
            self.kill()
            raise
        finally:
            self._processes = active_children() or self._processes

    @property
    def exit_status(self) -> int | None:
        """How the process ended, negative by a signal; None while it runs."""
        for process in self._processes:
            process.join(timeout=1.0)
        return next((process.exitcode for process in self._processes), None)

    @property
    def stopped(self) -> bool:
        """Whether a signal has stopped the process, so that it neither works nor ends."""
        with suppress(ChildProcessError):  # it has just ended
            return any(
                os.waitid(os.P_PID, process.pid, os.WSTOPPED | os.WNOHANG | os.WNOWAIT)
                for process in self._processes
                if process.pid and process.is_alive()
            )
        return False

    def kill(self, wait: bool = False) -> None:
        """Kill the process, and a running job with it.

        Wait for the thread of the pool before Python ends, which would wake it without its lock and
        may meet a pipe just closed (CPython's `_python_exit`). A process that a dead disk holds
        does not even die of a kill, and its thread is not waited for.
        """
        for process in self._processes:
            process.kill()
        if self._pool is not None:
            self._pool.shutdown(
                wait and self.exit_status is not None, cancel_futures=True
            )
        self._pool, self._processes = None, []


def _begin() -> None:
    """Make the new process step back, and end with its parent."""
    if hasattr(os, "SCHED_IDLE"):  # Linux: compute only while nobody else wants to
        os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
    else:
        os.nice(19)
    with suppress(
        OSError
    ):  # Linux: where memory runs out, end this process and not the node
        Path("/proc/self/oom_score_adj").write_text("1000")
    # Ctrl-C in a terminal reaches every process of the group; the node decides what to do.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _limited(job: Callable[..., Any], memory: int, options: Mapping[str, Any]) -> Any:
    """Do a job within a limit to the memory that it may write to [MiB]."""
    hard = resource.getrlimit(resource.RLIMIT_DATA)[1]
    limit = memory << 20
    resource.setrlimit(
        resource.RLIMIT_DATA,
        (limit if hard == resource.RLIM_INFINITY else min(limit, hard), hard),
    )
    if hasattr(os, "sched_yield"):
        # Linux may leave a thread that wakes behind an idle priority until the next tick (4 ms).
        signal.signal(signal.SIGALRM, lambda *_: os.sched_yield())
        signal.setitimer(signal.ITIMER_REAL, _YIELD, _YIELD)
    try:
        return job(**options)
    except MemoryError:  # NumPy's own kind does not have to come through to the node
        raise MemoryError from None
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)


def _end_with_parent() -> None:
    parent = parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)  # in the middle of its work, too
