# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Operating points of a campaign, and the reference plan on which effects are sized."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.stats import qmc

from hmcvt_core.errors import InputError
from studies.blind.effect import Box, FloatArray
from studies.blind.oil import NOMINAL_TEMPERATURE
from studies.blind.twin import OperatingPoints

#: Working range of the bench: engine speed (rad/s), load power (W), load torque (N m).
ENGINE_SPEED = (78.5, 230.0)
LOAD_POWER = (18e3, 85e3)
LOAD_TORQUE = (40.0, 600.0)
PLANS = ("random", "factorial", "constant_power")
_REFERENCE_POINTS = 96


def _between(limits: tuple[float, float], share: FloatArray) -> FloatArray:
    return np.asarray(limits[0] + (limits[1] - limits[0]) * share)


@lru_cache(maxsize=256)
def reference_points(box: Box, temperature_swing: float = 0.0) -> OperatingPoints:
    """96 evenly spread operating points inside `box`; temperature within 60 deg C +- swing."""
    share = qmc.Halton(d=4, scramble=False).random(16384)[1:]
    stroke = _between((-1.0, 1.0), share[:, 0])
    speed = _between(ENGINE_SPEED, share[:, 1])
    torque = _between(LOAD_POWER, share[:, 2]) / speed
    warm = NOMINAL_TEMPERATURE + temperature_swing * (2.0 * share[:, 3] - 1.0)
    inside = box.contains(stroke, speed, torque)
    inside &= (torque >= LOAD_TORQUE[0]) & (torque <= LOAD_TORQUE[1])
    index = np.flatnonzero(inside)[:_REFERENCE_POINTS]
    if len(index) < _REFERENCE_POINTS:
        raise InputError(f"too little of the working range lies in {box}")
    return OperatingPoints(stroke, speed, torque, warm).select(index)


def plan_points(
    plan: str, samples: int, rng: np.random.Generator, temperature_swing: float = 0.0
) -> OperatingPoints:
    """Draw `samples` operating points of a plan; temperature uniform in 60 deg C +- swing.

    `random`: stroke, speed and power uniform. `factorial`: a grid of strokes, speeds and, for
    each speed, torques, thinned at random to the number wanted. `constant_power`: one load power
    of 25 to 46 kW, stroke and speed uniform. Raises InputError for an unknown plan or fewer than
    one sample.
    """
    if samples < 1:
        raise InputError(f"samples is {samples}, must be at least 1")
    if plan == "random":
        stroke, speed, torque = _random(samples, rng)
    elif plan == "factorial":
        stroke, speed, torque = _factorial(samples, rng)
    elif plan == "constant_power":
        stroke = rng.uniform(-1.0, 1.0, samples)
        speed = rng.uniform(*ENGINE_SPEED, samples)
        torque = rng.uniform(25e3, 46e3) / speed
    else:
        raise InputError(f"plan {plan!r} does not exist, expected one of {PLANS}")
    warm = NOMINAL_TEMPERATURE + temperature_swing * rng.uniform(-1.0, 1.0, samples)
    return OperatingPoints(stroke, speed, torque, warm)


def _random(samples: int, rng: np.random.Generator) -> tuple[FloatArray, FloatArray, FloatArray]:
    stroke = rng.uniform(-1.0, 1.0, samples)
    speed, torque = np.empty(0), np.empty(0)
    while len(speed) < samples:
        more = rng.uniform(*ENGINE_SPEED, 2 * samples)
        load = rng.uniform(*LOAD_POWER, 2 * samples) / more
        fits = (load >= LOAD_TORQUE[0]) & (load <= LOAD_TORQUE[1])
        speed, torque = np.append(speed, more[fits]), np.append(torque, load[fits])
    return stroke, speed[:samples], torque[:samples]


def _factorial(samples: int, rng: np.random.Generator) -> tuple[FloatArray, FloatArray, FloatArray]:
    levels = [2, 2, 2]
    order = 0
    while levels[0] * levels[1] * levels[2] < samples:
        levels[order % 3] += 1
        order += 1
    stroke, speed, share = (axis.ravel() for axis in np.meshgrid(
        np.linspace(-1.0, 1.0, levels[0]), np.linspace(*ENGINE_SPEED, levels[1]),
        np.linspace(0.0, 1.0, levels[2]), indexing="ij"))
    least = np.maximum(LOAD_TORQUE[0], LOAD_POWER[0] / speed)
    most = np.minimum(LOAD_TORQUE[1], LOAD_POWER[1] / speed)
    torque = least + (most - least) * share
    # In random order, so that sessions do not coincide with a factor.
    kept = rng.permutation(len(stroke))[:samples]
    return stroke[kept], speed[kept], torque[kept]
