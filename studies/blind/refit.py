# SPDX-License-Identifier: Apache-2.0
"""What remains of a deviation when the base parameters are refitted: the measure of detectability.

Written apart from the diagnosis that is on trial: SciPy's least squares on the served model, with
the shared errors that no bench is free of (gain of the torque meters, gear efficiency).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from scipy.optimize import least_squares

import hmcvt_core as hmcvt
from studies.blind.effect import FloatArray

# log10 of the leakage, dampings: mean and deviation before any bench, and bounds.
_MEAN, _SPREAD = np.array([-10.8, 0.15, 0.20]), np.array([0.6, 0.25, 0.40])
_BOUNDS = np.array([[-13.0, -9.0], [0.0, 3.0], [0.0, 3.0], [-6.0, 6.0], [-6.0, 6.0]])
_METER_GAIN, _GEAR_LOSS = 0.0015, 0.0005  # one deviation of each
_SPEED_NOISE = 0.001  # relative
_STALLED = 100.0  # deviations charged where the model has no answer
_TRUST = np.array([8.0, 1.0])  # samples that the stated noise of efficiency and speed is worth
_ROUNDS = 8


def refitted(
    model: hmcvt.EfficiencyModel, samples: hmcvt.BenchSamples, noise: float, known: bool
) -> tuple[hmcvt.EfficiencyModel, float]:
    """Refit the base parameters of a model without effects.

    Args:
        model: where stage and gear efficiency come from.
        samples: to be met; output speed counts where it is there.
        noise: standard deviation of the efficiency [-].
        known: whether the noise is what is told; else it is what the residuals say as well.

    Returns:
        The refitted model, and the squared deviations that it leaves, over all channels.
    """
    at: Any = (samples.displacement_ratio, samples.engine_speed, samples.load_torque)
    gear = model.stage.gear_pairs[0].efficiency
    worse = model.stage.with_gear_efficiency(gear - _GEAR_LOSS)

    def at_base(base: FloatArray, stage: hmcvt.Stage) -> hmcvt.EfficiencyModel:
        return replace(model, stage=stage, parameters=hmcvt.HydraulicParameters(
            float(10.0 ** base[0]), float(base[1]), float(base[2])))

    def deviations(theta: FloatArray) -> FloatArray:
        there = at_base(theta[:3], model.stage)
        efficiency = there.efficiency(*at)
        loss = at_base(theta[:3], worse).efficiency(*at) - efficiency
        shared = theta[3] * _METER_GAIN * efficiency + theta[4] * loss
        rows = [(samples.efficiency - efficiency - shared) / noise]
        if samples.output_speed is not None:
            rows.append((samples.output_speed - there.output_speed(*at))
                        / (_SPEED_NOISE * samples.output_speed))
        return np.nan_to_num(np.array(rows), nan=_STALLED)

    def penalised(theta: FloatArray, scale: FloatArray) -> FloatArray:
        prior = np.concatenate([(theta[:3] - _MEAN) / _SPREAD, theta[3:]])
        return np.concatenate([(deviations(theta) / scale).ravel(), prior])

    theta, scale = np.concatenate([_MEAN, np.zeros(2)]), np.ones((1, 1))
    for _ in range(1 if known else _ROUNDS):
        theta = least_squares(penalised, theta, bounds=_BOUNDS.T, x_scale="jac", args=(scale,)).x
        left = np.sum(deviations(theta) ** 2, axis=1)
        trust, free = _TRUST[:len(left)], len(samples) - len(theta) / len(left)
        scale = np.sqrt((trust + left) / (trust + free))[:, None]
    return at_base(theta[:3], model.stage), float(np.sum(left))
