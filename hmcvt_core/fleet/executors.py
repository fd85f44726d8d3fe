# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Many logs side by side, on processes of this machine or on a Dask cluster.

Samples go out, outcomes come back; files stay with the caller, which is `run`. A cluster needs
hmcvt on scheduler and workers, and tries the log of a lost worker again by itself.
"""

from __future__ import annotations

import asyncio
import logging
import multiprocessing
import os
import signal
import threading
import traceback
from collections.abc import Callable, Generator, Iterator
from concurrent import futures
from contextlib import AbstractContextManager, contextmanager
from itertools import chain, islice
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from ..errors import HmcvtError, InputError
from ..version import __version__
from . import ONE_BLAS_THREAD

if TYPE_CHECKING:
    from distributed import Client

Key = TypeVar("Key")
Sent = TypeVar("Sent")
Result = TypeVar("Result")
_CONNECT = 10.0  # seconds
# Logs handed over ahead: enough that no worker waits, and that an adaptive cluster sees the work.
_AHEAD_PER_THREAD, _AHEAD_LEAST = 2, 32


class Crew(NamedTuple):
    """Where logs are studied, and how many it may have in hand at the moment."""

    executor: futures.Executor
    room: Callable[[], int]


Place = Callable[[], AbstractContextManager[Crew]]


def study_all(
    study: Callable[[Sent], Result], tasks: Iterator[tuple[Key, Sent]], place: Place
) -> Generator[tuple[Key, Result | str], None, None]:
    """Study logs side by side; give each with its outcome, in the order in which they finish.

    Tasks are taken one by one as there is room, so that a fleet need not fit into memory.

    Args:
        study: gives the result of a log.
        tasks: what a log is known by, and what is sent out for it.
        place: opens the executor, and another one when that is broken by the death of a worker.

    Yields:
        The same key and the result, or text that says in one line why there is none.

    Raises:
        InputError: the place cannot be used.
        HmcvtError: it is lost.
    """
    suspects: list[tuple[Key, Sent]] = []
    # Suspects each alone, so that it is known which kills; and last, when that hurts fewest.
    for batch in chain((chain([first], tasks) for first in tasks),
                       (iter([suspect]) for suspect in suspects)):
        in_hand: dict[futures.Future[Result | str], tuple[Key, Sent]] = {}
        finished: list[tuple[tuple[Key, Sent], Result | str | None]] = []
        works = True
        with place() as crew:
            while True:
                # Before the outcomes are told, so that nobody waits while their files are written.
                for task in islice(batch, max(0, crew.room() - len(in_hand)) if works else 0):
                    in_hand[_hand_over(crew.executor, study, task[1])] = task
                for task, outcome in finished:
                    if outcome is not None:
                        yield task[0], outcome
                    elif task in suspects:
                        yield task[0], "killed its worker 2 times (memory, most likely)"
                    else:
                        suspects.append(task)
                if not in_hand:
                    break
                done = futures.wait(in_hand, return_when=futures.FIRST_COMPLETED).done
                finished = [(in_hand.pop(future), _outcome(future)) for future in done]
                works = works and all(outcome is not None for _, outcome in finished)


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


def _hand_over(
    executor: futures.Executor, study: Callable[[Sent], Result], sent: Sent
) -> futures.Future[Result | str]:
    try:
        with _interrupt_later():
            return executor.submit(attempt, study, sent)
    except futures.BrokenExecutor as error:  # a worker was killed while it had nothing to do
        failed: futures.Future[Result | str] = futures.Future()
        failed.set_exception(error)
        return failed


@contextmanager
def _interrupt_later() -> Iterator[None]:
    """Put Ctrl-C off while a process may be started; it is for the run, which ends its workers."""
    came: list[object] = []
    # Not left to the mask below: a thread of BLAS takes the signal, and Python then interrupts the
    # main thread, in the middle of what the new process is to read.
    handler = signal.signal(signal.SIGINT, lambda *call: came.append(call))
    # The process inherits this; Windows has no such thing.
    set_mask: Callable[..., Any] = getattr(signal, "pthread_sigmask", lambda *_: set())
    mask = set_mask(getattr(signal, "SIG_BLOCK", 0), {signal.SIGINT})
    try:
        yield
    finally:
        set_mask(getattr(signal, "SIG_SETMASK", 0), mask)
        signal.signal(signal.SIGINT, handler)
        if came:
            signal.raise_signal(signal.SIGINT)


def _outcome(future: futures.Future[Result | str]) -> Result | str | None:
    """Return what a worker gave; None for one that died over this log or another."""
    try:
        return future.result()
    except futures.BrokenExecutor:
        return None
    except futures.CancelledError:
        raise HmcvtError("the Dask scheduler is lost; finished logs are kept, run again to go "
                         "on") from None
    except Exception as error:  # `attempt` raises none: the place failed over this log
        failures = getattr(error, "allowed_failures", None)  # of distributed.KilledWorker
        return _internal_failure(error) if failures is None else (
            f"killed its worker {failures + 1} times (as often as the cluster allows)")


@contextmanager
def on_processes(count: int) -> Iterator[Crew]:
    """Open as many worker processes, with one BLAS thread each; no worker outlives this process."""
    others = multiprocessing.active_children()
    # PYTHONSAFEPATH: a file random.py where the command is run must not become a module.
    before = os.environ.copy()
    os.environ.update(ONE_BLAS_THREAD, PYTHONSAFEPATH="1")
    pool = futures.ProcessPoolExecutor(
        count, multiprocessing.get_context("spawn"), _end_with_the_run)
    try:
        yield Crew(pool, lambda: count)
    except BaseException:
        # At once: a worker writes no files.
        for process in multiprocessing.active_children():
            if process not in others:
                process.kill()
        raise
    finally:
        pool.shutdown()
        os.environ.clear()
        os.environ.update(before)


def _end_with_the_run() -> None:
    """Have a worker end when the run is gone, even killed."""
    parent = multiprocessing.parent_process()
    assert parent is not None

    def watch() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@contextmanager
def on_cluster(address: str) -> Iterator[Crew]:
    """Open the Dask cluster whose scheduler has this address.

    Raises:
        InputError: Dask is not installed, nobody answers, or there is no hmcvt of this version.
    """
    with _connected(address) as client:
        try:
            # It unpacks what passes through it.
            found = {"the scheduler": client.run_on_scheduler(_version)}
        except Exception as error:  # whatever the import of another hmcvt may raise
            found = {"the scheduler": error}
        # Refused: a cluster whose every outcome would be a failure, or from another version.
        for place, version in {**found, **client.run(_version, on_error="return")}.items():
            if version != __version__:
                raise InputError(f"--scheduler {address}: {place} needs hmcvt {__version__}, "
                                 f"there is {version}")
        yield Crew(client.get_executor(pure=False), lambda: max(
            _AHEAD_LEAST, _AHEAD_PER_THREAD * sum(client.ncores().values())))


def _connected(address: str) -> Client:
    try:
        from distributed import Client
        from distributed.comm import connect
    except ImportError as error:
        raise InputError("--scheduler needs the library distributed (Dask); in the folder of "
                         "hmcvt: pip install \".[fleet]\"") from error

    # What it has to say about a lost scheduler is said in one line by `_outcome`.
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)

    async def knock() -> None:
        comm = await connect(address, timeout=_CONNECT)
        await comm.close()

    try:
        # First, because a client that finds nobody leaves threads behind that complain at exit.
        asyncio.run(knock())
        return Client(address, timeout=_CONNECT, set_as_default=False)
    except (OSError, ValueError) as error:  # a timeout is an OSError too
        raise InputError(f"--scheduler {address}: no Dask scheduler answers there: "
                         f"{error}") from error


def _version() -> str:
    return __version__
