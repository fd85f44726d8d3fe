# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A second solution of the steady state, written from the paper's equations alone.

Ten equations in ten unknowns, one for each law, handed to `scipy.optimize.root`. Nothing of
`hmcvt_core` is used but the numbers that a stage holds.
"""

import math
from types import SimpleNamespace

from scipy.optimize import root


def path_numbers(path):
    """Ratio with sign, efficiency."""
    ratio = math.prod(pair.ratio for pair in path.gear_pairs)
    return path.direction * ratio, math.prod(pair.efficiency for pair in path.gear_pairs)


def steady_states(stage, parameters, eps, engine_speed, load_torque, near=()):
    """Every steady state with a turning motor that `root` finds, the fastest output first.

    Searches from the motor speed without leakage and from the motor speeds in `near`.
    """
    units = stage.pump_motor
    tight = (eps * engine_speed / path_numbers(stage.pump)[0]
             * units.pump_displacement / units.motor_displacement)
    found = [_solve(stage, parameters, eps, engine_speed, load_torque, motor_drives, start)
             for start in (tight, *near) for motor_drives in (True, False)]
    return sorted((state for state in found if state is not None),
                  key=lambda state: -state.output_speed)


def _solve(stage, parameters, eps, engine_speed, load_torque, motor_drives, start):
    k, units = stage.planetary_constant, stage.pump_motor
    v_p, v_m = units.pump_displacement, units.motor_displacement
    i_mechanical, eta_mechanical = path_numbers(stage.mechanical)
    i_motor, eta_motor = path_numbers(stage.motor)
    i_output, eta_output = path_numbers(stage.output)
    i_pump, eta_pump = path_numbers(stage.pump)
    pump_speed = engine_speed / i_pump
    power = load_torque * engine_speed
    passed = eta_motor if motor_drives else 1.0 / eta_motor

    def unpack(x):
        speeds = dict(zip(("sun", "ring", "carrier"), x[0:3] * engine_speed, strict=True))
        torques = dict(zip(("sun", "ring", "carrier"), x[3:6] * load_torque, strict=True))
        return (speeds, torques, x[6] * engine_speed, x[7] * engine_speed, x[8] * load_torque,
                x[9] * load_torque / v_m)

    def laws(x):
        n, t, output_speed, motor_speed, motor_torque, pressure = unpack(x)
        friction = units.motor_friction * abs(pressure) * v_m * math.copysign(1.0, motor_speed)
        return [
            (k * n["ring"] - (1.0 + k) * n["carrier"] + n["sun"]) / engine_speed,  # Eq. (4)
            (n[stage.mechanical_member] - engine_speed / i_mechanical) / engine_speed,
            (n[stage.motor_member] - motor_speed / i_motor) / engine_speed,
            (output_speed - n[stage.output_member] / i_output) / engine_speed,
            # Torques that the shafts exert on the row: sun : ring : carrier = 1 : k : -(1 + k).
            (t["ring"] - k * t["sun"]) / load_torque,
            (t["carrier"] + (1.0 + k) * t["sun"]) / load_torque,
            # The row gives the load and what the output gears lose.
            (t[stage.output_member] * n[stage.output_member] + power / eta_output) / power,
            (t[stage.motor_member] - motor_torque * i_motor * passed) / load_torque,
            # Eq. (14)
            (pressure * v_m - parameters.motor_damping * motor_speed - motor_torque - friction)
            / load_torque,
            # Eq. (13)
            (v_p * pump_speed * eps - v_m * motor_speed - parameters.leakage * pressure)
            / (v_m * engine_speed),
        ]

    solution = root(laws, _start(stage, start, engine_speed), tol=1e-13)
    n, t, output_speed, motor_speed, motor_torque, pressure = unpack(solution.x)
    if max(map(abs, laws(solution.x))) > 1e-8 or output_speed <= 0.0 \
            or (motor_torque * motor_speed > 0.0) != motor_drives:
        return None
    ideal = pressure * v_p * eps
    # Eq. (15), with friction that resists.
    pump_torque = ideal + units.pump_friction * abs(ideal) + parameters.pump_damping * pump_speed
    from_pump = pump_torque * pump_speed
    from_pump = from_pump / eta_pump if from_pump > 0.0 else from_pump * eta_pump
    mechanical = t[stage.mechanical_member] * n[stage.mechanical_member] / eta_mechanical
    return SimpleNamespace(
        efficiency=power / (mechanical + from_pump), output_speed=output_speed,
        motor_speed=motor_speed, pressure=pressure)


def _start(stage, motor_speed, engine_speed):
    """The state without losses at a motor speed, scaled."""
    k = stage.planetary_constant
    speeds = {
        stage.mechanical_member: engine_speed / path_numbers(stage.mechanical)[0],
        stage.motor_member: motor_speed / path_numbers(stage.motor)[0],
    }
    weights = {"sun": 1.0, "ring": k, "carrier": -(1.0 + k)}
    total = sum(weights[member] * speed for member, speed in speeds.items())
    speeds[stage.output_member] = -total / weights[stage.output_member]
    output_speed = speeds[stage.output_member] / path_numbers(stage.output)[0]
    # Power balance of the row fixes the torque of the sun.
    sun = -engine_speed / speeds[stage.output_member] / weights[stage.output_member]
    torques = [sun, k * sun, -(1.0 + k) * sun]
    motor = dict(zip(("sun", "ring", "carrier"), torques, strict=True))[stage.motor_member]
    motor /= path_numbers(stage.motor)[0]
    scaled = [speeds[member] / engine_speed for member in ("sun", "ring", "carrier")]
    return [*scaled, *torques, output_speed / engine_speed, motor_speed / engine_speed, motor,
            motor]
