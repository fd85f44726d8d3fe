# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What happened on a bench, and what each of its channels recorded of it.

Nothing of the readers of `hmcvt_tools` is used here, nor in `files`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

SECONDS = 9.0
"""Length of a steady test [s]."""
FEWEST_SECONDS = 7.0
"""A test that all channels cover so long [s] has to arrive, or its loss to be stated."""
NAMES = ("EngineSpeed", "EngineTorque", "OutputSpeed", "OutputTorque", "PumpStroke")
INPUT = ("EngineSpeed", "EngineTorque")
OUTPUT = ("OutputSpeed", "OutputTorque")
NOISE = 3e-4
"""Standard deviation of speeds and torques, as a fraction."""
FOREIGN = {
    "CoolantTemperature": ("degC", 85.0),
    "ChargePressure": ("bar", 24.0),
    "EngineSpeedSetpoint": ("rpm", 1500.0),
    "AmbientTemperature": ("degC", 21.0),
    "FanSpeed": ("rpm", 2100.0),
}
"""Channels that hold none of the quantities, with unit and typical value."""


class Readings(NamedTuple):
    """Readings of one channel.

    Attributes:
        time: since the first test begins, shape (n,) [s].
        values: in r/min, N m, percent or the unit of a foreign channel, shape (n,).
    """

    time: Any
    values: Any


@dataclass(frozen=True)
class History:
    """Tests of a bench, one after the other.

    Attributes:
        seconds: length of each test [s].
        tests: value of each channel in each test, shape (tests,) each.
        readings: by channel.
        features: what was drawn.
    """

    seconds: float
    tests: dict[str, Any]
    readings: dict[str, Readings]
    features: dict[str, Any]

    @property
    def efficiency(self) -> Any:
        """Output power / engine power of each test, shape (tests,)."""
        return self.load / self.tests["EngineTorque"]

    @property
    def load(self) -> Any:
        """Output power / engine speed of each test, shape (tests,) [N m]."""
        out = self.tests["OutputSpeed"] * self.tests["OutputTorque"]
        return out / self.tests["EngineSpeed"]

    @property
    def covered(self) -> Any:
        """Whether all channels cover a test for long enough, shape (tests,)."""
        begin = 0.0
        end = np.inf
        for name in NAMES:
            time = self.readings[name].time
            begin = max(begin, float(time[0]))
            if name != "PumpStroke" or not self.features["on_change"]:
                end = min(end, float(time[-1]))
        starts = self.seconds * np.arange(len(self.efficiency))
        inside = np.minimum(starts + self.seconds, end) - np.maximum(starts, begin)
        return inside >= FEWEST_SECONDS


@dataclass(frozen=True)
class Recording:
    """A file and what it holds.

    Attributes:
        path: of the file.
        options: of the command.
        history: what happened.
        must_ask: whether the file leaves something open that no reader can know.
        features: how it was written.
    """

    path: Path
    options: tuple[str, ...]
    history: History
    must_ask: bool
    features: dict[str, Any] = field(default_factory=dict)


def random_history(rng: np.random.Generator) -> History:
    """Draw tests and how the channels sample them.

    Args:
        rng: of all choices.
    """
    count = int(rng.integers(3, 6))
    stroke = np.linspace(-0.9, 0.9, count) + rng.uniform(-0.05, 0.05, count)
    stroke = rng.permutation(stroke)
    speed = rng.uniform(1000.0, 2000.0, count)
    torque = rng.uniform(150.0, 500.0, count)
    ratio = 1.0 + 0.5 * stroke
    efficiency = rng.uniform(0.70, 0.92, count)
    tests = {
        "EngineSpeed": speed,
        "EngineTorque": torque,
        "OutputSpeed": ratio * speed,
        "OutputTorque": torque * efficiency / ratio,
        "PumpStroke": 100.0 * stroke,
    }
    features = {
        "rate": float(rng.choice([10.0, 20.0, 50.0])),
        "output_rate": float(rng.choice([10.0, 20.0, 25.0])),
        "delay": float(rng.choice([0.0, 0.0, rng.uniform(0.0, 2.0 * SECONDS)])),
        "on_change": bool(rng.random() < 0.4),
        "early": float(rng.choice([0.0, 3.7, 12.0])),
    }
    seconds = float(rng.choice([SECONDS, SECONDS, 40.0]))
    readings = {}
    for name in NAMES:
        rate = features["rate"]
        begin = -features["early"]
        if name in OUTPUT:
            rate = features["output_rate"]
            begin += features["delay"]
        noise = 0.0 if name == "PumpStroke" else NOISE
        time = np.arange(begin, count * seconds, 1.0 / rate)
        values = _values(rng, tests[name], time, seconds, noise)
        if name == "PumpStroke" and features["on_change"]:
            changed = np.append(True, np.diff(values) != 0.0)
            time = time[changed]
            values = values[changed]
        readings[name] = Readings(time, values)
    foreign = rng.choice(list(FOREIGN), int(rng.integers(0, 3)), replace=False)
    time = readings["EngineSpeed"].time
    for name in foreign.tolist():
        middle = FOREIGN[name][1]
        values = middle * (1.0 + 0.01 * rng.standard_normal(len(time)))
        readings[name] = Readings(time, values)
    features["foreign"] = tuple(foreign.tolist())
    return History(seconds, tests, readings, features)


def _values(
    rng: np.random.Generator, tests: Any, time: Any, seconds: float, noise: float
) -> Any:
    """Return the readings of a channel at times [s]; before the first test it is as in it."""
    test = np.clip(np.floor(time / seconds + 1e-9).astype(int), 0, len(tests) - 1)
    return tests[test] * (1.0 + noise * rng.standard_normal(len(time)))
