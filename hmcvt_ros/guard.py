# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Protection of the node against everything that comes from the network.

rclpy answers some services and topics itself: parameters, type descriptions, /clock. An exception
in one of its callbacks would end the process, and a long request would delay every answer.
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

QUIET = 5.0
"""Time between two warnings of one kind [s]."""

_ENTRY_FIELDS = ("parameters", "names", "prefixes")
"""Fields of requests that hold entries."""


class Guard:
    """Contains errors of callbacks, counts them and logs them.

    Attributes:
        contained: count of requests and messages that would have ended the node, or were refused
            for their size.
    """

    def __init__(self, node: Node) -> None:
        """Guard everything that rclpy has created in a node by itself."""
        self.contained = 0
        self._warned: dict[str, float] = {}
        self._log = node.get_logger()
        for service in node.services:
            service.callback = self._bounded(service.service_name, service.callback)
        # There is one for /clock with use_sim_time, and none otherwise.
        for subscription in node.subscriptions:
            subscription.callback = self.callback(
                subscription.callback, f"{subscription.topic_name} is ignored"
            )

    def warn(self, about: str, text: str) -> None:
        """Log a warning, unless one about the same was logged a moment ago."""
        # The throttle of the logger counts by line of code, not by input.
        now = time.monotonic()
        if now - self._warned.get(about, -math.inf) >= QUIET:
            self._warned[about] = now
            self._log.warning(text)

    def contain(self, where: str, error: Exception) -> str:
        """Count and log an error that must not end the node; return it in words."""
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
        """Return a callback whose exceptions become a line in the log.

        Args:
            function: callback to guard.
            where: its name for the log; that of the function when left out.
            refusal: called with the reason and the arguments instead, after an exception.
        """

        @functools.wraps(function)  # rclpy looks at how many arguments it takes
        def guarded(*arguments: Any) -> Any:
            try:
                return function(*arguments)
            except Exception as error:
                reason = self.contain(where or function.__name__, error)
                return refusal(reason, *arguments)

        return guarded

    def _bounded(self, name: str, answer: Callable[..., Any]) -> Callable[..., Any]:
        """Return a service callback that refuses requests that are too large."""
        contained = self.callback(answer, name, _refusal)

        def bounded(request: Any, response: Any) -> Any:
            _require_small(request)
            if not isinstance(request, SetParameters.Request):
                return contained(request, response)
            # One at a time: a bad entry does not take the others with it.
            for entry in request.parameters:
                single = SetParameters.Request(parameters=[entry])
                results = contained(single, SetParameters.Response()).results
                response.results.extend(results)
            return response

        return self.callback(bounded, name, _refusal)


def _require_small(request: Any) -> None:
    for name in _ENTRY_FIELDS:
        entries = len(getattr(request, name, ()))
        if entries > ENTRIES_LIMIT:
            raise InputError(f"{entries} entries; allowed are {ENTRIES_LIMIT}")
    size = len(serialize_message(request))
    if size > RAW_LIMIT:
        raise InputError(f"{size} bytes; allowed are {RAW_LIMIT}")


def _refusal(reason: str, request: Any, response: Any) -> Any:
    """Fill in a response; a response without a field for the reason stays empty, as in rclpy."""
    refused = SetParametersResult(successful=False, reason=reason)
    if hasattr(response, "results"):
        response.results = [refused] * len(request.parameters)
    elif hasattr(response, "failure_reason"):
        response.failure_reason = reason
    elif isinstance(getattr(response, "result", None), SetParametersResult):
        response.result = refused
    return response
