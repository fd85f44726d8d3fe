# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The shipped drive line, and short cycles."""

from dataclasses import fields, replace

import numpy as np

import hmcvt_core as hmcvt
from hmcvt_core.transmission.ranges import RPM
from hmcvt_tools.mission import Drive, load_vehicle, read_cycle

DRIVE = Drive(
    hmcvt.load_model(hmcvt.data_path("params/tractor.yaml")),
    hmcvt.load_engine(hmcvt.data_path("params/engine.yaml")),
    load_vehicle(hmcvt.data_path("params/vehicle.yaml")),
)
COARSE = 40.0 * RPM
"""Distance of engine speeds that keeps a test short."""


def written(folder, text):
    """Write a cycle file and return its path."""
    path = folder / "cycle.csv"
    path.write_text(text, encoding="utf-8")
    return path


def cycle(folder, header, *rows, step=1.0):
    """Return a cycle of given rows; the time is added."""
    lines = [f"time,{header}"]
    for i, row in enumerate(rows):
        lines.append(",".join(str(cell) for cell in (i, *row)))
    return read_cycle(written(folder, "\n".join(lines)), DRIVE.vehicle, step)


def beginning(read, count):
    """Return the first steps of a cycle."""
    arrays = {}
    for item in fields(read):
        value = getattr(read, item.name)
        if isinstance(value, np.ndarray):
            arrays[item.name] = value[:count]
    ground = {name: watts[:count] for name, watts in read.ground.items()}
    return replace(read, **arrays, ground=ground)


def limits_hold(mission, limits):
    """Whether engine speed and displacement ratio keep their rates, read from the series."""
    speed = np.diff(mission.engine_speed)
    stroke = np.diff(mission.displacement_ratio)
    stage = np.array(mission.stage)
    changed = (stage[1:] != stage[:-1]) & (stage[1:] != "neutral")
    changed &= stage[:-1] != "neutral"
    step = mission.cycle.step
    left = np.where(changed, step - limits.stage_change_time, step)
    slack = 1.0 + 1e-6
    speed_holds = np.abs(speed) <= slack * limits.engine_speed_rate * step
    # A stroke in neutral is NaN: any may follow.
    stroke_breaks = np.abs(stroke) > slack * limits.displacement_rate * left
    return speed_holds.all() and not stroke_breaks.any()
