# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The efficiency map: made in a thread of its own, so that answers do not wait for it."""

import functools
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

from std_msgs.msg import Float64MultiArray

from hmcvt_core import EfficiencyModel

from .messages import map_to_message
from .parameters import Settings, map_axes

MAPS_KEPT = 16
"""Maps that are kept, so that a stage engaged to and fro costs one map of each stage."""
SHORTEST_PERIOD = 0.5
"""Time between two maps [s]: one has 80 kB, and a stage may change ten times a second."""


class Maps:
    """Publishes the map of the model that was asked for last."""

    def __init__(self, publish: Callable[[Float64MultiArray], None]) -> None:
        """Start the thread.

        Args:
            publish: publishes a map.
        """
        self._publish = publish
        self._thread = ThreadPoolExecutor(1, "maps")
        self._make = functools.lru_cache(MAPS_KEPT)(_map)
        self._wanted: tuple[Any, ...] | None = None
        self._running: Future[Float64MultiArray] | None = None
        self._next = 0.0  # earliest time of the next map, by the monotonic clock

    def want(self, model: EfficiencyModel, settings: Settings) -> None:
        """Ask for a map; it replaces what was asked for before."""
        self._wanted = (
            model,
            settings.map_points,
            settings.engine_speed_limits,
            settings.map_load_torque_limits,
        )

    def poll(self) -> None:
        """Publish a map that is ready, or begin one; to be called about ten times a second.

        Raises:
            Exception: what the model raised when its map was made.
        """
        if self._running is not None:
            if not self._running.done():
                return
            made = self._running
            self._running = None
            self._publish(made.result())
            return
        if self._wanted is None or time.monotonic() < self._next:
            return
        self._next = time.monotonic() + SHORTEST_PERIOD
        self._running = self._thread.submit(self._make, *self._wanted)
        self._wanted = None

    def close(self) -> None:
        """End the thread."""
        self._thread.shutdown(wait=False, cancel_futures=True)


def _map(
    model: EfficiencyModel,
    points: tuple[int, int, int],
    engine_speeds: tuple[float, float],
    load_torques: tuple[float, float],
) -> Float64MultiArray:
    axes = map_axes(points, engine_speeds, load_torques)
    return map_to_message(model.efficiency_map(*axes))
