# SPDX-License-Identifier: Apache-2.0
"""The services of the node: each answers with a JSON object in `message`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.task import Future
from std_srvs.srv import Trigger

from hmcvt_core.errors import HmcvtError, InputError

from .bench_log import BenchLog
from .diagnostics import Activity
from .json_text import json_text
from .model_store import ModelStore
from .parameters import Settings
from .refit import BackgroundJob


class Services:
    """`~/reidentify`, `~/diagnose`, `~/revert` and `~/clear_samples`."""

    def __init__(
        self,
        node: Node,
        store: ModelStore,
        log: BenchLog,
        activity: Activity,
        settings: Callable[[], Settings],
        model_changed: Callable[[], None],
    ) -> None:
        self._node, self._store, self._log, self._activity = node, store, log, activity
        self._settings, self._model_changed = settings, model_changed
        self._job = BackgroundJob()
        self._answer: Future | None = None
        # Of their own group: one that awaits a job would hold up all else in the node's default
        # group; and re-entrant: a second request is refused while the first is being served.
        group = ReentrantCallbackGroup()
        for name, callback in (("reidentify", self._reidentify), ("diagnose", self._diagnose),
                               ("revert", self._revert), ("clear_samples", self._clear_samples)):
            node.create_service(Trigger, f"~/{name}", callback, callback_group=group)

    def poll(self) -> None:
        """Look whether the background job has ended; from the node's timer.

        The coroutine that waits for it only goes on when the executor wakes up, which the timer
        that calls this sees to.
        """
        self._activity.running = self._job.running
        result = self._job.poll()
        if result is not None and self._answer is not None:
            self._activity.running = ""
            self._answer.set_result(result)
            self._answer = None

    def close(self) -> None:
        """Kill a running job."""
        self._job.cancel()

    # --- services -----------------------------------------------------------------------------

    async def _reidentify(
        self, request: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        try:
            output = self._store.new_path()
            result = await self._in_background("reidentify", output=str(output), min_samples=
                                               self._settings().reidentify_min_samples)
            self._store.adopt(output)
        except (HmcvtError, OSError) as error:
            self._activity.last_refit = f"failed: {error}"
            return self._refused(response, "reidentify", error)
        self._activity.last_refit = f"{self._store.since}, {result['samples']} samples"
        self._model_changed()
        return self._done(response, "reidentify", {**result, **self._in_service()})

    async def _diagnose(
        self, request: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        try:
            return self._done(response, "diagnose", await self._in_background("diagnose"))
        except (HmcvtError, OSError) as error:
            return self._refused(response, "diagnose", error)

    def _revert(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        try:
            self._store.revert()
        except (HmcvtError, OSError) as error:
            return self._refused(response, "revert", error)
        self._model_changed()
        return self._done(response, "revert", self._in_service())

    def _clear_samples(
        self, request: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        try:
            count, kept = self._log.set_aside()
        except OSError as error:
            return self._refused(response, "clear_samples", error)
        kept_as = None if kept is None else str(kept)
        return self._done(response, "clear_samples", {"cleared": count, "kept_as": kept_as})

    # --- helpers ------------------------------------------------------------------------------

    async def _in_background(self, job: str, **options: Any) -> dict[str, Any]:
        """Run a job of the worker and wait for its answer without blocking the executor."""
        request = {"job": job, "samples": str(self._samples()), "model": str(self._store.path),
                   "seed": self._settings().reidentify_seed, **options}
        self._job.start(request)
        self._node.get_logger().info(f"{job}: started on {request['samples']}")
        self._answer = Future(executor=self._node.executor)
        result: dict[str, Any] = await self._answer
        if "error" in result:
            raise HmcvtError(result["error"])
        return result

    def _samples(self) -> Path:
        name = self._settings().samples_file
        if not name:
            if len(self._log) == 0:
                raise InputError("no bench samples logged yet (topic bench_sample)")
            return self._log.path
        folder = self._log.path.parent.resolve()
        path = (folder / name).resolve()
        # Parameters can be set from the network: they must not reach files elsewhere.
        if not path.is_relative_to(folder):
            raise InputError(f"samples_file = {name!r} lies outside the state folder {folder}")
        return path

    def _in_service(self) -> dict[str, str]:
        return {"model": self._store.model.fingerprint, "file": str(self._store.path)}

    def _done(
        self, response: Trigger.Response, name: str, result: Mapping[str, Any]
    ) -> Trigger.Response:
        response.success, response.message = True, json_text(result)
        self._node.get_logger().info(f"{name}: done")
        return response

    def _refused(
        self, response: Trigger.Response, name: str, error: Exception
    ) -> Trigger.Response:
        response.success, response.message = False, json_text({"error": str(error)})
        self._node.get_logger().warning(f"{name}: {error}")
        return response
