# SPDX-License-Identifier: Apache-2.0
"""The services of the node: each answers with a JSON object in `message`."""

from __future__ import annotations

import json
import time
from collections.abc import Awaitable, Callable
from concurrent.futures import Future as Running
from concurrent.futures import ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.task import Future
from std_srvs.srv import Trigger

from hmcvt_core import EfficiencyMap, HmcvtError, InputError
from hmcvt_core.files import plain

from . import jobs
from .bench_log import BenchLog
from .diagnostics import Activity, gap_values
from .model_store import ModelStore, utc_now
from .parameters import Settings
from .worker import Worker

Data = dict[str, Any]


class _NotAdoptedError(HmcvtError):
    """A refit that is worse than the model in service; `found` tells what was compared."""

    def __init__(self, found: Data) -> None:
        super().__init__(found["refused"])
        self.found = {key: value for key, value in found.items() if key != "refused"}


class Services:
    """`~/reidentify`, `~/diagnose`, `~/revert` and `~/clear_samples`.

    None takes a file name: whoever can reach the node over the network can call them. Refits and
    diagnoses are done by the worker process, changes of model by a thread, which waits for disks.
    """

    def __init__(
        self,
        node: Node,
        store: ModelStore,
        log: BenchLog,
        activity: Activity,
        settings: Callable[[], Settings],
        announce: Callable[[Settings, EfficiencyMap | None], None],
    ) -> None:
        self._node, self._store, self._log, self._activity = node, store, log, activity
        self._settings, self._announce = settings, announce
        self._folder = log.path.parent
        self._worker, self._thread = Worker(), ThreadPoolExecutor(1)
        self._waiting: list[tuple[Running[Any], Future]] = []
        self._job, self._started = "", 0.0  # of the worker; empty when it has none
        # Of their own group: one that awaits a job would hold up all else in the node's default
        # group; and re-entrant: a second request is refused while the first is being served.
        group = ReentrantCallbackGroup()
        for work in (self.reidentify, self.diagnose, self.revert, self.clear_samples):
            node.create_service(Trigger, f"~/{work.__name__}", self._answering(work),
                                callback_group=group)

    def poll(self) -> None:
        """Hand on what has been done; from the node's timer.

        A coroutine that waits only goes on when the executor wakes up, which the timer sees to.
        """
        for running, answer in [item for item in self._waiting if item[0].done()]:
            self._waiting.remove((running, answer))
            answer.set_result(None)
        self._activity.running = self._running()

    def close(self) -> None:
        """Kill a running job; finish a change of model that has begun."""
        self._worker.kill()
        self._thread.shutdown(cancel_futures=True)

    # --- services -----------------------------------------------------------------------------

    async def reidentify(self) -> Data:
        """Refit the model in service to the bench samples and put the refit into service."""
        settings, before = self._settings(), self._store.in_service.path
        try:
            output = self._store.new_path()
            result, refit, grid = await self._in_worker(
                jobs.reidentify, output=output, candidates=self._folder / "candidates",
                min_samples=settings.reidentify_min_samples, map_axes=settings.map_axes)
            if refit is None:
                raise _NotAdoptedError(result)
            await self._finished(self._thread.submit(self._store.adopt, output, before, refit))
        except (HmcvtError, OSError) as error:
            how = "not adopted" if isinstance(error, _NotAdoptedError) else "failed"
            self._activity.last_refit = f"{utc_now()}, {how}: {error}"
            raise
        self._announce(settings, grid)
        self._activity.last_refit = (
            f"{self._store.in_service.since}, {result['samples']} samples")
        return {**result, **self._in_service()}

    async def diagnose(self) -> Data:
        """Say why model and bench samples disagree."""
        fingerprint = self._store.in_service.model.fingerprint
        try:
            result, *_ = await self._in_worker(jobs.diagnose, reports=self._folder / "reports")
        except (HmcvtError, OSError) as error:
            self._activity.last_diagnosis = f"{utc_now()}, failed: {error}"
            raise
        self._activity.gap = gap_values(result, fingerprint, utc_now())
        self._activity.last_diagnosis = f"{utc_now()}, {result['verdict']}"
        return result

    async def revert(self) -> Data:
        """Put the model before into service."""
        settings = self._settings()
        grid = await self._finished(self._thread.submit(
            lambda: self._store.revert().efficiency_map(*settings.map_axes)))
        self._announce(settings, grid)
        return self._in_service()

    async def clear_samples(self) -> Data:
        """Begin a new bench log and keep the old one beside it."""
        count, kept = self._log.set_aside()
        return {"cleared": count, "kept_as": None if kept is None else str(kept)}

    # --- helpers ------------------------------------------------------------------------------

    def _answering(self, work: Callable[[], Awaitable[Data]]) -> Callable[..., Any]:
        """Make a service callback of what returns the answer or raises why there is none."""
        name, logger = work.__name__, self._node.get_logger()

        async def serve(
            request: Trigger.Request, response: Trigger.Response
        ) -> Trigger.Response:
            try:
                answer = await work()
                logger.info(f"{name}: {self._told(answer)}")
                response.success = True
            except Exception as error:  # of any kind: it must not end the node
                expected = isinstance(error, (HmcvtError, OSError))
                text = str(error) if expected else f"{type(error).__name__}: {error}"
                answer = {"error": text, **getattr(error, "found", {})}
                logger.warning(f"{name}: {text}")
            response.message = json.dumps(plain(answer), allow_nan=False)
            return response

        return serve

    def _running(self) -> str:
        """What the worker does and for how long; empty when nothing."""
        seconds = time.monotonic() - self._started
        return f"{self._job} has been running for {seconds:.1f} s" if self._job else ""

    async def _in_worker(self, job: Callable[..., jobs.Done], **options: Any) -> jobs.Done:
        """Run a job of the worker and wait for its answer without blocking the executor."""
        samples = self._samples()
        if self._job:
            raise HmcvtError(f"busy: {self._running()}")
        running = self._worker.submit(
            job, samples=samples, model=self._store.in_service.path,
            seed=self._settings().reidentify_seed, **options)
        self._job, self._started = job.__name__, time.monotonic()
        self._node.get_logger().info(f"{self._job}: started on {samples}")
        try:
            done: jobs.Done = await self._finished(running)
        except BrokenProcessPool:
            raise HmcvtError("the worker process ended with status "
                             f"{self._worker.exit_status}") from None
        finally:
            self._job = ""
        done.answer["seconds"] = round(time.monotonic() - self._started, 3)
        return done

    async def _finished(self, running: Running[Any]) -> Any:
        answer = Future(executor=self._node.executor)
        self._waiting.append((running, answer))
        await answer
        return running.result()

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
        if "verdict" in result:
            report = result["report"] or f"not written: {result['report_error']}"
            cause = self._activity.gap["gap leading cause"]
            return f"{result['verdict']}, leading cause {cause}; report {report}"
        return "done"

    def _in_service(self) -> Data:
        now = self._store.in_service
        return {"model": now.model.fingerprint, "file": str(now.path)}
