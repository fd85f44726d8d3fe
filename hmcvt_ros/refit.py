# SPDX-License-Identifier: Apache-2.0
"""Heavy work in a process beside the node, so that lookups keep their latency meanwhile.

One process for all jobs, started for the first: a start in itself costs the neighbours more time
than a refit. It can be killed, and it does not outlive a node that was.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Mapping
from typing import Any

from hmcvt_core.errors import HmcvtError
from hmcvt_core.fleet.threads import ONE_BLAS_THREAD

_COMMAND = (sys.executable, "-m", "hmcvt_ros.worker")
_PIECE = 1 << 16  # bytes that a pipe holds


class BackgroundJob:
    """At most one job of `hmcvt_ros.worker` at a time; never blocks."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._name = ""  # of the job that runs; empty when none does
        self._started = 0.0
        self._answer = b""  # as far as it has come

    @property
    def running(self) -> str:
        """What is running and for how long; empty when nothing is."""
        if not self._name:
            return ""
        return f"{self._name} has been running for {time.monotonic() - self._started:.1f} s"

    def start(self, request: Mapping[str, Any]) -> None:
        """Start a job.

        Raises:
            HmcvtError: one is running.
            OSError: no process can be started.
        """
        if self._name:
            raise HmcvtError(f"busy: {self.running}")
        if self._process is None or not _ask(self._process, request):
            self.cancel()  # it may have died while it had nothing to do
            self._process = _worker()
            _ask(self._process, request)  # `poll` tells if that one died at once
        self._name, self._started = str(request["job"]), time.monotonic()

    def poll(self) -> dict[str, Any] | None:
        """Return the answer once the job has ended, None before; `error` in it says what failed."""
        if not self._name or self._process is None:
            return None
        assert self._process.stdout is not None
        # First, so that an answer written before the end is not missed.
        ended = self._process.poll() is not None
        while piece := self._process.stdout.read(_PIECE):
            self._answer += piece
        if self._answer.endswith(b"\n"):
            answer: dict[str, Any] = json.loads(self._answer)
            self._name, self._answer = "", b""
            return answer
        if not ended:
            return None
        status = self._process.returncode
        self.cancel()
        return {"error": f"the worker process ended with status {status}"}

    def cancel(self) -> None:
        """Kill the process, and a running job with it."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            for pipe in (self._process.stdin, self._process.stdout):
                assert pipe is not None
                pipe.close()
        self._process = None
        self._name, self._answer = "", b""


def _ask(process: subprocess.Popen[bytes], request: Mapping[str, Any]) -> bool:
    """Hand over a request; False where nobody is there to take it."""
    assert process.stdin is not None
    try:
        process.stdin.write(json.dumps(dict(request)).encode() + b"\n")
    except BrokenPipeError:
        return False
    return True


def _worker() -> subprocess.Popen[bytes]:
    environment = {**os.environ, **ONE_BLAS_THREAD,
                   "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    process = subprocess.Popen(_COMMAND, stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0,
                               env=environment, start_new_session=True)
    assert process.stdout is not None
    os.set_blocking(process.stdout.fileno(), False)
    return process
