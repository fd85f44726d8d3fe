# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A watch on the bus of a machine: do its signals still agree as they did?

A bus states no output torque, so that there is no measured efficiency to watch. It states two
things twice:

* the engine torque, by its percent torque and by the fuel rate through the fuel map;
* the output speed, measured, and by displacement ratio and load through the model, which slips with
  the leakage of pump and motor.

Both differences are tested in steady windows by the same sequential test as bench samples. What a
bus does not know of itself is no drift: a bias of the torque, of the fuel meter and of the stroke,
and slopes of these over speed and load.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from typing import Any, NamedTuple

import numpy as np

from hmcvt_core.errors import InputError
from hmcvt_core.model.engine import Engine
from hmcvt_core.model.model import EfficiencyModel
from hmcvt_core.monitoring.change_test import FALSE_ALARMS, ChangeTest, step_size
from hmcvt_core.transmission.ranges import ENGINE_SPEED_LIMITS, Array

from ..logs.selection import Selection, read_rows
from ..logs.series import Log
from ..steady import Channels, Steadiness, find_windows, split_at_gaps
from .settings import EstimateSettings
from .solving import Stages

_STEP = 0.1  # s, between rows
_GAP = 1.0  # s, ends a window
_LIMITS = Steadiness()
_QUANTILE = 1.96
_ROUNDED = 1.0 / np.sqrt(12.0)
_STROKE_ERROR = 0.01
"""Zero and gain of a stroke sensor, and what the leakage of a model may be off, as parts of the
output speed; chosen from sensors of 1 % class."""
_SLOPE_ERROR = 0.02
"""Change of the bias of torque and fuel over speed and load, a fraction."""
_SCATTER = 0.003
"""Scatter of a mean from one window to the next beyond rounding, a fraction."""
_FUEL_STEPS = (0.01, 0.03, 0.1)
_SPEED_STEPS = (0.003, 0.01, 0.03)
"""Standard deviations of a drift's size, as fractions; equally likely."""
_MIN_LOAD = 0.2
"""Fraction of the full-load torque from which the fuel is compared: below it friction rules."""
_MIN_OUTPUT = 5.0
"""Output speed from which it is compared [rad/s]."""


class Windows(NamedTuple):
    """Means of steady windows of a bus, shape (n,) each, SI units; NaN where there is none.

    Attributes:
        stamp: middle [s].
        engine_speed, engine_torque, output_speed: [rad/s], [N m], [rad/s].
        fuel_rate: [kg/s].
        displacement_ratio: [-].
    """

    stamp: Array
    engine_speed: Array
    engine_torque: Array
    output_speed: Array
    fuel_rate: Array
    displacement_ratio: Array


@dataclass(frozen=True)
class Drift:
    """State of one comparison.

    Attributes:
        name: `fuel` or `output_speed`.
        windows: compared.
        open: whether a drift has begun.
        noticed: number of the window that raised the alarm, from 1.
        since: window at which it most likely began; the interval holds it at 95 %.
        since_stamp: its time [s].
        size: measured less expected, as a fraction of the expected.
        interval: of `size`, at 95 %.
    """

    name: str
    windows: int
    open: bool = False
    noticed: int | None = None
    since: int | None = None
    since_interval: tuple[int, int] | None = None
    since_stamp: float | None = None
    size: float | None = None
    interval: tuple[float, float] | None = None

    def report(self) -> str:
        """Return the state as a sentence."""
        words = self.name.replace("_", " ")
        if self.size is None or self.interval is None:
            return f"{words}: no drift in {self.windows} steady windows"
        low, high = sorted(100.0 * abs(end) for end in self.interval)
        side = "above" if self.size > 0.0 else "below"
        return (
            f"{words}: {100.0 * abs(self.size):.1f} % {side} what is expected (95 %: "
            f"{low:.1f} to {high:.1f}) since window {self.since} of {self.windows}, at "
            f"{self.since_stamp:.0f} s"
        )


@dataclass(frozen=True)
class BusDrift:
    """Result of a watch on a bus.

    Attributes:
        drifts: one for each comparison that the bus allows.
        false_alarms: chance of any alarm in a whole stream without a drift.
        notes: what could not be used.
    """

    drifts: tuple[Drift, ...]
    false_alarms: float
    notes: tuple[str, ...] = ()

    @property
    def open(self) -> bool:
        """Whether any drift has begun."""
        return any(drift.open for drift in self.drifts)

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON object of `hmcvt watch --json` on the bus of a machine."""
        return {
            "open": self.open,
            "false_alarms": self.false_alarms,
            "drifts": [asdict(drift) for drift in self.drifts],
            "notes": list(self.notes),
        }

    def report(self) -> str:
        """Return the result as text."""
        lines = [drift.report() for drift in self.drifts]
        lines += [f"  note: {note}" for note in self.notes]
        lines.append(
            "within what a bus can tell: it states no output torque, so that wear shows only "
            "in the fuel for a torque and in the slip of the output (a false alarm comes in "
            f"at most {100.0 * self.false_alarms:g} % of all streams, however long)"
        )
        return "\n".join(lines)


@dataclass
class _Compared:
    """The rows that one comparison has taken."""

    prior: Array
    spreads: tuple[float, ...]
    residuals: list[float] = field(default_factory=list)
    deviations: list[float] = field(default_factory=list)
    slopes: list[Array] = field(default_factory=list)

    def drift(self, name: str, false_alarms: float, stamps: Array) -> Drift:
        """Return the state after all rows.

        Args:
            name: of the comparison.
            false_alarms: chance over a whole stream.
            stamps: of the rows [s].
        """
        test = ChangeTest(self.prior, self.spreads)
        noticed = None
        rows = zip(self.residuals, self.deviations, self.slopes, strict=True)
        for number, (residual, deviation, slopes) in enumerate(rows, 1):
            stamp = float(stamps[number - 1])
            test.take(residual, deviation, slopes, number, stamp)
            if noticed is None and test.evidence >= -np.log(false_alarms):
                noticed = number
        count = len(self.residuals)
        if noticed is None:
            return Drift(name, count)
        start, first, last = test.start()
        size, deviation = step_size(
            np.array(self.residuals),
            np.array(self.deviations),
            np.array(self.slopes),
            self.prior,
            start.number,
        )
        half = _QUANTILE * deviation
        return Drift(
            name,
            count,
            True,
            noticed,
            start.sample,
            (first.sample, last.sample),
            start.stamp,
            size,
            (size - half, size + half),
        )


def watch_bus(
    log: Log,
    selection: Selection,
    model: EfficiencyModel,
    engine: Engine | None = None,
    *,
    false_alarms: float = FALSE_ALARMS,
) -> BusDrift:
    """Watch the bus of a machine for a drift.

    Args:
        log: to be read.
        selection: its channels.
        model: of the transmission.
        engine: fuel map, for the comparison of fuel and torque.
        false_alarms: chance of any alarm over a whole stream.

    Raises:
        InputError: the bus states nothing twice, or nothing is steady.
    """
    parts = list(_steady(log, selection))
    if not parts:
        raise InputError(f"{log.path}: no steady window of {_LIMITS.min_duration:g} s")
    columns = zip(*parts, strict=True)
    windows = Windows(*(np.concatenate(column) for column in columns))
    drifts = compare(windows, selection.resolution, model, engine, false_alarms)
    if not drifts:
        raise InputError(
            f"{log.path}: the bus states nothing twice: a watch needs fuel rate, engine torque "
            "and --engine, or displacement ratio, output speed and engine torque"
        )
    return BusDrift(drifts, false_alarms, tuple(log.remarks.lines))


def compare(
    windows: Windows,
    resolution: Any,
    model: EfficiencyModel,
    engine: Engine | None,
    false_alarms: float = FALSE_ALARMS,
) -> tuple[Drift, ...]:
    """Test each comparison that the windows allow.

    Args:
        windows: means, in order of time.
        resolution: step of the signals by quantity, SI.
        model: of the transmission.
        engine: fuel map, or None.
        false_alarms: chance of any alarm over a whole stream.
    """
    tests = {}
    if engine is not None and np.isfinite(windows.fuel_rate).any():
        tests["fuel"] = _fuel(windows, resolution, engine)
    if np.isfinite(windows.displacement_ratio).any():
        tests["output_speed"] = _output(windows, resolution, model)
    drifts = []
    for name, (compared, rows) in tests.items():
        if len(rows):
            share = false_alarms / len(tests)
            drifts.append(compared.drift(name, share, windows.stamp[rows]))
    return tuple(drifts)


def _fuel(windows: Windows, resolution: Any, engine: Engine) -> tuple[_Compared, Any]:
    """Compare the fuel rate with that of the map at the engine torque."""
    settings = EstimateSettings()
    level = np.hypot(settings.torque_bias, settings.fuel_bias)
    prior = np.diag(np.square([level, _SLOPE_ERROR, _SLOPE_ERROR]))
    compared = _Compared(prior, _FUEL_STEPS)
    expected = np.asarray(
        engine.fuel_rate(windows.engine_speed, windows.engine_torque), dtype=float
    )
    full = np.asarray(engine.full_load_torque(windows.engine_speed), dtype=float)
    with np.errstate(invalid="ignore", divide="ignore"):
        part = windows.engine_torque / full
        residual = np.log(windows.fuel_rate / expected)
        torque = np.sqrt(2.0) * _ROUNDED * resolution.get("engine_torque", 0.0)
        rounding = np.hypot(
            torque / windows.engine_torque,
            _ROUNDED * resolution.get("fuel_rate", 0.0) / windows.fuel_rate,
        )
    (rows,) = np.nonzero((part > _MIN_LOAD) & np.isfinite(residual))
    for row in rows.tolist():
        compared.residuals.append(float(residual[row]))
        compared.deviations.append(float(np.hypot(rounding[row], _SCATTER)))
        compared.slopes.append(
            np.array([1.0, _speed_axis(windows.engine_speed[row]), 2.0 * part[row] - 1])
        )
    return compared, rows


def _output(
    windows: Windows, resolution: Any, model: EfficiencyModel
) -> tuple[_Compared, Any]:
    """Compare the output speed with that of the model at displacement ratio and load."""
    prior = np.diag(np.square([_STROKE_ERROR] * 3))
    compared = _Compared(prior, _SPEED_STEPS)
    stages = Stages.of(model)
    expected, per_stroke, load = _expected_output(windows, stages, model)
    with np.errstate(invalid="ignore", divide="ignore"):
        residual = windows.output_speed / expected - 1.0
        rounding = np.hypot(
            per_stroke * _ROUNDED * resolution.get("displacement_ratio", 0.0),
            _ROUNDED * resolution.get("output_speed", 0.0) / windows.output_speed,
        )
    turning = np.abs(windows.output_speed) > _MIN_OUTPUT
    (rows,) = np.nonzero(turning & np.isfinite(residual) & np.isfinite(rounding))
    for row in rows.tolist():
        compared.residuals.append(float(residual[row]))
        compared.deviations.append(float(np.hypot(rounding[row], _SCATTER)))
        compared.slopes.append(
            np.array(
                [1.0, windows.displacement_ratio[row], load[row] / _MIDDLE_LOAD - 1.0]
            )
        )
    return compared, rows


_MIDDLE_LOAD = 200.0
"""Load torque in the middle of tests [N m], as in a watch on bench samples."""
_STROKE_STEP = 1e-3


def _expected_output(
    windows: Windows, stages: Stages, model: EfficiencyModel
) -> tuple[Array, Array, Array]:
    """Return the output speed by the model, its relative change with the stroke, and the load."""
    count = len(windows.stamp)
    expected = np.full(count, np.nan)
    per_stroke = np.full(count, np.nan)
    load = np.full(count, np.nan)
    ratio = windows.output_speed / windows.engine_speed
    engaged, _ = stages.engaged(ratio, windows.displacement_ratio, None)
    physical = model.without_meters()
    for number, (name, solver) in enumerate(stages.solvers.items()):
        of_stage = (engaged == number) & np.isfinite(windows.displacement_ratio)
        (rows,) = np.nonzero(of_stage)
        if not len(rows):
            continue
        speed = windows.engine_speed[rows]
        solved = solver.solve(
            speed, windows.output_speed[rows], windows.engine_torque[rows]
        )
        answered = np.isfinite(solved.load_torque)
        at = rows[answered]
        stroke = np.clip(windows.displacement_ratio[at], -1.0, 1.0)
        near = np.where(stroke > 0.0, stroke - _STROKE_STEP, stroke + _STROKE_STEP)
        point = (windows.engine_speed[at], solved.load_torque[answered])
        in_stage = physical.in_stage(name)
        expected[at] = in_stage.output_speed(stroke, *point)
        moved = in_stage.output_speed(near, *point)
        per_stroke[at] = np.abs(moved / expected[at] - 1.0) / _STROKE_STEP
        load[at] = solved.load_torque[answered]
    return expected, per_stroke, load


def _speed_axis(engine_speed: float) -> float:
    """Return an engine speed as -1 to 1 over the usual range."""
    low, high = ENGINE_SPEED_LIMITS
    return (float(engine_speed) - 0.5 * (low + high)) / (0.5 * (high - low))


def _steady(log: Log, selection: Selection) -> Iterator[Windows]:
    """Yield the means of the steady windows of each piece of a log."""
    for joined, values in read_rows(log, selection, _STEP):
        settled = [values["engine_speed"], values.get("engine_torque")]
        if settled[1] is None or "output_speed" not in values:
            return
        settled.append(values["output_speed"])
        rows = np.stack([joined.time, *settled])
        known = np.isfinite(rows).all(axis=0) & (rows[1] > 0.0)
        (usable,) = np.nonzero(known)
        if not len(usable):
            continue
        empty = np.full(len(joined.time), np.nan)
        fuel = values.get("fuel_rate", empty)
        stroke = values.get("displacement_ratio", empty)
        means = []
        for part in split_at_gaps(joined.time[usable], _GAP):
            at = usable[part]
            for window in find_windows(
                joined.time[at], _channels(rows[1:, at]), _LIMITS
            ):
                inside = at[window]
                columns = [*rows[:, inside], fuel[inside], stroke[inside]]
                means.append([float(np.mean(column)) for column in columns])
        if means:
            yield Windows(*np.array(means).T)


def _channels(values: Array) -> Channels:
    """Return engine speed, engine torque and output speed with their limits."""
    drift = (_LIMITS.speed_drift, _LIMITS.torque_drift, _LIMITS.speed_drift)
    scatter = (_LIMITS.speed_scatter, _LIMITS.torque_scatter, _LIMITS.speed_scatter)
    return Channels(values, np.array(drift), np.array(scatter), np.ones(3, dtype=bool))
