# SPDX-License-Identifier: Apache-2.0
"""From a bag to bench samples."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from hmcvt_core.errors import InputError
from hmcvt_core.files.bench import BenchSamples
from hmcvt_core.transmission.ranges import BENCH_COLUMNS

from .collect import Collected, collect
from .hints import nothing_steady
from .reader import Bag
from .report import ImportReport, SteadyWindow
from .samples import (
    Readings,
    Sample,
    averaged_sample,
    complaint,
    steady_channels,
    window_sample,
)
from .series import Stretches, align, split_at_gaps
from .settings import ImportSettings
from .steady import find_windows
from .topics import Topics, find_topics

OUT_OF_ORDER = "out of order"


class Imported(NamedTuple):
    """What a bag gave."""

    samples: BenchSamples
    report: ImportReport


class _Found(NamedTuple):
    window: SteadyWindow
    sample: Sample


def import_bag(
    path: str | os.PathLike[str],
    settings: ImportSettings | None = None,
    progress: Callable[[str], None] | None = None,
) -> Imported:
    """Turn a recorded bag into bench samples, one for each steady window.

    Args:
        path: folder of the bag, or one of its files.
        settings: where to look and how; None takes the defaults.
        progress: told how far the reading is.

    Returns:
        The samples in the order of the log, and what became of the messages.

    Raises:
        InputError: rosbags is not installed; the bag is missing, damaged or empty; a topic is
            missing; there is no steady window, or none within the ranges of bench samples.
    """
    settings = settings or ImportSettings()
    with Bag(path) as bag:
        topics = find_topics(bag, settings)
        collected = collect(bag, topics, settings.age_limit, progress)
    readings = _readings(collected, settings)
    stretches = _stretches(readings, settings)
    if stretches.out_of_order:
        collected.counts[topics.bench].refused[OUT_OF_ORDER] += stretches.out_of_order
    found = _find(readings, stretches, settings)
    if not found:
        raise InputError(f"{path}: {nothing_steady(readings, stretches, settings)}")
    good, refused = _judge(str(path), found)
    report = _report(str(path), topics, collected, settings.averaged,
                     stretches.seconds(readings.time), len(stretches.parts) - 1,
                     found, good, refused)
    return Imported(_samples(good, str(path)), report)


def _readings(collected: Collected, settings: ImportSettings) -> Readings:
    temperature = None
    if collected.oil_temperature is not None:
        temperature = align(collected.oil_temperature, collected.bench, settings.age_limit)
    return Readings.of(collected.bench, temperature)


def _stretches(readings: Readings, settings: ImportSettings) -> Stretches:
    if settings.averaged:  # each message stands alone, no matter when the next one comes
        return Stretches([np.array([i]) for i in range(len(readings.time))], 0)
    return split_at_gaps(readings.time, settings.gap)


def _find(readings: Readings, stretches: Stretches, settings: ImportSettings) -> list[_Found]:
    found = []
    for index in stretches.parts:
        part = readings.select(index)
        if settings.averaged:
            found.append(_Found(SteadyWindow(float(part.time[0]), 0.0, 1, 1.0),
                                averaged_sample(part)))
            continue
        channels = steady_channels(part, settings.steadiness)
        for window in find_windows(part.time, channels, settings.steadiness):
            start, end = part.time[window.start], part.time[window.stop - 1]
            sample = window_sample(part, window)
            found.append(_Found(SteadyWindow(
                float(start), float(end - start), window.stop - window.start,
                sample.effective_size), sample))
    return found


def _judge(path: str, found: list[_Found]) -> tuple[list[_Found], Counter[str]]:
    """Part the windows into those that are bench samples and counts of the others."""
    complaints = [complaint(item.sample) for item in found]
    good = [item for item, wrong in zip(found, complaints, strict=True) if wrong is None]
    refused = Counter(wrong for wrong in complaints if wrong is not None)
    if not good:
        reasons = ", ".join(f"{number} {reason}" for reason, number in refused.items())
        raise InputError(f"{path}: none of the {len(found)} steady windows can be used: {reasons}")
    return good, refused


def _samples(found: list[_Found], source: str) -> BenchSamples:
    rows = [item.sample.values for item in found]
    columns: dict[str, Any] = {
        column.name: np.array([row[column.name] for row in rows])
        for column in BENCH_COLUMNS if column.name in rows[0]}
    return BenchSamples(**columns, source=source)


def _report(
    path: str, topics: Topics, collected: Collected, averaged: bool, seconds: float, gaps: int,
    found: list[_Found], good: list[_Found], refused: Counter[str],
) -> ImportReport:
    return ImportReport(
        bag=path,
        clock="header stamp" if collected.bench.stamped else "time of receipt",
        read={name: count.read for name, count in collected.counts.items()},
        refused={name: dict(count.refused) for name, count in collected.counts.items()},
        averaged=averaged,
        seconds_logged=seconds,
        seconds_steady=sum(item.window.duration for item in found),
        gaps=0 if averaged else gaps,
        windows_found=len(found),
        windows_refused=dict(refused),
        windows=tuple(item.window for item in good),
        notes=topics.notes,
    )
