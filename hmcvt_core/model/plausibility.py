# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Whether pressure and output speed of a bench can be those of the transmission in the file."""

import numpy as np

from ..files.bench import BenchSamples
from ..transmission.parameters import PRIOR_MEAN, from_scaled
from ..transmission.ranges import Array
from ..transmission.stage import CM3_PER_REV, Stage, speed_ratio
from .model import EfficiencyModel
from .signs import sign_problems, signs_by_stage
from .staged_samples import by_stage

_TYPICAL_LEAKAGE = float(from_scaled(PRIOR_MEAN)[0])  # m3/(s Pa), before any bench
_CURVATURE = 0.01
"""Deviation of the speed ratio from a straight line over the stroke, by the losses [-]."""
_STROKE_OFFSET = 0.1
"""Of a full stroke: largest offset of an actuator, as of effect `displacement_error`."""
_SLOPE_LOSS = 0.35
"""Of the slope: what a dead band and the damping of a leaky unit take."""
_SLOPE_ERRORS = 3.0  # standard errors
_PRIOR_WIDTH = 2.0  # of the factor on the typical leakage
_LOADED = 1e6
"""Pressure above which the torque of the motor decides it [Pa]."""
_OTHER_MOTOR = 1.25
"""Factor on the pressure that no unmodelled loss explains."""


def pressure_remark(model: EfficiencyModel, samples: BenchSamples) -> str | None:
    """Return a sentence where the pressure does not fit this motor under its load, else None."""
    if samples.pressure is None:
        return None
    expected = model.readings_at(samples.points)["pressure"]
    loaded = np.abs(expected) > _LOADED  # False for NaN
    if not loaded.any():
        return None
    factor = float(np.median(samples.pressure[loaded] / expected[loaded]))
    if 1.0 / _OTHER_MOTOR < factor < _OTHER_MOTOR:
        return None
    volume = model.stage.pump_motor.motor_displacement / CM3_PER_REV
    return (
        f"the pressure is {factor:.2g} times that of a motor of {volume:.3g} cm3/r under this "
        "load: check the displacement of the motor in the file, the unit of the pressure, and "
        "that the low side is taken off"
    )


def gear_train_remarks(model: EfficiencyModel, samples: BenchSamples) -> list[str]:
    """Return a sentence for each stage whose output speed does not fit its gear train."""
    remarks = sign_problems(signs_by_stage(model, samples))
    if remarks:
        return remarks  # a line through speeds of the wrong sense says nothing further
    for name, part in by_stage(model, samples).items():
        remark = gear_train_remark(model.in_stage(name).stage, part)
        if remark is not None:
            remarks.append(remark)
    return remarks


def gear_train_remark(stage: Stage, samples: BenchSamples) -> str | None:
    """Return a sentence where the output speed does not fit this gear train, else None.

    A robust line through output / engine speed over the stroke gives the ratio at no stroke and
    what a full stroke adds. Leakage is a third regressor: by eqs (13), (14) it lowers the ratio in
    proportion to load torque / output speed. An error of the stroke moves either a little.
    """
    # The ratio of an output-coupled stage is no line over the stroke.
    if samples.output_speed is None or stage.layout == "output_coupled":
        return None
    level = stage.mechanical_speed_ratio
    change = float(speed_ratio(stage, np.array(1.0))) - level
    scale = _CURVATURE * (abs(level) + abs(change))
    line, errors = _ratio_line(stage, samples, samples.output_speed, level, change)
    level_miss = abs(line[0] - level) - _SLOPE_ERRORS * errors[0]
    change_miss = abs(line[1] - change) - _SLOPE_ERRORS * errors[1]
    level_fits = level_miss <= scale + _STROKE_OFFSET * abs(change)
    change_fits = change_miss <= _SLOPE_LOSS * abs(change)
    if level_fits and change_fits:
        return None
    return (
        f"the output speed is of another gear train: the ratio at stroke 0 is {line[0]:.2f}, "
        f"the file says {level:.2f}; a full stroke changes it by {line[1]:+.2f}, the file "
        f"says {change:+.2f}: check the stage and its ratios, the sign of the displacement "
        "ratio, and unit and column of the output speed"
    )


def _ratio_line(
    stage: Stage,
    samples: BenchSamples,
    output_speed: Array,
    level: float,
    change: float,
) -> tuple[Array, Array]:
    """Level, change over a full stroke, factor on the typical leakage; and standard errors."""
    from scipy.optimize import least_squares

    size = abs(level) + abs(change)
    per_torque = stage.motor_speed_ratio / stage.pump_motor.motor_displacement
    slip = per_torque**2 * _TYPICAL_LEAKAGE * samples.load_torque / output_speed
    # The prior is weak: a slope that the strokes do not show stays that of the file.
    prior = np.array([level, change, 1.0])
    width = np.array([size, size, _PRIOR_WIDTH])
    regressors = np.stack(
        [np.ones_like(slip), samples.displacement_ratio, -slip], axis=1
    )
    scale = _CURVATURE * size
    rows = np.concatenate([regressors / scale, np.diag(1.0 / width)])
    target = np.append(output_speed / samples.engine_speed / scale, prior / width)
    fit = least_squares(
        lambda line: rows @ line - target,
        prior,
        # A copy: SciPy up to 1.15 weighs the rows in place.
        lambda line: rows.copy(),
        loss="soft_l1",
    )
    covariance = np.linalg.inv(fit.jac.T @ fit.jac)
    return np.asarray(fit.x), np.sqrt(np.diagonal(covariance))
