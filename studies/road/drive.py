# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A drive of a tractor: what truly happens at both shafts, with transients.

The tractor goes from one task to the next: it holds a ground speed and a load for half a minute and
changes to others in seconds; in headlands it stands. The machine is the model with parameters drawn
within their standard errors, a smooth error of its form, and an engine with inertia.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from hmcvt_core import EfficiencyModel, HydraulicParameters
from hmcvt_core.transmission.ranges import RPM
from hmcvt_core.transmission.stage import speed_ratio

Array = NDArray[np.float64]

RATE = 100.0
"""Of the simulation [Hz]."""
FORM = 0.0012
"""Root mean square of the error of the form, in efficiency [-]."""


class Machine(NamedTuple):
    """One tractor, as nobody can measure it.

    Attributes:
        model: of its transmission.
        form_phases: of the error of the form, shape (3,).
        inertia: of the engine [kg m2].
        friction: of the engine at 1,500 r/min, as a part of the reference torque [-].
        reference: torque of 100 % [N m].
        oil_temperature: of the transmission, on the bus [deg C]; None where it is not.
    """

    model: EfficiencyModel
    form_phases: Array
    inertia: float
    friction: float
    reference: float
    oil_temperature: float | None = None


@dataclass(frozen=True, eq=False)
class Drive:
    """What truly happens; arrays of shape (n,), SI units.

    Attributes:
        time: [s].
        stage: names.
        displacement_ratio, engine_speed, output_speed: [-], [rad/s], [rad/s].
        engine_torque: at the flywheel [N m].
        friction_torque: of the engine [N m].
        output_power: [W].
    """

    time: Array
    stage: NDArray[np.str_]
    displacement_ratio: Array
    engine_speed: Array
    output_speed: Array
    engine_torque: Array
    friction_torque: Array
    output_power: Array


def machine_of(model: EfficiencyModel, rng: np.random.Generator) -> Machine:
    """Draw a tractor that a model is of.

    Args:
        model: states the errors of its parameters.
        rng: random numbers.
    """
    errors = np.array(list(model.standard_errors.values()))
    correlation = np.asarray(model.correlation)
    drawn = rng.multivariate_normal(model.parameters.to_array() / errors, correlation)
    values = np.maximum(drawn * errors, 1e-14)
    return Machine(
        replace(model, parameters=HydraulicParameters(*values.tolist())),
        rng.uniform(0.0, 2.0 * np.pi, 3),
        float(np.clip(rng.normal(2.0, 1.0), 0.5, 4.0)),
        float(rng.uniform(0.06, 0.11)),
        float(rng.choice([700.0, 800.0, 900.0])),
    )


def drive(machine: Machine, seconds: float, rng: np.random.Generator) -> Drive:
    """Simulate a drive.

    Args:
        machine: the tractor.
        seconds: how long.
        rng: random numbers.
    """
    count = int(seconds * RATE)
    time = np.arange(count) / RATE
    speed, ratio, power = _tasks(count, rng)
    speed = _lagged(speed, 0.8)
    output = _lagged(ratio * _lagged(speed, 0.5), 1.5)
    power = _lagged(power * (1.0 + _rough(count, rng)), 0.6)
    acceleration = np.gradient(speed, time)
    # At low speed the power is limited by the torque of the wheels.
    power = np.where(output < 6.0, power * output / 6.0, power)
    names, stroke, torque = _balanced(machine, speed, output, power / speed)
    torque = torque + machine.inertia * acceleration
    friction = machine.friction * machine.reference * (0.6 + 0.4 * speed / 157.0)
    return Drive(time, names, stroke, speed, output, torque, friction, power)


def _tasks(count: int, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Engine speeds, speed ratios and output powers of tasks one after the other."""
    columns: list[tuple[int, float, float, float]] = []
    done = 0
    while done < count:
        length = int(rng.uniform(6.0, 45.0) * RATE)
        speed = rng.uniform(1100.0, 2100.0) * RPM
        kind = rng.random()
        if kind < 0.1:
            task = (rng.uniform(800.0, 950.0) * RPM, 0.0, 0.0)
        elif kind < 0.65:
            task = (speed, rng.uniform(0.2, 0.8), rng.uniform(15e3, 85e3))
        else:
            task = (speed, rng.uniform(0.8, 1.5), rng.uniform(5e3, 70e3))
        columns.append((length, *task))
        done += length
    lengths = [length for length, *_ in columns]
    tasks = np.array([row[1:] for row in columns])
    rows = np.repeat(tasks, lengths, axis=0)[:count]
    # The power never exceeds what the engine gives at its speed.
    return rows[:, 0], rows[:, 1], np.minimum(rows[:, 2], 560.0 * rows[:, 0])


def _lagged(values: Array, time_constant: float) -> Array:
    """Return values behind a lag of the first order [s]."""
    keep = np.exp(-1.0 / (RATE * time_constant))
    start = [keep * values[0]]
    filtered, _ = lfilter([1.0 - keep], [1.0, -keep], values, zi=start)
    return np.asarray(filtered)


def _rough(count: int, rng: np.random.Generator) -> Array:
    """Return a load that varies by 8 % within seconds."""
    noise = rng.standard_normal(count)
    keep = np.exp(-1.0 / (RATE * 2.0))
    return np.asarray(lfilter([0.08 * np.sqrt(1.0 - keep**2)], [1.0, -keep], noise))


def _balanced(
    machine: Machine, speed: Array, output: Array, load: Array
) -> tuple[NDArray[np.str_], Array, Array]:
    """Return stage, displacement ratio and engine torque that carry a load."""
    count = len(speed)
    names = np.full(count, "", dtype="U8")
    stroke = np.zeros(count)
    torque = np.full(count, np.nan)
    excess = np.full(count, np.inf)
    for name, model in machine.model.stages.items():
        ends = speed_ratio(model.stage, np.array([-1.0, 1.0]))
        ratio = output / speed
        near = (ratio > min(ends) - 0.05) & (ratio < max(ends) + 0.05)
        (rows,) = np.nonzero(near)
        if not len(rows):
            continue
        turning = np.maximum(output[rows], 1e-3)
        strokes, torques = model.balance("the twin").held(
            speed[rows], turning, load[rows]
        )
        over = np.abs(strokes)
        better = np.isfinite(torques) & (over < excess[rows])
        at = rows[better]
        names[at] = name
        stroke[at] = strokes[better]
        torque[at] = torques[better]
        excess[at] = over[better]
    error = _form_error(machine, stroke, speed, load)
    return names, np.clip(stroke, -1.0, 1.0), torque * (1.0 - error)


def _form_error(machine: Machine, stroke: Array, speed: Array, load: Array) -> Array:
    """Return by how much the efficiency is better than the model says [-]."""
    waves = np.stack([stroke * 3.0, speed / 40.0, load / 80.0])
    total = np.sin(waves + machine.form_phases[:, None]).sum(axis=0)
    return FORM * np.sqrt(2.0 / 3.0) * total
