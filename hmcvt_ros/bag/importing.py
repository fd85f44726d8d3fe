# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""From a bag to bench samples, and what became of its messages."""

import logging
import os
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hmcvt_core import BenchSamples, InputError
from hmcvt_tools import (
    SETTLED,
    Readings,
    Steadiness,
    SteadyWindow,
    block_statistics,
    channels,
    complaint,
    split_at_gaps,
    steady_tests,
)

from .reader import Bag
from .recording import Array, Recording, listed, record
from .settings import ImportSettings
from .topics import find_topics

_LOGGER = logging.getLogger(__name__)
_EVERY_MESSAGE_APART = -1.0
"""A gap that lies between any two messages: an average stands alone."""


@dataclass(frozen=True)
class ImportReport:
    """What became of a bag.

    Attributes:
        bag: path of the bag.
        clock: `header stamp` or `time of receipt`.
        read: messages by topic.
        refused: messages by topic and reason.
        averaged: whether every message was taken as a steady average; the times below are 0 then.
        seconds_logged: time covered by usable messages without gaps [s].
        seconds_steady: time in steady windows [s].
        gaps: count of pauses and steps back of the clock.
        windows_found: steady windows, or messages that are averages already.
        windows_refused: refused windows by reason.
        windows: windows that became samples.
        notes: what is missing or noteworthy, as sentences.
        seconds_transient: time in no window [s].
        stages: samples by stage; empty where the bag names no stages.
    """

    bag: str
    clock: str
    read: Mapping[str, int]
    refused: Mapping[str, Mapping[str, int]]
    averaged: bool
    seconds_logged: float
    seconds_steady: float
    gaps: int
    windows_found: int
    windows_refused: Mapping[str, int]
    windows: tuple[SteadyWindow, ...]
    notes: tuple[str, ...]
    seconds_transient: float
    stages: Mapping[str, int]

    def text(self) -> str:
        """Return the report as lines."""
        lines = [f"{self.bag}, times by {self.clock}"]
        for topic, count in self.read.items():
            refused = _refused(self.refused[topic])
            lines.append(f"  {topic}: {count} messages read, {refused}")
        if not self.averaged:
            lines.append(
                f"  {self.seconds_logged:.1f} s logged: {self.seconds_steady:.1f} s steady, "
                f"{self.seconds_transient:.1f} s rejected as transient; gaps: {self.gaps}"
            )
        kind = "averages" if self.averaged else "steady windows"
        lines.append(f"  {self.windows_found} {kind}, {_refused(self.windows_refused)}")
        if self.stages:
            counts = [f"{count} in {stage}" for stage, count in self.stages.items()]
            lines.append(f"  samples by stage: {', '.join(counts)}")
        lines.extend(f"  note: {note}" for note in self.notes)
        return "\n".join(lines)


class Imported(NamedTuple):
    """Bench samples of a bag, and what became of its messages."""

    samples: BenchSamples
    report: ImportReport


class _Test(NamedTuple):
    """A steady test: its window, its averages by column, and its stage; empty where unknown."""

    window: SteadyWindow
    values: Mapping[str, float]
    stage: str


def import_bag(
    path: str | os.PathLike[str],
    settings: ImportSettings | None = None,
    progress: Callable[[str], None] | None = None,
) -> Imported:
    """Turn a recorded bag into bench samples, one for each steady window.

    Args:
        path: folder of the bag, or one of its files.
        settings: where to look and how; None takes the defaults.
        progress: called with the progress of reading.

    Returns:
        The samples in the order of the log, and what became of the messages.

    Raises:
        InputError: rosbags is not installed; the bag is missing, damaged or empty; a topic is
            missing; there is no steady window, or none within the ranges of bench samples.
    """
    settings = settings or ImportSettings()
    with Bag(Path(path)) as bag:
        topics = find_topics(bag, settings)
        recording = record(
            bag,
            topics,
            settings.age_limit,
            settings.gap,
            settings.use_stage,
            progress,
        )
        notes = (*bag.notes, *topics.notes, *recording.notes)
    readings = recording.readings
    gap = _EVERY_MESSAGE_APART if settings.averaged else settings.gap
    index = split_at_gaps(readings.time, gap)
    out_of_order = len(readings.time) - sum(len(part) for part in index)
    if out_of_order:
        recording.refused[topics.bench]["out of order"] += out_of_order
    stretches = [readings.select(part) for part in index]
    tests = _steady_tests(recording, index, settings)
    if not tests:
        raise InputError(
            f"{path}: {_nothing_steady(readings.time, stretches, settings)}"
        )
    usable, refused = _judged(tests)
    if not usable:
        raise InputError(
            f"{path}: none of the {len(tests)} steady windows can be used: "
            f"{listed(refused)}"
        )
    logged = float(sum(stretch.span for stretch in stretches))
    steady = sum(test.window.duration for test in tests)
    report = ImportReport(
        bag=str(path),
        clock=recording.clock,
        read=dict(recording.read),
        refused={topic: dict(count) for topic, count in recording.refused.items()},
        averaged=settings.averaged,
        seconds_logged=logged,
        seconds_steady=steady,
        gaps=0 if settings.averaged else len(stretches) - 1,
        windows_found=len(tests),
        windows_refused=dict(refused),
        windows=tuple(test.window for test in usable),
        notes=notes,
        seconds_transient=logged - steady,
        stages=dict(Counter(test.stage for test in usable if test.stage)),
    )
    return Imported(_samples(usable, recording, str(path)), report)


def read_bag(path: str | os.PathLike[str]) -> BenchSamples:
    """Read the steady windows of a bag, as `import_bag` does without further settings.

    The notes of the report are logged, because the samples alone do not show what is missing.
    """
    samples, report = import_bag(path)
    for note in report.notes:
        _LOGGER.warning("%s: %s", path, note)
    return samples


def _steady_tests(
    recording: Recording, index: Sequence[list[int]], settings: ImportSettings
) -> list[_Test]:
    """Average the steady windows; a change of stage ends one."""
    tests = []
    for part in index:
        for piece in _of_one_stage(part, recording.stages):
            stage = ""
            if recording.stages is not None:
                stage = str(recording.stages[piece[0]])
            stretch = recording.readings.select(piece)
            for window, values in steady_tests(
                [stretch], settings.steadiness, settings.averaged
            ):
                tests.append(_Test(window, values, stage))
    return tests


def _of_one_stage(part: list[int], stages: NDArray[np.str_] | None) -> list[list[int]]:
    """Cut a stretch of readings wherever the stage changes."""
    if stages is None:
        return [part]
    names = stages[part]
    changes = np.flatnonzero(names[1:] != names[:-1]) + 1
    return [piece.tolist() for piece in np.split(np.array(part), changes)]


def _judged(tests: Sequence[_Test]) -> tuple[list[_Test], Counter[str]]:
    """Return the tests within the ranges of bench samples, and counts of the others by reason."""
    usable = []
    refused: Counter[str] = Counter()
    for test in tests:
        reason = complaint(test.values)
        if reason is None:
            usable.append(test)
        else:
            refused[reason] += 1
    return usable, refused


def _samples(tests: Sequence[_Test], recording: Recording, source: str) -> BenchSamples:
    columns: dict[str, Any] = {
        name: np.array([test.values[name] for test in tests])
        for name in tests[0].values
    }
    extra = {}
    if recording.stages is not None:
        extra["stage"] = tuple(test.stage for test in tests)
    return BenchSamples(**columns, extra=extra, source=source)


# --- sentences -------------------------------------------------------------------------------


def _refused(reasons: Mapping[str, int]) -> str:
    text = f"{sum(reasons.values())} refused"
    if reasons:
        text = f"{text} ({listed(reasons)})"
    return text


def _nothing_steady(
    time: Array, stretches: Sequence[Readings], settings: ImportSettings
) -> str:
    """Return the sentence for a log without a steady window."""
    shortest = settings.steadiness.min_duration
    longest = max(stretches, key=lambda stretch: stretch.span)
    seconds = sum(stretch.span for stretch in stretches)
    head = f"no steady window of {shortest:g} s in {seconds:.1f} s"
    if longest.span >= shortest:
        return f"{head}; {_unsettled(longest, settings.steadiness)}"
    apart = "one message only"
    if len(time) > 1:
        apart = f"messages come {np.median(np.abs(np.diff(time))):.3g} s apart"
    return (
        f"{head}: the longest stretch without a gap of {settings.gap:g} s lasts "
        f"{longest.span:.1f} s, {apart} (--gap; or --averaged when each message is a "
        "steady average)"
    )


def _unsettled(readings: Readings, limits: Steadiness) -> str:
    """Return scatter and change of each channel with its limits."""
    settled = channels(readings, limits)
    _, means, deviations = block_statistics(readings.time, settled.values, limits.block)
    scale = np.where(settled.relative[:, None], np.abs(means), 1.0)
    scatter = deviations / scale
    change = np.abs(np.diff(means)) / scale[:, 1:]
    parts = [
        f"{name} {_median(scatter[i])} (limit {settled.scatter[i]:g}) and "
        f"{_median(change[i])} ({settled.drift[i]:g})"
        for i, name in enumerate(SETTLED)
    ]
    return (
        f"median scatter in blocks of {limits.block:g} s and change from one to the next: "
        f"{', '.join(parts)}"
    )


def _median(values: Array) -> str:
    known = values[np.isfinite(values)]
    return f"{np.median(known):.2g}" if len(known) else "unknown"
