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

from ..errors import HmcvtError, InputError
from ..version import __version__
from . import ONE_BLAS_THREAD

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

Key = TypeVar("Key")
Sent = TypeVar("Sent")
Result = TypeVar("Result")
_CONNECT = 10.0  # seconds
# Logs handed over to a cluster: so many that no worker waits, and all have room in memory; and of
# these at a time, so that outcomes are told while a large fleet is still being read.
_AHEAD, _AT_A_TIME = 256, 32
_FILES = 10  # that a process takes here, pipes and semaphores


def study_all(
    study: Callable[[Sent], Result],
    tasks: Iterator[tuple[Key, Sent]],
    place: AbstractContextManager[futures.Executor],
) -> Generator[tuple[Key, Result | str], None, None]:
    """Study logs side by side; give each with its outcome, in the order in which they finish.

    Tasks are taken as there is room, so that a fleet need not fit into memory.

    Args:
        study: gives the result of a log.
        tasks: what a log is known by, and what is sent out for it.
        place: opens the executor.

    Yields:
        The same key and the result, or text that says in one line why there is none.

    Raises:
        InputError: the place cannot be used.
        HmcvtError: it is lost.
    """
    killed: list[tuple[Key, Sent]] = []
    with place as executor:

        def outcomes(
            tasks: Iterator[tuple[Key, Sent]], ahead: int
        ) -> Iterator[tuple[tuple[Key, Sent], Result | str | None]]:
            in_hand: dict[futures.Future[Result | str], tuple[Key, Sent]] = {}
            while True:
                for task in islice(tasks, min(_AT_A_TIME, ahead - len(in_hand))):
                    in_hand[executor.submit(attempt, study, task[1])] = task
                if not in_hand:
                    return
                for future in futures.wait(
                    in_hand, return_when=futures.FIRST_COMPLETED
                ).done:
                    yield in_hand.pop(future), _outcome(future)

        for task, outcome in outcomes(tasks, getattr(executor, "ahead", _AHEAD)):
            if outcome is None:
                killed.append(task)
            else:
                yield task[0], outcome
        # Each alone, and last, when it hurts fewest.
        for task, outcome in outcomes(iter(killed), 1):
            yield (
                task[0],
                (
                    "killed its worker 2 times (memory, most likely)"
                    if outcome is None
                    else outcome
                ),
            )


def attempt(study: Callable[[Sent], Result], sent: Sent) -> Result | str:
    """Return the result of a study, or in one line why there is none: done by the worker."""
    try:
        return study(sent)
    except HmcvtError as error:
        return str(error)
    except Exception as error:  # one log must not stop thousands
        return _internal_failure(error)


def _internal_failure(error: Exception) -> str:
    """Return an unexpected error as one line that tells the place."""
    frames = traceback.extract_tb(error.__traceback__)
    place = f" at {frames[-1].filename}:{frames[-1].lineno}" if frames else ""
    text = " ".join(str(error).split())
    return f"internal failure (please report it): {type(error).__name__}: {text}{place}"


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
    except Exception as error:  # `attempt` raises none: the place failed over this log
        failures = getattr(
            error, "allowed_failures", None
        )  # of distributed.KilledWorker
        return (
            _internal_failure(error)
            if failures is None
            else (
                f"killed its worker {failures + 1} times (as often as the cluster allows)"
            )
        )


class Processes(futures.ThreadPoolExecutor):
    """As many processes as asked for, with one BLAS thread each; none outlives this one.

    Each is in the hands of a thread here: a killed one takes with it (`BrokenExecutor`) its own
    work alone, and leaves its place to another. To close ends them at once: they write no files.

    Attributes:
        ahead: pieces of work that are enough for none to wait.
    """

    def __init__(self, count: int) -> None:
        self.ahead = 2 * count
        _allow_files(_FILES * count)
        # What a thread blocks its process inherits: Ctrl-C is for the run. Not so on Windows.
        block = getattr(signal, "pthread_sigmask", None)
        super().__init__(
            count,
            initializer=block and partial(block, signal.SIG_BLOCK, {signal.SIGINT}),
        )
        self._spawn = multiprocessing.get_context("spawn")
        self._heard, self._held = self._spawn.Pipe(duplex=False)
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
        self._held.close()
        self.shutdown()
        while not self._idle.empty():
            self._idle.get().shutdown()

    def _open(self) -> futures.Executor:
        return futures.ProcessPoolExecutor(
            1, self._spawn, _thread.start_new_thread, (_end_with, (self._heard,))
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
        most = soft + more if hard == resource.RLIM_INFINITY else min(soft + more, hard)
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
        InputError: Dask is not installed, nobody answers, or there is no hmcvt of this version.
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

    # What it has to say about a lost scheduler is said in one line by `_outcome`.
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
    try:
        # First, because a client that finds nobody leaves threads behind that complain at exit.
        asyncio.run(knock())
        client = Client(address, timeout=_CONNECT, set_as_default=False)
    except (OSError, ValueError) as error:  # a timeout is an OSError too
        raise InputError(
            f"--scheduler {address}: no Dask scheduler answers there: {error}"
        ) from error
    with client:
        version = pkgutil.resolve_name, "hmcvt_core.version:__version__"
        try:
            found = {"the scheduler": client.run_on_scheduler(*version)}
        except Exception as error:  # whatever the import of another hmcvt may raise
            found = {"the scheduler": error}
        # Refused: a cluster whose every outcome would be a failure, or from another version.
        for place, there in {
            **found,
            **client.run(*version, on_error="return"),
        }.items():
            if there != __version__:
                raise InputError(
                    f"--scheduler {address}: {place} needs hmcvt {__version__}, "
                    f"there is {there}"
                )
        yield client.get_executor(pure=False)
