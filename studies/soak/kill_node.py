# SPDX-License-Identifier: Apache-2.0
"""The node, killed over DDS: while it logs, while it refits, while it puts models into service.

The trials of one kind follow each other in one state folder: each start is the restart that shows
what the kill before has left.
"""

from __future__ import annotations

import itertools
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
import yaml
from rclpy.context import Context
from rclpy.signals import SignalHandlerOptions

import hmcvt_core as hmcvt
from hmcvt_ros.bench_player import BenchPlayer
from hmcvt_ros.messages import bench_sample_to_message
from hmcvt_ros.model_store import ModelStore

from .kill_lines import BASE, leftovers, model
from .processes import ROOT

_PERIOD = 0.01  # seconds between two samples
_BURST = 50  # samples that come at once
_TORQUE, _EFFICIENCY = 200.0, 0.8
_REFITS = 60  # that can be reverted one after the other
_COMPLAINT = re.compile(r"Traceback|cannot be read|damaged lines")
_numbers = itertools.count(1)

Rng = np.random.Generator


@dataclass(frozen=True)
class Outcome:
    """What a kill left.

    Attributes:
        acknowledged: operations that had been acknowledged since the start of the process.
        midway: whether one was under way.
        leftovers: temporary files found.
        problems: broken promises.
    """

    acknowledged: int
    midway: bool
    leftovers: int
    problems: tuple[str, ...]


class _Node:
    """A node process and a client of it, in a namespace that none had before."""

    def __init__(self, context: Context, state: Path) -> None:
        namespace = f"/killed{next(_numbers)}"
        self.state, self.log = state, state.with_name(f"{state.name}{namespace.strip('/')}.log")
        self.problems: list[str] = []
        self.player = BenchPlayer(context, namespace)
        with self.log.open("w") as output:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "hmcvt_ros.efficiency_node", "--ros-args",
                 "-r", f"__ns:={namespace}", "-p", f"model_file:={BASE}",
                 "-p", f"state_folder:={state}"], stdout=output, stderr=output, cwd=ROOT)
        self.check(self.player.wait_for_node(), "the node did not come up")

    def check(self, good: bool, complaint: str) -> None:
        if not good:
            self.problems.append(f"{self.log}: {complaint}")

    def kill(self) -> None:
        """End the node at once, and see that nothing of it goes on."""
        children = Path(f"/proc/{self._process.pid}/task/{self._process.pid}/children")
        workers = children.read_text().split()
        self._process.send_signal(signal.SIGKILL)
        self._process.wait()
        self.player.spin_for(0.1)  # what it had said before
        self.check(self.player.wait_until(lambda: not any(map(_alive, workers)), 5.0),
                   "the worker lives on")

    def close(self) -> None:
        self.player.close()
        if self._process.poll() is None:
            self._process.kill()
            self._process.wait()
        self.check(not _COMPLAINT.search(self.log.read_text()), "complains")

    @property
    def logged(self) -> int:
        """Samples in the log, by the last diagnostics; -1 before the first."""
        status = self.player.statuses.get("model")
        return -1 if status is None else int(status["values"]["bench samples logged"])

    @property
    def file(self) -> Path:
        """Parameter file that it says is in service."""
        self.player.wait_until(lambda: bool(self.player.model_text), 10.0)
        return Path(yaml.safe_load(self.player.model_text)["served"]["file"])


def _alive(pid: str) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


# --- trials ---------------------------------------------------------------------------------------


def logging(node: _Node, rng: Rng) -> Outcome:
    """Kill it while samples come in."""
    log = node.state / "bench_samples.csv"
    node.player.wait_until(lambda: node.logged >= 0, 5.0)
    before = _rows(log)
    node.check(node.logged == len(before), f"{len(before)} samples, it says {node.logged}")
    number = sent = int(before[-1].split(b".")[0]) if before else 0
    acknowledged: list[bytes] = before
    end = time.monotonic() + rng.uniform(1.2, 2.4)
    while time.monotonic() < end:
        sent += 1
        node.player.send_sample(_message(sent))
        node.player.spin_for(_PERIOD)
        if node.logged > len(acknowledged):
            acknowledged = _rows(log)[:node.logged]
    for _ in range(_BURST):  # so that it is busy when the kill comes
        sent += 1
        node.player.send_sample(_message(sent))
    time.sleep(rng.uniform(0.0, 0.05))
    node.kill()
    rows = _rows(log)
    count = max(node.logged, len(acknowledged))
    node.check(len(rows) >= count, f"{len(rows)} samples, acknowledged {count}")
    node.check(rows[:len(acknowledged)] == acknowledged, "acknowledged samples changed")
    found = [int(row.split(b".")[0]) for row in rows]
    node.check(found == sorted(set(found)), "samples out of order")
    node.check(all(row == _row(n) for row, n in zip(rows, found, strict=True)), "values changed")
    midway = not found or found[-1] < sent
    node.check(len(found) - len(before) <= sent - number, "more samples than were sent")
    return _outcome(node, count - len(before), midway)


def refit(node: _Node, rng: Rng) -> Outcome:
    """Kill it during ~/reidentify: at any moment of it, or when the new file comes."""
    if not (node.state / "bench_samples.csv").exists():
        table = hmcvt.read_bench(hmcvt.data_path("data/table2.csv"))
        for i in range(len(table)):
            node.player.send_sample(_message(
                i + 1, float(table.displacement_ratio[i]), float(table.engine_speed[i]),
                float(table.load_torque[i]), float(table.efficiency[i])))
        node.check(node.player.wait_for_logged(len(table)), "samples were not logged")
    before, models = node.file, node.state / "models"
    known = set(models.glob("*"))
    reply = node.player.request("reidentify")
    if rng.random() < 0.4:
        node.player.wait_until(reply.done, rng.uniform(0.0, 1.2))
    else:
        _watch(lambda: reply.done() or set(models.glob("*")) - known, node.player)
        node.player.wait_until(reply.done, rng.uniform(0.0, 0.15))
    node.kill()
    done = reply.done() and reply.result().success
    _check_models(node, before, done)
    return _outcome(node, int(done), not reply.done())


def revert(node: _Node, rng: Rng) -> Outcome:
    """Kill it while models go out of service one after the other."""
    before = _stack(node.state)
    count, last = 0, node.file
    reply = node.player.request("revert")
    end = time.monotonic() + rng.uniform(0.0, 0.4)
    while node.player.wait_until(reply.done, end - time.monotonic()):
        answer = json.loads(reply.result().message)
        node.check(reply.result().success, f"refused: {answer}")
        count, last = count + 1, Path(answer["file"])
        if count == len(before) - 1:
            break  # the last refit: before it comes the model of model_file
        reply = node.player.request("revert")
    node.kill()
    if reply.done():
        last = Path(json.loads(reply.result().message)["file"])
    stack, told = _stack(node.state), before.index(last.name) + 1
    node.check(stack in (before[:told], before[:told - 1]), f"{stack[-1:]}, acknowledged {last}")
    return _outcome(node, count, not reply.done())


KINDS: dict[str, Callable[[_Node, Rng], Outcome]] = {
    "node that logs": logging, "node that refits": refit, "node that reverts": revert}


def trials(kind: str, count: int, folder: Path, rng: Rng) -> Iterator[Outcome]:
    """Run trials of a kind; one more outcome is that of a start after the last."""
    state = folder / kind.replace(" ", "-")
    with _context() as context:
        for _ in range(count):
            if KINDS[kind] is revert:
                _fill(state)
            yield _trial(context, state, lambda node: KINDS[kind](node, rng))
        yield _trial(context, state, lambda node: Outcome(0, False, 0, ()))


def _trial(context: Context, state: Path, kill: Callable[[_Node], Outcome]) -> Outcome:
    expected = _in_service(state)
    node = _Node(context, state)
    try:
        node.check(node.file == expected, f"serves {node.file}, not {expected}")
        node.check(leftovers(state) == 0, "temporary files stay")
        outcome = kill(node)
    finally:
        node.close()
    return Outcome(outcome.acknowledged, outcome.midway, outcome.leftovers, tuple(node.problems))


# --- helpers --------------------------------------------------------------------------------------


@contextmanager
def _context() -> Iterator[Context]:
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    context = Context()
    rclpy.init(context=context, signal_handler_options=SignalHandlerOptions.NO)
    try:
        yield context
    finally:
        context.try_shutdown()


def _message(number: int, ratio: float = 0.1, speed: float = 0.0, torque: float = _TORQUE,
             efficiency: float = _EFFICIENCY) -> Any:
    speed = speed or 100.0 + number % 1000 / 7.0
    message = bench_sample_to_message(
        ratio, speed, torque / efficiency, 80.0, torque * speed / 80.0)
    message.header.stamp.sec = number
    return message


def _row(number: int) -> bytes:
    """Return the line of the log that a sample must become."""
    from hmcvt_ros.messages import bench_sample_from_message

    found = bench_sample_from_message(_message(number), 0.0)
    columns = (found.stamp, found.displacement_ratio, found.engine_speed, found.load_torque,
               found.efficiency, found.output_speed)
    return ",".join(repr(float(np.ravel(column)[0])) for column in columns).encode()


def _rows(log: Path) -> list[bytes]:
    if not log.exists():
        return []
    *lines, _torn = log.read_bytes().split(b"\n")
    return lines[1:]


def _watch(condition: Callable[[], Any], player: BenchPlayer, timeout: float = 30.0) -> None:
    """Wait with a finer grain than that of the client."""
    end = time.monotonic() + timeout
    while not condition() and time.monotonic() < end:
        player.spin_for(0.001)


def _fill(state: Path) -> None:
    """Put refits into service that can be reverted."""
    store = ModelStore(BASE, state)
    while len(_stack(state)) < _REFITS:
        path = store.new_path()
        hmcvt.save_model(model(int(path.stem)), path)
        store.adopt(path)


def _stack(state: Path) -> list[str]:
    path = state / "in_service.json"
    return list(json.loads(path.read_text())["in_service"]) if path.exists() else []


def _in_service(state: Path) -> Path:
    stack = _stack(state)
    return state / "models" / stack[-1] if stack else BASE.resolve()


def _check_models(node: _Node, before: Path, done: bool) -> None:
    for path in (node.state / "models").glob("*.yaml"):
        hmcvt.load_model(path)
    found = _in_service(node.state)
    node.check(found != before if done else True, "an acknowledged refit is not in service")
    hmcvt.read_bench(node.state / "bench_samples.csv")


def _outcome(node: _Node, acknowledged: int, midway: bool) -> Outcome:
    return Outcome(acknowledged, midway, leftovers(node.state), ())
