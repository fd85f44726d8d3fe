# SPDX-License-Identifier: Apache-2.0
"""One bench sample out of the readings of one steady window."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hmcvt_core.transmission.ranges import BENCH_COLUMNS, DISPLACEMENT_RATIO, EFFICIENCY_STD

from .scatter import ratio_of_means
from .series import Series
from .settings import Steadiness
from .steady import Channel, Window

Array = NDArray[np.float64]
_ZERO_ERROR = 0.01
"""At full stroke a stroke sensor may read this much above 1 on average."""


class Readings(NamedTuple):
    """Momentary readings of a bench, each of shape (n,): s, rad/s, N m, -, deg C.

    `oil_temperature` is NaN where none is known, and None when no topic carries it.
    """

    time: Array
    engine_speed: Array
    engine_torque: Array
    output_speed: Array
    output_torque: Array
    displacement_ratio: Array
    oil_temperature: Array | None

    @classmethod
    def of(cls, bench: Series, oil_temperature: Array | None) -> Readings:
        """Name the channels of a bench series."""
        engine_speed, engine_torque, output_speed, output_torque, stroke = bench.values.T
        return cls(bench.time, engine_speed, engine_torque, output_speed, output_torque, stroke,
                   oil_temperature)

    @property
    def engine_power(self) -> Array:
        """[W]."""
        return self.engine_torque * self.engine_speed

    @property
    def output_power(self) -> Array:
        """[W]."""
        return self.output_torque * self.output_speed

    def select(self, index: slice | NDArray[np.intp]) -> Readings:
        """Return some of the readings."""
        temperature = None if self.oil_temperature is None else self.oil_temperature[index]
        return Readings(self.time[index], self.engine_speed[index], self.engine_torque[index],
                        self.output_speed[index], self.output_torque[index],
                        self.displacement_ratio[index], temperature)


class Sample(NamedTuple):
    """One bench sample by column, and the readings in it that count as independent."""

    values: Mapping[str, float]
    effective_size: float


def steady_channels(readings: Readings, limits: Steadiness) -> list[Channel]:
    """Return what has to be settled.

    The engine torque besides the load torque: an engine that takes up speed loads only the one.
    The output speed besides the engine speed: it shows a stroke that still moves when the
    displacement ratio in the log is the one commanded.
    """
    speed, torque = (limits.speed_drift, limits.speed_scatter), (
        limits.torque_drift, limits.torque_scatter)
    stroke = limits.displacement_drift
    return [
        Channel("engine_speed", readings.engine_speed, *speed),
        Channel("output_speed", readings.output_speed, *speed),
        Channel("engine_torque", readings.engine_torque, *torque),
        Channel("load_torque", readings.output_power / readings.engine_speed, *torque),
        Channel("displacement_ratio", readings.displacement_ratio, stroke, stroke, relative=False),
    ]


def window_sample(readings: Readings, window: Window) -> Sample:
    """Average a steady window; `stamp` is its middle.

    Efficiency is mean output power / mean engine power, its deviation that of the mean from the
    scatter within the window.
    """
    part = readings.select(slice(window.start, window.stop))
    efficiency = ratio_of_means(part.output_power, part.engine_power)
    values = _averages(part, efficiency.value)
    values["stamp"] = float(part.time[0] + part.time[-1]) / 2.0
    # A log without any noise still has a last digit.
    values["efficiency_std"] = max(efficiency.std, EFFICIENCY_STD.low)
    return Sample(values, efficiency.effective_size)


def averaged_sample(part: Readings) -> Sample:
    """Take a single reading as a steady average; how well it is known it does not say."""
    engine_power = float(part.engine_power[0])
    efficiency = float(part.output_power[0]) / engine_power if engine_power else math.nan
    values = _averages(part, efficiency)
    values["stamp"] = float(part.time[0])
    return Sample(values, 1.0)


def complaint(sample: Sample) -> str | None:
    """Say why a sample cannot be used, None when it can."""
    if math.isnan(sample.values.get("oil_temperature", 0.0)):
        return "no oil_temperature in time (--no-oil-temperature does without)"
    for column in BENCH_COLUMNS:
        value = sample.values.get(column.name)
        if value is not None and not column.contains(value):
            return f"{column.name} out of range"
    return None


def _averages(part: Readings, efficiency: float) -> dict[str, float]:
    speed = float(part.engine_speed.mean())
    stroke = float(part.displacement_ratio.mean())
    if abs(stroke) <= DISPLACEMENT_RATIO.high + _ZERO_ERROR:
        stroke = float(np.clip(stroke, DISPLACEMENT_RATIO.low, DISPLACEMENT_RATIO.high))
    values = {
        "displacement_ratio": stroke,
        "engine_speed": speed,
        "load_torque": float(part.output_power.mean()) / speed,
        "efficiency": efficiency,
        "output_speed": float(part.output_speed.mean()),
    }
    if part.oil_temperature is not None:
        known = part.oil_temperature[~np.isnan(part.oil_temperature)]
        # A few readings without a temperature do no harm; a window mostly without one has none.
        enough = 2 * len(known) > len(part.oil_temperature)
        values["oil_temperature"] = float(known.mean()) if enough else math.nan
    return values
