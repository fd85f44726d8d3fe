# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Nothing that comes from the network ends the node or holds it up.

rclpy answers some services and topics itself: parameters, type descriptions, /clock. An exception
in one of its callbacks would end the process, and a long request would hold up every answer.
"""

from __future__ import annotations

import functools
import math
import time
from collections.abc import Callable
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import SetParameters
from rclpy.node import Node
from rclpy.serialization import serialize_message

from .messages import RAW_LIMIT

ENTRIES_LIMIT = 100
"""Most entries of a request."""

QUIET = 5.0  # seconds between two warnings of one kind


class Guard:
    """Contains what goes wrong, counts it and tells it.

    Attributes:
        contained: count of requests and messages that would have ended the node, or were refused
            for their size.
        clocks_refused: count of messages on /clock that hold no time.
    """

    def __init__(self, node: Node) -> None:
        """Take hold of everything that rclpy has created in a node by itself."""
        self.contained = self.clocks_refused = 0
        self._warned: dict[str, float] = {}
        self._log = node.get_logger()
        for service in node.services:
            service.callback = self._bounded(service.service_name, service.callback)
        for subscription in node.subscriptions:  # /clock, with use_sim_time; else none
            subscription.callback = self._checked(subscription.callback)

    def warn(self, about: str, text: str) -> None:
        """Log a warning, unless there has been one about the same just now."""
        # The throttle of the logger is one for each line of code, not one for each input.
        now = time.monotonic()
        if now - self._warned.get(about, -math.inf) >= QUIET:
            self._warned[about] = now
            self._log.warning(text)

    def contain(self, where: str, error: Exception | str) -> None:
        """Count and tell what must not end the node."""
        self.contained += 1
        kind = f"{type(error).__name__}: " if isinstance(error, Exception) else ""
        self.warn(f"{where} {type(error).__name__}", f"{where}: {kind}{error}")

    def callback(self, function: Callable[..., None]) -> Callable[..., None]:
        """Keep an exception of a callback to a line in the log."""
        @functools.wraps(function)  # rclpy looks at how many arguments it takes
        def guarded(*arguments: Any) -> None:
            try:
                function(*arguments)
            except Exception as error:
                self.contain(function.__name__, error)
        return guarded

    def _bounded(self, name: str, answer: Callable[..., Any]) -> Callable[..., Any]:
        def bounded(request: Any, response: Any) -> Any:
            reason = excess(request)
            if reason:
                self.contain(name, reason)
                return _refusal(request, response, reason)
            if not isinstance(request, SetParameters.Request):
                return contained(request, response)
            # One at a time: a bad entry does not take the others with it.
            for entry in request.parameters:
                one = SetParameters.Request(parameters=[entry])
                response.results.extend(contained(one, SetParameters.Response()).results)
            return response

        def contained(request: Any, response: Any) -> Any:
            try:
                return answer(request, response)
            except Exception as error:
                self.contain(name, error)
                return _refusal(request, response, f"{type(error).__name__}: {error}")

        return bounded

    def _checked(self, take: Callable[..., None]) -> Callable[..., None]:
        def checked(message: Any) -> None:
            try:
                take(message)
            except Exception as error:
                self.clocks_refused += 1
                self.warn("/clock", f"/clock: {message.clock.sec} s, {message.clock.nanosec} ns "
                                    f"is no time and is ignored ({error})")
        return checked


def excess(request: Any) -> str:
    """Say what is too large in a request; empty when nothing is."""
    entries = max((len(getattr(request, name)) for name in ("parameters", "names", "prefixes")
                   if hasattr(request, name)), default=0)
    if entries > ENTRIES_LIMIT:
        return f"{entries} entries; allowed are {ENTRIES_LIMIT}"
    size = len(serialize_message(request))
    return f"{size} bytes; allowed are {RAW_LIMIT}" if size > RAW_LIMIT else ""


def _refusal(request: Any, response: Any, reason: str) -> Any:
    """Fill in a response; those that can tell no reason stay empty, as rclpy has it."""
    refused = SetParametersResult(successful=False, reason=reason)
    if hasattr(response, "results"):
        response.results = [refused] * len(request.parameters)
    elif hasattr(response, "failure_reason"):
        response.failure_reason = reason
    elif isinstance(getattr(response, "result", None), SetParametersResult):
        response.result = refused
    return response
