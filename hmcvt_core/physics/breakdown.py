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
from .balance import PowerFlow, through_gears
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
    losses = _hydraulic_losses(stage, parameters, flow)
    _add_gears_and_row(losses, stage, flow, effects)
    state = flow.state
    for effect in effects:
        watts = np.asarray(
            effect.engine_drag(state) * state.engine_speed
            + effect.pump_drag(state) * state.pump_speed
            + effect.motor_drag(state) * np.abs(state.motor_speed)
            + effect.output_drag(state) * state.output_speed
        )
        if watts.any():
            losses[effect.name] = losses.get(effect.name, 0.0) + watts
    return Breakdown(flow.engine_power, flow.output_power, losses)


def _hydraulic_losses(
    stage: Stage, parameters: HydraulicParameters, flow: PowerFlow
) -> dict[str, Array]:
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
    return {**losses, "pressure_drop": drop} if drop.any() else losses


def _add_gears_and_row(
    losses: dict[str, Array], stage: Stage, flow: PowerFlow, effects: Sequence[Effect]
) -> None:
    state = flow.state
    passed = []
    for path, torque, speed, direction in (
        (stage.output, flow.output_torque, state.output_speed, 1.0),
        (stage.motor, flow.row_motor_torque, state.motor_speed, flow.direction),
        (stage.mechanical, flow.row_mechanical_torque, state.engine_speed, 1.0),
        (stage.pump, flow.pump_torque / stage.pump.ratio, state.engine_speed,
         np.sign(flow.pump_torque)),
    ):
        torques = through_gears(path, torque, speed, direction, effects)
        passed.append(torques[-1])
        for pair, (after, before) in zip(
                reversed(path.gear_pairs), pairwise(torques), strict=True):
            name = f"gear_pair_{pair.name}"
            # A pair that serves two paths loses on both.
            losses[name] = losses.get(name, 0.0) + (before - after) * speed
    losses["planetary_row"] = (flow.row_motor_torque * state.motor_speed
                               + flow.row_mechanical_torque * state.engine_speed
                               - passed[0] * state.output_speed)
