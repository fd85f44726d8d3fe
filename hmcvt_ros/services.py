# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The services of the node: each answers with a JSON object in `message`."""

from __future__ import annotations

import json
import re
import time
from collections.abc import Awaitable, Callable, Iterator
from concurrent.futures import CancelledError
from concurrent.futures import Future as Running
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.task import Future
from std_srvs.srv import Trigger

from hmcvt_core import EfficiencyMap, EfficiencyModel, HmcvtError, InputError
from hmcvt_core.files import plain

from . import jobs
from .diagnostics import Activity, gap_values
from .model_store import ModelStore, servable, utc_now
from .parameters import ADOPT, Settings
from .recorder import Recorder
from .worker import Worker

Data = dict[str, Any]
MOST_WAITING = 50
"""Requests that may wait for a disk together."""

_CANCELLED = "ended by ~/cancel"
_FOLDERS = re.compile(r"""(?<![\w~./)-])(?:/[^/\s"']+)+/""")  # of an absolute path


class _NotAdoptedError(HmcvtError):
    """A refit that must not serve; `found` tells what was compared."""

    def __init__(self, found: Data) -> None:
        super().__init__(found["refused"])
        self.found = {key: value for key, value in found.items() if key != "refused"}


@dataclass
class _Job:
    """What is under way for a caller; one at a time.

    Attributes:
        name: of the service.
        started: when, by the monotonic clock [s].
        working: whether the worker does it; else it waits for a disk.
        stopped: whether the worker was found stopped.
        ended: why before its end; empty when it was not.
    """

    name: str
    started: float
    working: bool = False
    stopped: bool = False
    ended: str = ""

    def __str__(self) -> str:
        return f"{self.name} has been running for {time.monotonic() - self.started:.1f} s"


class _Staged(NamedTuple):
    """A refit that waits for `~/adopt`: its file, and what it is to take the place of."""

    path: Path
    instead_of: Path
    fingerprint: str


class Services:
    """The services of the node; each method without an underscore up to `cancel` is one.

    None takes a file name: whoever can reach the node over the network can call them. Refits and
    diagnoses are done by the worker process, the rest by the thread that waits for disks.
    """

    def __init__(
        self,
        node: Node,
        store: ModelStore,
        log: Recorder,
        activity: Activity,
        settings: Callable[[], Settings],
        announce: Callable[[Settings, EfficiencyMap | None], None],
    ) -> None:
        self._node, self._store, self._log, self._activity = node, store, log, activity
        self._settings, self._announce = settings, announce
        self._folder = log.path.parent
        self._worker = Worker()
        self._waiting: list[tuple[Running[Any], Future]] = []
        self._job: _Job | None = None
        self._staged: _Staged | None = None
        # Of their own group: one that awaits a job would hold up all else in the node's default
        # group; and re-entrant: a second request is refused while the first is being served.
        group = ReentrantCallbackGroup()
        for work in (self.reidentify, self.diagnose, self.adopt, self.revert, self.clear_samples,
                     self.cancel):
            node.create_service(Trigger, f"~/{work.__name__}", self._answering(work),
                                callback_group=group)

    def poll(self) -> None:
        """End a job that must not go on, hand on what has been done; from the node's timer.

        A coroutine that waits only goes on when the executor wakes up, which the timer sees to.
        """
        if self._job and self._job.working and not self._job.ended:
            self._end(self._job, self._trouble(self._job))
        for running, answer in [item for item in self._waiting if item[0].done()]:
            self._waiting.remove((running, answer))
            answer.set_result(None)
        working = self._job is not None and self._job.working
        self._activity.running = str(self._job) if working else ""
        staged = self._staged
        self._activity.staged = f"{staged.path} ({staged.fingerprint})" if staged else ""

    def close(self) -> None:
        """Kill a running job."""
        self._worker.kill()

    # --- services -----------------------------------------------------------------------------

    async def reidentify(self) -> Data:
        """Refit the model in service to the bench samples, and adopt or stage the refit."""
        settings, before = self._settings(), self._store.in_service.path
        try:
            with self._under_way("reidentify"):
                output = await self._on_disk(self._store.new_path)
                result, refit, grid = await self._in_worker(
                    jobs.reidentify, base=self._store.reference, output=output,
                    candidates=self._folder / "candidates",
                    min_samples=settings.reidentify_min_samples, map_axes=settings.map_axes,
                    max_drift=settings.reidentify_max_drift)
                if refit is None:
                    raise _NotAdoptedError(result)
                result["staged"] = settings.reidentify_mode != ADOPT
                if result["staged"]:
                    self._staged = _Staged(output, before, refit.fingerprint)
                else:
                    await self._on_disk(self._store.adopt, output, before, refit)
        except Exception as error:
            how = "not adopted" if isinstance(error, _NotAdoptedError) else "failed"
            self._activity.last_refit = f"{utc_now()}, {how}: {error}"
            raise
        if result["staged"]:
            self._activity.last_refit = f"{utc_now()}, {result['samples']} samples, staged"
            return {**result, "model": refit.fingerprint, "file": str(output)}
        in_service = self._changed(settings, grid)
        self._activity.last_refit = (
            f"{self._store.in_service.since}, {result['samples']} samples")
        return {**result, **in_service}

    async def adopt(self) -> Data:
        """Put the refit staged last into service."""
        settings, staged = self._settings(), self._staged
        if staged is None:
            raise HmcvtError("no refit is staged; ~/reidentify with reidentify_mode = stage does")
        grid = await self._on_disk(
            lambda: self._put_into_service(staged).efficiency_map(*settings.map_axes))
        return self._changed(settings, grid)

    async def diagnose(self) -> Data:
        """Say why model and bench samples disagree."""
        fingerprint = self._store.in_service.model.fingerprint
        try:
            with self._under_way("diagnose"):
                result, *_ = await self._in_worker(
                    jobs.diagnose, reports=self._folder / "reports")
        except Exception as error:
            self._activity.last_diagnosis = f"{utc_now()}, failed: {error}"
            raise
        self._activity.gap = gap_values(result, fingerprint, utc_now())
        self._activity.last_diagnosis = f"{utc_now()}, {result['verdict']}"
        return result

    async def revert(self) -> Data:
        """Put the model before into service."""
        settings = self._settings()
        grid = await self._on_disk(
            lambda: self._store.revert().efficiency_map(*settings.map_axes))
        return self._changed(settings, grid)

    async def clear_samples(self) -> Data:
        """Begin a new bench log and keep the old one beside it."""
        with self._under_way("clear_samples"):  # a job must not end with samples that are gone
            count, kept = await self._on_disk(self._log.set_aside)
            self._staged = None
        return {"cleared": count, "kept_as": None if kept is None else str(kept)}

    async def cancel(self) -> Data:
        """End the refit or diagnosis under way."""
        job = self._job
        if job is None:
            raise HmcvtError("nothing to cancel: no job is running")
        if not job.working:
            raise HmcvtError(f"{job}, and waits for a disk now: it cannot be ended")
        self._end(job, _CANCELLED)
        return {"cancelled": job.name, "seconds": round(time.monotonic() - job.started, 3)}

    # --- helpers ------------------------------------------------------------------------------

    def _answering(self, work: Callable[[], Awaitable[Data]]) -> Callable[..., Any]:
        """Make a service callback of what returns the answer or raises why there is none."""
        name, logger = work.__name__, self._node.get_logger()

        async def serve(
            request: Trigger.Request, response: Trigger.Response
        ) -> Trigger.Response:
            try:
                if len(self._waiting) >= MOST_WAITING:
                    raise HmcvtError(f"busy: {MOST_WAITING} requests wait already for the disk")
                answer = await work()
                logger.info(f"{name}: {self._told(answer)}")
                response.success = True
            except Exception as error:  # of any kind: it must not end the node
                expected = isinstance(error, (HmcvtError, OSError))
                text = str(error) if expected else f"{type(error).__name__}: {error}"
                answer = {"error": text, **getattr(error, "found", {})}
                logger.warning(f"{name}: {text}")
            response.message = self._without_folders(json.dumps(plain(answer), allow_nan=False))
            return response

        return serve

    def _without_folders(self, text: str) -> str:
        """Name files as within the state folder: where that is is nobody's business."""
        for folder in (self._folder.resolve(), self._folder):
            text = text.replace(json.dumps(f"{folder}/")[1:-1], "")
        return _FOLDERS.sub("", text)

    @contextmanager
    def _under_way(self, name: str) -> Iterator[None]:
        if self._job is not None:
            raise HmcvtError(f"busy: {self._job}")
        self._job = _Job(name, time.monotonic())
        try:
            yield
        finally:
            self._job = None

    def _trouble(self, job: _Job) -> str:
        """Say why the worker must not go on; empty when it may."""
        limit = self._settings().job_time_limit
        if time.monotonic() - job.started > limit:
            return f"ended after job_time_limit = {limit:g} s"
        # Twice: whoever stops and continues node and worker together means no harm.
        before, job.stopped = job.stopped, self._worker.stopped
        return "the worker process was stopped by a signal, and has been ended" if (
            before and job.stopped) else ""

    def _end(self, job: _Job, why: str) -> None:
        if why:
            job.ended = why
            self._worker.kill()

    async def _in_worker(self, work: Callable[..., jobs.Done], **options: Any) -> jobs.Done:
        """Let the worker do the job under way, without blocking the executor."""
        job, settings = self._job, self._settings()
        assert job is not None
        samples, model = await self._on_disk(self._material)
        self._activity.trouble = ""
        job.working = True
        try:
            running = self._worker.submit(
                work, settings.job_memory_limit, samples=samples, model=model,
                seed=settings.reidentify_seed, **options)
            self._node.get_logger().info(f"{job.name}: started on {samples}")
            done: jobs.Done = await self._finished(running)
        except (BrokenProcessPool, CancelledError):
            job.ended = job.ended or ("the worker process ended with status "
                                      f"{self._worker.exit_status}")
        except MemoryError:
            job.ended = ("ended, for it needs more than job_memory_limit = "
                         f"{settings.job_memory_limit} MiB")
        finally:
            job.working = False
        if job.ended:
            if job.ended != _CANCELLED:
                self._activity.trouble = f"{job.name}: {job.ended}"
            raise HmcvtError(f"{job.name}: {job.ended}")
        done.answer["seconds"] = round(time.monotonic() - job.started, 3)
        return done

    async def _on_disk(self, work: Callable[..., Any], *arguments: Any) -> Any:
        """Do in the thread that waits for disks, after all samples that came before."""
        return await self._finished(self._log.call(work, *arguments))

    async def _finished(self, running: Running[Any]) -> Any:
        answer = Future(executor=self._node.executor)
        self._waiting.append((running, answer))
        await answer
        return running.result()

    def _material(self) -> tuple[Path, Path]:
        """Return the samples and the model of a job, both as they were written."""
        return self._samples(), self._store.proven()

    def _samples(self) -> Path:
        name = self._settings().samples_file
        if not name:
            if self._log.checked() == 0:
                raise InputError("no bench samples logged yet (topic bench_sample)")
            return self._log.path
        folder = self._folder.resolve()
        path = (folder / name).resolve()
        # Parameters can be set from the network: they must not reach files elsewhere.
        if not path.is_relative_to(folder):
            raise InputError(f"samples_file = {name!r} lies outside the state folder")
        return path

    def _told(self, result: Data) -> str:
        """What the log says of an answer."""
        if result.get("staged"):
            return f"{result['file']} ({result['model']}) waits for ~/adopt"
        if "file" in result:
            return f"{result['file']} ({result['model']}) in service"
        if "verdict" in result:
            report = result["report"] or f"not written: {result['report_error']}"
            cause = self._activity.gap["gap leading cause"]
            return f"{result['verdict']}, leading cause {cause}; report {report}"
        return "done"

    def _put_into_service(self, staged: _Staged) -> EfficiencyModel:
        model = servable(staged.path)
        if model.fingerprint != staged.fingerprint:
            raise InputError(f"{staged.path}: is not the refit that was staged")
        return self._store.adopt(staged.path, staged.instead_of, model)

    def _changed(self, settings: Settings, grid: EfficiencyMap | None) -> Data:
        """Tell everyone of another model in service, and the caller of its name and file."""
        self._staged = None  # it was compared with the one before
        self._announce(settings, grid)
        now = self._store.in_service
        return {"model": now.model.fingerprint, "file": str(now.path)}
