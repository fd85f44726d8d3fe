# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A second solution of the steady state, written from the paper's equations alone.

Shafts, row, gears and units by their own laws, of every layout, pull and overrun; what is open,
output speed and pressure, is handed to `scipy.optimize.fsolve`. Nothing of `hmcvt_core` is used but
the numbers that a stage holds.
"""

from math import copysign, prod
from typing import NamedTuple

import numpy as np
from scipy.optimize import fsolve

PRESSURES = (1.0, -1.0, 20.0, -20.0, 80.0, -80.0)  # MPa, where the searches begin


class State(NamedTuple):
    output_speed: float
    engine_torque: float


def steady_states(stage, found, eps, engine_speed, load_torque, near):
    """Every steady state with a turning motor that `fsolve` finds within half of the outputs."""
    units = stage.pump_motor
    v_p, v_m = units.pump_displacement, units.motor_displacement
    row = {
        "sun": 1.0,
        "ring": stage.planetary_constant,
        "carrier": -1.0 - stage.planetary_constant,
    }
    i, eta = (
        {path: function(getattr(stage, path)) for path in stage.paths}
        for function in (
            lambda path: path.direction * prod(pair.ratio for pair in path.gear_pairs),
            lambda path: prod(pair.efficiency for pair in path.gear_pairs),
        )
    )

    def passed(path, torque, speed):
        """Torque beyond a path, not yet geared, of one that is put in."""
        return torque * eta[path] ** copysign(1.0, torque * speed)

    def third(first, second, a, b):
        """Speed of the member that is left, eq. (4)."""
        left = ({"sun", "ring", "carrier"} - {a, b}).pop()
        return -(row[a] * first + row[b] * second) / row[left]

    engine, held, out = stage.mechanical_member, stage.motor_member, stage.output_member

    def state(output, pressure):
        if stage.layout == "input_coupled":
            pump = engine_speed / i["pump"]
            motor = (
                third(engine_speed / i["mechanical"], output * i["output"], engine, out)
                * (i["motor"])
            )
        elif stage.layout == "hydrostatic":
            pump, motor = engine_speed / i["pump"], output * i["output"] * i["motor"]
        else:
            member = third(
                engine_speed / i["mechanical"], output * i["output"], engine, out
            )
            sense = copysign(1.0, -row[engine] / row[held] / i["mechanical"])
            pump, motor = sense * member / i["pump"], output * i["motor"]
        rubbing = np.sign(motor) * units.motor_friction * abs(pressure) * v_m
        motor_torque = (
            pressure * v_m - found.motor_damping * motor - rubbing
        )  # Eq. (14)
        rubbing = np.sign(pump) * units.pump_friction * abs(pressure * eps) * v_p
        pump_torque = (
            pressure * eps * v_p + found.pump_damping * pump + rubbing
        )  # Eq. (15)
        flow = v_p * pump * eps - v_m * motor - found.leakage * pressure  # Eq. (13)
        from_motor = passed("motor", motor_torque, motor) * i["motor"]
        to_pump = -passed("pump", -pump_torque, pump) / i["pump"]
        if stage.layout == "output_coupled":
            torque = -sense * to_pump * i["pump"] / i["pump"]  # of the pump on the row
            share = torque / row[held]
            given = (
                passed("output", -share * row[out], output * i["output"]) * i["output"]
            )
            taken = -passed(
                "mechanical", -share * row[engine] / i["mechanical"], engine_speed
            )
            return flow, from_motor + given, taken
        if stage.layout == "hydrostatic":
            given, taken = from_motor, 0.0
        else:
            share = from_motor / row[held]
            given, taken = -share * row[out], share * row[engine] / i["mechanical"]
            taken = -passed("mechanical", -taken, engine_speed)
        at_output = passed("output", given, output * i["output"]) * i["output"]
        return flow, at_output, taken + to_pump

    states = []
    for expected in near:

        def laws(x, expected=expected):
            flow, at_output, _ = state(x[0] * expected, x[1] * 1e6)
            return (
                flow / (v_m * engine_speed),
                at_output * x[0] * expected / engine_speed - load_torque,
            )

        for pressure in PRESSURES:
            x, _, done, _ = fsolve(laws, [1.0, pressure], full_output=True, xtol=1e-13)
            if done == 1 and max(map(abs, laws(x))) < 1e-7 and abs(x[0] - 1.0) < 0.5:
                states.append(
                    State(x[0] * expected, state(x[0] * expected, x[1] * 1e6)[2])
                )
    return states
