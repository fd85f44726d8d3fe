# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The node, killed over DDS: while it logs, while it refits, while it puts models into service.

The trials of one kind follow each other in one state folder: each start is the restart that shows
what the kill before has left.
"""

from __future__ import annotations

import itertools
import json
import re
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from rclpy.context import Context

import hmcvt_core as hmcvt
from examples.bench_player import BenchPlayer, bench_sample_to_message
from hmcvt_ros.bench_log import rows_of
from hmcvt_ros.inputs import Tally
from hmcvt_ros.messages import bench_sample_from_message
from hmcvt_ros.model_store import WAYS_BACK, ModelStore

from . import processes
from .kill_lines import BASE, leftovers, model
from .load import client
from .processes import Process

_PERIOD = 0.01  # seconds between two samples
_BURST = 50  # samples that come at once
_TORQUE, _EFFICIENCY = 200.0, 0.8
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
    """A node process and a client of it."""

    def __init__(self, context: Context, process: Process, namespace: str, state: Path) -> None:
        self.state, self.process = state, process
        self.problems: list[str] = []
        self.player = BenchPlayer(context, namespace)
        self.check(self.player.wait_for_node(), "the node did not come up")

    def check(self, good: bool, complaint: str) -> None:
        if not good:
            self.problems.append(f"{self.process.log_file}: {complaint}")

    def kill(self) -> None:
        """End the node at once, and see that nothing of it goes on."""
        workers = self.process.kill()
        self.player.spin_for(0.1)  # what it had said before
        self.check(self.player.wait_until(lambda: not any(map(alive, workers)), 5.0),
                   "the worker lives on")

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


def alive(pid: str | int) -> bool:
    """Whether a process runs; one that is dead but not yet collected does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


# --- trials: operations acknowledged, whether one was under way -----------------------------------


def logging(node: _Node, rng: Rng) -> tuple[int, bool]:
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
    return count - len(before), midway


def refit(node: _Node, rng: Rng) -> tuple[int, bool]:
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
        end = time.monotonic() + 30.0
        while not reply.done() and not set(models.glob("*")) - known and time.monotonic() < end:
            node.player.spin_for(0.001)  # a finer grain than that of the client
        node.player.wait_until(reply.done, rng.uniform(0.0, 0.15))
    node.kill()
    done = reply.done() and reply.result().success
    _check_models(node, before, done)
    return int(done), not reply.done()


def revert(node: _Node, rng: Rng) -> tuple[int, bool]:
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
    return count, not reply.done()


KINDS: dict[str, Callable[[_Node, Rng], tuple[int, bool]]] = {
    "node that logs": logging, "node that refits": refit, "node that reverts": revert}


def trials(kind: str, count: int, folder: Path, rng: Rng) -> Iterator[Outcome]:
    """Run trials of a kind; one more outcome is that of a start after the last."""
    state = folder / kind.replace(" ", "-")
    with client() as here:
        for _ in range(count):
            if KINDS[kind] is revert:
                _fill(state)
            yield _trial(here.context, state, lambda node: KINDS[kind](node, rng))
        yield _trial(here.context, state, lambda node: (0, False))


def _trial(context: Context, state: Path, kill: Callable[[_Node], tuple[int, bool]]) -> Outcome:
    expected = _in_service(state)
    namespace = f"/killed{next(_numbers)}"  # that none had before
    with processes.node(namespace, state.parent, state_folder=state, model_file=BASE) as process:
        node = _Node(context, process, namespace, state)
        try:
            node.check(node.file == expected, f"serves {node.file}, not {expected}")
            node.check(leftovers(state) == 0, "temporary files stay")
            acknowledged, midway = kill(node)
            left = leftovers(state)
        finally:
            node.player.close()
    node.check(not _COMPLAINT.search(process.log), "complains")
    return Outcome(acknowledged, midway, left, tuple(node.problems))


# --- helpers --------------------------------------------------------------------------------------


def _message(number: int, ratio: float = 0.1, speed: float = 0.0, torque: float = _TORQUE,
             efficiency: float = _EFFICIENCY) -> Any:
    speed = speed or 100.0 + number % 1000 / 7.0
    message = bench_sample_to_message(
        ratio, speed, torque / efficiency, 80.0, torque * speed / 80.0)
    message.header.stamp.sec = number
    return message


def _row(number: int) -> bytes:
    """Return the line of the log that a sample must become."""
    found = bench_sample_from_message(_message(number), 0.0, Tally(()))
    row, = rows_of(found)
    return row.removesuffix(b"\n")


def _rows(log: Path) -> list[bytes]:
    if not log.exists():
        return []
    *lines, _torn = log.read_bytes().split(b"\n")
    return lines[1:]


def _fill(state: Path) -> None:
    """Put refits into service that can be reverted."""
    store = ModelStore(BASE, state)
    while len(_stack(state)) < WAYS_BACK:
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
    node.check(not done or found != before, "an acknowledged refit is not in service")
    hmcvt.read_bench(node.state / "bench_samples.csv")
