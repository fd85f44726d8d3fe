# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Nothing that comes from the network ends the node or holds it up.

rclpy answers some services and topics itself: parameters, type descriptions, /clock. An exception
in one of its callbacks would end the process, and a long request would hold up every answer.
"""

import functools
import math
import time
from collections.abc import Callable
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import SetParameters
from rclpy.node import Node
from rclpy.serialization import serialize_message

from hmcvt_core import HmcvtError, InputError

from .messages import RAW_LIMIT

ENTRIES_LIMIT = 100
"""Most entries of a request."""

QUIET = 5.0  # seconds between two warnings of one kind


class Guard:
    """Contains what goes wrong, counts it and tells it.

    Attributes:
        contained: count of requests and messages that would have ended the node, or were refused
            for their size.
    """

    def __init__(self, node: Node) -> None:
        """Take hold of everything that rclpy has created in a node by itself."""
        self.contained = 0
        self._warned: dict[str, float] = {}
        self._log = node.get_logger()
        for service in node.services:
            service.callback = self._bounded(service.service_name, service.callback)
        for subscription in node.subscriptions:  # /clock, with use_sim_time; else none
            subscription.callback = self.callback(
                subscription.callback, f"{subscription.topic_name} is ignored"
            )

    def warn(self, about: str, text: str) -> None:
        """Log a warning, unless there has been one about the same just now."""
        # The throttle of the logger is one for each line of code, not one for each input.
        now = time.monotonic()
        if now - self._warned.get(about, -math.inf) >= QUIET:
            self._warned[about] = now
            self._log.warning(text)

    def contain(self, where: str, error: Exception) -> str:
        """Count and tell what must not end the node; return it in words."""
        self.contained += 1
        kind = "" if isinstance(error, HmcvtError) else f"{type(error).__name__}: "
        self.warn(f"{where} {kind}", f"{where}: {kind}{error}")
        return f"{kind}{error}"

    def callback(
        self,
        function: Callable[..., Any],
        where: str = "",
        refusal: Callable[..., Any] = lambda *_: None,
    ) -> Callable[..., Any]:
        """Keep an exception of a callback to a line in the log.

        Args:
            function: the callback.
            where: its name for people; that of the function when left out.
            refusal: what answers instead of it, given the reason and the arguments.
        """

        @functools.wraps(function)  # rclpy looks at how many arguments it takes
        def guarded(*arguments: Any) -> Any:
            try:
                return function(*arguments)
            except Exception as error:
                return refusal(
                    self.contain(where or function.__name__, error), *arguments
                )

        return guarded

    def _bounded(self, name: str, answer: Callable[..., Any]) -> Callable[..., Any]:
        contained = self.callback(answer, name, _refusal)

        def bounded(request: Any, response: Any) -> Any:
            _require_small(request)
            if not isinstance(request, SetParameters.Request):
                return contained(request, response)
            # One at a time: a bad entry does not take the others with it.
            for entry in request.parameters:
                one = SetParameters.Request(parameters=[entry])
                response.results.extend(
                    contained(one, SetParameters.Response()).results
                )
            return response

        return self.callback(bounded, name, _refusal)


def _require_small(request: Any) -> None:
    entries = max(
        (
            len(getattr(request, name))
            for name in ("parameters", "names", "prefixes")
            if hasattr(request, name)
        ),
        default=0,
    )
    if entries > ENTRIES_LIMIT:
        raise InputError(f"{entries} entries; allowed are {ENTRIES_LIMIT}")
    size = len(serialize_message(request))
    if size > RAW_LIMIT:
        raise InputError(f"{size} bytes; allowed are {RAW_LIMIT}")


def _refusal(reason: str, request: Any, response: Any) -> Any:
    """Fill in a response; those that can tell no reason stay empty, as rclpy has it."""
    refused = SetParametersResult(successful=False, reason=reason)
    if hasattr(response, "results"):
        response.results = [refused] * len(request.parameters)
    elif hasattr(response, "failure_reason"):
        response.failure_reason = reason
    elif isinstance(getattr(response, "result", None), SetParametersResult):
        response.result = refused
    return response
