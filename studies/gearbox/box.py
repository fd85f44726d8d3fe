# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A gearbox of five stages with reverse as a truth of its own: nothing of hmcvt computes it.

One planetary row, whose ring the engine drives forward or backward, whose sun the hydraulic motor
drives and whose carrier drives the output through one of four gears. Known by its teeth. Wet
clutches that are open drag by shear alone: torque = drag x viscosity x slip.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

RING, SUN = 96, 36
TEETH = {
    "A": (36, 45),
    "R": (80, 20),
    "P": (31, 40),
    "M": (52, 31),
    "O2": (64, 25),
    "O3": (56, 35),
}
"""Driven and driving teeth of every pair."""
DISPLACEMENT = 55.0
"""Of pump and motor [cm3/rev]."""
OUTPUT = {"F1": ("O2", "O3"), "F2": ("O2",), "F3": ("O3",), "F4": (), "R": ("O2",)}
"""Gear pairs between carrier and output in every stage."""
PAIR_EFFICIENCY = 0.985
FRICTION = 0.01
"""Friction torque / pressure torque of either unit [-]."""
MEDIUM_OIL = 70.0
"""Oil temperature at which the viscosity is 1 [deg C]."""
STANDING = 2.0
"""Motor speed within which friction changes its sense [rad/s]."""
VISCOSITY_SLOPE = 0.022
"""Relative change of the viscosity per kelvin [1/K]."""
METER_RANGES = (1000.0, 3000.0)
"""Of the torque meters of engine and output [N m]."""
METER_CLASS = 0.001
"""Of the torque meters: error / range [-]."""
TYPICAL_DRAG = 0.01
"""Of one open clutch at viscosity 1 [N m s/rad]."""
EFFICIENCY_NOISE = 0.002
"""Of a test, relative, by both torques together [-]."""

_ROW = "row=k pump=P motor=M:sun"
DESCRIPTION = (
    *(
        f"--gear-pair={name}={driven}/{driving}"
        for name, (driven, driving) in TEETH.items()
    ),
    f"--planetary-row=k={RING}/{SUN}",
    f"--pump-displacement={DISPLACEMENT}",
    f"--motor-displacement={DISPLACEMENT}",
    f"--gear-efficiency={PAIR_EFFICIENCY}",
    f"--stage=F1 {_ROW} mechanical=A:ring output=O2,O3:carrier",
    f"--stage=F2 {_ROW} mechanical=A:ring output=O2:carrier",
    f"--stage=F3 {_ROW} mechanical=A:ring output=O3:carrier",
    f"--stage=F4 {_ROW} mechanical=A:ring output=direct:carrier",
    f"--stage=R {_ROW} reverse=yes mechanical=-R:ring output=O2:carrier",
    "--clutch=C1 between=carrier/O2/O3,output closed=F1",
    "--clutch=C2 between=carrier/O2,output closed=F2,R",
    "--clutch=C3 between=carrier/O3,output closed=F3",
    "--clutch=C4 between=carrier,output closed=F4",
    "--clutch=CF between=engine/A,ring closed=F1,F2,F3,F4",
    "--clutch=CR between=-engine/R,ring closed=R",
)
"""Options of its engineer for `hmcvt transmission new`."""


@dataclass(frozen=True)
class Machine:
    """One machine of the type.

    Attributes:
        leakage: of the circuit at viscosity 1 [m3/(s Pa)].
        motor_damping: at viscosity 1 [N m s/rad].
        pump_damping: at viscosity 1 [N m s/rad].
        clutch_drag: of one open clutch at viscosity 1 [N m s/rad].
    """

    leakage: float = 2.5e-11
    motor_damping: float = 0.05
    pump_damping: float = 0.05
    clutch_drag: float = 0.0


@dataclass(frozen=True)
class Test:
    """One steady state, SI units.

    Attributes:
        output_speed: negative backward [rad/s].
        engine_torque: [N m].
        output_torque: with the sign of the output speed [N m].
        pressure: port A less port B of the circuit [Pa].
    """

    __test__ = False  # no class of tests

    output_speed: float
    engine_torque: float
    output_torque: float
    pressure: float


def ratio(pair: str) -> float:
    """Return driving speed / driven speed of a pair [-]."""
    driven, driving = TEETH[pair]
    return driven / driving


def output_ratio(stage: str) -> float:
    """Return carrier speed / output speed of a stage [-]."""
    return math.prod(ratio(pair) for pair in OUTPUT[stage])


def ring_ratio(stage: str) -> float:
    """Return ring speed / engine speed of a stage [-]."""
    return -1.0 / ratio("R") if stage == "R" else 1.0 / ratio("A")


def speed_ratio(stage: str, stroke: float) -> float:
    """Return output speed / engine speed without leakage [-]."""
    sun = stroke / ratio("P") / ratio("M")
    carrier = (RING * ring_ratio(stage) + SUN * sun) / (RING + SUN)
    return carrier / output_ratio(stage)


def _passed(power: float, pairs: int) -> float:
    """Return the power in front of gear pairs for that behind them."""
    efficiency = PAIR_EFFICIENCY**pairs
    return power / efficiency if power > 0.0 else power * efficiency


def steady(
    machine: Machine,
    stage: str,
    stroke: float,
    engine_speed: float,
    output_torque: float,
    oil: float,
) -> Test:
    """Return the steady state against the torque of a brake.

    Args:
        machine: of the type.
        stage: engaged.
        stroke: of the pump [-].
        engine_speed: [rad/s].
        output_torque: of the brake, without sign [N m].
        oil: temperature [deg C].

    Raises:
        ValueError: the brake stalls the output.
    """
    viscosity = math.exp(-VISCOSITY_SLOPE * (oil - MEDIUM_OIL))
    volume = DISPLACEMENT * 1e-6 / (2.0 * math.pi)
    leakage = machine.leakage / viscosity
    ring = ring_ratio(stage) * engine_speed
    pump = engine_speed / ratio("P")
    motor = stroke * pump
    for _ in range(200):
        sun = motor / ratio("M")
        carrier = (RING * ring + SUN * sun) / (RING + SUN)
        output = carrier / output_ratio(stage)
        drag = machine.clutch_drag * viscosity
        heat = drag * _slips_squared(stage, engine_speed, carrier, output)
        output_power = output_torque * abs(output)
        at_carrier = _passed(output_power, len(OUTPUT[stage])) + heat
        sun_torque = at_carrier / carrier * SUN / (RING + SUN)
        turning = math.tanh(motor / STANDING) * math.copysign(1.0, sun_torque)
        motor_torque = sun_torque / ratio("M") * PAIR_EFFICIENCY**-turning
        shaft = motor_torque + machine.motor_damping * viscosity * motor
        lost = FRICTION * turning
        pressure = shaft / (volume * (1.0 - lost))
        settled = (stroke * volume * pump - leakage * pressure) / volume
        if abs(settled - motor) < 1e-12 * pump:
            break
        motor = 0.5 * (settled + motor)
    else:
        raise ValueError(f"{stage} at stroke {stroke:g} is stalled")
    ideal = stroke * volume * pressure
    pump_torque = (
        ideal + FRICTION * abs(ideal) + machine.pump_damping * viscosity * pump
    )
    at_ring = at_carrier * RING / (RING + SUN) * ring / carrier
    at_pump = pump_torque * pump
    # The two clutches of the ring: one is open at any time, its sides turn against each other.
    ring_heat = drag * (engine_speed * (1.0 / ratio("A") + 1.0 / ratio("R"))) ** 2
    into = _passed(at_ring, 1) + _passed(at_pump, 1) + ring_heat
    torque = math.copysign(output_torque, output)
    return Test(output, into / engine_speed, torque, pressure)


def _slips_squared(
    stage: str, engine_speed: float, carrier: float, output: float
) -> float:
    """Return the sum of the squared slips of the open clutches of the output [rad2/s2]."""
    engaged = output_ratio(stage)
    total = 0.0
    for other in ("F1", "F2", "F3", "F4"):
        if not math.isclose(output_ratio(other), engaged):
            total += (carrier / output_ratio(other) - output) ** 2
    return total


def plan(tests: int) -> list[tuple[str, float, float, float, float]]:
    """Return stage, stroke, engine speed, brake torque and oil temperature of a campaign.

    Args:
        tests: in each stage.
    """
    strokes = np.linspace(-0.95, 0.95, 7)
    speeds = np.array([1200.0, 1500.0, 1800.0]) * 2.0 * math.pi / 60.0
    powers = np.array([25e3, 50e3, 80e3])
    points = []
    for stage in OUTPUT:
        # Next to standstill the slip of the reverse stage is as large as its speed.
        usable = strokes[strokes < -0.2] if stage == "R" else strokes
        scale = 0.2 if stage == "R" else 1.0
        for number in range(tests):
            stroke = usable[number % len(usable)]
            speed = speeds[(number + number // len(usable)) % 3]
            power = scale * powers[(number + number // 3) % 3]
            oil = 62.0 + 4.0 * (number % 5)
            torque = power / (speed * abs(speed_ratio(stage, stroke)))
            points.append((stage, float(stroke), float(speed), float(torque), oil))
    return points


def campaign(
    machine: Machine,
    tests: int,
    seed: int,
    zero: float = 0.3,
    days: int = 3,
    year: int = 2026,
) -> list[dict[str, object]]:
    """Return the table of a bench: one row for each test, in the units and words of the bench.

    Args:
        machine: on the bench.
        tests: in each stage.
        seed: of order, noise and zeros.
        zero: deviation of the zeros of the torque meters from day to day / their class [-].
        days: over which the tests are spread.
        year: of the days.
    """
    random = np.random.default_rng(seed)
    points = plan(tests)
    order = random.permutation(len(points))
    deviation = np.array(METER_RANGES) * METER_CLASS * zero
    zeros = random.normal(0.0, 1.0, (days, 2)) * deviation
    rows = []
    for place, index in enumerate(order):
        stage, stroke, speed, torque, oil = points[index]
        day = place * days // len(order)
        done = steady(machine, stage, stroke, speed, torque, oil)
        noise = random.normal(0.0, EFFICIENCY_NOISE / math.sqrt(2.0), 2)
        engine = done.engine_torque * (1.0 + noise[0]) + zeros[day, 0]
        output = done.output_torque * (1.0 + noise[1]) + zeros[day, 1]
        rpm = 60.0 / (2.0 * math.pi)
        rows.append(
            {
                "Datum": f"{9 + day:02d}.03.{year}",
                "Gang": stage,
                "Verstellung [%]": round(100.0 * stroke, 3),
                "Motordrehzahl [1/min]": round(speed * rpm, 2),
                "Motormoment [Nm]": round(engine, 3),
                "Abtriebsdrehzahl [1/min]": round(
                    done.output_speed * rpm * (1.0 + random.normal(0.0, 2e-4)), 3
                ),
                "Abtriebsmoment [Nm]": round(output, 3),
                "Öltemperatur [°C]": round(oil + random.normal(0.0, 0.3), 2),
                "Differenzdruck [bar]": round(
                    done.pressure * 1e-5 * (1.0 + random.normal(0.0, 0.003)), 3
                ),
            }
        )
    return rows
