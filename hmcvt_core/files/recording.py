# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A recording of momentary readings, and the bench samples that its steady windows make."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..transmission.ranges import BENCH_COLUMNS, DISPLACEMENT_RATIO, EFFICIENCY_STD
from .steady import Channel, Steadiness, find_windows, ratio_of_means

Array = NDArray[np.float64]
_ZERO_ERROR = 0.01
"""At full stroke a stroke sensor may read this much above 1 on average."""



class Shafts(NamedTuple):
    """Readings of both shafts: numbers, or arrays of one shape.

    Attributes:
        engine_speed, engine_torque, output_speed, output_torque: rad/s, N m.
        displacement_ratio: NaN where the message does not hold it.
    """

    engine_speed: Any
    engine_torque: Any
    output_speed: Any
    output_torque: Any
    displacement_ratio: Any

    @property
    def engine_power(self) -> Any:
        """[W]."""
        return self.engine_torque * self.engine_speed

    @property
    def output_power(self) -> Any:
        """[W]."""
        return self.output_torque * self.output_speed

    @property
    def load_torque(self) -> Any:
        """Output power / engine speed [N m]."""
        return self.output_power / self.engine_speed

    @property
    def efficiency(self) -> Any:
        """Output power / engine power [-]."""
        return self.output_power / self.engine_power


class Readings(NamedTuple):
    """Momentary readings of a bench.

    Attributes:
        time: [s], shape (n,).
        shafts: arrays of shape (n,).
        oil_temperature: [deg C], shape (n,), NaN where none is known; None when no topic has it.
    """

    time: Array
    shafts: Shafts
    oil_temperature: Array | None

    @property
    def span(self) -> float:
        """Time that they cover [s]."""
        return float(self.time[-1] - self.time[0])

    def select(self, index: slice | list[int]) -> Readings:
        """Return some of the readings."""
        temperature = None if self.oil_temperature is None else self.oil_temperature[index]
        return Readings(self.time[index], Shafts(*(column[index] for column in self.shafts)),
                        temperature)


@dataclass(frozen=True)
class SteadyWindow:
    """One steady window: time of its first message and duration [s], count of messages.

    `effective_size` is how many independent messages would tell as much.
    """

    start: float
    duration: float
    messages: int
    effective_size: float


def split_at_gaps(time: Array, gap: float) -> list[list[int]]:
    """Split readings (n,) at every step of their time [s] by more than a gap, either way.

    Returns:
        Indices of each stretch, in which time rises strictly: a reading is left out when another
        of its time or later came before.
    """
    parts: list[list[int]] = []
    last = -np.inf
    for i, now in enumerate(time.tolist()):
        if abs(now - last) > gap:
            parts.append([i])
        elif now > last:
            parts[-1].append(i)
        else:
            continue
        last = now
    return parts


def channels(readings: Readings, limits: Steadiness) -> list[Channel]:
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


def steady_tests(
    stretches: Iterable[Readings], limits: Steadiness, averaged: bool = False
) -> list[tuple[SteadyWindow, dict[str, float]]]:
    """Average the steady windows of stretches without gaps, or each as a whole; see `average`."""
    return [average(part) for stretch in stretches for part in (
        [stretch] if averaged else map(stretch.select, find_windows(
            stretch.time, channels(stretch, limits), limits)))]


def average(part: Readings) -> tuple[SteadyWindow, dict[str, float]]:
    """Average the readings of a steady window, by column of a bench file; `stamp` is its middle.

    Efficiency is mean output power / mean engine power, its deviation that of the mean from the
    scatter within the window; a single reading does not tell how well it is known.
    """
    shafts, start, end = part.shafts, float(part.time[0]), float(part.time[-1])
    efficiency, std, size = ratio_of_means(shafts.output_power, shafts.engine_power)
    speed, stroke = float(shafts.engine_speed.mean()), float(shafts.displacement_ratio.mean())
    if abs(stroke) <= DISPLACEMENT_RATIO.high + _ZERO_ERROR:
        stroke = float(np.clip(stroke, DISPLACEMENT_RATIO.low, DISPLACEMENT_RATIO.high))
    values = {
        "displacement_ratio": stroke,
        "engine_speed": speed,
        "load_torque": float(shafts.output_power.mean()) / speed,
        "efficiency": efficiency,
        "output_speed": float(shafts.output_speed.mean()),
        "stamp": (start + end) / 2.0,
    }
    if part.oil_temperature is not None:
        known = part.oil_temperature[~np.isnan(part.oil_temperature)]
        # A few readings without a temperature do no harm; a window mostly without one has none.
        enough = 2 * len(known) > len(part.oil_temperature)
        values["oil_temperature"] = float(known.mean()) if enough else math.nan
    if len(part.time) > 1:
        # A log without any noise still has a last digit.
        values["efficiency_std"] = max(std, EFFICIENCY_STD.low)
    return SteadyWindow(start, end - start, len(part.time), size), values


def complaint(values: Mapping[str, float]) -> str | None:
    """Say why averages make no bench sample, None when they do."""
    if math.isnan(values.get("oil_temperature", 0.0)):
        return "no oil_temperature in time (--no-oil-temperature does without)"
    return next((f"{column.name} out of range" for column in BENCH_COLUMNS
                 if column.name in values and not column.contains(values[column.name])), None)
