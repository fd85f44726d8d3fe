# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Build the shipped work cycles from published figures.

    python -m studies.cycles [FOLDER]

Means, ranges and the equations of slip and rolling resistance are published; each cycle names its
source. The course over time is drawn from a fixed seed: no published record at 1 s was at hand.

D497: ASABE D497.7, Agricultural Machinery Management Data: draft F (A + B S + C S^2) W T, and the
equations of Brixius for gross traction, motion resistance and slip.
"""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hmcvt_core.files.table import csv_text
from hmcvt_core.transmission.ranges import Array

DURATION = 1200  # s
MASS = 7500.0  # kg, as in params/vehicle.yaml
GRAVITY = 9.81
FIRM = 55.0
"""Mobility number of a firm soil, D497 clause 3."""
TILLED = 40.0
"""Mobility number of a tilled soil, D497 clause 3."""
ROAD_RESISTANCE = 0.02
"""Rolling resistance on a road: Renius, Fundamentals of Tractor Design (2020)."""
ROAD_SLIP = 0.01
FIELD_RATE = 0.8
"""Highest change of the ground speed in the field and on the road [km/h/s]; assumed."""
FORCE_RATE = 5.0
"""Highest change of the drawbar force as an implement enters or leaves the soil [kN/s]; assumed."""

PLOUGH_SOURCE = (
    "draft of a mouldboard plough, D497 table 1: 0.7 (652 + 5.1 S^2) W T in a medium soil, "
    "W = 1.6 m, T = 20 cm, S = 8 km/h: 21.9 kN; firm soil; turns of 18 s assumed"
)
ROTARY_SOURCE = (
    "power harrow at 6 km/h, PTO 1000 r/min: PTO torque within 80 to 620 N m and draught within "
    "4 to 13 kN as measured by Balsari et al., Biosystems Engineering 202 (2021) 28-41; means "
    "400 N m and 8 kN; turns at the lower end; tilled soil"
)
TRANSPORT_SOURCE = (
    "trailer of 12 t behind the tractor, rolling resistance of a road 0.02 (Renius 2020), limit "
    "40 km/h (EU class of tractors T1a), village 25 km/h; hills of 1.5 % and stops assumed"
)
SOWING_SOURCE = (
    "grain drill with press wheels, D497 table 1: 300 N a row, 40 rows, 10 km/h; tilled soil; "
    "fan and hydraulics 12 kW and turns of 16 s assumed"
)
LOADER_SOURCE = (
    "short loading cycle of 30 s (Caterpillar Performance Handbook, wheel loaders: 0.45 to 0.55 "
    "min); engine from 1700 r/min (usual advice for loader work); bucket force, lifting power and "
    "speeds assumed: the shipped transmission reverses up to about 3.5 km/h"
)


@dataclass(frozen=True)
class Phase:
    """A part of a cycle in which the demand holds.

    Attributes:
        seconds: length [s].
        speed: at its end, reached by the acceleration of the cycle [km/h].
        force: at the drawbar [kN].
        pto: at the PTO shaft [kW].
        auxiliary: at the engine [kW].
        slope: rise / distance [-].
        lowest: engine speed that the hydraulics need [r/min].
    """

    seconds: int
    speed: float
    force: float = 0.0
    pto: float = 0.0
    auxiliary: float = 3.0
    slope: float = 0.0
    lowest: float = 0.0


def wandering(rng: np.random.Generator, count: int, seconds: float) -> Array:
    """Return noise of mean 0 and variance 1 that forgets within a time [s]."""
    kept = np.exp(-1.0 / seconds)
    noise = rng.normal(size=count)
    values = np.empty(count)
    values[0] = noise[0]
    for i in range(1, count):
        values[i] = kept * values[i - 1] + np.sqrt(1.0 - kept**2) * noise[i]
    return values


def column(phases: Sequence[Phase], name: str) -> Array:
    """Return a quantity of the phases, second by second."""
    values: list[float] = []
    while len(values) < DURATION:
        for phase in phases:
            values += [getattr(phase, name)] * phase.seconds
    return np.array(values[:DURATION])


def ramped(speed: Array, rate: float) -> Array:
    """Return a speed that changes by at most a rate in a second."""
    values = np.empty_like(speed)
    now = 0.0
    for i, wanted in enumerate(speed):
        now += float(np.clip(wanted - now, -rate, rate))
        values[i] = now
    return values


def traction(pull: Array, mobility: float) -> tuple[Array, Array]:
    """Return slip and motion resistance ratio at net pulls [N], D497 clause 3."""
    weight = MASS * GRAVITY
    slip = np.full_like(pull, 0.05)
    resistance = np.full_like(pull, 0.06)
    for _ in range(50):
        resistance = 1.0 / mobility + 0.04 + 0.5 * slip / np.sqrt(mobility)
        gross = np.maximum(pull, 0.0) / weight + resistance
        most = 0.88 * (1.0 - np.exp(-0.1 * mobility))
        slip = -np.log(1.0 - np.maximum(gross - 0.04, 0.0) / most) / 7.5
    return slip, resistance


def cycle(
    source: str,
    phases: Sequence[Phase],
    mobility: float | None,
    spread: float,
    rate: float,
    seed: int,
) -> str:
    """Return a cycle file.

    Args:
        source: of the figures.
        phases: repeated up to `DURATION`.
        mobility: of the soil; None on a road.
        spread: relative standard deviation of force and PTO power [-].
        rate: of the speed [km/h/s].
        seed: of the course over time.
    """
    rng = np.random.default_rng(seed)
    speed = ramped(column(phases, "speed"), rate)
    course = 0.6 * wandering(rng, DURATION, 30.0) + 0.8 * wandering(rng, DURATION, 2.0)
    factor = 1.0 + spread * np.clip(course, -2.5, 2.5)
    force = 1e3 * ramped(column(phases, "force"), FORCE_RATE) * factor
    pto = 1e3 * column(phases, "pto") * factor
    if mobility is None:
        force = force + trailer_force(speed, column(phases, "slope"))
        slip = np.full(DURATION, ROAD_SLIP)
        resistance = np.full(DURATION, ROAD_RESISTANCE)
    else:
        slip, resistance = traction(force, mobility)
    columns = {
        "time [s]": np.arange(DURATION),
        "ground_speed [km/h]": speed.round(3),
        "drawbar_force [N]": force.round(0),
        "pto_power [W]": pto.round(0),
        "auxiliary_power [W]": 1e3 * column(phases, "auxiliary"),
        "lowest_engine_speed [r/min]": column(phases, "lowest"),
        "slope": column(phases, "slope"),
        "rolling_resistance": resistance.round(4),
        "slip": slip.round(4),
    }
    return f"# {source}.\n# Made by studies/cycles.py.\n" + csv_text(columns)


TRAILER_MASS = 12_000.0  # kg


def trailer_force(speed: Array, slope: Array) -> Array:
    """Return the drawbar force of a trailer on a road [N]."""
    gain = np.diff(speed, prepend=speed[0]) / 3.6
    return TRAILER_MASS * (GRAVITY * (ROAD_RESISTANCE + slope) + gain)


LOADER_SPEED = 1700.0
"""Lowest engine speed of loader work: advice of a maker of loaders, 1700 to 2200 r/min [r/min]."""

PLOUGHING = (
    Phase(90, 8.0, 21.9),
    Phase(3, 5.0, 5.0, auxiliary=12.0),
    Phase(12, 5.0),
    Phase(3, 5.0, 5.0, auxiliary=12.0),
)
ROTARY_TILLING = (
    Phase(120, 6.0, 8.0, pto=41.9, auxiliary=3.0),
    Phase(4, 4.0, 2.0, pto=8.4, auxiliary=10.0),
    Phase(10, 4.0, 0.0, pto=8.4),
    Phase(4, 4.0, 2.0, pto=8.4, auxiliary=10.0),
)
TRANSPORT = (
    Phase(5, 0.0),
    Phase(60, 25.0),
    Phase(80, 40.0),
    Phase(60, 40.0, slope=0.015),
    Phase(50, 40.0, slope=-0.015),
    Phase(60, 40.0),
    Phase(25, 15.0),
    Phase(40, 25.0),
    Phase(20, 0.0),
)
SOWING = (
    Phase(110, 10.0, 12.0, auxiliary=12.0),
    Phase(3, 6.0, 4.0, auxiliary=18.0),
    Phase(10, 6.0, 0.0, auxiliary=8.0),
    Phase(3, 6.0, 4.0, auxiliary=18.0),
)
LOADER = (
    Phase(5, 6.0, lowest=LOADER_SPEED),
    Phase(5, 2.0, 25.0, auxiliary=12.0, lowest=LOADER_SPEED),
    Phase(2, 0.0, auxiliary=20.0, lowest=LOADER_SPEED),
    Phase(6, -3.0, auxiliary=8.0, lowest=LOADER_SPEED),
    Phase(6, 6.0, auxiliary=20.0, lowest=LOADER_SPEED),
    Phase(2, 0.0, auxiliary=12.0, lowest=LOADER_SPEED),
    Phase(4, -3.0, auxiliary=5.0, lowest=LOADER_SPEED),
)


def main() -> None:
    """Write the five cycles into a folder, `data` when none is given."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "data")
    texts = {
        "ploughing": cycle(PLOUGH_SOURCE, PLOUGHING, FIRM, 0.08, FIELD_RATE, 1),
        "rotary_tilling": cycle(
            ROTARY_SOURCE, ROTARY_TILLING, TILLED, 0.1, FIELD_RATE, 2
        ),
        "transport": cycle(TRANSPORT_SOURCE, TRANSPORT, None, 0.0, FIELD_RATE, 3),
        "sowing": cycle(SOWING_SOURCE, SOWING, TILLED, 0.06, FIELD_RATE, 4),
        "loader": cycle(LOADER_SOURCE, LOADER, FIRM, 0.15, 2.0, 5),
    }
    for name, text in texts.items():
        (folder / f"cycle_{name}.csv").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
