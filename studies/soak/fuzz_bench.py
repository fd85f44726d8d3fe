# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Nonsense on `bench_sample`: every message is either logged as it is or refused, and counted."""

import csv
import math
from pathlib import Path

import numpy as np
from rclpy.publisher import Publisher
from sensor_msgs.msg import JointState

from examples.bench_player import bench_sample_to_message

from .fuzz_inputs import DEPTH, FULL_STROKE, LIMITS, STROKE
from .load import Target

USED = (
    ("velocity", "engine"),
    ("effort", "engine"),
    ("velocity", "output"),
    ("effort", "output"),
    ("position", "displacement"),
)
_PATIENCE = 60.0
_NEVER = (math.nan, math.inf, -math.inf, -1.7e308, 1.7e308, -50.0)
_NO_SPEED_OR_TORQUE = (0.0, -0.0, 5e-324, -5e-324)
_LOW, _HIGH = LIMITS[STROKE]
_NO_STROKE = (
    math.nextafter(_LOW, -math.inf),
    math.nextafter(_HIGH, math.inf),
    -1.1,
    1.1,
)

Row = tuple[float, ...]
"""Displacement ratio, engine speed, load torque, efficiency, output speed."""


class BenchFuzzer:
    """Sends bench samples, most of them broken, and compares log and counts with what is due.

    Attributes:
        sent: count of messages.
        rows: what the log must hold.
        differences: where it does not; empty when all is well.
    """

    def __init__(
        self, target: Target, publisher: Publisher, log: Path, seed: int
    ) -> None:
        self.sent = 0
        self.rows: list[Row] = []
        self.differences: list[str] = []
        self._target, self._publisher, self._log = target, publisher, log
        self._random = np.random.default_rng(seed)

    def run(self, count: int) -> None:
        """Send `count` messages; stop at the first difference."""
        if not self._target.ear.listen_until(
            lambda: self._publisher.get_subscription_count() > 0, 20.0
        ):
            raise TimeoutError(f"the node does not listen:\n{self._target.process.log}")
        while self.sent < count and not self.differences:
            for _ in range(min(DEPTH // 2, count - self.sent)):
                self._send()
            self._compare_counts()
        self._compare_log()

    def _send(self) -> None:
        message, row = self._good()
        spoil = SPOILERS[self._random.integers(len(SPOILERS))]
        if self._random.integers(10):
            spoil(self._random, message)
            row = row if spoil in HARMLESS else None
        else:
            _stamp(self._random, message)
        self._publisher.publish(message)
        self.sent += 1
        if row is not None:
            self.rows.append(row)

    def _good(self) -> tuple[JointState, Row | None]:
        uniform = self._random.uniform
        ratio = float(
            self._random.choice(
                [
                    uniform(-1, 1),
                    uniform(_LOW, _HIGH),
                    uniform(_LOW, -1),
                    uniform(1, _HIGH),
                    _LOW,
                    _HIGH,
                ]
            )
        )
        speed, output_speed = uniform(50, 300), uniform(5, 300)
        load, efficiency = uniform(10, 500), uniform(0.3, 0.95)
        power = load * speed
        message = bench_sample_to_message(
            ratio, speed, power / efficiency / speed, output_speed, power / output_speed
        )
        stroke = max(-FULL_STROKE, min(ratio, FULL_STROKE))
        return message, (stroke, speed, load, efficiency, output_speed)

    def _compare_counts(self) -> None:
        def counts() -> tuple[int, int]:
            return (
                self._target.statuses.sum("model", "bench samples logged"),
                self._target.statuses.sum("model", "bench samples refused"),
            )

        due = len(self.rows), self.sent - len(self.rows)
        if not self._target.ear.listen_until(lambda: counts() == due, _PATIENCE):
            self.differences.append(f"logged and refused {counts()}, not {due}")

    def _compare_log(self) -> None:
        names = (
            "displacement_ratio",
            "engine_speed",
            "load_torque",
            "efficiency",
            "output_speed",
        )
        with self._log.open(newline="") as file:
            logged = list(csv.DictReader(file))
        found = np.array([[float(row[name]) for name in names] for row in logged])
        due = np.array(self.rows)
        if found.shape != due.shape or not np.allclose(
            found, due, rtol=1e-12, atol=0.0
        ):
            self.differences.append(
                f"the log holds {found.shape} numbers that are not those sent"
            )
        if not all(0.0 < float(row["stamp"]) < 1e12 for row in logged):
            self.differences.append("a stamp in the log is no time")


# --- what can be wrong with a message -------------------------------------------------------------

ARRAYS = ("position", "velocity", "effort")


def _stamp(random: np.random.Generator, message: JointState) -> None:
    message.header.stamp.sec = int(random.choice([0, 1, -1, -(2**31), 2**31 - 1]))
    message.header.stamp.nanosec = int(random.choice([0, 1, 999_999_999, 2**32 - 1]))


def _other_joints(random: np.random.Generator, message: JointState) -> None:
    message.name = ["", "motor", *message.name, "öl", "x" * 300]
    for field in ARRAYS:
        setattr(
            message, field, [math.inf, math.nan, *getattr(message, field), 1e308, 0.0]
        )


def _number(random: np.random.Generator, message: JointState) -> None:
    field, joint = USED[random.integers(len(USED))]
    bad = (*_NEVER, *(_NO_STROKE if field == "position" else _NO_SPEED_OR_TORQUE))
    getattr(message, field)[message.name.index(joint)] = float(random.choice(bad))


def _name(random: np.random.Generator, message: JointState) -> None:
    message.name[random.integers(3)] = str(
        random.choice(["", "Engine", "motor", "engine ", "é"])
    )


def _doubled(random: np.random.Generator, message: JointState) -> None:
    again = int(random.integers(3))
    for field in ("name", *ARRAYS):
        values = list(getattr(message, field))
        setattr(message, field, [*values, values[again]])


def _all_empty(random: np.random.Generator, message: JointState) -> None:
    for field in ("name", *ARRAYS):
        setattr(message, field, [])


def _length(random: np.random.Generator, message: JointState) -> None:
    field = str(random.choice(ARRAYS))
    values = list(getattr(message, field))
    setattr(message, field, (values[:0], values[:-1], values * 40)[random.integers(3)])


def _impossible(random: np.random.Generator, message: JointState) -> None:
    message.effort[0] /= random.uniform(5.0, 1e6)  # more power comes out than goes in


HARMLESS = (_stamp, _other_joints)
SPOILERS = (
    *HARMLESS,
    _number,
    _number,
    _number,
    _name,
    _doubled,
    _all_empty,
    _length,
    _length,
    _impossible,
)
