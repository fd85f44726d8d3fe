# SPDX-License-Identifier: Apache-2.0
"""The services of the node: each answers with a JSON object in `message`."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.task import Future
from std_srvs.srv import Trigger

from hmcvt_core.errors import HmcvtError, InputError

from .bench_log import BenchLog
from .diagnostics import Activity, GapSummary
from .json_text import json_text
from .model_store import ModelStore
from .parameters import Settings
from .refit import BackgroundJob

Data = dict[str, Any]


class _NotAdoptedError(HmcvtError):
    """A refit that is worse than the model in service; `found` tells what was compared."""

    def __init__(self, found: Data) -> None:
        super().__init__(found["refused"])
        self.found = {key: value for key, value in found.items() if key != "refused"}


class Services:
    """`~/reidentify`, `~/diagnose`, `~/revert` and `~/clear_samples`.

    None takes a file name: whoever can reach the node over the network can call them.
    """

    def __init__(
        self,
        node: Node,
        store: ModelStore,
        log: BenchLog,
        activity: Activity,
        settings: Callable[[], Settings],
        change_model: Callable[[Callable[[], object]], Awaitable[None]],
    ) -> None:
        self._node, self._store, self._log, self._activity = node, store, log, activity
        self._settings, self._change_model = settings, change_model
        self._folder = log.path.parent
        self._job = BackgroundJob()
        self._answer: Future | None = None
        # Of their own group: one that awaits a job would hold up all else in the node's default
        # group; and re-entrant: a second request is refused while the first is being served.
        group = ReentrantCallbackGroup()
        for work in (self.reidentify, self.diagnose, self.revert, self.clear_samples):
            node.create_service(Trigger, f"~/{work.__name__}", self._answering(work),
                                callback_group=group)

    def poll(self) -> None:
        """Look whether the background job has ended; from the node's timer.

        The coroutine that waits for it only goes on when the executor wakes up, which the timer
        that calls this sees to.
        """
        waiting = self._answer
        if waiting is not None and (result := self._job.poll()) is not None:
            self._answer = None
            waiting.set_result(result)
        self._activity.running = self._job.running

    def close(self) -> None:
        """Kill a running job."""
        self._job.cancel()

    # --- services -----------------------------------------------------------------------------

    async def reidentify(self) -> Data:
        """Refit the model in service to the bench samples and put the refit into service."""
        try:
            result = await self._refit()
        except _NotAdoptedError as error:
            self._activity.last_refit = f"{_utc_now()}, not adopted: {error}"
            raise
        except (HmcvtError, OSError) as error:
            self._activity.last_refit = f"{_utc_now()}, failed: {error}"
            raise
        self._activity.last_refit = (
            f"{self._store.in_service.since}, {result['samples']} samples")
        return {**result, **self._in_service()}

    async def _refit(self) -> Data:
        output, before = self._store.new_path(), self._store.path
        result = await self._in_background(
            "reidentify", output=str(output), candidates=str(self._folder / "candidates"),
            min_samples=self._settings().reidentify_min_samples)
        if "refused" in result:
            raise _NotAdoptedError(result)
        await self._change_model(lambda: self._store.adopt(output, instead_of=before))
        return result

    async def diagnose(self) -> Data:
        """Say why model and bench samples disagree."""
        fingerprint = self._store.model.fingerprint
        try:
            result = await self._in_background("diagnose", reports=str(self._folder / "reports"))
        except (HmcvtError, OSError) as error:
            self._activity.last_diagnosis = f"{_utc_now()}, failed: {error}"
            raise
        found = GapSummary.of(result, fingerprint, _utc_now())
        self._activity.gap = found
        self._activity.last_diagnosis = f"{found.time}, {found.verdict}"
        return result

    async def revert(self) -> Data:
        """Put the model before into service."""
        await self._change_model(self._store.revert)
        return self._in_service()

    async def clear_samples(self) -> Data:
        """Begin a new bench log and keep the old one beside it."""
        count, kept = self._log.set_aside()
        return {"cleared": count, "kept_as": None if kept is None else str(kept)}

    # --- helpers ------------------------------------------------------------------------------

    def _answering(self, work: Callable[[], Awaitable[Data]]) -> Callable[..., Any]:
        """Make a service callback of what returns the answer or raises why there is none."""
        name = work.__name__

        async def serve(
            request: Trigger.Request, response: Trigger.Response
        ) -> Trigger.Response:
            try:
                result = await work()
            except Exception as error:  # of any kind: it must not end the node
                expected = isinstance(error, (HmcvtError, OSError))
                text = str(error) if expected else f"{type(error).__name__}: {error}"
                self._node.get_logger().warning(f"{name}: {text}")
                found = error.found if isinstance(error, _NotAdoptedError) else {}
                response.success, response.message = False, json_text({"error": text, **found})
            else:
                self._node.get_logger().info(f"{name}: {self._told(result)}")
                response.success, response.message = True, json_text(result)
            return response

        return serve

    async def _in_background(self, job: str, **options: Any) -> Data:
        """Run a job of the worker and wait for its answer without blocking the executor."""
        request = {"job": job, "samples": str(self._samples()), "model": str(self._store.path),
                   "seed": self._settings().reidentify_seed, **options}
        self._job.start(request)
        self._node.get_logger().info(f"{job}: started on {request['samples']}")
        self._answer = Future(executor=self._node.executor)
        result: Data = await self._answer
        if "error" in result:
            raise HmcvtError(result["error"])
        return result

    def _samples(self) -> Path:
        name = self._settings().samples_file
        if not name:
            if len(self._log) == 0:
                raise InputError("no bench samples logged yet (topic bench_sample)")
            return self._log.path
        folder = self._folder.resolve()
        path = (folder / name).resolve()
        # Parameters can be set from the network: they must not reach files elsewhere.
        if not path.is_relative_to(folder):
            raise InputError(f"samples_file = {name!r} lies outside the state folder {folder}")
        return path

    def _told(self, result: Data) -> str:
        """What the log says of an answer."""
        if "file" in result:
            return f"{result['file']} ({result['model']}) in service"
        if "verdict" in result and self._activity.gap is not None:
            report = result["report"] or f"not written: {result['report_error']}"
            return (f"{result['verdict']}, leading cause {self._activity.gap.leading_cause}; "
                    f"report {report}")
        return "done"

    def _in_service(self) -> Data:
        now = self._store.in_service
        return {"model": now.model.fingerprint, "file": str(now.path)}


def _utc_now() -> str:
    return datetime.now(timezone.utc).strftime("%Y-%m-%dT%H:%M:%SZ")
