# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Diagnose an electric drive: a function whose arguments switch effects on.

    python examples/electric_drive.py

A permanent-magnet motor with its inverter runs at a speed and a torque; the bench reads the power
from the battery and the phase current. The model knows copper loss and iron loss. A campaign is
simulated on a drive whose magnets have weakened, and diagnosed.
"""

import numpy as np

import hmcvt_core as hmcvt

TORQUE_CONSTANT = 0.60  # N m/A, with new magnets
CHANNEL_NOISE = {"battery_power": 15.0, "phase_current": 0.15}  # W, A


def drive(
    points: hmcvt.Points,
    *,
    resistance: float,
    iron_loss: float,
    magnet_weakening: float = 0.0,
    bearing_drag: float = 0.0,
    windage: float = 0.0,
    conduction_drop: float = 0.0,
    torque_zero: float = 0.0,
) -> dict[str, hmcvt.Array]:
    """Return battery power [W] and phase current [A] at n points, shape (n,) each.

    Args:
        points: `speed` [rad/s] and `torque` [N m] as the meter reads it, shape (n,) each.
        resistance: of the copper [ohm].
        iron_loss: hysteresis loss per speed [W s/rad].
        magnet_weakening: part of the flux that is lost.
        bearing_drag: torque [N m].
        windage: torque per squared speed [N m s2].
        conduction_drop: voltage across the inverter [V].
        torque_zero: what the torque meter reads at rest [N m].
    """
    speed = points["speed"]
    torque = points["torque"] - torque_zero + bearing_drag + windage * speed**2
    current = torque / (TORQUE_CONSTANT * (1.0 - magnet_weakening))
    copper = 1.5 * resistance * current**2
    iron = iron_loss * speed
    inverter = 3.0 * conduction_drop * np.abs(current)
    power = torque * speed + copper + iron + inverter
    return {"battery_power": power, "phase_current": current}


system = hmcvt.Simulator(
    function=drive,
    axes=(
        hmcvt.Axis.of("speed", "rad/s", digits=0),
        hmcvt.Axis.of("torque", "N m", digits=1),
    ),
    channels=(
        hmcvt.Channel.of(
            "phase_current", "A", CHANNEL_NOISE["phase_current"], digits=2
        ),
        hmcvt.Channel.of(
            "battery_power", "W", CHANNEL_NOISE["battery_power"], digits=0
        ),
    ),
    parameters=(
        hmcvt.Parameter("resistance", "ohm", 0.020, 0.002, low=0.0),
        hmcvt.Parameter("iron_loss", "W s/rad", 1.0, 0.2, low=0.0),
    ),
    effects=(
        hmcvt.Switch(
            "magnet_weakening",
            "-",
            0.03,
            0.0,
            0.3,
            summary="the magnets have lost flux",
            component="rotor",
            remedy="measure the voltage at no load",
        ),
        hmcvt.Switch(
            "bearing_drag",
            "N m",
            0.5,
            0.0,
            5.0,
            summary="the bearing drags with a constant torque",
            component="bearing",
            remedy="let the rotor coast down",
        ),
        hmcvt.Switch(
            "windage",
            "N m s2",
            5e-6,
            0.0,
            5e-5,
            summary="the rotor churns air or oil",
            component="rotor",
            remedy="let the rotor coast down",
        ),
        hmcvt.Switch(
            "conduction_drop",
            "V",
            0.5,
            0.0,
            5.0,
            summary="the inverter drops more voltage",
            component="inverter",
            remedy="measure the voltage across a switch",
        ),
        hmcvt.Switch(
            "torque_zero",
            "N m",
            0.3,
            -3.0,
            3.0,
            summary="the torque meter reads an offset",
            component="sensor",
            remedy="read the torque meter at rest",
        ),
    ),
)


def campaign(
    seed: int, tests: int = 60, **hidden: float
) -> tuple[dict[str, hmcvt.Array], dict[str, hmcvt.Array]]:
    """Return operating points and readings of a simulated drive with hidden effects."""
    rng = np.random.default_rng(seed)
    points = {
        "speed": rng.uniform(50.0, 600.0, tests),
        "torque": rng.uniform(5.0, 80.0, tests),
    }
    resistance = 0.020 + 0.001 * rng.standard_normal()
    iron_loss = 1.0 + 0.1 * rng.standard_normal()
    true = drive(points, resistance=resistance, iron_loss=iron_loss, **hidden)
    readings = {}
    for name, noise in CHANNEL_NOISE.items():
        readings[name] = true[name] + noise * rng.standard_normal(tests)
    return points, readings


if __name__ == "__main__":
    points, readings = campaign(seed=1, magnet_weakening=0.04)
    observed = hmcvt.observe_system(system, {**points, **readings}, noise=CHANNEL_NOISE)
    print(hmcvt.diagnose_system(system, observed).report())
