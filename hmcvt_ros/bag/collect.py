# SPDX-License-Identifier: Apache-2.0
"""Reads the messages of a bag into time series, and counts what is refused."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hmcvt_core.errors import InputError

from .messages import (
    RefusedError,
    header_stamp,
    read_displacement,
    read_shafts,
    read_temperature,
)
from .reader import Bag
from .series import Series, SeriesBuffer, align
from .topics import DISPLACEMENT_TOPIC, Topics

STALE_DISPLACEMENT = f"no {DISPLACEMENT_TOPIC} in time"
_DISPLACEMENT = 4  # its column among the channels of a bench reading
_EVERY = 2000  # messages between two reports of progress


@dataclass
class TopicCount:
    """What became of the messages of one topic.

    Attributes:
        read: count of messages.
        refused: counts by reason.
    """

    read: int = 0
    refused: Counter[str] = field(default_factory=Counter)


@dataclass(frozen=True)
class Collected:
    """Time series of one bag.

    Attributes:
        bench: channels engine speed [rad/s], engine torque [N m], output speed [rad/s], output
            torque [N m], displacement ratio [-].
        oil_temperature: one channel [deg C], or None.
        counts: by full name of the topic.
    """

    bench: Series
    oil_temperature: Series | None
    counts: dict[str, TopicCount]


def collect(
    bag: Bag, topics: Topics, age_limit: float, progress: Callable[[str], None] | None = None
) -> Collected:
    """Read a bag.

    Args:
        bag: open.
        topics: to read.
        age_limit: of the displacement ratio, where it comes on a topic of its own [s].
        progress: told how far the reading is.

    Raises:
        InputError: the bag is damaged, or no message of the shafts can be used.
    """
    counts = {name: TopicCount() for name in topics.names}
    buffers = {name: SeriesBuffer(1) for name in topics.names}
    buffers[topics.bench] = SeriesBuffer(_DISPLACEMENT + 1)
    readers = _readers(topics)
    total = sum(bag.counts[name] for name in topics.names)
    for number, record in enumerate(bag.records(topics.names), start=1):
        count = counts[record.topic]
        count.read += 1
        try:
            values = readers[record.topic](record.message)
        except RefusedError as refusal:
            count.refused[str(refusal)] += 1
            continue
        buffers[record.topic].append(header_stamp(record.message), record.receipt, *values)
        if progress is not None and number % _EVERY == 0:
            progress(f"{number} of {total} messages")
    series = {name: buffer.series() for name, buffer in buffers.items()}
    stroke = None if topics.displacement_ratio is None else series[topics.displacement_ratio]
    bench = _fill_displacement(series[topics.bench], stroke, age_limit, counts[topics.bench])
    if not len(bench.time):
        raise InputError(f"{bag.path}: {_nothing_usable(topics, counts[topics.bench])}")
    temperature = None if topics.oil_temperature is None else series[topics.oil_temperature]
    return Collected(bench, temperature, counts)


def _readers(topics: Topics) -> dict[str, Callable[[Any], tuple[float, ...]]]:
    elsewhere = topics.displacement_ratio is not None
    readers: dict[str, Callable[[Any], tuple[float, ...]]] = {
        topics.bench: lambda message: read_shafts(message, elsewhere)}
    if topics.displacement_ratio is not None:
        readers[topics.displacement_ratio] = lambda message: (read_displacement(message),)
    if topics.oil_temperature is not None:
        readers[topics.oil_temperature] = lambda message: (read_temperature(message),)
    return readers


def _fill_displacement(
    bench: Series, stroke: Series | None, age_limit: float, count: TopicCount
) -> Series:
    """Put the displacement ratio of its own topic where the shafts' message has none."""
    missing = np.isnan(bench.values[:, _DISPLACEMENT])
    if stroke is None or not missing.any():
        return bench
    values = bench.values.copy()
    values[missing, _DISPLACEMENT] = align(stroke, bench, age_limit)[missing]
    known = ~np.isnan(values[:, _DISPLACEMENT])
    if not known.all():
        count.refused[STALE_DISPLACEMENT] += int(np.count_nonzero(~known))
    return Series(bench.stamp[known], bench.receipt[known], values[known])


def _nothing_usable(topics: Topics, count: TopicCount) -> str:
    reasons = ", ".join(f"{number} {reason}" for reason, number in count.refused.most_common())
    return (f"none of the {count.read} messages on {topics.bench} can be used: {reasons} (needs "
            f"velocity and effort of joints engine and output, and position of joint displacement "
            f"or a topic {DISPLACEMENT_TOPIC})")
