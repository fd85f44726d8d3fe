# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The messages of a bag as time series on one clock, and counts of what is refused."""

from __future__ import annotations

import math
from array import array
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hmcvt_core import InputError
from hmcvt_core.interface import (
    DISPLACEMENT_RATIO,
    ENGINE_SPEED,
    LOAD_TORQUE,
    OIL_TEMPERATURE,
    OUTPUT_SPEED,
    Range,
)
from hmcvt_tools import Readings, Shafts, held

from ..shafts import UnreadableError, read_shafts
from .reader import NANOSECONDS, Bag
from .stages import UNKNOWN, StageMessage, Stages, stages_of
from .topics import DISPLACEMENT_TOPIC, Topics

Array = NDArray[np.float64]

HEADER_STAMP = "header stamp"
TIME_OF_RECEIPT = "time of receipt"
NO_STAGE = "no stage"
"""Why a message is refused that came before the stage was known."""

_OVERSHOOT = 0.05
"""A reading at full stroke may exceed 1 by this much with its noise [-]; chosen by us."""
_OUTPUT_TORQUE_LIMIT = 20_000.0
"""Largest output torque that a sensor on a tractor can rightly show [N m]; chosen by us."""
_STROKE = Range(
    "displacement_ratio",
    DISPLACEMENT_RATIO.low - _OVERSHOOT,
    DISPLACEMENT_RATIO.high + _OVERSHOOT,
    "-",
)


def _either_sign(name: str, limit: float, unit: str) -> Range:
    # In a transient the output may drive, and noise straddles zero.
    return Range(name, -limit, limit, unit)


_SIGNALS = {
    "engine_speed": ENGINE_SPEED,
    DISPLACEMENT_TOPIC: _STROKE,
    "engine_torque": _either_sign("engine_torque", LOAD_TORQUE.high, "N m"),
    "output_torque": _either_sign("output_torque", _OUTPUT_TORQUE_LIMIT, "N m"),
    "output_speed": _either_sign("output_speed", OUTPUT_SPEED.high, "rad/s"),
}
"""What a sensor can rightly show, by signal."""

_STAMP = 0
_RECEIPT = 1
_VALUES = 2
"""Columns of a table of messages; the values begin at the last."""
_PROGRESS_EVERY = 2000
"""Messages between two reports of progress."""


@dataclass(frozen=True)
class Recording:
    """The readings of a bag.

    Attributes:
        readings: readings in the order they were received.
        clock: `HEADER_STAMP` or `TIME_OF_RECEIPT`.
        read: messages by full name of the topic.
        refused: messages refused by topic and reason.
        stages: stage of each reading, shape (n,); None where the bag names no stages.
        notes: what is worth knowing of the stages, as sentences.
    """

    readings: Readings
    clock: str
    read: Counter[str]
    refused: Mapping[str, Counter[str]]
    stages: NDArray[np.str_] | None
    notes: tuple[str, ...]


@dataclass
class _Messages:
    """The messages of one topic.

    Attributes:
        width: count of values in a message.
        numbers: stamp [s] (0 for none), time of receipt [s] and values of each message in a row.
        frames: `header.frame_id` of each message.
        read: count of messages, unreadable ones too.
        refused: counts by reason.
    """

    width: int
    numbers: array[float] = field(default_factory=lambda: array("d"))
    frames: list[str] = field(default_factory=list)
    read: int = 0
    refused: Counter[str] = field(default_factory=Counter)

    def table(self) -> Array:
        """Return a row for each message: stamp, time of receipt, values."""
        return np.array(self.numbers, dtype=float).reshape(-1, _VALUES + self.width)


@dataclass
class _BenchRows:
    """The messages with the shafts that can still be used.

    Attributes:
        rows: stamp, time of receipt and the fields of `Shafts` of each message.
        frames: `header.frame_id` of each message.
        refused: counts of the others by reason.
    """

    rows: Array
    frames: NDArray[np.str_]
    refused: Counter[str]

    def keep(self, known: NDArray[np.bool_], reason: str) -> None:
        """Keep some messages; count the others as refused."""
        self.rows = self.rows[known]
        self.frames = self.frames[known]
        if not known.all():
            self.refused[reason] = int((~known).sum())


def record(
    bag: Bag,
    topics: Topics,
    age_limit: float,
    gap: float,
    use_stage: bool = True,
    progress: Callable[[str], None] | None = None,
) -> Recording:
    """Read the time series in a bag.

    Args:
        bag: open bag.
        topics: topics to read.
        age_limit: largest distance in time between a slow topic and a message [s].
        gap: the same between a signal with a topic of its own and the engine speed [s].
        use_stage: whether to look for the stage.
        progress: called with the progress of reading.

    Raises:
        InputError: the bag is damaged, or no message of the shafts can be used.
    """
    messages, stage_messages = _collect(bag, topics, progress)
    bench = _bench_rows(messages[topics.bench], topics)
    _fill_in_signals(bench, topics, messages, gap if topics.apart else age_limit)
    stages = Stages(None)
    if use_stage:
        stages = _stages(bench, stage_messages)
    if not len(bench.rows):
        raise InputError(
            f"{bag.path}: {_nothing_usable(messages[topics.bench], topics)}"
        )
    temperature = None
    if topics.oil_temperature is not None:
        readings = messages[topics.oil_temperature].table()
        temperature = align(readings, bench.rows, age_limit)
    clock = _clock(bench.rows)
    return Recording(
        Readings(bench.rows[:, clock], Shafts(*bench.rows[:, _VALUES:].T), temperature),
        HEADER_STAMP if clock == _STAMP else TIME_OF_RECEIPT,
        Counter({name: series.read for name, series in messages.items()}),
        {name: series.refused for name, series in messages.items()},
        stages.names,
        (stages.note,) if stages.note else (),
    )


def listed(reasons: Mapping[str, int]) -> str:
    """Return counts by reason as text."""
    return ", ".join(f"{count} {reason}" for reason, count in reasons.items())


def align(slow: Array, fast: Array, age_limit: float) -> Array:
    """Return the values of a slow series at the times of a fast one.

    Both on header stamps when both have them and those of the slow one rise, else both on times of
    receipt: two clocks are never mixed.

    Args:
        slow: a row for each message: stamp [s] (0 for none), time of receipt [s], value; (m, 3).
        fast: the same of the series whose times are wanted, shape (n, 2 or more).
        age_limit: a reading further away than this in time is not used [s].

    Returns:
        Values as of `held`, shape (n,).
    """
    if not len(slow):
        return np.full(len(fast), np.nan)
    clock = _RECEIPT
    if np.all(np.diff(slow[:, _STAMP]) >= 0.0):
        clock = _clock(slow, fast)
    return held(fast[:, clock], slow[:, clock], slow[:, _VALUES], age_limit)


# --- series of the shafts --------------------------------------------------------------------


def _bench_rows(messages: _Messages, topics: Topics) -> _BenchRows:
    rows = messages.table()
    if topics.apart:
        # The readings are those at the times of the engine speed.
        values = np.full((len(rows), len(Shafts._fields)), np.nan)
        rows = np.column_stack([rows[:, :_VALUES], values])
    return _BenchRows(rows, np.array(messages.frames, dtype=str), messages.refused)


def _fill_in_signals(
    bench: _BenchRows,
    topics: Topics,
    messages: Mapping[str, _Messages],
    age_limit: float,
) -> None:
    """Take signals with a topic of their own where the message of the shafts lacks them."""
    for name, (topic, _) in topics.signals.items():
        column = bench.rows[:, _VALUES + Shafts._fields.index(name)]
        elsewhere = align(messages[topic].table(), bench.rows, age_limit)
        column[:] = np.where(np.isnan(column), elsewhere, column)
        bench.keep(~np.isnan(column), f"no {name} in time")


def _stages(bench: _BenchRows, stage_messages: Sequence[StageMessage]) -> Stages:
    """Return the stage of each message; those before the first stage are refused."""
    stages = stages_of(bench.frames.tolist(), bench.rows[:, _RECEIPT], stage_messages)
    if stages.names is None:
        return stages
    known = stages.names != UNKNOWN
    bench.keep(known, NO_STAGE)
    return stages._replace(names=stages.names[known])


# --- reading ---------------------------------------------------------------------------------


def _collect(
    bag: Bag, topics: Topics, progress: Callable[[str], None] | None
) -> tuple[dict[str, _Messages], list[StageMessage]]:
    """Read the messages of all topics; those on the topic of the stage apart."""
    messages = {}
    for name in topics.names:
        shafts = name == topics.bench and not topics.apart
        messages[name] = _Messages(len(Shafts._fields) if shafts else 1)
    stage_messages: list[StageMessage] = []
    total = sum(bag.counts[name] for name in topics.names)
    for number, (topic, receipt, message) in enumerate(
        bag.records(topics.names), start=1
    ):
        series = messages[topic]
        series.read += 1
        try:
            if message is None:
                raise UnreadableError("unreadable")
            if topic == topics.stage:
                stage_messages.append(StageMessage(receipt, message.data.strip()))
                continue
            values = _values(message, topic, topics)
        except UnreadableError as error:
            series.refused[error.reason] += 1
            continue
        series.numbers.extend((_stamp(message), receipt, *values))
        series.frames.append(_frame(message))
        if progress is not None and number % _PROGRESS_EVERY == 0:
            progress(f"{number} of {total} messages")
    return messages, stage_messages


def _stamp(message: Any) -> float:
    header = getattr(message, "header", None)
    if header is None:
        return 0.0
    return float(header.stamp.sec + header.stamp.nanosec * NANOSECONDS)


def _frame(message: Any) -> str:
    header = getattr(message, "header", None)
    return "" if header is None else str(header.frame_id).strip()


def _values(message: Any, topic: str, topics: Topics) -> tuple[float, ...]:
    """Return the readings in a message.

    One message is a momentary reading: only what no sensor can rightly show is refused. The ranges
    of bench samples are checked on the averages.

    Raises:
        UnreadableError: a reading is missing, not finite or out of range.
    """
    for name, (signal_topic, size) in topics.signals.items():
        if topic == signal_topic:
            return (_checked(size * message.data, _SIGNALS[name]),)
    if topic == topics.oil_temperature:
        return (_checked(message.temperature, OIL_TEMPERATURE),)
    shafts = read_shafts(message, stroke_elsewhere=bool(topics.signals))
    needed = shafts if "displacement" in message.name else shafts[:4]
    if not all(map(math.isfinite, needed)):
        raise UnreadableError("not finite")
    if not _plausible(shafts):
        raise UnreadableError("out of range")
    return shafts


def _plausible(shafts: Shafts) -> bool:
    """Whether sensors can rightly show these readings; a stroke of NaN comes from its topic."""
    return (
        ENGINE_SPEED.low <= shafts.engine_speed <= ENGINE_SPEED.high
        and abs(shafts.load_torque) <= LOAD_TORQUE.high
        and abs(shafts.engine_torque) <= LOAD_TORQUE.high
        and abs(shafts.output_speed) <= OUTPUT_SPEED.high
        and not abs(shafts.displacement_ratio) > _STROKE.high
    )


def _checked(value: Any, limits: Range) -> float:
    if not math.isfinite(value):
        raise UnreadableError("not finite")
    if not limits.low <= value <= limits.high:
        raise UnreadableError("out of range")
    return float(value)


def _clock(*tables: Array) -> int:
    """Return the column of the times: that of the stamps when every message has one.

    Half of the readings on one clock and half on another make no time series.
    """
    for table in tables:
        if not len(table) or not np.all(table[:, _STAMP] > 0.0):
            return _RECEIPT
    return _STAMP


def _nothing_usable(bench: _Messages, topics: Topics) -> str:
    reasons = listed(dict(bench.refused.most_common()))
    needs = (
        "velocity and effort of joints engine and output, and position of joint "
        f"displacement or a topic {DISPLACEMENT_TOPIC}"
    )
    if topics.apart:
        needs = "all signals in time"
    if set(bench.refused) == {NO_STAGE}:
        needs = (
            "a message on the topic stage before the samples, or header.frame_id; "
            "--no-stage does without"
        )
    return (
        f"none of the {bench.read} messages on {topics.bench} can be used: "
        f"{reasons} (needs {needs})"
    )
