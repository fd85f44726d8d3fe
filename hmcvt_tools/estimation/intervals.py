# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Standard deviations of an estimate, by source, to first order.

Each source changes the load by a known slope. Sources are independent of each other; those that
stay the same over a log (bias of the torque, parameters, form of the model) add up in an energy,
the others average out.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hmcvt_core.model.intervals import half_width
from hmcvt_core.transmission.ranges import Array

from .condition import Moves
from .settings import EstimateSettings
from .solving import Solved

_UNIFORM = 1.0 / np.sqrt(12.0)
"""Standard deviation of a step by which values are rounded, in steps."""
_LATE = 1.0 / np.sqrt(3.0)
"""Root mean square of a delay, uniform from 0 to 1."""
MISFIT = 0.0012
"""Error of the form of a fitted model in efficiency [-], as in a diagnosis."""


class Inputs(NamedTuple):
    """Signals of a log, SI units, shape (n,) each.

    Attributes:
        time: [s].
        engine_speed: [rad/s].
        output_speed: [rad/s].
        engine_torque: at the flywheel, as the bus states it [N m].
        gross_torque: with the friction of the engine, which the bias scales with [N m].
    """

    time: Array
    engine_speed: Array
    output_speed: Array
    engine_torque: Array
    gross_torque: Array


class Deviations(NamedTuple):
    """Standard deviations of the output power by source [W], shape (n,) each.

    Attributes:
        lasting: shape (k, n), of sources that stay the same over a log, with their sign.
        passing: root of the sum of squares of the others.
        output_speed: of the output speed [rad/s].
    """

    lasting: Array
    passing: Array
    output_speed: Array

    @property
    def power(self) -> Array:
        """Of the output power [W]."""
        return np.asarray(np.sqrt((self.lasting**2).sum(axis=0) + self.passing**2))


def rate_of_change(time: Array, values: Array) -> Array:
    """Return the change of a signal by central differences, 0 next to a gap.

    Args:
        time: [s], rising, shape (n,).
        values: shape (n,).
    """
    if len(time) < 3:
        return np.zeros(len(time))
    rate = np.zeros(len(time))
    span = time[2:] - time[:-2]
    usual = float(np.median(span))
    with np.errstate(invalid="ignore"):
        change = (values[2:] - values[:-2]) / span
        rate[1:-1] = np.where(span <= 3.0 * usual, change, 0.0)
    return np.nan_to_num(rate)


def deviations(
    inputs: Inputs,
    solved: Solved,
    correlation: Array | None,
    resolution: dict[str, float],
    settings: EstimateSettings,
    bias: float,
    moved: Moves,
    degrees_of_freedom: float | None = None,
) -> Deviations:
    """Return the standard deviations of an estimate.

    Args:
        inputs: signals.
        solved: loads and their slopes.
        correlation: of the parameters, shape (p, p); None where the model states no errors.
        resolution: step of the signals by quantity, SI; of the torque it counts twice, because
            friction is rounded too.
        settings: errors of the bus.
        bias: of the torque, a fraction.
        moved: what condition of the machine leaves open.
        degrees_of_freedom: of the errors of the parameters; None for normal errors.
    """
    speed = inputs.engine_speed
    per_torque = solved.load_per_torque * speed
    late = _LATE * settings.delay
    torque_rate = rate_of_change(inputs.time, inputs.engine_torque)
    acceleration = rate_of_change(inputs.time, speed)
    output_rate = rate_of_change(inputs.time, inputs.output_speed)
    rounded = np.sqrt(2.0) * _UNIFORM * resolution.get("engine_torque", 0.0)
    inertia = settings.engine_inertia * settings.inertia_error
    passing = np.sqrt(
        (per_torque * rounded) ** 2
        + (per_torque * late * torque_rate) ** 2
        + (per_torque * inertia * acceleration) ** 2
    )
    lasting = [per_torque * bias * inputs.gross_torque]
    engine_power = inputs.engine_torque * speed
    form = MISFIT if correlation is not None else settings.form_error
    lasting.append(form * engine_power)
    lasting.append(solved.load_per_torque * settings.hydraulics[1])
    lasting.append(moved.wear_deviation * speed)
    lasting.append(moved.oil_deviation * speed)
    if correlation is not None:
        # Independent combinations of the parameters.
        root = np.linalg.cholesky(correlation + 1e-9 * np.eye(len(correlation)))
        # Widened so that QUANTILE, of the normal distribution, gives the interval of Student's t.
        widened = half_width(degrees_of_freedom) / half_width(None)
        lasting += list(widened * (root.T @ solved.parameter_change) * speed)
    rounded_speed = _UNIFORM * resolution.get("output_speed", 0.0)
    return Deviations(
        np.array(lasting), passing, np.hypot(rounded_speed, late * output_rate)
    )
