# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Errors of the bench's torque meters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from studies.blind.effect import Effect, MeterReadings, either_sign


@dataclass(frozen=True)
class TorqueSensor(Effect):
    """Zero or gain error of the engine's or the output's torque meter.

    The engine's meter moves the efficiency only, the output's moves the load torque column with
    it. A gain error bends slightly with load. `sense` +1 makes the meter read high.
    """

    variants: ClassVar[tuple[str, ...]] = (
        "engine_zero", "engine_gain", "output_zero", "output_gain")
    limit: ClassVar[float] = 12.0
    sense: float = either_sign()

    def read(self, readings: MeterReadings) -> MeterReadings:
        engine, output = readings.engine_torque, readings.output_torque
        zero = self.sense * 2.0 * self.size
        gain = self.sense * 0.01 * self.size
        if self.variant == "engine_zero":
            engine = engine + zero
        elif self.variant == "engine_gain":
            engine = engine * (1.0 + gain * (0.95 + 0.05 * np.abs(engine) / 400.0))
        elif self.variant == "output_zero":
            output = output + zero
        else:
            output = output * (1.0 + gain * (0.95 + 0.05 * np.abs(output) / 400.0))
        return MeterReadings(engine, output)
