# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A second process for heavy work, so that lookups keep their latency meanwhile.

One process serves all jobs and is started for the first: starting it takes the node longer than a
refit. It computes only while no other process wants to, and where that is never, a job is begun
again in a process that takes a share. The process can be killed, and it does not outlive the node.
It loads this module first, at full priority, so it imports nothing but the standard library.
"""

import os
import resource
import signal
import threading
from collections.abc import Callable, Mapping
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from multiprocessing import parent_process
from multiprocessing.context import SpawnContext, SpawnProcess
from pathlib import Path
from typing import Any

_YIELD_PERIOD = 5e-4
"""Time between two offers of the processor to others [s]; about what an answer takes."""
_LOWEST_PRIORITY = 19
_SHARING_PRIORITY = 5
"""Nice value of a process that takes a share: a quarter of a core beside one busy process."""
_STARVED_AFTER = 5.0
"""Time that a process waits for a processor before it can count as starved [s]; chosen by us."""
_STARVED_SHARE = 0.2
"""Fraction of the time it wants to compute below which a process is starved; chosen by us."""
_NANOSECOND = 1e-9
_FIRST_OUT_OF_MEMORY = "1000"
"""Score of the process that Linux ends first where memory runs out."""


class _Context(SpawnContext):
    """Spawns processes and remembers them: other children of this program are not ours.

    Attributes:
        processes: processes that were started.
    """

    def __init__(self) -> None:
        super().__init__()
        self.processes: list[SpawnProcess] = []

    def Process(self, *arguments: Any, **options: Any) -> SpawnProcess:  # type: ignore[override]  # noqa: N802
        """Create a process; the pool calls this."""
        process = SpawnProcess(*arguments, **options)
        self.processes.append(process)
        return process


class Worker:
    """An executor of one process, replaced when it has died."""

    def __init__(self) -> None:
        self._pool: ProcessPoolExecutor | None = None
        self._processes: list[SpawnProcess] = []
        self._shares = False  # whether the process takes a share
        self._before = (0.0, 0.0)  # times of the process before the job [s]

    def submit(
        self,
        job: Callable[..., Any],
        memory: int,
        shares: bool = False,
        **options: Any,
    ) -> Future[Any]:
        """Start a job.

        Args:
            job: function to call in the other process.
            memory: memory that it may take [MiB].
            shares: whether the job takes a share of a busy processor, or what others leave.
            options: arguments of the job.

        Returns:
            A future that raises `BrokenProcessPool` when the process dies meanwhile, and
            `MemoryError` beyond `memory`.

        Raises:
            OSError: no process can be started.
        """
        if shares != self._shares:
            self.kill()
        if self._pool is None:
            context = _Context()
            self._processes = context.processes
            self._shares = shares
            self._pool = ProcessPoolExecutor(1, context, _begin, (shares,))
        self._before = self._times() or (0.0, 0.0)
        try:
            return self._pool.submit(_limited, job, memory, options)
        except BrokenProcessPool:  # it died while it was idle
            self.kill()
            return self.submit(job, memory, shares, **options)
        except OSError:
            self.kill()
            raise

    @property
    def exit_status(self) -> int | None:
        """How the process ended, negative by a signal; None while it runs."""
        for process in self._started:
            process.join(timeout=1.0)
            return process.exitcode
        return None

    @property
    def _started(self) -> list[SpawnProcess]:
        """The processes that were started, as opposed to those that could not be."""
        return [process for process in self._processes if process.pid is not None]

    @property
    def stopped(self) -> bool:
        """Whether a signal has stopped the process, so that it neither works nor ends."""
        with suppress(ChildProcessError):  # it has just ended
            return any(
                os.waitid(os.P_PID, process.pid, os.WSTOPPED | os.WNOHANG | os.WNOWAIT)
                for process in self._started
                if process.pid and process.is_alive()
            )
        return False

    @property
    def starved(self) -> bool:
        """Whether others leave the process of a job hardly any time on the processors."""
        times = self._times()
        if times is None or self._shares:
            return False
        ran = times[0] - self._before[0]
        waited = times[1] - self._before[1]
        return waited > _STARVED_AFTER and ran < _STARVED_SHARE * (ran + waited)

    def _times(self) -> tuple[float, float] | None:
        """Return how long the process has run and waited for a processor [s]; None if unknown."""
        for process in self._started:
            with suppress(OSError, ValueError):  # Linux tells it, where it is built in
                words = Path(f"/proc/{process.pid}/schedstat").read_text().split()
                return float(words[0]) * _NANOSECOND, float(words[1]) * _NANOSECOND
        return None

    def kill(self, wait: bool = False) -> None:
        """Kill the process, and a running job with it.

        Args:
            wait: whether to wait for the thread of the pool. Before Python ends this is needed:
                Python would wake that thread without its lock, and the thread may meet a pipe just
                closed (CPython's `_python_exit`). A process that a dead disk holds does not even
                die of a kill, and its thread is not waited for.
        """
        for process in self._started:
            process.kill()
        if self._pool is not None:
            dead = self.exit_status is not None if wait else False
            self._pool.shutdown(wait=dead, cancel_futures=True)
        self._pool = None
        self._processes = []


def _begin(shares: bool) -> None:
    """Give the new process a low priority, and let it end with its parent.

    Args:
        shares: whether it takes a share of a busy processor. A process without privileges cannot
            leave the idle priority again.
    """
    if hasattr(os, "SCHED_IDLE"):  # Linux: compute only while no other process wants to
        # Set in either case: the policy of the node, which is inherited, may be a real-time one.
        policy = os.SCHED_OTHER if shares else os.SCHED_IDLE
        nice = os.getpriority(os.PRIO_PROCESS, 0)
        # Linux counts threads as processes; the main module may have begun some, as NumPy does.
        for task in map(int, os.listdir("/proc/self/task")):
            with suppress(ProcessLookupError):  # it has just ended
                os.sched_setscheduler(task, policy, os.sched_param(0))
                if shares:
                    os.setpriority(os.PRIO_PROCESS, task, nice + _SHARING_PRIORITY)
    else:
        os.nice(_SHARING_PRIORITY if shares else _LOWEST_PRIORITY)
    with suppress(OSError):  # on Linux only
        Path("/proc/self/oom_score_adj").write_text(_FIRST_OUT_OF_MEMORY)
    # Ctrl-C in a terminal reaches every process of the group; the node decides what to do.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _limited(job: Callable[..., Any], memory: int, options: Mapping[str, Any]) -> Any:
    """Do a job within a limit to the memory that it may write to [MiB]."""
    hard = resource.getrlimit(resource.RLIMIT_DATA)[1]
    limit = memory << 20
    if hard != resource.RLIM_INFINITY:
        limit = min(limit, hard)
    resource.setrlimit(resource.RLIMIT_DATA, (limit, hard))
    if hasattr(os, "SCHED_IDLE") and os.sched_getscheduler(0) == os.SCHED_IDLE:
        # Linux may leave a thread that wakes behind an idle priority until the next tick (4 ms).
        signal.signal(signal.SIGALRM, lambda *_: os.sched_yield())
        signal.setitimer(signal.ITIMER_REAL, _YIELD_PERIOD, _YIELD_PERIOD)
    try:
        return job(**options)
    except MemoryError:  # NumPy's kind of it need not be known to the node
        raise MemoryError from None
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)


def _end_with_parent() -> None:
    parent = parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)  # in the middle of its work, too
