# SPDX-License-Identifier: Apache-2.0
"""A thread for the few milliseconds that a change of model takes.

They go into reading files, waiting for the disk and making the messages that tell of it. A process,
which refits and diagnoses have, could not put a model into the service of this one.
"""

from __future__ import annotations

import sys
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future as Running
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from rclpy.node import Node
from rclpy.task import Future

# Python lets a thread compute for 5 ms before another has its turn; no lookup shall wait that long.
_TURN = 5e-4
_BREATHER = 0.005  # seconds in which the lookups that waited catch up


class Beside:
    """Does one thing after the other."""

    def __init__(self, node: Node) -> None:
        sys.setswitchinterval(_TURN)
        self._node = node
        self._thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix="hmcvt")
        self._running: deque[tuple[Running[Any], Future]] = deque()

    async def run(self, *steps: Callable[[], Any]) -> list[Any]:
        """Return what the steps return, or raise what one raises, without holding up the node."""
        found = Future(executor=self._node.executor)
        self._running.append((self._thread.submit(_do, steps), found))
        results: list[Any] = await found
        return results

    def poll(self) -> None:
        """Hand on what has been done; from the node's timer."""
        while self._running and self._running[0][0].done():
            running, found = self._running.popleft()
            error = running.exception()
            if error is None:
                found.set_result(running.result())
            else:
                found.set_exception(error)

    def close(self) -> None:
        """Finish what has begun, and do no more."""
        self._thread.shutdown(cancel_futures=True)


def _do(steps: tuple[Callable[[], Any], ...]) -> list[Any]:
    results: list[Any] = []
    for step in steps:
        if results:
            time.sleep(_BREATHER)
        results.append(step())
    return results
