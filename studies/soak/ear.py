# SPDX-License-Identifier: Apache-2.0
"""Listening without an executor, and what the node says about itself."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.subscription import Subscription

Handler = Callable[[Any, int], None]
"""Takes a message and when the middleware received it [ns since 1970]."""


def unused(message: object) -> None:
    """The callback of a subscription that no executor serves."""


class Ear:
    """Takes the messages of some subscriptions of a node.

    An executor of rclpy would cost this process more than the node under test spends on an
    answer; the way around it is the one of `rclpy.wait_for_message`.
    """

    def __init__(self, node: Node, handlers: Mapping[Subscription, Handler]) -> None:
        self._handlers = dict(handlers)
        self._wait_set = rclpy_implementation.WaitSet(
            len(handlers), 0, 0, 0, 0, 0, node.context.handle)

    def listen(self, timeout: float) -> None:
        """Wait until there is something or the time [s] is over, and hand out all there is."""
        self._wait_set.clear_entities()
        for subscription in self._handlers:
            self._wait_set.add_subscription(subscription.handle)
        self._wait_set.wait(max(0, int(timeout * 1e9)))
        ready = self._wait_set.get_ready_entities("subscription")
        for subscription, handle in self._handlers.items():
            if subscription.handle.pointer not in ready:
                continue
            while (taken := subscription.handle.take_message(subscription.msg_type, False)):
                handle(taken[0], taken[1]["received_timestamp"])

    def listen_for(self, seconds: float) -> None:
        """Hand out what comes during a while."""
        self.listen_until(lambda: False, seconds)

    def listen_until(self, condition: Callable[[], bool], timeout: float) -> bool:
        """Hand out what comes until a condition holds; False when it does not in time [s]."""
        end = time.monotonic() + timeout
        while not condition():
            left = end - time.monotonic()
            if left <= 0.0:
                return False
            self.listen(min(left, 0.1))
        return True


class Statuses:
    """The last diagnostics of the node `hmcvt` in a namespace.

    Attributes:
        values: by the last word of the name of the status (`inputs`, `model`), then by key.
        stamp: when the node wrote them [ns since 1970], 0 before the first.
    """

    def __init__(self, namespace: str) -> None:
        self._mine = f"{namespace.lstrip('/')}/hmcvt: "
        self.values: dict[str, dict[str, str]] = {}
        self.stamp = 0

    def take(self, message: DiagnosticArray, received: int) -> None:
        for status in message.status:
            if status.name.startswith(self._mine):
                self.values[status.name.removeprefix(self._mine)] = {
                    pair.key: pair.value for pair in status.values}
                stamp = message.header.stamp
                self.stamp = stamp.sec * 1_000_000_000 + stamp.nanosec

    def sum(self, status: str, words: str) -> int:
        """Add up the counts whose key has these words."""
        return sum(int(value) for key, value in self.values[status].items() if words in key)
