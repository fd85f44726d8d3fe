# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Made-up stages of every layout, and points at which edges of the physics are frequent."""

from hmcvt_core import (
    EfficiencyModel,
    GearPair,
    HydraulicParameters,
    Path,
    PumpMotor,
    Stage,
)
from hmcvt_core.errors import InputError
from hmcvt_core.transmission.stage import MEMBERS


def made_up_model(rng, layout):
    """Return a model of a valid stage; either sense of every path and of the output."""
    while True:
        try:
            stage = _stage(rng, layout)
        except InputError:
            continue  # the senses of the paths contradict `reverse`
        parameters = HydraulicParameters(
            10.0 ** rng.uniform(-12.5, -10.3),
            rng.uniform(0.0, 0.3),
            rng.uniform(0.0, 0.3),
        )
        return EfficiencyModel(stage, parameters)


def _stage(rng, layout):
    has_row = layout != "hydrostatic"
    mechanical, hydraulic, output = rng.permutation(MEMBERS).tolist()
    units = PumpMotor(
        10.0 ** rng.uniform(-5.4, -4.6),
        10.0 ** rng.uniform(-5.4, -4.6),
        rng.uniform(0.0, 0.05),
        rng.uniform(0.0, 0.05),
    )
    return Stage(
        name="made up",
        planetary_constant=rng.uniform(1.3, 4.0) if has_row else 0.0,
        mechanical=_path(rng, "m") if has_row else Path(()),
        mechanical_member=mechanical if has_row else "",
        pump=_path(rng, "p", direction=1),
        motor=_path(rng, "h"),
        motor_member=hydraulic if has_row else "",
        output=_path(rng, "o"),
        output_member=output if has_row else "",
        pump_motor=units,
        layout=layout,
        reverse=has_row and bool(rng.integers(2)),
    )


def _path(rng, name, direction=None):
    pairs = []
    for number in range(rng.integers(1, 3)):
        ratio, efficiency = rng.uniform(0.5, 2.0), rng.uniform(0.93, 0.995)
        pairs.append(GearPair(f"{name}{number}", ratio, efficiency))
    return Path(tuple(pairs), direction or int(rng.choice((-1, 1))))


def edge_points(rng, count):
    """Return strokes, speeds and loads: pull, overrun, no load, close to neutral."""
    stroke = rng.uniform(-1.0, 1.0, count)
    near_neutral = rng.random(count) < 0.1
    stroke[near_neutral] *= 10.0 ** rng.uniform(-5.0, -1.0, near_neutral.sum())
    engine_speed = rng.uniform(40.0, 230.0, count)
    load_torque = rng.uniform(-800.0, 500.0, count)
    load_torque[rng.random(count) < 0.2] = 0.0
    return stroke, engine_speed, load_torque
