# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Many logs side by side, on processes of this machine or on a Dask cluster.

Samples go out, outcomes come back; files stay with the caller, which is `run`. A cluster needs
hmcvt on scheduler and workers, and tries the log of a lost worker again by itself.
"""

from __future__ import annotations

import _thread
import asyncio
import logging
import multiprocessing
import os
import pkgutil
import signal
import traceback
from collections.abc import Callable, Generator, Iterator
from concurrent import futures
from contextlib import AbstractContextManager, contextmanager, suppress
from functools import partial
from itertools import islice
from queue import SimpleQueue
from typing import TYPE_CHECKING, Any, TypeVar

from hmcvt_core.errors import HmcvtError, InputError
from hmcvt_core.version import __version__

from . import ONE_BLAS_THREAD

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

Key = TypeVar("Key")
Sent = TypeVar("Sent")
Result = TypeVar("Result")
_CONNECT = 10.0  # seconds
_AHEAD = 256
"""Logs submitted to a cluster: enough that no worker waits, few enough for the memory."""

_AT_A_TIME = 32
"""Logs submitted at a time, so that outcomes arrive while a large fleet is still being read."""

_FILES = 10  # pipes and semaphores that a process of this machine needs


def study_all(
    study: Callable[[Sent], Result],
    tasks: Iterator[tuple[Key, Sent]],
    opened: AbstractContextManager[futures.Executor],
) -> Generator[tuple[Key, Result | str], None, None]:
    """Study logs side by side; yield each with its outcome, in the order in which they finish.

    Tasks are taken as there is room, so that a fleet need not fit into memory.

    Args:
        study: returns the result of a log.
        tasks: the key of each log, and what is sent to the worker.
        opened: opens the executor.

    Yields:
        The same key and the result, or text that says in one line why there is none.

    Raises:
        InputError: the executor cannot be used.
        HmcvtError: it is lost.
    """
    killed: list[tuple[Key, Sent]] = []
    with opened as executor:
        ahead = getattr(executor, "ahead", _AHEAD)
        for task, outcome in _outcomes(executor, study, tasks, ahead):
            if outcome is None:
                killed.append(task)
            else:
                yield task[0], outcome
        # Logs that killed their worker are tried again one at a time, after all others.
        for task, outcome in _outcomes(executor, study, iter(killed), 1):
            if outcome is None:
                yield task[0], "killed its worker 2 times (memory, most likely)"
            else:
                yield task[0], outcome


def _outcomes(
    executor: futures.Executor,
    study: Callable[[Sent], Result],
    tasks: Iterator[tuple[Key, Sent]],
    ahead: int,
) -> Iterator[tuple[tuple[Key, Sent], Result | str | None]]:
    """Yield each task with its outcome, None where the worker was killed.

    Args:
        executor: does the work.
        study: returns the result of a log.
        tasks: key and what is sent.
        ahead: maximum number of tasks submitted.
    """
    pending: dict[futures.Future[Result | str], tuple[Key, Sent]] = {}
    while True:
        room = min(_AT_A_TIME, ahead - len(pending))
        for task in islice(tasks, room):
            pending[executor.submit(attempt, study, task[1])] = task
        if not pending:
            return
        done = futures.wait(pending, return_when=futures.FIRST_COMPLETED).done
        for future in done:
            yield pending.pop(future), _outcome(future)


def attempt(study: Callable[[Sent], Result], sent: Sent) -> Result | str:
    """Return the result of a study, or in one line why there is none: done by the worker."""
    try:
        return study(sent)
    except HmcvtError as error:
        return str(error)
    except Exception as error:  # one log must not stop thousands
        return _internal_failure(error)


def _internal_failure(error: Exception) -> str:
    """Return an unexpected error as one line that names file and line."""
    text = " ".join(str(error).split())
    line = f"internal failure (please report it): {type(error).__name__}: {text}"
    frames = traceback.extract_tb(error.__traceback__)
    if frames:
        line += f" at {frames[-1].filename}:{frames[-1].lineno}"
    return line


def _outcome(future: futures.Future[Result | str]) -> Result | str | None:
    """Return what a worker gave; None for one that was killed."""
    try:
        return future.result()
    except futures.BrokenExecutor:
        return None
    except futures.CancelledError:
        raise HmcvtError(
            "the Dask scheduler is lost; finished logs are kept, run again to go on"
        ) from None
    except Exception as error:  # `attempt` raises none: the executor failed
        # An attribute of distributed.KilledWorker.
        failures = getattr(error, "allowed_failures", None)
        if failures is None:
            return _internal_failure(error)
        return (
            f"killed its worker {failures + 1} times (as often as the cluster allows)"
        )


class Processes(futures.ThreadPoolExecutor):
    """Processes of this machine with one BLAS thread each; none outlives this process.

    A thread of this process attends to each of them: one that is killed loses only its current work
    (`BrokenExecutor`) and is replaced. Closing ends them at once, since they write no files.

    Args:
        count: number of processes.

    Attributes:
        ahead: pieces of work submitted, enough that no process waits.
    """

    def __init__(self, count: int) -> None:
        self.ahead = 2 * count
        _allow_files(_FILES * count)
        # A process inherits the signals that its thread blocks: Ctrl-C is for this process alone.
        # Windows has no such mask.
        block = getattr(signal, "pthread_sigmask", None)
        initializer = None
        if block is not None:
            initializer = partial(block, signal.SIG_BLOCK, {signal.SIGINT})
        super().__init__(count, initializer=initializer)
        self._spawn = multiprocessing.get_context("spawn")
        # Workers wait at one end; they end when the other end is closed.
        self._worker_end, self._run_end = self._spawn.Pipe(duplex=False)
        self._idle: SimpleQueue[futures.Executor] = SimpleQueue()
        for _ in range(count):
            self._idle.put(self._open())

    def submit(
        self, work: Callable[..., Any], /, *args: Any, **named: Any
    ) -> futures.Future[Any]:
        """Have a process do the work."""
        return super().submit(self._hand_over, partial(work, *args, **named))

    def __enter__(self) -> Processes:
        self._environment = os.environ.copy()
        # PYTHONSAFEPATH: a file random.py where the command is run must not become a module.
        os.environ.update(ONE_BLAS_THREAD, PYTHONSAFEPATH="1")
        return self

    def __exit__(self, *_: object) -> None:
        os.environ.clear()
        os.environ.update(self._environment)
        self.shutdown(wait=False, cancel_futures=True)
        self._run_end.close()
        self.shutdown()
        while not self._idle.empty():
            self._idle.get().shutdown()

    def _open(self) -> futures.Executor:
        return futures.ProcessPoolExecutor(
            1, self._spawn, _thread.start_new_thread, (_end_with, (self._worker_end,))
        )

    def _hand_over(self, work: Callable[[], Any]) -> Any:
        process = self._idle.get()
        try:
            return process.submit(work).result()
        except futures.BrokenExecutor:
            process.shutdown()
            process = self._open()
            raise
        finally:
            self._idle.put(process)


def _allow_files(more: int) -> None:
    """Have the system let this process open more files; on Windows there is no such limit."""
    with suppress(ImportError, ValueError):
        import resource

        soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
        most = soft + more
        if hard != resource.RLIM_INFINITY:
            most = min(most, hard)
        if soft != resource.RLIM_INFINITY:
            resource.setrlimit(resource.RLIMIT_NOFILE, (most, hard))


def _end_with(run: Connection) -> None:
    """End this worker when the run closes its end, or is gone, even killed."""
    with suppress(EOFError, OSError):
        run.recv_bytes()
    os._exit(1)


@contextmanager
def on_cluster(address: str) -> Iterator[futures.Executor]:
    """Open the Dask cluster whose scheduler has this address.

    Raises:
        InputError: Dask is not installed, no scheduler answers, or the cluster has no hmcvt of this
            version.
    """
    try:
        from distributed import Client
        from distributed.comm import connect
    except ImportError as error:
        raise InputError(
            "--scheduler needs the library distributed (Dask); in the folder of "
            'hmcvt: pip install ".[fleet]"'
        ) from error

    async def knock() -> None:
        await (await connect(address, timeout=_CONNECT)).close()

    # `_outcome` reports a lost scheduler in one line.
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
    try:
        # A client without an answer leaves threads behind that complain at exit: ask first.
        asyncio.run(knock())
        client = Client(address, timeout=_CONNECT, set_as_default=False)
    except (OSError, ValueError) as error:  # a timeout is an OSError too
        raise InputError(
            f"--scheduler {address}: no Dask scheduler answers there: {error}"
        ) from error
    with client:
        _require_same_version(client, address)
        yield client.get_executor(pure=False)


def _require_same_version(client: Any, address: str) -> None:
    """Refuse a cluster whose every outcome would be a failure, or of another version."""
    target = "hmcvt_core.version:__version__"
    versions: dict[str, Any] = {}
    try:
        versions["the scheduler"] = client.run_on_scheduler(
            pkgutil.resolve_name, target
        )
    except Exception as error:  # the import of another hmcvt may raise anything
        versions["the scheduler"] = error
    versions.update(client.run(pkgutil.resolve_name, target, on_error="return"))
    for member, version in versions.items():
        if version != __version__:
            raise InputError(
                f"--scheduler {address}: {member} needs hmcvt {__version__}, "
                f"there is {version}"
            )
