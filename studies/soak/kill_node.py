# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The node, killed over DDS at random moments while it logs, refits and goes back.

The trials follow each other in one state folder: each start is the restart that shows what the kill
before has left.
"""

import itertools
import json
import re
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml
from rclpy.context import Context

import hmcvt_core as hmcvt
from examples.bench_player import BenchPlayer, bench_message
from hmcvt_ros.bench_log import rows_of
from hmcvt_ros.inputs import Tally
from hmcvt_ros.messages import bench_sample_from_message

from . import processes
from .kill_lines import BASE, leftovers
from .load import client
from .processes import Process

_PERIOD = 0.01  # seconds between two samples
_BURST = 50  # samples that come at once
_LONGEST = 3.0  # seconds until the kill
_COMPLAINT = re.compile(r"Traceback|cannot be read|damaged lines")
_TABLE = hmcvt.read_bench(hmcvt.data_path("data/table2.csv"))
_numbers = itertools.count(1)


class Outcome(NamedTuple):
    """What was acknowledged before a kill, whether more was under way, and what it left."""

    acknowledged: int
    midway: bool
    leftovers: int
    problems: tuple[str, ...]


def trials(count: int, folder: Path, rng: np.random.Generator) -> Iterator[Outcome]:
    """Run trials; one more outcome is that of a start after the last."""
    state = folder / "state"
    with client() as here:
        for seconds in (*rng.uniform(0.2, _LONGEST, count), 0.0):
            yield _trial(here.context, state, seconds, rng)


def _trial(
    context: Context, state: Path, seconds: float, rng: np.random.Generator
) -> Outcome:
    namespace = f"/killed{next(_numbers)}"  # that none had before
    with processes.node(
        namespace, state.parent, state_folder=state, model_file=BASE
    ) as process:
        use = _Use(context, process, namespace, state)
        try:
            use.start()
            if seconds:
                use.go_on(seconds, rng)
                use.kill()
            left = leftovers(state)
        finally:
            use.player.close()
    use.check(not _COMPLAINT.search(process.log), "complains")
    return Outcome(use.acknowledged, use.midway, left, tuple(use.problems))


class _Use:
    """A node that is used, and what it has acknowledged; see `Outcome`."""

    def __init__(
        self, context: Context, process: Process, namespace: str, state: Path
    ) -> None:
        self.player = BenchPlayer(context, namespace)
        self.problems: list[str] = []
        self.acknowledged, self.midway = 0, False
        self._process, self._state = process, state
        self._stack, self._before = _stack(state), _rows(state)
        self._sent = _number(self._before[-1]) if self._before else 0
        self._service, self._reply = "", None

    def check(self, good: bool, complaint: str) -> None:
        if not good:
            self.problems.append(f"{self._process.log_file}: {complaint}")

    def start(self) -> None:
        """Wait for the node and see that it stands where the last one was killed."""
        self.check(self.player.wait_for_node(), "the node did not come up")
        file = yaml.safe_load(self.player.model_text or "")["served"]["file"]
        self.check(
            Path(file).name == _in_service(self._state).name,
            f"serves {file}, not {self._stack[-1:]}",
        )
        self.check(
            self.player.wait_for_logged(len(self._before)), "logged samples are gone"
        )
        self.check(leftovers(self._state) == 0, "temporary files stay")

    def go_on(self, seconds: float, rng: np.random.Generator) -> None:
        """Send samples and ask, whenever it has replied, for a refit or the way back."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self._send(1)
            self.player.spin_for(_PERIOD)
            if self._reply is None or self._reply.done():
                self._take_reply()
                self._service = str(rng.choice(["reidentify", "revert"]))
                self._reply = self.player.request(self._service)
        self._send(_BURST)  # so that it is busy when the kill comes
        time.sleep(rng.uniform(0.0, 0.05))

    def kill(self) -> None:
        """End the node at once; see that nothing of it goes on and nothing acknowledged is lost."""
        workers = self._process.kill()
        self.player.spin_for(0.1)  # what it had said before
        self.check(
            self.player.wait_until(lambda: not any(map(alive, workers)), 5.0),
            "the worker lives on",
        )
        self._take_reply()
        stack, before = _stack(self._state), self._stack
        moved = (
            stack == before[:-1] if self._service == "revert" else stack[:-1] == before
        )
        self.check(
            stack == before or (moved and not self._reply.done()),
            f"in service {stack}, acknowledged {before}",
        )
        for path in (self._state / "models").glob("*.yaml"):
            hmcvt.load_model(path)
        rows = _rows(self._state)
        found = list(map(_number, rows))
        logged = int(self.player.statuses["model"]["values"]["bench samples logged"])
        self.check(len(rows) >= logged, f"{len(rows)} samples, acknowledged {logged}")
        self.check(
            rows[: len(self._before)] == self._before, "samples of earlier have changed"
        )
        self.check(found == sorted(set(found)), "samples are out of order")
        self.check(rows == list(map(_row, found)), "samples are not what was sent")
        self.acknowledged += logged - len(self._before)
        self.midway = not self._reply.done() or not found or found[-1] < self._sent

    def _send(self, count: int) -> None:
        for _ in range(count):
            self._sent += 1
            self.player.send_sample(_message(self._sent))

    def _take_reply(self) -> None:
        """Note what a reply has put into service: it must be what the state folder says."""
        if self._reply is None or not self._reply.done():
            return
        answer, self._stack = self._reply.result(), _stack(self._state)
        if answer.success:
            file = Path(json.loads(answer.message)["file"]).name
            self.check(file == _in_service(self._state).name, f"acknowledged {file}")
            self.acknowledged += 1


def alive(pid: str | int) -> bool:
    """Whether a process runs; one that is dead but not yet collected does not."""
    try:
        return (
            Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
        )
    except OSError:
        return False


# --- what is sent, and what is in the state folder ------------------------------------------------


def _message(number: int) -> Any:
    """Return a test of Table 2 that tells its number by its stamp."""
    message = bench_message(_TABLE, number % len(_TABLE))
    message.header.stamp.sec = number
    return message


def _row(number: int) -> bytes:
    """Return the line of the log that a sample must become, without number and checksum."""
    (row,) = rows_of(bench_sample_from_message(_message(number), 0.0, Tally(())))
    return row


def _number(row: bytes) -> int:
    return int(row.split(b".")[0])


def _rows(state: Path) -> list[bytes]:
    log = state / "bench_samples.csv"
    *lines, _torn = log.read_bytes().split(b"\n") if log.exists() else [b""]
    return [line.partition(b",")[2].rpartition(b",")[0] for line in lines[1:]]


def _stack(state: Path) -> list[str]:
    path = state / "in_service.json"
    return list(json.loads(path.read_text())["in_service"]) if path.exists() else []


def _in_service(state: Path) -> Path:
    stack = _stack(state)
    return state / "models" / stack[-1] if stack else BASE.resolve()
