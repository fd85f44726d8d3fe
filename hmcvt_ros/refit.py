# SPDX-License-Identifier: Apache-2.0
"""Heavy work in a process of its own, so that lookups keep their latency meanwhile.

A process per job and not a pool: it can be killed, and it does not outlive a node that was.
"""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from typing import IO, Any

from hmcvt_core.errors import HmcvtError

# BLAS threads would fight with the threads of DDS on a small machine.
_ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
_COMMAND = (sys.executable, "-m", "hmcvt_ros.worker")


class BackgroundJob:
    """At most one job of `hmcvt_ros.worker` at a time; never blocks."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._output: IO[bytes] | None = None
        self._name = ""
        self._started = 0.0

    @property
    def running(self) -> str:
        """What is running and for how long; empty when nothing is."""
        if self._process is None:
            return ""
        return f"{self._name} has been running for {time.monotonic() - self._started:.1f} s"

    def start(self, request: Mapping[str, Any]) -> None:
        """Start a job.

        Raises:
            HmcvtError: one is running.
            OSError: no process can be started.
        """
        if self._process is not None:
            raise HmcvtError(f"busy: {self.running}")
        # A file and not a pipe: the answer may be larger than what a pipe holds.
        self._output = tempfile.TemporaryFile()  # noqa: SIM115 (closed in `cancel`)
        environment = {**os.environ, **_ONE_THREAD,
                       "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
        self._process = subprocess.Popen(
            _COMMAND, stdin=subprocess.PIPE, stdout=self._output, env=environment,
            start_new_session=True)
        self._name, self._started = str(request["job"]), time.monotonic()
        assert self._process.stdin is not None
        with contextlib.suppress(BrokenPipeError):  # it died at once; `poll` tells
            self._process.stdin.write(json.dumps(dict(request)).encode() + b"\n")
            self._process.stdin.flush()

    def poll(self) -> dict[str, Any] | None:
        """Return the answer once the job has ended, None before; `error` in it says what failed."""
        if self._process is None or self._process.poll() is None:
            return None
        status = self._process.returncode
        assert self._output is not None
        self._output.seek(0)
        text = self._output.read()
        name = self._name
        self.cancel()
        try:
            answer = json.loads(text)
        except ValueError:
            answer = None
        if status != 0 or not isinstance(answer, dict):
            return {"error": f"{name}: the worker process ended with status {status}"}
        return answer

    def cancel(self) -> None:
        """Kill a running job and forget it."""
        if self._process is None:
            return
        self._process.kill()
        self._process.wait()
        if self._process.stdin is not None:
            with contextlib.suppress(BrokenPipeError):
                self._process.stdin.close()
        if self._output is not None:
            self._output.close()
        self._process = self._output = None
