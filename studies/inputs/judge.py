# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Read random inputs and compare them with their truth."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from hmcvt_core import load_engine
from hmcvt_core.errors import InputError
from hmcvt_tools.mission import read_cycle
from hmcvt_tools.mission.vehicle import Vehicle, load_vehicle

from .cycles import RandomCycle
from .engines import RandomEngine
from .vehicles import RandomVehicle

TOLERANCE = 1e-4


class Judged(NamedTuple):
    """What reading an input did.

    Attributes:
        refused: message of the error; `""` where it was read.
        wrong: what is wrong without a word; `""` for nothing.
    """

    refused: str
    wrong: str = ""


def _read(reader: Callable[[Any], Any], path: Any) -> tuple[Any, Judged]:
    try:
        return reader(path), Judged("")
    except InputError as error:
        return None, Judged(str(error))
    except Exception as error:  # what a user would see as a traceback
        return None, Judged(repr(error), f"traceback: {error!r}")


def judge_cycle(cycle: RandomCycle) -> Judged:
    """Read a cycle; every demand is right, or its column is named as not used."""
    read, judged = _read(read_cycle, cycle.path)
    if read is None:
        return judged
    remarks = " ".join(read.remarks)
    speed, power = cycle.output
    expected = {
        "output_speed": (read.output_speed, speed),
        "output_power": (read.output_power, power),
    }
    zero = np.zeros(len(read))
    for name in ("pto_power", "auxiliary_power", "lowest_engine_speed"):
        header = cycle.headers.get(name, "")
        if header and header in remarks:
            continue
        expected[name] = (getattr(read, name), cycle.demands.get(name, zero))
    said = [name for name, cell in cycle.headers.items() if cell in remarks]
    for header in cycle.foreign:
        if header not in remarks:
            return Judged("", f"column {header!r} is not named")
    for name, (values, truth) in expected.items():
        if name.startswith("output") and said:
            continue
        if len(values) != len(truth):
            return Judged("", f"{len(values)} steps, {len(truth)} in the file")
        if not np.allclose(values, truth, rtol=TOLERANCE, atol=1e-3):
            return Judged("", f"{name} is {values[:3]}, not {truth[:3]}")
    return judged


def judge_engine(engine: RandomEngine) -> Judged:
    """Read an engine map; the fuel is right at its points."""
    read, judged = _read(load_engine, engine.path)
    if read is None:
        return judged
    inner = engine.torque < 0.95 * engine.torque.max()
    speed = np.clip(engine.speed, read.speed[0], read.speed[-1])
    fuel = read.fuel_rate(speed, 0.98 * engine.torque)
    slope = 0.02 * engine.torque * engine.speed / (0.43 * 42.8e6)
    error = np.abs(fuel / (engine.fuel - slope) - 1.0)[inner]
    if np.nanmax(error) > 5e-3 or np.isnan(error).any():
        return Judged("", f"fuel differs by {100 * np.nanmax(error):.2f} %")
    return judged


def judge_vehicle(vehicle: RandomVehicle) -> Judged:
    """Read a vehicle file; every value is right, and a misspelt key is refused."""
    read, judged = _read(load_vehicle, vehicle.path)
    if read is None:
        return judged
    if vehicle.misspelt:
        return Judged("", f"key {vehicle.misspelt} is taken or dropped")
    for key, value in vehicle.values.items():
        if not np.isclose(getattr(read, key), value, rtol=TOLERANCE):
            return Judged("", f"{key} is {getattr(read, key)}, not {value}")
    usual = Vehicle()
    for key in ("mass", "slip"):
        if key not in vehicle.values and getattr(read, key) != getattr(usual, key):
            return Judged("", f"{key} is not the usual one")
    return judged
