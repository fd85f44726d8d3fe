# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The services of the node: each answers with a JSON object in `message`."""

import json
import types
from collections.abc import Awaitable, Callable, Generator, Iterator
from concurrent.futures import CancelledError, Future
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.node import Node
from std_msgs.msg import String
from std_srvs.srv import Trigger

from hmcvt_core import EfficiencyModel, HmcvtError, InputError
from hmcvt_core.interface import plain

from . import jobs, qos
from .bench_log import require_intact
from .diagnostics import Activity, Job, Staged, gap_values
from .guard import Budget, Log
from .model_store import ModelStore, utc_now
from .parameters import ADOPT, Settings
from .public_text import PublicText
from .recorder import Recorder
from .worker import Worker

Data = dict[str, Any]
MAX_WAITING = 10
"""Requests that may wait for a disk together; rclpy looks at each of them at every message."""
REQUESTS_PER_SECOND = 50
"""Requests beyond which more are refused at once."""
PROGRESS_EVERY = 1.0
"""Time between two messages about a running job [s]."""

_PYTHON_FAILED = 1
"""Exit status of a process of Python that an error ended."""
_CANCELLED = "ended by ~/cancel"
_GOAL_CANCELLED = "ended, because its goal was cancelled"


class Progress:
    """Publishes how far a job is on `~/progress`, as a JSON object.

    Attributes:
        listener: called with the job and its state as well.
    """

    def __init__(self, node: Node, public: PublicText) -> None:
        """Create the topic on a node."""
        self.listener: Callable[[Job, str], None] = lambda job, state: None
        self._publisher = node.create_publisher(
            String,
            "~/progress",
            **qos.overridable(qos.LATCHED),
            event_callbacks=PublisherEventCallbacks(use_default_callbacks=False),
        )
        self._public = public
        self._next = 0.0  # seconds of the job at the next repetition

    def report(self, job: Job, state: str, **details: str) -> None:
        """Publish a new state of a job: started, running, done, refused, failed, ended early."""
        self._next = job.seconds + PROGRESS_EVERY
        data = {"job": job.name, "state": state, "seconds": round(job.seconds, 1)}
        text = json.dumps({**data, **details})
        self._publisher.publish(String(data=self._public(text)))
        self.listener(job, state)

    def repeat(self, job: Job) -> None:
        """Publish that a job is still running, once a second."""
        if job.seconds >= self._next:
            self.report(job, "running")


class _NotAdoptedError(HmcvtError):
    """A refit that must not serve; `details` holds what was compared."""

    def __init__(self, result: Data) -> None:
        super().__init__(result["refused"])
        self.details = {key: value for key, value in result.items() if key != "refused"}


class Reply(NamedTuple):
    """A reply to a request.

    Attributes:
        success: whether the work was done.
        message: JSON object without folders.
    """

    success: bool
    message: str


class Services:
    """The services of the node; each coroutine from `reidentify` to `cancel` is one.

    None takes a file name, because everyone on the network can call them. Refits and diagnoses are
    done by the worker process, the rest by the thread that waits for disks.

    Attributes:
        progress: publishes how far a job is.
    """

    def __init__(
        self,
        node: Node,
        store: ModelStore,
        log: Recorder,
        activity: Activity,
        settings: Callable[[], Settings],
        announce: Callable[[], None],
        lines: Log,
        public: PublicText,
        effects_checksum: str,
    ) -> None:
        """Create the services.

        Args:
            node: node that offers them.
            store: models of the node.
            log: log of the bench samples.
            activity: what the node does; kept up to date.
            settings: returns the parameters of the node.
            announce: called after a change of model.
            lines: log of the node.
            public: what of a text may leave the machine.
            effects_checksum: that of the file with effects, see `jobs.loaded_effects`.
        """
        self._node = node
        self._effects_checksum = effects_checksum
        self._store = store
        self._log = log
        self._activity = activity
        self._settings = settings
        self._announce = announce
        self._lines = lines
        self._public = public
        self._folder = log.log.path.parent
        self._worker = Worker()
        self.progress = Progress(node, public)
        self._unanswered = 0  # requests
        self._requests = Budget(REQUESTS_PER_SECOND)
        # A group apart: a service that awaits a job would block the node's default group. It is
        # re-entrant, so that a second request can be refused while the first is served.
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
                self._callback(work),
                callback_group=group,
            )

    def poll(self) -> None:
        """End a job that must not continue; called by the node's timer."""
        job = self._activity.job
        if job is None or not job.working or job.ended:
            return
        self.progress.repeat(job)
        reason = self._reason_to_end(job)
        if reason:
            self._end(job, reason)
        elif self._worker.starved:
            job.starved = True
            self._worker.kill()

    def close(self) -> None:
        """Kill a running job."""
        if self._activity.job is not None:
            self._activity.job.ended = "the node was closed"
        self._worker.kill(wait=True)
        executor = self._node.executor
        if executor is not None:
            executor.wake()  # so that the caller of the job gets a reply

    # --- services -----------------------------------------------------------------------------

    async def reidentify(self) -> Data:
        """Refit the model in service to the bench samples, and adopt or stage the refit."""
        settings = self._settings()
        before = self._store.in_service.path
        with self._under_way("reidentify"):
            output = await self._on_disk(self._store.new_path)
            result = await self._in_worker(
                jobs.reidentify,
                base=self._store.reference,
                output=output,
                candidates=self._folder / "candidates",
                min_samples=settings.reidentify_min_samples,
                max_drift=settings.reidentify_max_drift,
                max_change=settings.reidentify_max_change,
                accepted=self._store.accepted,
                noise=settings.bench_noise,
            )
            if "refused" in result:
                raise _NotAdoptedError(result)
            refit = Staged(output, result["model"], before)
            doubt = result["doubt"]
            result["staged"] = settings.reidentify_mode != ADOPT or doubt is not None
            if result["staged"]:
                staged = await self._stage(refit, doubt or "reidentify_mode is stage")
                result["file"] = str(staged.path)
            else:
                served = await self._adopted(refit, accepted=False)
                result["file"] = served["file"]
        return result

    async def adopt(self) -> Data:
        """Put the refit staged last into service."""
        staged = self._activity.staged
        if staged is None:
            raise HmcvtError(
                "no refit is staged; ~/reidentify with reidentify_mode = stage does"
            )
        return await self._adopted(staged, accepted=True)

    async def diagnose(self) -> Data:
        """Diagnose the gap between model and bench samples."""
        fingerprint = self._store.in_service.model.fingerprint
        with self._under_way("diagnose"):
            result = await self._in_worker(
                jobs.diagnose,
                reports=self._folder / "reports",
                noise=self._settings().bench_noise,
                baseline=self._settings().baseline_file,
            )
        self._activity.gap = gap_values(result, fingerprint, utc_now())
        return result

    async def revert(self) -> Data:
        """Put the model before into service."""
        return await self._put_into_service(self._store.revert)

    async def clear_samples(self) -> Data:
        """Begin a new bench log and keep the old one."""
        # A job must not end with samples that are gone.
        with self._under_way("clear_samples"):
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

    # --- requests and replies -----------------------------------------------------------------

    @property
    def job(self) -> Job | None:
        """The job under way."""
        return self._activity.job

    def end(self, job: Job) -> None:
        """End a refit or a diagnosis whose goal was cancelled."""
        self._end(job, _GOAL_CANCELLED)

    def too_many(self) -> str:
        """Count a request; return why it is refused at once, empty where it is not."""
        if not self._requests.spend(1):
            return f"busy: more than {REQUESTS_PER_SECOND} requests a second"
        if self._unanswered >= MAX_WAITING:
            return f"busy: {MAX_WAITING} requests wait already for the disk"
        return ""

    async def answer(
        self, work: Callable[[], Awaitable[Data]], refusal: str = ""
    ) -> Reply:
        """Do the work of a service.

        Args:
            work: does it and returns the answer, or raises the reason.
            refusal: why it is not done at all; empty where it is.
        """
        name = work.__name__
        self._unanswered += 1
        try:
            if refusal:
                raise HmcvtError(refusal)
            data = await work()
            end = self._summary(data)
            self._lines.note(name, f"{name}: {end}")
            success = True
        except Exception as error:  # of any kind: it must not end the node
            data, end = self._failure(name, error)
            success = False
        finally:
            self._unanswered -= 1
        if name in self._activity.ends:
            self._activity.ends[name] = f"{utc_now()}, {end}"
        # Without folders: do not disclose where the files are.
        text = json.dumps(plain(data), allow_nan=False)
        return Reply(success, self._public(text))

    def _callback(self, work: Callable[[], Awaitable[Data]]) -> Callable[..., Any]:
        """Return the callback of a service."""

        async def serve(
            request: Trigger.Request, response: Trigger.Response
        ) -> Trigger.Response:
            reply = await self.answer(work, self.too_many())
            response.success = reply.success
            response.message = reply.message
            return response

        return serve

    def _failure(self, name: str, error: Exception) -> tuple[Data, str]:
        """Log why a request failed; return the answer, and how it ended for diagnostics."""
        text = str(error)
        if not isinstance(error, (HmcvtError, OSError)):
            text = f"{type(error).__name__}: {error}"
        answer = {"error": text}
        outcome = "failed"
        if isinstance(error, _NotAdoptedError):
            answer.update(error.details)
            outcome = "not adopted"
        # A client that is refused may ask again at once, for ever: that must not fill a disk.
        self._lines.warn(f"{name} {text.startswith('busy')}", f"{name}: {text}")
        return answer, f"{outcome}: {text}"

    def _summary(self, answer: Data) -> str:
        """Return what the log and diagnostics say of an answer."""
        if "verdict" in answer:
            report = answer["report"] or f"not written: {answer['report_error']}"
            leading = ""
            if answer["causes"]:
                leading = f", leading cause {self._activity.gap['gap leading cause']}"
            return f"{answer['verdict']}{leading}; report {report}"
        if "file" not in answer:
            return "done"
        basis = f"{answer['samples']} samples, " if "samples" in answer else ""
        state = "in service"
        if answer.get("staged"):
            assert self._activity.staged is not None
            state = f"waits for ~/adopt: {self._activity.staged.reason}"
        return f"{basis}{answer['file']} ({answer['model']}) {state}"

    # --- jobs ---------------------------------------------------------------------------------

    @contextmanager
    def _under_way(self, name: str) -> Iterator[None]:
        if self._activity.job is not None:
            raise HmcvtError(f"busy: {self._activity.job}")
        job = Job(name)
        self._activity.job = job
        ended = "failed"
        try:
            yield
            ended = "done"
        except _NotAdoptedError:
            ended = "refused"
            raise
        except GeneratorExit:  # the node is gone, and its topics with it
            ended = ""
            raise
        finally:
            self._activity.job = None
            if ended:
                self.progress.report(job, "ended early" if job.ended else ended)

    def _reason_to_end(self, job: Job) -> str:
        """Return why the worker must not continue; empty when it may."""
        limit = self._settings().job_time_limit
        if job.seconds > limit:
            return f"ended after job_time_limit = {limit:g} s"
        # Twice in a row: stopping and continuing node and worker together is no fault.
        was_stopped = job.stopped
        job.stopped = self._worker.stopped
        if was_stopped and job.stopped:
            return "the worker process was stopped by a signal, and has been ended"
        return ""

    def _end(self, job: Job, reason: str) -> None:
        job.ended = reason
        self._worker.kill()

    async def _in_worker(self, work: Callable[..., Data], **options: Any) -> Data:
        """Let the worker do the job under way, without blocking the executor."""
        job = self._activity.job
        assert job is not None
        settings = self._settings()
        samples = await self._on_disk(self._samples)
        self._activity.trouble = ""
        if job.ended:
            raise HmcvtError(f"{job.name}: {job.ended}")
        job.working = True
        given = {
            "work": work,
            "promised": self._store.promised,
            "effects": settings.effects_file,
            "effects_checksum": self._effects_checksum,
            "samples": samples,
            "seed": settings.reidentify_seed,
            **options,
        }
        try:
            running = self._worker.submit(
                jobs.with_proven, settings.job_memory_limit, **given
            )
            self._lines.note(f"{job.name} started", f"{job.name}: started on {samples}")
            self.progress.report(job, "started", samples=samples.name)
            result: Data = await self._result_despite_load(job, running, given)
        except (BrokenProcessPool, CancelledError):
            status = self._worker.exit_status
            hint = ""
            if status == _PYTHON_FAILED:
                hint = (
                    ", as stderr explains; the main module of a program with the node has to be a "
                    'file with if __name__ == "__main__"'
                )
            job.ended = (
                job.ended or f"the worker process ended with status {status}{hint}"
            )
        except MemoryError:
            job.ended = (
                "ended, for it needs more than job_memory_limit = "
                f"{settings.job_memory_limit} MiB"
            )
        finally:
            job.working = False
            job.computed = True
        if job.ended:
            if job.ended not in (_CANCELLED, _GOAL_CANCELLED):
                self._activity.trouble = f"{job.name}: {job.ended}"
            raise HmcvtError(f"{job.name}: {job.ended}")
        return {**result, "seconds": round(job.seconds, 3)}

    async def _result_despite_load(
        self, job: Job, running: Future[Any], given: Data
    ) -> Data:
        """Return the result of the job under way, begun again where other processes starve it.

        Args:
            job: the job.
            running: its future.
            given: arguments of the job.
        """
        try:
            return await _result_of(running)
        except (BrokenProcessPool, CancelledError):
            if job.ended or not job.starved:
                raise
        self._lines.note(
            f"{job.name} starved",
            f"{job.name}: the processors are busy; begun again with a share of them",
        )
        again = self._worker.submit(
            jobs.with_proven,
            self._settings().job_memory_limit,
            shares=True,
            **given,
        )
        return await _result_of(again)

    def _samples(self) -> Path:
        """Return the file with the samples of a job, checked."""
        name = self._settings().samples_file
        log = self._log.log
        folder = self._folder.resolve()
        path = (folder / name).resolve()
        if not name or path == log.path.resolve():
            log.check()
            if not len(log):
                raise InputError("no bench samples logged yet (topic bench_sample)")
            return log.path
        # Parameters can be set from the network: they must not reach files elsewhere.
        if not path.is_relative_to(folder):
            raise InputError(f"samples_file = {name!r} lies outside the state folder")
        if path.exists() and not path.is_file():  # reading it might never end
            raise InputError(f"samples_file = {name!r} is no regular file")
        require_intact(path)
        return path

    async def _adopted(self, refit: Staged, accepted: bool) -> Data:
        """Put a refit into service; `accepted` is whether a client decided on it."""
        return await self._put_into_service(
            lambda: self._store.adopt(
                refit.path, refit.fingerprint, refit.instead_of, accepted
            )
        )

    async def _stage(self, refit: Staged, reason: str) -> Staged:
        """Let a refit wait for `~/adopt`, in place of the one before."""
        before = self._activity.staged
        if before is not None and before.fingerprint == refit.fingerprint:
            # The same once more: the file before stays, which a client may know.
            await self._on_disk(refit.path.unlink)
            refit = refit._replace(path=before.path)
        staged = refit._replace(reason=reason)
        self._activity.staged = staged
        return staged

    async def _put_into_service(self, change: Callable[[], EfficiencyModel]) -> Data:
        """Change the model in service and announce it; return its fingerprint and file."""
        await self._on_disk(change)
        self._activity.staged = None  # it was compared with the model before
        self._announce()
        served = self._store.in_service
        return {"model": served.model.fingerprint, "file": str(served.path)}

    async def _on_disk(self, work: Callable[..., Any], *arguments: Any) -> Any:
        """Run work in the thread that waits for disks, after all samples that came before."""
        return await _result_of(self._log.call(work, *arguments))


@types.coroutine
def _result_of(running: Future[Any]) -> Generator[None, None, Any]:
    """Wait for another thread or process.

    The executor resumes its coroutines whenever it wakes up; the node's timer wakes it.
    """
    while not running.done():
        yield
    return running.result()
