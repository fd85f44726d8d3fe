# SPDX-License-Identifier: Apache-2.0
"""Many logs on a Dask cluster: samples go out, outcomes come back, files stay here.

Scheduler and workers need hmcvt, not the folders. The cluster itself tries the log of a lost
worker again.
"""

from __future__ import annotations

import asyncio
import logging
import uuid
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from ..errors import HmcvtError, InputError
from ..version import __version__
from .settings import Settings
from .study import Broken, Outcome, Outcomes, Task, internal_failure, study

if TYPE_CHECKING:
    from distributed import Client, Future

_CONNECT = 10.0  # seconds
# Logs handed over ahead: enough that no worker waits, and that an adaptive cluster sees the work.
_AHEAD_PER_THREAD, _AHEAD_LEAST = 2, 32


def on_cluster(tasks: Iterator[Task], settings: Settings, *, address: str) -> Outcomes:
    """Study tasks on the cluster whose scheduler has this address; see `study.Execute`.

    Raises:
        InputError: Dask is not installed, nobody answers, or there is no hmcvt of this version.
        HmcvtError: the scheduler is lost.
    """
    with _connected(address) as client:
        from distributed import as_completed

        _check_versions(client, address)
        run = uuid.uuid4().hex
        names: dict[str, str] = {}
        futures = as_completed(loop=client.loop)

        def hand_over() -> None:
            room = max(_AHEAD_LEAST, _AHEAD_PER_THREAD * sum(client.ncores().values()))
            while len(names) < room and (task := next(tasks, None)) is not None:
                key = f"hmcvt-fleet-{run}-{task.name}"
                names[key] = task.name
                futures.add(client.submit(study, task.samples, settings, key=key))

        hand_over()
        for future in futures:
            yield names.pop(future.key), _outcome(future, address)
            hand_over()


def _connected(address: str) -> Client:
    try:
        from distributed import Client
        from distributed.comm import connect
    except ImportError as error:
        raise InputError("--scheduler needs the library distributed (Dask); in the folder of "
                         "hmcvt: pip install '.[fleet]'") from error

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


def _check_versions(client: Client, address: str) -> None:
    """Refuse a cluster whose every outcome would be a failure, or from another version."""
    try:
        # It unpacks what passes through it.
        found = {"the scheduler": client.run_on_scheduler(_version)}
    except Exception as error:  # whatever the import of another hmcvt may raise
        found = {"the scheduler": error}
    found.update(client.run(_version, on_error="return"))
    for place, version in found.items():
        if version != __version__:
            raise InputError(f"--scheduler {address}: {place} needs hmcvt {__version__}, "
                             f"there is {version}")


def _version() -> str:
    return __version__


def _outcome(future: Future, address: str) -> Outcome:
    from distributed import KilledWorker

    if future.status in ("cancelled", "lost"):
        raise HmcvtError(f"the Dask scheduler at {address} is lost; finished logs are kept, "
                         "run again to go on")
    if future.status == "finished":
        found: Outcome = future.result()
        return found
    error: Any = future.exception()
    if isinstance(error, KilledWorker):
        return Broken(f"killed its worker {error.allowed_failures + 1} times (as often as the "
                      "cluster allows)")
    return Broken(internal_failure(error))
