# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Operating points of a campaign, and the reference plan on which effects are sized."""

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
    stroke, speed = (
        _between((-1.0, 1.0), share[:, 0]),
        _between(ENGINE_SPEED, share[:, 1]),
    )
    warm = NOMINAL_TEMPERATURE + temperature_swing * (2.0 * share[:, 3] - 1.0)
    return OperatingPoints(stroke, speed, _load(speed, share[:, 2]), warm)


def random_points(
    samples: int, rng: np.random.Generator, temperature_swing: float = 0.0
) -> OperatingPoints:
    """Draw stroke, speed and load uniformly, and temperature in 60 deg C +- swing.

    Raises InputError for fewer than one sample.
    """
    if samples < 1:
        raise InputError(f"samples is {samples}, must be at least 1")
    stroke, speed = rng.uniform(-1.0, 1.0, samples), rng.uniform(*ENGINE_SPEED, samples)
    torque = _load(speed, rng.random(samples))
    warm = NOMINAL_TEMPERATURE + temperature_swing * rng.uniform(-1.0, 1.0, samples)
    return OperatingPoints(stroke, speed, torque, warm)
