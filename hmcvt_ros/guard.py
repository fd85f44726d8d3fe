# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Protection of the node against everything that comes from the network.

rclpy answers some services and topics itself: parameters, type descriptions, /clock. An exception
in one of its callbacks would end the process, and a long request would delay every answer.
"""

import functools
import math
import time
from collections import deque
from collections.abc import Callable
from typing import Any

from rcl_interfaces.msg import (
    LoggerLevel,
    SetLoggerLevelsResult,
    SetParametersResult,
)
from rcl_interfaces.srv import SetLoggerLevels, SetParameters
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.serialization import serialize_message

from hmcvt_core import HmcvtError, InputError

from .messages import RAW_LIMIT
from .public_text import PublicText, printable

ENTRIES_LIMIT = 100
"""Most entries of a request."""
ENTRIES_PER_SECOND = 300
"""Most entries of all requests together; a file of all parameters has thirty."""
COST_OF_A_CHANGE = 5
"""Entries that are read in the time in which one parameter is set and announced."""

QUIET = 5.0
"""Time between two warnings of one kind [s]."""
NOTES_AT_ONCE = 20
"""Lines of one kind about what succeeded, within a minute."""
_NOTES_WITHIN = 60.0

_LIBRARIES = ("rcl", "rclpy", "rmw_fastrtps_cpp")
"""Loggers of ROS itself whose levels can be set."""
_NAME_SHOWN = 100
"""Characters of the name of a logger that a message shows."""

_ENTRY_FIELDS = ("parameters", "names", "prefixes", "levels")
"""Fields of requests that hold entries."""


class Budget:
    """What may be spent within a second."""

    def __init__(self, limit: int) -> None:
        """Take the limit."""
        self._limit = limit
        self._spent = 0
        self._second = 0

    def spend(self, count: int) -> bool:
        """Spend a count; return False when the budget of the present second is used up."""
        second = int(time.monotonic())
        if second != self._second:
            self._second = second
            self._spent = 0
        if self._spent >= self._limit:
            return False
        self._spent += count
        return True


class Log:
    """Writes lines to the log of a node; what repeats is counted and not written.

    A line that names folders stays on the machine. The others are published on /rosout too.
    """

    def __init__(self, node: Node, public: PublicText) -> None:
        """Take the node and what of a text may leave the machine."""
        self._node_logger = node.get_logger()
        # A logger that is no node's is not published.
        self._local_logger = get_logger(_local(self._node_logger.name))
        self._public = public
        self._warned: dict[str, float] = {}
        self._noted: dict[str, deque[float]] = {}
        self._suppressed: dict[str, int] = {}

    def warning(self, text: str) -> None:
        """Write a warning."""
        self._logger_of(text).warning(printable(text))

    def info(self, text: str) -> None:
        """Write what was done."""
        self._logger_of(text).info(printable(text))

    def warn(self, about: str, text: str) -> None:
        """Write a warning, unless one about the same was written a moment ago."""
        # The throttle of the logger counts by line of code, not by input.
        now = time.monotonic()
        if now - self._warned.get(about, -math.inf) < QUIET:
            self._suppress(about)
            return
        self._warned[about] = now
        self.warning(text + self._repetitions(about))

    def note(self, about: str, text: str) -> None:
        """Write what was done, unless the same was done often within the last minute."""
        now = time.monotonic()
        times = self._noted.setdefault(about, deque(maxlen=NOTES_AT_ONCE))
        if len(times) == NOTES_AT_ONCE and now - times[0] < _NOTES_WITHIN:
            self._suppress(about)
            return
        times.append(now)
        self.info(text + self._repetitions(about))

    def _logger_of(self, text: str) -> Any:
        if self._public.names_folders(text):
            return self._local_logger
        return self._node_logger

    def _suppress(self, about: str) -> None:
        self._suppressed[about] = self._suppressed.get(about, 0) + 1

    def _repetitions(self, about: str) -> str:
        """Return how many lines of a kind were not written since the last one, in words."""
        count = self._suppressed.pop(about, 0)
        return f" ({count} more like this were not written)" if count else ""


class Guard:
    """Contains errors of callbacks, counts them and logs them.

    Attributes:
        contained: count of requests and messages that would have ended the node, or were refused
            for their size.
        log: log of the node.
    """

    def __init__(self, node: Node, log: Log) -> None:
        """Guard everything that rclpy has created in a node by itself.

        ROS has no other way than to exchange the attribute `callback`; a test names the version of
        rclpy for which it was tried.
        """
        self.contained = 0
        self.log = log
        self._entries = Budget(ENTRIES_PER_SECOND)
        name = node.get_logger().name
        self._loggers = (name, _local(name), *_LIBRARIES)
        for service in node.services:
            service.callback = self._bounded(service.service_name, service.callback)
        # There is one for /clock with use_sim_time, and none otherwise.
        for subscription in node.subscriptions:
            subscription.callback = self.callback(
                subscription.callback, f"{subscription.topic_name} is ignored"
            )

    def warn(self, about: str, text: str) -> None:
        """Log a warning, unless one about the same was logged a moment ago."""
        self.log.warn(about, text)

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
        """Return a service callback that refuses requests that are too large or too many."""
        contained = self.callback(answer, name, _refusal)

        def bounded(request: Any, response: Any) -> Any:
            _require_small(request)
            self._require_known_loggers(request)
            self._require_few(request)
            if not isinstance(request, SetParameters.Request):
                return contained(request, response)
            # One at a time: a bad entry does not take the others with it.
            for entry in request.parameters:
                single = SetParameters.Request(parameters=[entry])
                results = contained(single, SetParameters.Response()).results
                response.results.extend(results)
            return response

        return self.callback(bounded, name, _refusal)

    def _require_few(self, request: Any) -> None:
        """Refuse what would keep the thread that answers busy."""
        cost = max(_entries(request), 1)
        if isinstance(request, SetParameters.Request):
            cost *= COST_OF_A_CHANGE
        if not self._entries.spend(cost):
            raise InputError(
                f"busy: more than {ENTRIES_PER_SECOND} entries of requests a second"
            )

    def _require_known_loggers(self, request: Any) -> None:
        """Refuse levels of loggers that would fill a disk, hide errors or take memory."""
        if not isinstance(request, SetLoggerLevels.Request):
            return
        for entry in request.levels:
            if entry.name not in self._loggers:
                # ROS would keep the level of every name that anyone thinks of.
                raise InputError(
                    f"logger {printable(entry.name[:_NAME_SHOWN])!r} does not exist; there is "
                    f"{', '.join(self._loggers)}"
                )
            if entry.level < LoggerLevel.LOG_LEVEL_INFO:
                raise InputError(
                    f"logger {entry.name!r}: level {entry.level} is below info; give it at the "
                    "start by --log-level"
                )
            if entry.level > LoggerLevel.LOG_LEVEL_ERROR:
                raise InputError(
                    f"logger {entry.name!r}: level {entry.level} is above error and would hide "
                    "errors"
                )


def _local(name: str) -> str:
    """Return the logger of a node whose lines stay on the machine."""
    return f"{name}.local"


def _entries(request: Any) -> int:
    return max(len(getattr(request, name, ())) for name in _ENTRY_FIELDS)


def _require_small(request: Any) -> None:
    entries = _entries(request)
    if entries > ENTRIES_LIMIT:
        raise InputError(f"{entries} entries; allowed are {ENTRIES_LIMIT}")
    size = len(serialize_message(request))
    if size > RAW_LIMIT:
        raise InputError(f"{size} bytes; allowed are {RAW_LIMIT}")


def _refusal(reason: str, request: Any, response: Any) -> Any:
    """Fill in a response; a response without a field for the reason stays empty, as in rclpy."""
    refused = SetParametersResult(successful=False, reason=reason)
    if isinstance(request, SetLoggerLevels.Request):
        not_set = SetLoggerLevelsResult(successful=False, reason=reason)
        response.results = [not_set] * len(request.levels)
    elif hasattr(response, "results"):
        response.results = [refused] * len(request.parameters)
    elif hasattr(response, "failure_reason"):
        response.failure_reason = reason
    elif isinstance(getattr(response, "result", None), SetParametersResult):
        response.result = refused
    return response
