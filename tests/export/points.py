# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Random operating points, and how two answers are compared."""

import numpy as np

from hmcvt_core.transmission.ranges import ANY_LOAD, ENGINE_SPEED
from hmcvt_core.transmission.stage import speed_ratio


def random_points(seed, count, kind=np.float64):
    """Return strokes, engine speeds and loads: pull, overrun, zero load, zero stroke."""
    rng = np.random.default_rng(seed)
    stroke = rng.uniform(-1.0, 1.0, count)
    stroke[rng.random(count) < 0.02] = 0.0
    speed = rng.uniform(ENGINE_SPEED.low, ENGINE_SPEED.high, count)
    load = rng.uniform(ANY_LOAD.low, ANY_LOAD.high, count)
    usual = rng.random(count) < 0.5
    load[usual] = rng.uniform(-400.0, 400.0, usual.sum())
    load[rng.random(count) < 0.05] = 0.0
    return tuple(column.astype(kind).astype(float) for column in (stroke, speed, load))


def random_outputs(seed, count, stage):
    """Return output speeds and powers that a stage reaches at usual engine speeds, mostly."""
    rng = np.random.default_rng(seed)
    speed = speed_ratio(stage, rng.uniform(-1.0, 1.0, count))
    speed = speed * rng.uniform(80.0, 230.0, count)
    power = np.exp(rng.uniform(np.log(500.0), np.log(3e5), count))
    valid = (np.abs(speed) > 0.2) & (np.abs(speed) < 900.0)
    return speed[valid], power[valid]


def bits_differ(first, second):
    """Count numbers that differ in any bit but those of NaN."""
    both_nan = np.isnan(first) & np.isnan(second)
    return int((~((first == second) | both_nan)).sum())
