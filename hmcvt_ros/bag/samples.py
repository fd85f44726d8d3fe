# SPDX-License-Identifier: Apache-2.0
"""One bench sample out of the readings of one steady window, and how well it is known."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hmcvt_core.transmission.ranges import BENCH_COLUMNS, DISPLACEMENT_RATIO, EFFICIENCY_STD

from .recording import Readings
from .steady import Channel, Steadiness

Array = NDArray[np.float64]
_ZERO_ERROR = 0.01
"""At full stroke a stroke sensor may read this much above 1 on average."""
_LAGS_SUMMED = 3.0  # in correlation times
_MOST_LAGS = 4  # a quarter of the readings: further lags have too few pairs


@dataclass(frozen=True)
class SteadyWindow:
    """One steady window: time of its first message and duration [s], count of messages.

    `effective_size` is how many independent messages would tell as much.
    """

    start: float
    duration: float
    messages: int
    effective_size: float


class Sample(NamedTuple):
    """A steady window, and the bench sample that it gives by column."""

    window: SteadyWindow
    values: Mapping[str, float]


def steady_channels(readings: Readings, limits: Steadiness) -> list[Channel]:
    """Return what has to be settled.

    The engine torque besides the load torque: an engine that takes up speed loads only the one.
    The output speed besides the engine speed: it shows a stroke that still moves when the
    displacement ratio in the log is the one commanded.
    """
    speed = limits.speed_drift, limits.speed_scatter
    torque = limits.torque_drift, limits.torque_scatter
    stroke, shafts = limits.displacement_drift, readings.shafts
    return [
        Channel("engine_speed", shafts.engine_speed, *speed),
        Channel("output_speed", shafts.output_speed, *speed),
        Channel("engine_torque", shafts.engine_torque, *torque),
        Channel("load_torque", shafts.load_torque, *torque),
        Channel("displacement_ratio", shafts.displacement_ratio, stroke, stroke, relative=False),
    ]


def steady_sample(part: Readings) -> Sample:
    """Average the readings of a steady window; `stamp` is its middle.

    Efficiency is mean output power / mean engine power, its deviation that of the mean from the
    scatter within the window; a single reading does not tell how well it is known.
    """
    start, duration = float(part.time[0]), float(part.time[-1] - part.time[0])
    efficiency, std, size = ratio_of_means(part.shafts.output_power, part.shafts.engine_power)
    values = _averages(part, efficiency)
    if len(part.time) > 1:
        # A log without any noise still has a last digit.
        values["efficiency_std"] = max(std, EFFICIENCY_STD.low)
    return Sample(SteadyWindow(start, duration, len(part.time), size), values)


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
    shafts = part.shafts
    speed, stroke = float(shafts.engine_speed.mean()), float(shafts.displacement_ratio.mean())
    if abs(stroke) <= DISPLACEMENT_RATIO.high + _ZERO_ERROR:
        stroke = float(np.clip(stroke, DISPLACEMENT_RATIO.low, DISPLACEMENT_RATIO.high))
    values = {
        "displacement_ratio": stroke,
        "engine_speed": speed,
        "load_torque": float(shafts.output_power.mean()) / speed,
        "efficiency": efficiency,
        "output_speed": float(shafts.output_speed.mean()),
        "stamp": float(part.time[0] + part.time[-1]) / 2.0,
    }
    if part.oil_temperature is not None:
        known = part.oil_temperature[~np.isnan(part.oil_temperature)]
        # A few readings without a temperature do no harm; a window mostly without one has none.
        enough = 2 * len(known) > len(part.oil_temperature)
        values["oil_temperature"] = float(known.mean()) if enough else math.nan
    return values


def effective_size(values: Array) -> float:
    """Return the number of independent readings with as good a mean.

    The autocorrelations rho_k are summed up to the first lag M that is 3 times the sum so far,
    S = 1 + 2 sum(rho_k) (Sokal's automatic windowing): further lags add noise only. About the
    sample's own mean every rho_k comes out too small by the very variance sought; with that put
    back, variance of the mean = s^2 S / (n - 2 M - 1) = s^2 / (size - 1). Readings that alternate
    would give S < 1; that gain is not taken.

    The deviation that follows is still a fifth too small when the time constant of the noise is
    1/20 of the series: nothing in so short a series tells.

    Args:
        values: equally spaced readings, shape (n,), n at least 2.
    """
    count = len(values)
    centred = values - values.mean()
    spectrum = np.fft.rfft(centred, 1 << (2 * count - 1).bit_length())
    products = np.fft.irfft(np.abs(spectrum) ** 2)[:count // _MOST_LAGS + 1]
    if not products[0] > 0.0:
        return float(count)
    sums = np.maximum(2.0 * np.cumsum(products / products[0]) - 1.0, 1.0)
    enough = np.flatnonzero(np.arange(len(sums)) >= _LAGS_SUMMED * sums)
    last = int(enough[0]) if len(enough) else len(sums) - 1
    return 1.0 + float((count - 2 * last - 1) / sums[last])


def ratio_of_means(numerator: Array, denominator: Array) -> tuple[float, float, float]:
    """Return mean(numerator) / mean(denominator), its standard deviation and effective size.

    The deviation is that of the mean of `numerator - ratio denominator`, so that what moves both
    alike cancels; NaN for a single reading. Both are NaN where the denominator is 0 on average.

    Args:
        numerator, denominator: equally spaced readings, shape (n,).
    """
    base = float(denominator.mean())
    value = float(numerator.mean()) / base if base else math.nan
    if len(numerator) == 1 or not base:
        return value, math.nan, float(len(numerator))
    residual = numerator - value * denominator
    size = effective_size(residual)
    return value, float(residual.std()) / abs(base) / math.sqrt(size - 1.0), size
