# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The actions of the optional package hmcvt_msgs: a refit and a diagnosis that can be cancelled."""

import json
import math
from collections.abc import Awaitable, Callable
from types import ModuleType
from typing import Any

from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node

from .diagnostics import Job
from .guard import Log
from .services import Data, Reply, Services

RESULT_KEPT = 60
"""Time for which a client can ask for a result [s]."""


def refit_result(kind: Any, reply: Reply) -> Any:
    """Return the result of Refit.

    Args:
        kind: class of the result.
        reply: that of `~/reidentify`.
    """
    data = json.loads(reply.message)
    result = kind(reply=reply.message)
    result.reason = data.get("error") or data.get("doubt") or ""
    result.outcome = kind.FAILED
    if reply.success:
        result.outcome = kind.STAGED if data["staged"] else kind.ADOPTED
    elif "candidate" in data:
        result.outcome = kind.REFUSED
    result.model = data.get("model", "")
    result.file = data.get("file") or data.get("candidate") or ""
    result.samples = data.get("samples", 0)
    result.warnings = data.get("warnings", [])
    for name in ("error_before", "error_after", "largest_change"):
        setattr(result, name, float(data.get(name, math.nan)))
    return result


def diagnose_result(kind: Any, reply: Reply) -> Any:
    """Return the result of Diagnose.

    Args:
        kind: class of the result.
        reply: that of `~/diagnose`.
    """
    data = json.loads(reply.message)
    result = kind(reply=reply.message, probability=math.nan)
    result.reason = data.get("error", "")
    result.verdict = data.get("verdict", "")
    for leading in data.get("sets", [])[:1]:
        result.effects = leading["effects"]
        result.probability = float(leading["probability"])
    result.report = data.get("report") or ""
    return result


class Actions:
    """The actions `~/reidentify` and `~/diagnose`; each does what the service of its name does."""

    def __init__(
        self, node: Node, kinds: ModuleType, services: Services, lines: Log
    ) -> None:
        """Create the actions.

        Args:
            node: node that offers them.
            kinds: module hmcvt_msgs.action.
            services: do the work.
            lines: log of the node.
        """
        self._services = services
        self._lines = lines
        self._goal: ServerGoalHandle | None = None  # whose job is under way
        self._feedback: Any = None  # class of its feedback
        services.progress.listener = self._report
        self._servers = []
        for kind, work, result_of in (
            (kinds.Refit, services.reidentify, refit_result),
            (kinds.Diagnose, services.diagnose, diagnose_result),
        ):
            server = ActionServer(
                node,
                kind,
                f"~/{work.__name__}",
                self._executing(kind, work, result_of),
                goal_callback=self._take,
                cancel_callback=self._cancel,
                result_timeout=RESULT_KEPT,
            )
            self._servers.append(server)

    def destroy(self) -> None:
        """Remove the actions from the node."""
        self._goal = None
        while self._servers:
            self._servers.pop().destroy()

    def _take(self, request: Any) -> GoalResponse:
        """Reject a goal while a job is under way, or beyond the limit to requests."""
        refusal = self._services.too_many()
        if self._services.job is not None:
            refusal = f"busy: {self._services.job}"
        if refusal:
            self._lines.warn("goal", f"a goal is rejected: {refusal}")
            return GoalResponse.REJECT
        return GoalResponse.ACCEPT

    def _executing(
        self,
        kind: Any,
        work: Callable[[], Awaitable[Data]],
        result_of: Callable[[Any, Reply], Any],
    ) -> Callable[[ServerGoalHandle], Awaitable[Any]]:
        """Return the callback that reaches a goal of an action."""

        async def execute(goal: ServerGoalHandle) -> Any:
            if goal.is_cancel_requested:
                goal.canceled()
                return kind.Result(reason="cancelled before it began")
            # Where another job is under way, this one is refused at once.
            if self._services.job is None:
                self._goal = goal
                self._feedback = kind.Feedback
            try:
                reply = await self._services.answer(work)
            finally:
                if self._goal is goal:
                    self._goal = None
            if goal.is_cancel_requested:
                goal.canceled()
            elif reply.success:
                goal.succeed()
            else:
                goal.abort()
            return result_of(kind.Result, reply)

        return execute

    def _cancel(self, goal: ServerGoalHandle) -> CancelResponse:
        """End the job of a goal, unless its result is being put into service."""
        if goal is not self._goal:  # it has not begun
            return CancelResponse.ACCEPT
        job = self._services.job
        if job is None or job.computed:
            return CancelResponse.REJECT
        self._services.end(job)
        return CancelResponse.ACCEPT

    def _report(self, job: Job, state: str) -> None:
        """Publish how far a job is as feedback of its goal."""
        if self._goal is not None:
            seconds = round(job.seconds, 1)
            self._goal.publish_feedback(self._feedback(state=state, seconds=seconds))
