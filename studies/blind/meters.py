# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Errors of the bench's torque meters."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from studies.blind.effect import Effect, FloatArray, either_sign


@dataclass(frozen=True)
class TorqueSensor(Effect):
    """Zero or gain error of the engine's or the output's torque meter.

    The engine's meter moves the efficiency only, the output's moves the load torque column with
    it. A gain error bends slightly with load. `sense` +1 makes the meter read high.
    """

    variants: ClassVar[tuple[str, ...]] = (
        "engine_zero",
        "engine_gain",
        "output_zero",
        "output_gain",
    )
    limit: ClassVar[float] = 12.0
    sense: float = either_sign()

    def read(
        self, engine_torque: FloatArray, output_torque: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        meter, _, error = self.variant.partition("_")
        torque = engine_torque if meter == "engine" else output_torque
        if error == "zero":
            shown = torque + self.sense * 2.0 * self.size
        else:
            form_error = 0.95 + 0.05 * np.abs(torque) / 400.0
            shown = torque * (1.0 + self.sense * 0.01 * self.size * form_error)
        return (shown, output_torque) if meter == "engine" else (engine_torque, shown)
