# SPDX-License-Identifier: Apache-2.0
"""Where the watts go: every loss of the power balance by the part that takes it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ..transmission.parameters import HydraulicParameters
from ..transmission.stage import Stage
from .balance import PowerFlow
from .effects.base import Effect

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Breakdown:
    """Power in, power out and every loss between them [W]; arrays of one shape.

    Attributes:
        input_power: from the engine.
        output_power: to the load.
        losses: by part: `gear_pair_<name>`, `leakage`, `pump_damping`, `pump_friction`,
            `motor_damping`, `motor_friction`, `planetary_row`, and the name of each effect that
            drags a shaft. Their sum is input_power - output_power.
    """

    input_power: Array
    output_power: Array
    losses: Mapping[str, Array]


def breakdown(
    stage: Stage, parameters: HydraulicParameters, flow: PowerFlow, effects: Sequence[Effect] = ()
) -> Breakdown:
    """Share the lost power of a steady state among the parts of what it was solved with."""
    state, units = flow.state, stage.pump_motor
    delivered = units.pump_displacement * state.displacement_ratio * state.pump_speed
    taken = units.motor_displacement * state.motor_speed
    viscosity = state.viscosity_ratio
    losses = {
        # What leaks does so at the pressure of the motor, eq. (13), behind the lines that all
        # flow passes.
        "leakage": state.pressure * (delivered - taken),
        "pump_damping": parameters.pump_damping * viscosity * state.pump_speed**2,
        "pump_friction": units.pump_friction * np.abs(flow.pump_pressure * delivered),
        "motor_damping": parameters.motor_damping * viscosity * state.motor_speed**2,
        "motor_friction": units.motor_friction * np.abs(state.pressure * taken),
    }
    drop = (flow.pump_pressure - state.pressure) * delivered
    if drop.any():
        losses["pressure_drop"] = drop
    speeds = {"output": state.output_speed, "motor": state.motor_speed,
              "mechanical": state.engine_speed, "pump": state.engine_speed}
    for path, speed in speeds.items():
        pairs = reversed(getattr(stage, path).gear_pairs)
        for pair, (after, before) in zip(pairs, pairwise(flow.torques[path]), strict=True):
            name = f"gear_pair_{pair.name}"
            # A pair that serves two paths loses on both.
            losses[name] = losses.get(name, 0.0) + (before - after) * speed
    losses["planetary_row"] = (flow.torques["motor"][0] * state.motor_speed
                               + flow.torques["mechanical"][0] * state.engine_speed
                               - flow.torques["output"][-1] * state.output_speed)
    for effect in effects:
        watts = np.asarray(
            effect.engine_drag(state) * state.engine_speed
            + effect.pump_drag(state) * state.pump_speed
            + effect.motor_drag(state) * np.abs(state.motor_speed)
            + effect.output_drag(state) * state.output_speed
        )
        if watts.any():
            losses[effect.name] = losses.get(effect.name, 0.0) + watts
    return Breakdown(np.asarray(flow.engine_power), flow.output_power, losses)
