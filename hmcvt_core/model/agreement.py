# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What meters show beside a model: the operating point; how well samples and gear train agree."""

import math
from collections.abc import Collection, Mapping

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..files.bench import BenchSamples
from ..transmission.parameters import PRIOR_MEAN, from_scaled
from ..transmission.ranges import (
    ANY_LOAD,
    DISPLACEMENT_RATIO,
    ENGINE_SPEED,
    Array,
    OperatingPoints,
)
from ..transmission.stage import CM3_PER_REV, Stage, speed_ratio
from .model import NO_OPTIMUM, EfficiencyModel

STROKES = ("displacement_ratio", "output_speed")
LOADS = ("load_torque", "output_power", "output_torque", "engine_torque")
_HALVINGS = 60
_LEAKAGE = float(from_scaled(PRIOR_MEAN)[0])  # m3/(s Pa), before any bench
_BENT = 0.01  # of the ratio: how far the losses bend the line
# Of a full stroke: the most that an actuator is off, as `displacement_error` has it; what a dead
# band and the damping of a leaky unit take from the slope.
_OFFSET, _GAIN = 0.1, 0.35
_LOADED = 1e6  # Pa
_OTHER_MOTOR = 1.25  # losses that nobody modelled change the pressure by less


def stage_of_each(
    stages: Collection[str], samples: BenchSamples
) -> NDArray[np.str_] | None:
    """Return the stage of each sample, shape (n,); None where they need not say.

    Raises:
        InputError: of several stages a sample names none, or one that is not there.
    """
    names = samples.points.stage
    if names is None:
        if len(stages) > 1:
            raise InputError(
                f"{samples.source}: column stage is missing; the model has "
                f"{', '.join(stages)}"
            )
        return None
    for i in np.flatnonzero(~np.isin(names, list(stages))):
        place = f"row {samples.rows[i]}" if samples.rows else f"sample {i + 1}"
        raise InputError(
            f"{samples.source}: {place}: stage {str(names[i])!r} is not known to the "
            f"model; there is {', '.join(stages)}"
        )
    return names


def by_stage(model: EfficiencyModel, samples: BenchSamples) -> dict[str, BenchSamples]:
    """Return the samples of each stage that occurs; errors as of `stage_of_each`."""
    names = stage_of_each(model.stages, samples)
    if names is None:
        return {model.stage.name: samples}
    return {
        name: samples.select(names == name) for name in dict.fromkeys(names.tolist())
    }


def carried_at(model: EfficiencyModel, points: OperatingPoints) -> Array:
    """Efficiency at n points, shape (n,) [-]; 0 where the load cannot be carried."""
    return np.nan_to_num(model.solution_at(points).efficiency, nan=0.0)


def relative_errors(predicted: Array, measured: Array) -> Array:
    """|Predicted - measured| / measured (Table 3), shape (..., n) [-]."""
    return np.asarray(np.abs(predicted - measured) / measured)


def determination_loss(predicted: Array, measured: Array) -> Array:
    """1 - RSQ, eq. (21), of predictions (..., n), shape (...); NaN where one has no answer.

    As printed, the lower sum runs over predicted (not measured) minus the measured mean.
    """
    spread = np.sum((predicted - measured.mean()) ** 2, axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.sum((predicted - measured) ** 2, axis=-1) / spread)


def mean_error(predicted: Array, measured: Array) -> float:
    """Mean of `relative_errors` (n,) where there is an answer [-]; NaN where there is none."""
    errors = relative_errors(predicted, measured)
    answered = errors[np.isfinite(errors)]
    return float(answered.mean()) if len(answered) else np.nan


def pressure_remark(model: EfficiencyModel, samples: BenchSamples) -> str | None:
    """Say that the pressure is not one of this motor under its load; None where it may be."""
    if samples.pressure is None:
        return None
    expected = model.readings_at(samples.points)[2]
    loaded = np.abs(expected) > _LOADED  # False for NaN
    factor = (
        float(np.median(samples.pressure[loaded] / expected[loaded]))
        if loaded.any()
        else 1.0
    )
    if 1.0 / _OTHER_MOTOR < factor < _OTHER_MOTOR:
        return None
    volume = model.stage.pump_motor.motor_displacement / CM3_PER_REV
    return (
        f"the pressure is {factor:.2g} times that of a motor of {volume:.3g} cm3/r under this "
        "load: check the displacement of the motor in the file, the unit of the pressure, and "
        "that the low side is taken off"
    )


def gear_train_remarks(model: EfficiencyModel, samples: BenchSamples) -> list[str]:
    """Say of each stage that occurs that its output speed is not one of its gear train, if so."""
    remarks = (
        gear_train_remark(model.in_stage(name).stage, part)
        for name, part in by_stage(model, samples).items()
    )
    return [remark for remark in remarks if remark is not None]


def gear_train_remark(stage: Stage, samples: BenchSamples) -> str | None:
    """Say that the output speed is not one of this gear train; None where it may be.

    A robust line through output / engine speed over the stroke gives the ratio at no stroke and
    what a full stroke adds. Leakage is taken along: by eqs (13), (14) it lowers the ratio in
    proportion to load torque / output speed. An error of the stroke moves either a little.
    """
    measured = samples.output_speed
    if measured is None or stage.layout == "output_coupled":  # no line over the stroke
        return None
    from scipy.optimize import least_squares

    level = stage.mechanical_speed_ratio
    change = float(speed_ratio(stage, np.array(1.0))) - level
    size = abs(level) + abs(change)
    leak = (
        stage.motor_speed_ratio / stage.pump_motor.motor_displacement
    ) ** 2 * _LEAKAGE
    slip = leak * samples.load_torque / measured
    # What is known before is weak: a slope that the strokes do not show stays that of the file.
    known, width = np.array([level, change, 1.0]), np.array([size, size, 2.0])
    rows = np.concatenate(
        [
            np.stack([np.ones_like(slip), samples.displacement_ratio, -slip], axis=1)
            / (_BENT * size),
            np.diag(1.0 / width),
        ]
    )
    target = np.append(measured / samples.engine_speed / (_BENT * size), known / width)
    # SciPy up to 1.15 weighs the slopes in place.
    line = least_squares(
        lambda at: rows @ at - target, known, lambda at: rows.copy(), loss="soft_l1"
    )
    doubt = 3.0 * np.sqrt(np.diagonal(np.linalg.inv(line.jac.T @ line.jac)))
    off = np.abs(line.x - known)[:2] - doubt[:2]
    if off[0] <= _BENT * size + _OFFSET * abs(change) and off[1] <= _GAIN * abs(change):
        return None
    return (
        f"the output speed is of another gear train: the ratio at stroke 0 is {line.x[0]:.2f}, "
        f"the file says {level:.2f}; a full stroke changes it by {line.x[1]:+.2f}, the file "
        f"says {change:+.2f}: check the stage and its ratios, the sign of the displacement "
        "ratio, and unit and column of the output speed"
    )


def operating_point(
    model: EfficiencyModel, engine_speed: float, given: Mapping[str, float | None]
) -> tuple[float, float]:
    """Displacement ratio [-] and load torque [N m] at an engine speed [rad/s].

    Args:
        model: of one stage, formulation `power_balance`.
        engine_speed: [rad/s].
        given: one of `STROKES` and one of `LOADS`, the others None or left out; SI units. Torques
            are negative in overrun, in either sense of the output.

    Raises:
        InputError: a value is out of range or cannot be reached.
    """
    known = {name: value for name, value in given.items() if value is not None}
    speed, output = (
        float(ENGINE_SPEED.check(engine_speed)),
        known.get("output_speed", math.nan),
    )
    if "output_torque" in known and "output_speed" in known:
        known["output_power"] = known.pop("output_torque") * abs(output)
    if "output_power" in known:
        known["load_torque"] = known["output_power"] / speed

    def stroke_at(load: float) -> float:
        if "displacement_ratio" in known:
            return float(DISPLACEMENT_RATIO.check(known["displacement_ratio"]))
        return float(
            model.balance(NO_OPTIMUM).held(*np.array([[speed], [output], [load]]))[0][0]
        )

    def torque_at(load: float) -> float:
        point = min(max(stroke_at(load), -1.0), 1.0), speed, load
        if "engine_torque" in known:
            found = load + model.power_loss(*point) / speed
        else:
            found = load * speed / abs(model.output_speed(*point))
        return math.inf if math.isnan(found) else float(found)  # no load beyond a stall

    if (
        "load_torque" not in known
    ):  # by halving, for the torque of a shaft rises with the load
        name = "engine_torque" if "engine_torque" in known else "output_torque"
        low, high = ANY_LOAD.low, ANY_LOAD.high
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            low, high = (
                (middle, high) if torque_at(middle) < known[name] else (low, middle)
            )
        if not abs(torque_at(low) - known[name]) <= 1e-6 * max(abs(known[name]), 1.0):
            raise InputError(
                f"{name} = {known[name]:g} N m is more than stage {model.stage.name} "
                "can carry at this engine speed and displacement ratio"
            )
        known["load_torque"] = low
    load = float(ANY_LOAD.check(known["load_torque"]))
    stroke = stroke_at(load)
    if not abs(stroke) <= 1.0 + 1e-9:
        raise InputError(
            f"output_speed = {output:g} rad/s is out of reach of stage "
            f"{model.stage.name} at this engine speed and load: it would take a "
            f"displacement ratio of {stroke:.3g}"
        )
    return min(max(stroke, -1.0), 1.0), load
