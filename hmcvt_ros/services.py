# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The services of the node: each answers with a JSON object in `message`."""

import json
import re
import types
from collections.abc import Awaitable, Callable, Generator, Iterator
from concurrent.futures import CancelledError, Future
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from std_srvs.srv import Trigger

from hmcvt_core import EfficiencyMap, EfficiencyModel, HmcvtError, InputError
from hmcvt_core.files import plain

from . import jobs
from .bench_log import Recorder
from .diagnostics import Activity, Job, Staged, gap_values
from .model_store import ModelStore, utc_now
from .parameters import ADOPT, Settings
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
        announce: Callable[[Settings, EfficiencyMap], None],
        warn: Callable[[str, str], None],
    ) -> None:
        self._node, self._store, self._log, self._activity = node, store, log, activity
        self._settings, self._announce, self._warn = settings, announce, warn
        self._folder = log.log.path.parent
        self._worker = Worker()
        self._served = 0  # requests that have no reply yet
        # Of their own group: one that awaits a job would hold up all else in the node's default
        # group; and re-entrant: a second request is refused while the first is being served.
        group = ReentrantCallbackGroup()
        for work in (
            self.reidentify,
            self.diagnose,
            self.adopt,
            self.revert,
            self.clear_samples,
            self.cancel,
        ):
            node.create_service(
                Trigger,
                f"~/{work.__name__}",
                self._answering(work),
                callback_group=group,
            )

    def poll(self) -> None:
        """End a job that must not go on; from the node's timer."""
        job = self._activity.job
        if (
            job is not None
            and job.working
            and not job.ended
            and (why := self._trouble(job))
        ):
            self._end(job, why)

    def close(self) -> None:
        """Kill a running job."""
        self._worker.kill(wait=True)

    # --- services -----------------------------------------------------------------------------

    async def reidentify(self) -> Data:
        """Refit the model in service to the bench samples, and adopt or stage the refit."""
        settings, before = self._settings(), self._store.in_service.path
        with self._under_way("reidentify"):
            output = await self._on_disk(self._store.new_path)
            result = await self._in_worker(
                jobs.reidentify,
                base=self._store.reference,
                output=output,
                candidates=self._folder / "candidates",
                min_samples=settings.reidentify_min_samples,
                max_drift=settings.reidentify_max_drift,
            )
            if "refused" in result:
                raise _NotAdoptedError(result)
            refit = Staged(output, result["model"], before)
            result["staged"] = settings.reidentify_mode != ADOPT
            if result["staged"]:
                self._activity.staged = refit
            else:
                await self._put_into_service(lambda: self._store.adopt(*refit))
        return result

    async def adopt(self) -> Data:
        """Put the refit staged last into service."""
        staged = self._activity.staged
        if staged is None:
            raise HmcvtError(
                "no refit is staged; ~/reidentify with reidentify_mode = stage does"
            )
        return await self._put_into_service(lambda: self._store.adopt(*staged))

    async def diagnose(self) -> Data:
        """Say why model and bench samples disagree."""
        fingerprint = self._store.in_service.model.fingerprint
        with self._under_way("diagnose"):
            result = await self._in_worker(
                jobs.diagnose, reports=self._folder / "reports"
            )
        self._activity.gap = gap_values(result, fingerprint, utc_now())
        return result

    async def revert(self) -> Data:
        """Put the model before into service."""
        return await self._put_into_service(self._store.revert)

    async def clear_samples(self) -> Data:
        """Begin a new bench log and keep the old one beside it."""
        with self._under_way(
            "clear_samples"
        ):  # a job must not end with samples that are gone
            count, kept = await self._on_disk(self._log.set_aside)
            self._activity.staged = None
        return {"cleared": count, "kept_as": None if kept is None else str(kept)}

    async def cancel(self) -> Data:
        """End the refit or diagnosis under way."""
        job = self._activity.job
        if job is None:
            raise HmcvtError("nothing to cancel: no job is running")
        if not job.working:
            raise HmcvtError(f"{job}, and waits for a disk now: it cannot be ended")
        self._end(job, _CANCELLED)
        return {"cancelled": job.name, "seconds": round(job.seconds, 3)}

    # --- helpers ------------------------------------------------------------------------------

    def _answering(self, work: Callable[[], Awaitable[Data]]) -> Callable[..., Any]:
        """Make a service callback of what returns the answer or raises why there is none."""
        name, logger = work.__name__, self._node.get_logger()

        async def serve(
            request: Trigger.Request, response: Trigger.Response
        ) -> Trigger.Response:
            self._served += 1
            try:
                if self._served > MOST_WAITING:
                    raise HmcvtError(
                        f"busy: {MOST_WAITING} requests wait already for the disk"
                    )
                answer = await work()
                end = self._told(answer)
                logger.info(f"{name}: {end}")
                response.success = True
            except Exception as error:  # of any kind: it must not end the node
                expected = isinstance(error, (HmcvtError, OSError))
                text = str(error) if expected else f"{type(error).__name__}: {error}"
                answer = {"error": text, **getattr(error, "found", {})}
                how = "not adopted" if isinstance(error, _NotAdoptedError) else "failed"
                end = f"{how}: {text}"
                # Who is refused may ask again at once, and for ever: that must not fill a disk.
                self._warn(f"{name} {text.startswith('busy')}", f"{name}: {text}")
            finally:
                self._served -= 1
            if name in self._activity.ends:
                self._activity.ends[name] = f"{utc_now()}, {end}"
            response.message = self._without_folders(
                json.dumps(plain(answer), allow_nan=False)
            )
            return response

        return serve

    def _without_folders(self, text: str) -> str:
        """Name files as within the state folder: where that is is nobody's business."""
        for folder in (self._folder.resolve(), self._folder):
            text = text.replace(json.dumps(f"{folder}/")[1:-1], "")
        return _FOLDERS.sub("", text)

    @contextmanager
    def _under_way(self, name: str) -> Iterator[None]:
        if self._activity.job is not None:
            raise HmcvtError(f"busy: {self._activity.job}")
        self._activity.job = Job(name)
        try:
            yield
        finally:
            self._activity.job = None

    def _trouble(self, job: Job) -> str:
        """Say why the worker must not go on; empty when it may."""
        limit = self._settings().job_time_limit
        if job.seconds > limit:
            return f"ended after job_time_limit = {limit:g} s"
        # Twice: whoever stops and continues node and worker together means no harm.
        before, job.stopped = job.stopped, self._worker.stopped
        return (
            "the worker process was stopped by a signal, and has been ended"
            if (before and job.stopped)
            else ""
        )

    def _end(self, job: Job, why: str) -> None:
        job.ended = why
        self._worker.kill()

    async def _in_worker(self, work: Callable[..., Data], **options: Any) -> Data:
        """Let the worker do the job under way, without blocking the executor."""
        job, settings = self._activity.job, self._settings()
        assert job is not None
        samples = await self._on_disk(self._samples)
        self._activity.trouble = ""
        job.working = True
        try:
            running = self._worker.submit(
                jobs.with_proven,
                settings.job_memory_limit,
                work=work,
                promised=self._store.promised,
                effects=settings.effects_file,
                samples=samples,
                seed=settings.reidentify_seed,
                **options,
            )
            self._node.get_logger().info(f"{job.name}: started on {samples}")
            done: Data = await _finished(running)
        except (BrokenProcessPool, CancelledError):
            job.ended = job.ended or (
                f"the worker process ended with status {self._worker.exit_status}"
            )
        except MemoryError:
            job.ended = (
                "ended, for it needs more than job_memory_limit = "
                f"{settings.job_memory_limit} MiB"
            )
        finally:
            job.working = False
        if job.ended:
            if job.ended != _CANCELLED:
                self._activity.trouble = f"{job.name}: {job.ended}"
            raise HmcvtError(f"{job.name}: {job.ended}")
        return {**done, "seconds": round(job.seconds, 3)}

    async def _on_disk(self, work: Callable[..., Any], *arguments: Any) -> Any:
        """Do in the thread that waits for disks, after all samples that came before."""
        return await _finished(self._log.call(work, *arguments))

    def _samples(self) -> Path:
        """Return the samples of a job, as they were written."""
        name, log = self._settings().samples_file, self._log.log
        if not name:
            log.check()
            if not len(log):
                raise InputError("no bench samples logged yet (topic bench_sample)")
            return log.path
        folder = self._folder.resolve()
        path = (folder / name).resolve()
        # Parameters can be set from the network: they must not reach files elsewhere.
        if not path.is_relative_to(folder):
            raise InputError(f"samples_file = {name!r} lies outside the state folder")
        if path.exists() and not path.is_file():  # to read it might never end
            raise InputError(f"samples_file = {name!r} is no regular file")
        return path

    def _told(self, result: Data) -> str:
        """What the log and diagnostics say of an answer."""
        if "verdict" in result:
            report = result["report"] or f"not written: {result['report_error']}"
            cause = self._activity.gap["gap leading cause"]
            return f"{result['verdict']}, leading cause {cause}; report {report}"
        if "file" not in result:
            return "done"
        basis = f"{result['samples']} samples, " if "samples" in result else ""
        state = "waits for ~/adopt" if result.get("staged") else "in service"
        return f"{basis}{result['file']} ({result['model']}) {state}"

    async def _put_into_service(self, change: Callable[[], EfficiencyModel]) -> Data:
        """Change the model; tell everyone of it, and the caller of its name and file."""
        settings = self._settings()
        grid = await self._on_disk(lambda: change().efficiency_map(*settings.map_axes))
        self._activity.staged = None  # it was compared with the one before
        self._announce(settings, grid)
        now = self._store.in_service
        return {"model": now.model.fingerprint, "file": str(now.path)}


@types.coroutine
def _finished(running: Future[Any]) -> Generator[None, None, Any]:
    """Wait for what another thread or process does.

    The executor looks after its coroutines whenever it wakes up, which the node's timer sees to.
    """
    while not running.done():
        yield
    return running.result()
