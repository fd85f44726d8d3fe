# SPDX-License-Identifier: Apache-2.0
"""Nonsense on `bench_sample`: every message is either logged as it is or refused, and counted."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState

from hmcvt_ros import qos

from .ear import Ear, Statuses, unused
from .fuzz_inputs import DEPTH
from .processes import Process

JOINTS = ("engine", "output", "displacement")
USED = (("velocity", "engine"), ("effort", "engine"), ("velocity", "output"),
        ("effort", "output"), ("position", "displacement"))
_PATIENCE = 60.0
_NEVER = (math.nan, math.inf, -math.inf, -1.7e308, 1.7e308, -50.0)
_NO_SPEED_OR_TORQUE = (0.0, -0.0, 5e-324, -5e-324)

Row = tuple[float, ...]
"""Displacement ratio, engine speed, load torque, efficiency, output speed."""


class BenchFuzzer:
    """Sends bench samples, most of them broken, and compares log and counts with what is due.

    Attributes:
        sent: count of messages.
        rows: what the log must hold.
        differences: where it does not; empty when all is well.
    """

    def __init__(self, client: Node, process: Process, namespace: str, log: Path,
                 seed: int) -> None:
        self.sent = 0
        self.rows: list[Row] = []
        self.differences: list[str] = []
        self._process, self._log = process, log
        self._random = np.random.default_rng(seed)
        self._statuses = Statuses(namespace)
        self._publisher = client.create_publisher(
            JointState, f"{namespace}/bench_sample", QoSProfile(depth=DEPTH))
        diagnostics = client.create_subscription(
            DiagnosticArray, "/diagnostics", unused, qos.DIAGNOSTICS)
        self.ear = Ear(client, {diagnostics: self._statuses.take})

    def run(self, count: int) -> None:
        """Send `count` messages; stop at the first difference."""
        if not self.ear.listen_until(lambda: self._publisher.get_subscription_count() > 0
                                     and self._statuses.stamp > 0, 20.0):
            raise TimeoutError(f"the node did not come up:\n{self._process.log}")
        while self.sent < count and not self.differences:
            for _ in range(min(DEPTH // 2, count - self.sent)):
                self._send()
            self._compare_counts()
        self._compare_log()

    def _send(self) -> None:
        message, row = self._good()
        spoil = self._random.choice(SPOILERS)
        if self._random.integers(10):
            row = row if spoil(self._random, message) else None
        else:
            _stamp(self._random, message)
        self._publisher.publish(message)
        self.sent += 1
        if row is not None:
            self.rows.append(row)

    def _good(self) -> tuple[JointState, Row | None]:
        uniform = self._random.uniform
        ratio, speed, output_speed = uniform(-1, 1), uniform(50, 300), uniform(5, 300)
        load, efficiency = uniform(10, 500), uniform(0.3, 0.95)
        power = load * speed
        message = JointState(
            name=list(JOINTS), position=[math.nan, math.nan, ratio],
            velocity=[speed, output_speed, math.nan],
            effort=[power / efficiency / speed, power / output_speed, math.nan])
        return message, (ratio, speed, load, efficiency, output_speed)

    def _compare_counts(self) -> None:
        def counts() -> tuple[int, int]:
            return (self._statuses.sum("model", "bench samples logged"),
                    self._statuses.sum("model", "bench samples refused"))

        due = len(self.rows), self.sent - len(self.rows)
        if not self.ear.listen_until(lambda: counts() == due, _PATIENCE):
            self.differences.append(f"logged and refused {counts()}, not {due}")

    def _compare_log(self) -> None:
        names = ("displacement_ratio", "engine_speed", "load_torque", "efficiency", "output_speed")
        with self._log.open(newline="") as file:
            logged = list(csv.DictReader(file))
        found = np.array([[float(row[name]) for name in names] for row in logged])
        due = np.array(self.rows)
        if found.shape != due.shape or not np.allclose(found, due, rtol=1e-12, atol=0.0):
            self.differences.append(f"the log holds {found.shape} numbers that are not those sent")
        if not all(0.0 < float(row["stamp"]) < 1e12 for row in logged):
            self.differences.append("a stamp in the log is no time")


# --- what can be wrong with a message; True when it has to be logged all the same -----------------

Spoiler = Callable[[np.random.Generator, JointState], bool]


def _stamp(random: np.random.Generator, message: JointState) -> bool:
    message.header.stamp.sec = int(random.choice([0, 1, -1, -2**31, 2**31 - 1]))
    message.header.stamp.nanosec = int(random.choice([0, 1, 999_999_999, 2**32 - 1]))
    return True


def _other_joints(random: np.random.Generator, message: JointState) -> bool:
    message.name = ["", "motor", *message.name, "öl", "x" * 300]
    for field in ("position", "velocity", "effort"):
        setattr(message, field, [math.inf, math.nan, *getattr(message, field), 1e308, 0.0])
    return True


def _number(random: np.random.Generator, message: JointState) -> bool:
    field, joint = USED[random.integers(len(USED))]
    bad = (*_NEVER, 1.0001, -1.0001) if field == "position" else (*_NEVER, *_NO_SPEED_OR_TORQUE)
    getattr(message, field)[message.name.index(joint)] = float(random.choice(bad))
    return False


def _name(random: np.random.Generator, message: JointState) -> bool:
    message.name[random.integers(3)] = str(random.choice(["", "Engine", "motor", "engine ", "é"]))
    return False


def _doubled(random: np.random.Generator, message: JointState) -> bool:
    again = int(random.integers(3))
    for field in ("name", "position", "velocity", "effort"):
        values = list(getattr(message, field))
        setattr(message, field, [*values, values[again]])
    return False


def _empty(random: np.random.Generator, message: JointState) -> bool:
    setattr(message, str(random.choice(["position", "velocity", "effort"])), [])
    return False


def _all_empty(random: np.random.Generator, message: JointState) -> bool:
    for field in ("name", "position", "velocity", "effort"):
        setattr(message, field, [])
    return False


def _unequal(random: np.random.Generator, message: JointState) -> bool:
    field = str(random.choice(["position", "velocity", "effort"]))
    values = list(getattr(message, field))
    setattr(message, field, values[:-1] if random.integers(2) else values * 40)
    return False


def _impossible(random: np.random.Generator, message: JointState) -> bool:
    message.effort[0] /= random.uniform(5.0, 1e6)  # more power comes out than goes in
    return False


SPOILERS: list[Spoiler] = [
    _stamp, _other_joints, _number, _number, _number, _name, _doubled, _empty, _all_empty,
    _unequal, _impossible]
