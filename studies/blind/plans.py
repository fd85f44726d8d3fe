# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Operating points of a campaign, and the reference plan on which effects are sized."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.stats import qmc

from hmcvt_core.errors import InputError
from studies.blind.effect import FloatArray
from studies.blind.hydrostatics import NOMINAL_TEMPERATURE
from studies.blind.twin import OperatingPoints

#: Working range of the bench: engine speed (rad/s), load power (W), load torque (N m).
ENGINE_SPEED = (78.5, 230.0)
LOAD_POWER = (18e3, 85e3)
LOAD_TORQUE = (40.0, 600.0)
PLANS = ("random", "factorial", "constant_power")
_REFERENCE_POINTS = 96


def _between(limits: tuple[float, float], share: FloatArray) -> FloatArray:
    return np.asarray(limits[0] + (limits[1] - limits[0]) * share)


def _load(speed: FloatArray, share: FloatArray) -> FloatArray:
    """Load torque at a share of the load power that the bench can ask for at a speed."""
    least = np.maximum(LOAD_TORQUE[0], LOAD_POWER[0] / speed)
    most = np.minimum(LOAD_TORQUE[1], LOAD_POWER[1] / speed)
    return np.asarray(least + (most - least) * share)


@lru_cache(maxsize=64)
def reference_points(temperature_swing: float = 0.0) -> OperatingPoints:
    """96 evenly spread operating points; temperature within 60 deg C +- swing."""
    share = qmc.Halton(d=4, scramble=False).random(_REFERENCE_POINTS + 1)[1:]
    stroke, speed = _between((-1.0, 1.0), share[:, 0]), _between(ENGINE_SPEED, share[:, 1])
    warm = NOMINAL_TEMPERATURE + temperature_swing * (2.0 * share[:, 3] - 1.0)
    return OperatingPoints(stroke, speed, _load(speed, share[:, 2]), warm)


def plan_points(
    plan: str, samples: int, rng: np.random.Generator, temperature_swing: float = 0.0
) -> OperatingPoints:
    """Draw `samples` operating points of a plan; temperature uniform in 60 deg C +- swing.

    `random`: stroke, speed and load uniform. `factorial`: a grid of strokes, speeds and, for
    each speed, torques, thinned at random to the number wanted. `constant_power`: one load power
    of 25 to 46 kW, stroke and speed uniform. Raises InputError for an unknown plan or fewer than
    one sample.
    """
    if samples < 1:
        raise InputError(f"samples is {samples}, must be at least 1")
    if plan not in PLANS:
        raise InputError(f"plan {plan!r} does not exist, expected one of {PLANS}")
    stroke, speed = rng.uniform(-1.0, 1.0, samples), rng.uniform(*ENGINE_SPEED, samples)
    torque = _load(speed, rng.random(samples))
    if plan == "factorial":
        levels = [2, 2, 2]
        while np.prod(levels) < samples:
            levels[int(np.argmin(levels))] += 1
        grid = np.meshgrid(np.linspace(-1.0, 1.0, levels[0]), np.linspace(*ENGINE_SPEED, levels[1]),
                           np.linspace(0.0, 1.0, levels[2]))
        # In random order, so that sessions do not coincide with a factor.
        kept = rng.permutation(grid[0].size)[:samples]
        stroke, speed, share = (axis.ravel()[kept] for axis in grid)
        torque = _load(speed, share)
    elif plan == "constant_power":
        torque = rng.uniform(25e3, 46e3) / speed
    warm = NOMINAL_TEMPERATURE + temperature_swing * rng.uniform(-1.0, 1.0, samples)
    return OperatingPoints(stroke, speed, torque, warm)
