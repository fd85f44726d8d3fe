# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The messages of a bag as time series on one clock, and counts of what is refused."""

import math
from array import array
from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hmcvt_core import InputError
from hmcvt_core.files.steady import Readings, Shafts, held
from hmcvt_core.transmission.ranges import (
    DISPLACEMENT_RATIO,
    ENGINE_SPEED,
    LOAD_TORQUE,
    OIL_TEMPERATURE,
    OUTPUT_SPEED,
    Range,
)

from ..shafts import UnreadableError, read_shafts
from .reader import DISPLACEMENT_TOPIC, Bag, Topics

Array = NDArray[np.float64]

_OVERSHOOT = 0.05
"""A stroke reading at full stroke, with its noise, may exceed 1 by this much."""
_STROKE = Range(
    "displacement_ratio",
    DISPLACEMENT_RATIO.low - _OVERSHOOT,
    DISPLACEMENT_RATIO.high + _OVERSHOOT,
    "-",
)
# What no sensor can rightly show; either sign, for in a transient the output may drive, and noise
# straddles zero.
_SIGNALS = {
    "engine_speed": ENGINE_SPEED,
    DISPLACEMENT_TOPIC: _STROKE,
    **{
        name: Range(name, -most, most, unit)
        for name, most, unit in (
            ("engine_torque", LOAD_TORQUE.high, "N m"),
            ("output_torque", 20_000.0, "N m"),
            ("output_speed", OUTPUT_SPEED.high, "rad/s"),
        )
    },
}
_NANOSECONDS = 1e-9
CLOCKS = ("header stamp", "time of receipt")
_EVERY = 2000  # messages between two reports of progress


def record(
    bag: Bag,
    topics: Topics,
    age_limit: float,
    gap: float,
    progress: Callable[[str], None] | None = None,
) -> tuple[Readings, str, Counter[str], dict[str, Counter[str]]]:
    """Read a bag.

    Args:
        bag: open.
        topics: to read.
        age_limit: how far in time a reading of a slow topic may lie from one of the shafts [s].
        gap: the same of a signal with a topic of its own [s].
        progress: told how far the reading is.

    Returns:
        Readings in the order they were received; their clock, `header stamp` or `time of receipt`;
        messages by full name of the topic; messages refused by topic and reason.

    Raises:
        InputError: the bag is damaged, or no message of the shafts can be used.
    """
    read: Counter[str] = Counter(dict.fromkeys(topics.names, 0))
    refused: dict[str, Counter[str]] = {name: Counter() for name in topics.names}
    numbers = {name: array("d") for name in topics.names}
    total = sum(bag.counts[name] for name in topics.names)
    for number, (topic, receipt, message) in enumerate(
        bag.records(topics.names), start=1
    ):
        read[topic] += 1
        try:
            values = _values(message, topic, topics)
        except UnreadableError as error:
            refused[topic][error.reason] += 1
            continue
        numbers[topic].extend((_stamp(message), receipt, *values))
        if progress is not None and number % _EVERY == 0:
            progress(f"{number} of {total} messages")
    # Of each message its stamp [s], 0 where there is none, its time of receipt [s], its values.
    tables = {
        name: np.array(found, dtype=float).reshape(
            -1,
            2
            + (len(Shafts._fields) if name == topics.bench and not topics.apart else 1),
        )
        for name, found in numbers.items()
    }
    bench = tables[topics.bench]
    if topics.apart:  # at the times of the engine speed
        bench = np.column_stack(
            [bench[:, :2], np.full((len(bench), len(Shafts._fields)), np.nan)]
        )
    for name, (topic, _) in topics.signals.items():
        # Where the shafts' message has none; messages without one in time are left out.
        column = bench[:, 2 + Shafts._fields.index(name)]
        elsewhere = align(tables[topic], bench, gap if topics.apart else age_limit)
        column[:] = np.where(np.isnan(column), elsewhere, column)
        known = ~np.isnan(column)
        bench = bench[known]
        if not known.all():
            refused[topics.bench][f"no {name} in time"] = int((~known).sum())
    if not len(bench):
        reasons = listed(dict(refused[topics.bench].most_common()))
        raise InputError(
            f"{bag.path}: none of the {read[topics.bench]} messages on {topics.bench} can be used: "
            f"{reasons} (needs "
            + (
                "all signals in time)"
                if topics.apart
                else "velocity and effort of joints engine and output, and position "
                f"of joint displacement or a topic {DISPLACEMENT_TOPIC})"
            )
        )
    temperature = (
        None
        if topics.oil_temperature is None
        else align(tables[topics.oil_temperature], bench, age_limit)
    )
    clock = _clock(bench)
    readings = Readings(bench[:, clock], Shafts(*bench[:, 2:].T), temperature)
    return readings, CLOCKS[clock], read, refused


def listed(reasons: Mapping[str, int]) -> str:
    """Return counts by reason as text."""
    return ", ".join(f"{count} {reason}" for reason, count in reasons.items())


def _stamp(message: Any) -> float:
    header = getattr(message, "header", None)
    return (
        0.0
        if header is None
        else header.stamp.sec + header.stamp.nanosec * _NANOSECONDS
    )


def _values(message: Any, topic: str, topics: Topics) -> tuple[float, ...]:
    """Return the readings in a message.

    One message is a momentary reading: only what no sensor can rightly show is refused. What the
    average has to satisfy is checked when there is one.

    Raises:
        UnreadableError: with the reason.
    """
    if message is None:
        raise UnreadableError("unreadable")
    for name, (one, size) in topics.signals.items():
        if topic == one:
            return (_checked(size * message.data, _SIGNALS[name]),)
    if topic == topics.oil_temperature:
        return (_checked(message.temperature, OIL_TEMPERATURE),)
    found = read_shafts(message, stroke_elsewhere=bool(topics.signals))
    if not all(
        map(math.isfinite, found if "displacement" in message.name else found[:4])
    ):
        raise UnreadableError("not finite")
    if (
        not ENGINE_SPEED.low <= found.engine_speed <= ENGINE_SPEED.high
        or abs(found.load_torque) > LOAD_TORQUE.high
        or abs(found.engine_torque) > LOAD_TORQUE.high
        or abs(found.output_speed) > OUTPUT_SPEED.high
        or abs(found.displacement_ratio) > _STROKE.high
    ):
        raise UnreadableError("out of range")
    return found


def _checked(value: Any, limits: Range) -> float:
    if not math.isfinite(value):
        raise UnreadableError("not finite")
    if not limits.low <= value <= limits.high:
        raise UnreadableError("out of range")
    return float(value)


def _clock(*tables: Array) -> int:
    """Return the column of the times: of the stamps when every message has one.

    Half of the readings on one clock and half on another make no time series.
    """
    return 0 if all(len(table) and np.all(table[:, 0] > 0.0) for table in tables) else 1


def align(slow: Array, fast: Array, age_limit: float) -> Array:
    """Return the values of a slow series at the times of a fast one.

    Both on header stamps when both have them and those of the slow one rise, else both on times of
    receipt: two clocks are never mixed.

    Args:
        slow, fast: a row for each message: stamp [s] (0 for none), time of receipt [s], values.
        age_limit: a reading further away than this in time is not used [s].

    Returns:
        Shape (len(fast),), as `held`.
    """
    if not len(slow):
        return np.full(len(fast), np.nan)
    clock = _clock(slow, fast) if np.all(np.diff(slow[:, 0]) >= 0.0) else 1
    return held(fast[:, clock], slow[:, clock], slow[:, 2], age_limit)
