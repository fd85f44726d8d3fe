# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""From a bag to bench samples, and what became of its messages."""

import os
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from hmcvt_core import BenchSamples, InputError
from hmcvt_core.files.steady import (
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

from .reader import Bag, ImportSettings, find_topics
from .recording import Array, listed, record


@dataclass(frozen=True)
class ImportReport:
    """What became of a bag.

    Attributes:
        bag: its path.
        clock: `header stamp` or `time of receipt`.
        read: messages by topic.
        refused: messages by topic and reason.
        averaged: every message was taken as a steady average; the times below are 0 then.
        seconds_logged: time covered by usable messages, gaps left out.
        seconds_steady: in windows.
        gaps: count of pauses and steps back of the clock.
        windows_found: steady windows, or messages that are averages already.
        windows_refused: of those, by reason.
        windows: those that became samples.
        notes: what else is worth knowing, in sentences.
        seconds_transient: in no window.
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

    def text(self) -> str:
        """Return the report as lines."""
        lines = [f"{self.bag}, times by {self.clock}"]
        for topic, count in self.read.items():
            lines.append(
                f"  {topic}: {count} messages read, {_refused(self.refused[topic])}"
            )
        if not self.averaged:
            lines.append(
                f"  {self.seconds_logged:.1f} s logged: {self.seconds_steady:.1f} s steady, "
                f"{self.seconds_transient:.1f} s rejected as transient; gaps: {self.gaps}"
            )
        kind = "averages" if self.averaged else "steady windows"
        lines.append(f"  {self.windows_found} {kind}, {_refused(self.windows_refused)}")
        return "\n".join([*lines, *(f"  note: {note}" for note in self.notes)])


class Imported(NamedTuple):
    """What a bag gave."""

    samples: BenchSamples
    report: ImportReport


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
        readings, clock, read, refused = record(
            bag, topics, settings.age_limit, settings.gap, progress
        )
    # An average stands alone, no matter when the next one comes.
    index = split_at_gaps(readings.time, -1.0 if settings.averaged else settings.gap)
    if out_of_order := len(readings.time) - sum(map(len, index)):
        refused[topics.bench]["out of order"] += out_of_order
    stretches = [readings.select(part) for part in index]
    found = steady_tests(stretches, settings.steadiness, settings.averaged)
    if not found:
        raise InputError(
            f"{path}: {_nothing_steady(readings.time, stretches, settings)}"
        )
    wrong = [complaint(values) for _, values in found]
    good = [
        sample for sample, reason in zip(found, wrong, strict=True) if reason is None
    ]
    windows_refused = Counter(filter(None, wrong))
    if not good:
        raise InputError(
            f"{path}: none of the {len(found)} steady windows can be used: "
            f"{listed(windows_refused)}"
        )
    logged = float(sum(stretch.span for stretch in stretches))
    steady = sum(window.duration for window, _ in found)
    columns: dict[str, Any] = {
        name: np.array([values[name] for _, values in good]) for name in good[0][1]
    }
    return Imported(
        BenchSamples(**columns, source=str(path)),
        ImportReport(
            bag=str(path),
            clock=clock,
            read=dict(read),
            refused={name: dict(count) for name, count in refused.items()},
            averaged=settings.averaged,
            seconds_logged=logged,
            seconds_steady=steady,
            gaps=0 if settings.averaged else len(stretches) - 1,
            windows_found=len(found),
            windows_refused=dict(windows_refused),
            windows=tuple(window for window, _ in good),
            notes=topics.notes,
            seconds_transient=logged - steady,
        ),
    )


def read_bag(path: str | os.PathLike[str]) -> BenchSamples:
    """Read the steady windows of a bag, as `import_bag` does without further settings."""
    return import_bag(path).samples


def _refused(reasons: Mapping[str, int]) -> str:
    return f"{sum(reasons.values())} refused" + (
        f" ({listed(reasons)})" if reasons else ""
    )


def _nothing_steady(
    time: Array, stretches: Sequence[Readings], settings: ImportSettings
) -> str:
    """Return the sentence for a log in which no steady window was found."""
    least, longest = (
        settings.steadiness.min_duration,
        max(stretches, key=lambda item: item.span),
    )
    head = f"no steady window of {least:g} s in {sum(item.span for item in stretches):.1f} s"
    if longest.span < least:
        steps = np.abs(np.diff(time))
        apart = (
            f"messages come {np.median(steps):.3g} s apart"
            if len(steps)
            else "one message only"
        )
        return (
            f"{head}: the longest stretch without a gap of {settings.gap:g} s lasts "
            f"{longest.span:.1f} s, {apart} (--gap; or --averaged when each message is a "
            "steady average)"
        )
    return f"{head}; {_unsettled(longest, settings.steadiness)}"


def _unsettled(readings: Readings, limits: Steadiness) -> str:
    settled = channels(readings, limits)
    _, means, deviations = block_statistics(readings.time, settled.values, limits.block)
    scale = np.where(settled.relative[:, None], np.abs(means), 1.0)
    scatter, change = deviations / scale, np.abs(np.diff(means)) / scale[:, 1:]
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
