# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
r"""Errors of torque meters, gauges and the stroke sensor that the readings of a session share.

A bench is run in sessions. Within one the torque meters keep their zero and their gain, drift
slowly, and read higher on the way down than on the way up. The efficiency is computed from both
torques, and the load torque :math:`L` (output power / engine speed) from that of the output. With
the zero errors :math:`z` and the gain error :math:`g`, a channel :math:`f` that is predicted at the
measured load therefore seems to be off by

.. math:: \delta L = \left|\frac{\omega_{out}}{\omega_e}\right| z_{output}, \qquad
          \Delta\eta = -\frac{\eta^2}{L} z_{engine}
          + \left(\frac{\eta}{L} - \frac{\partial\eta}{\partial L}\right)\delta L + \eta\, g,
          \qquad \Delta f = -\frac{\partial f}{\partial L}\,\delta L

so a zero weighs most at light load. The sensor of the stroke :math:`e` has a zero and a gain too; a
channel that is predicted at the measured stroke then seems to be off by
:math:`-\frac{\partial f}{\partial e} (z_e + g_e e)`. Each error is one column with a normal prior;
the refit and the evidence treat it like any other parameter.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...diagnosis.fitting.hypothesis import Hypothesis
from ...diagnosis.fitting.refit import refit
from ...diagnosis.observations import SESSION, Observations, SharedError
from ...diagnosis.settings import TIE_TOLERANCE
from ...diagnosis.system import Array, System
from ...files.bench import BenchSamples
from ...transmission.quantities import STORED
from .base import GaugeError, gauge_errors
from .channels import DISPLACEMENT_RATIO, ENGINE_SPEED, LOAD_TORQUE, by_name

RANGE_MARGIN = 1.5
"""Range of a torque meter, in the largest torque of the campaign.

A meter is chosen so that the largest torque fills two thirds of its range.
"""
ACCURACY_CLASS = 0.001
"""Limit of an error of a torque meter of class 0.1 [part of the range] (VDI/VDE 2646)."""
OF_LIMIT = 1.0 / np.sqrt(3.0)
"""Standard deviation / limit, where every error within is as likely (JCGM 100:2008, 4.3.7)."""
ZERO_DEVIATION = ACCURACY_CLASS * OF_LIMIT
"""Standard deviation of the zero in a session [part of the range]: the effect of 10 K on it."""
DRIFT_DEVIATION = 0.5 * ZERO_DEVIATION
"""Standard deviation of half the drift of the zero over a session [part of the range].

The oil warms by some 5 K after a bench is warm.
"""
HYSTERESIS_DEVIATION = 0.5 * ACCURACY_CLASS * OF_LIMIT
"""Standard deviation of half the width of the hysteresis [part of the range].

The class limits linearity with hysteresis.
"""
SESSION_PAUSE = 1800.0
"""Pause between two samples that begins a session at least [s]: a bench cools within it."""
SESSION_PAUSE_RATIO = 10.0
"""Ratio of that pause to the median time between samples: a slow plan is no pause."""
MIN_SESSION_SAMPLES = 3
"""Samples from which a session has errors of its own; in fewer they look like noise."""
LOAD_STEP = 1e-3
"""Step of the derivative by the load, as a part of it."""
STROKE_STEP = 1e-4
"""Step of the derivative by the stroke [-]."""
MAX_SESSIONS = 12
"""Sessions with errors of their own; further ones share those of the last. Limit of time."""


@dataclass(frozen=True, eq=False)
class Sessions:
    """Sessions of a campaign of n samples.

    Attributes:
        index: session of each sample, from 0, shape (n,).
        count: of sessions.
        phase: time within the session, -1 at its first and 1 at its last sample, shape (n,); zero
            where the order of the samples is not known.
        direction: 1 where the torque rose to the sample, -1 where it fell, 0 where unknown, (n,).
        names: of the sessions: their labels, else their numbers from 1.
    """

    index: NDArray[np.intp]
    count: int
    phase: Array
    direction: Array
    names: tuple[str, ...] = ("1",)


_Column = tuple[SharedError, Array]
"""An error, and the change of every channel by one deviation of it, shape (channels, n)."""


class _Meter(NamedTuple):
    """A torque meter, and what it changes.

    Attributes:
        name: of the shaft that it sits on.
        range: largest torque that it is made for [N m].
        change: change of every channel by a zero of the whole range, shape (channels, n).
    """

    name: str
    range: float
    change: Array

    def column(self, kind: str, part: float, session: str, factor: Array) -> _Column:
        """Return an error of the meter.

        Args:
            kind: of the error, in words.
            part: its standard deviation, as a part of the range.
            session: name of the session; empty where all readings share the error.
            factor: of the error at each sample, shape (n,).
        """
        name = f"{kind} of the {self.name} meter"
        error = SharedError(name, session, part * self.range, "N m")
        return error, factor * part * self.change


def sessions_of(samples: BenchSamples) -> Sessions:
    """Return the sessions by column `session`, else by pauses in `stamp`, else one.

    Args:
        samples: bench samples; their order within a session is that of `stamp`, else of the rows.
    """
    n = len(samples)
    labels = samples.extra.get("session")
    stamp = samples.stamp
    if labels is not None:
        index, names = _labelled(labels)
    elif stamp is not None:
        index = np.minimum(_by_pauses(stamp), MAX_SESSIONS - 1)
        names = tuple(str(number + 1) for number in range(int(index.max()) + 1))
    else:
        zeros = np.zeros(n)
        return Sessions(np.zeros(n, dtype=np.intp), 1, zeros, zeros)
    time = np.arange(n, dtype=float) if stamp is None else stamp
    phase = np.zeros(n)
    direction = np.zeros(n)
    # The last digits of a torque that was held are no direction.
    tolerance = TIE_TOLERANCE * float(samples.load_torque.max())
    for session in range(len(names)):
        rows = np.flatnonzero(index == session)
        in_order = rows[np.argsort(time[rows], kind="stable")]
        phase[in_order] = _scaled_time(time[in_order])
        if stamp is not None:
            steps = np.diff(samples.load_torque[in_order])
            is_step = np.abs(steps) > tolerance
            direction[in_order[1:]] = np.where(is_step, np.sign(steps), 0.0)
    return Sessions(index, len(names), phase, direction, names)


def _labelled(
    labels: Sequence[object],
) -> tuple[NDArray[np.intp], tuple[str, ...]]:
    """Number the sessions by their labels, shape (n,), and return their names."""
    texts = ["" if label is None else str(label) for label in labels]
    distinct, index = np.unique(texts, return_inverse=True)
    names = tuple(distinct.tolist())
    last = MAX_SESSIONS - 1
    if len(names) > MAX_SESSIONS:
        names = (*names[:last], f"{names[last]} and others")
    return np.minimum(index.ravel(), last), names


def _by_pauses(stamp: Array) -> NDArray[np.intp]:
    """Number the sessions that long pauses divide, shape (n,)."""
    order = np.argsort(stamp, kind="stable")
    steps = np.diff(stamp[order])
    if not len(steps):
        return np.zeros(len(stamp), dtype=np.intp)
    pause = max(SESSION_PAUSE, SESSION_PAUSE_RATIO * float(np.median(steps)))
    index = np.zeros(len(stamp), dtype=np.intp)
    index[order[1:]] = np.cumsum(steps > pause)
    return index


def _scaled_time(time: Array) -> Array:
    """Return times scaled to -1 ... 1, zero where they do not differ."""
    length = np.ptp(time)
    if length == 0.0:
        return np.zeros(len(time))
    return np.asarray(2.0 * (time - time.min()) / length - 1.0)


def with_meter_errors(observed: Observations, system: System) -> Observations:
    """Return observations whose readings share the errors of the meters.

    What an error changes depends on the base parameters: by a tenth, where the leakage differs as
    much as it does between machines. They are fitted first.

    Args:
        observed: of bench samples.
        system: the transmission; its prediction gives what a wrong load does to each channel.
    """
    before_any_fit = _with_errors_at(observed, system, system.base.mean)
    return _with_errors_at(observed, system, _fitted_base(before_any_fit, system))


def _fitted_base(observed: Observations, system: System) -> Array:
    """Return the scaled base parameters fitted to readings, shape (p,); few are no fit."""
    mean = system.base.mean
    predicted = system.predict(mean, (), observed.points)
    answered = np.flatnonzero(np.isfinite(predicted).all(axis=0))
    if len(answered) <= len(mean):
        return mean
    hypothesis = Hypothesis(system, shared_count=observed.shared_count)
    return refit(hypothesis, observed.select(answered)).base


def _with_errors_at(
    observed: Observations, system: System, base: Array
) -> Observations:
    """Return observations with the errors of the meters, as they act at base parameters, (p,)."""
    sessions = sessions_of(observed.samples)
    predicted = system.predict(base, (), observed.points)
    rows = [system.channels.index(channel) for channel in observed.channels]

    def slopes_along(axis: str, step: Array) -> Array:
        """Return derivatives of the predicted readings, shape (channels, n)."""
        moved = {**observed.points, axis: observed.points[axis] + step}
        change = system.predict(base, (), moved)[rows] - predicted[rows]
        return np.asarray(change / step)

    slopes = slopes_along(LOAD_TORQUE.name, _load_step(observed))
    stroke_slopes = slopes_along(DISPLACEMENT_RATIO.name, _stroke_step(observed))
    readings, speed_ratio = _without_noise(observed, by_name(predicted))
    meters = _meters(observed, readings["efficiency"], speed_ratio, slopes)
    gauges = _changes_by_gauges(observed, readings)
    gauges += _changes_by_stroke_sensor(observed, stroke_slopes)
    columns: list[_Column] = []
    number = np.full(len(observed), -1.0)
    for session in range(sessions.count):
        inside = sessions.index == session
        if inside.sum() >= MIN_SESSION_SAMPLES:
            number[inside] = session
            columns += _columns_of_session(sessions, session, meters, gauges)
    for meter in meters:
        columns.append(
            meter.column(
                "half the hysteresis", HYSTERESIS_DEVIATION, "", sessions.direction
            )
        )
    present = [(error, column) for error, column in columns if column.any()]
    points = observed.points
    if sessions.count > 1:
        points = {**points, SESSION: number}
    shared_errors = None
    if present:
        shared_errors = np.stack([column for _, column in present], axis=-1)
    return replace(
        observed,
        points=points,
        deviation=_with_load_noise(observed, slopes),
        shared_errors=shared_errors,
        shared_names=tuple(error for error, _ in present),
    )


def _columns_of_session(
    sessions: Sessions,
    session: int,
    meters: Sequence[_Meter],
    gauges: Sequence[tuple[GaugeError, Array]],
) -> list[_Column]:
    """Return the errors that the readings of one session share.

    Args:
        sessions: of the campaign.
        session: number of the one.
        meters: of the torques.
        gauges: errors of the others, and the change of every channel by an error of 1.
    """
    inside = sessions.index == session
    name = sessions.names[session]
    columns = []
    for meter in meters:
        columns.append(meter.column("zero", ZERO_DEVIATION, name, inside))
    for error, change in gauges:
        shared = SharedError(error.words, name, error.deviation, error.unit)
        columns.append((shared, inside * error.deviation * change))
    of_time = inside * sessions.phase
    for meter in meters:
        columns.append(meter.column("half the drift", DRIFT_DEVIATION, name, of_time))
    return columns


def _with_load_noise(observed: Observations, slopes: Array) -> Array:
    """Return the deviations of the readings with those of the load at which they are predicted.

    Half of the variance of an efficiency is that of the output torque, and so of the load.

    Args:
        observed: of bench samples.
        slopes: derivatives of the channels by the load, shape (channels, n).
    """
    samples = observed.samples
    of_load = samples.load_torque * observed.deviation[0] / samples.efficiency
    of_channels = np.abs(slopes) * of_load / np.sqrt(2.0)
    of_channels[0] = 0.0
    return np.hypot(observed.deviation, _finite(of_channels))


def _without_noise(
    observed: Observations, predicted: Mapping[str, Array]
) -> tuple[dict[str, Array], Array]:
    """Return readings by channel, and output speed / engine speed, as the base model predicts them.

    Columns made of readings would hold their noise, and a large zero would then explain noise.
    Where the model has no answer, a reading is that measured and the ratio is 1.
    """
    readings = {}
    for channel, measured in zip(observed.channels, observed.measured, strict=True):
        answer = predicted[channel.name]
        readings[channel.name] = np.where(np.isfinite(answer), answer, measured)
    speed_ratio = predicted["output_speed"] / observed.points[ENGINE_SPEED.name]
    answered = np.isfinite(predicted["efficiency"])
    return readings, np.where(answered, np.abs(speed_ratio), 1.0)


def _changes_by_gauges(
    observed: Observations, readings: Mapping[str, Array]
) -> list[tuple[GaugeError, Array]]:
    """Return the errors of gauges that sessions have, and the change of every channel by each.

    Args:
        observed: of bench samples.
        readings: by channel, without noise, shape (n,) each.

    Returns:
        Changes by an error of 1, shape (channels, n) each.
    """
    names = [channel.name for channel in observed.channels]
    changes = []
    for error in gauge_errors(names):
        if error.by_session:
            change = np.zeros_like(observed.measured)
            change[names.index(error.channel)] = error.change_at(
                readings[error.channel]
            )
            changes.append((error, change))
    return changes


def _changes_by_stroke_sensor(
    observed: Observations, slopes: Array
) -> list[tuple[GaugeError, Array]]:
    """Return the errors of the stroke sensor, and the change of every channel by each of 1.

    A reading at the true stroke e is compared with the prediction at the measured one, e + error.

    Args:
        observed: of bench samples.
        slopes: derivatives of the channels by the stroke, shape (channels, n).

    Returns:
        Changes by an error of 1, shape (channels, n) each; zero where a step has no answer.
    """
    stroke = observed.points[DISPLACEMENT_RATIO.name]
    changes = []
    for error in gauge_errors([DISPLACEMENT_RATIO.name], STORED):
        changes.append((error, -_finite(slopes) * error.change_at(stroke)))
    return changes


def _meters(
    observed: Observations, efficiency: Array, speed_ratio: Array, slopes: Array
) -> tuple[_Meter, _Meter]:
    """Return the torque meters of engine and output; no change without an answer.

    Args:
        observed: of bench samples.
        efficiency: without noise, shape (n,).
        speed_ratio: output speed / engine speed without noise, shape (n,).
        slopes: derivatives of the channels by the load, shape (channels, n).
    """
    load = observed.points[LOAD_TORQUE.name]
    engine = np.zeros_like(observed.measured)
    with np.errstate(divide="ignore", invalid="ignore"):
        engine_torque = load / efficiency
        output_torque = load / speed_ratio
        engine[0] = -efficiency / engine_torque
        # The output meter moves the efficiency and the load at which it is predicted.
        output = -slopes
        output[0] += efficiency / load
    engine_range = RANGE_MARGIN * _largest(engine_torque)
    output_range = RANGE_MARGIN * _largest(output_torque)
    return (
        _Meter("engine", engine_range, _finite(engine_range * engine)),
        _Meter("output", output_range, _finite(output_range * speed_ratio * output)),
    )


def _load_step(observed: Observations) -> Array:
    """Return the step of the derivative by the load [N m], shape (n,)."""
    load = observed.points[LOAD_TORQUE.name]
    return np.asarray(np.maximum(LOAD_STEP * np.abs(load), LOAD_TORQUE.tolerance))


def _stroke_step(observed: Observations) -> Array:
    """Return the step of the derivative by the stroke [-], (n,): towards zero, within its range."""
    stroke = observed.points[DISPLACEMENT_RATIO.name]
    return np.where(stroke > 0.0, -STROKE_STEP, STROKE_STEP)


def _finite(changes: Array) -> Array:
    return np.nan_to_num(changes, posinf=0.0, neginf=0.0)


def _largest(torque: Array) -> float:
    """Return the largest finite magnitude, zero where there is none."""
    return float(np.abs(torque[np.isfinite(torque)]).max(initial=0.0))
