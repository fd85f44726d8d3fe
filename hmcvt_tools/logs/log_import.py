# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Bench samples from a log: its steady windows, found piece by piece."""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from hmcvt_core.errors import InputError
from hmcvt_core.files.bench import BenchSamples
from hmcvt_core.transmission.ranges import EFFICIENCY_STD

from ..tables.checks import changing_strokes, contradictions, implausible
from ..tables.proposal import INPUTS, OUTPUTS, missing_quantities
from ..tables.raw import Imported
from ..tables.recordings import (
    Windows,
    bench_columns,
    out_of_range_note,
    stamp_origin,
    windows_of,
)
from ..tables.shafts import exchanged_shafts, shafts_note
from .opening import open_log
from .selection import Selection, Stated, read_rows, select
from .series import Log, Report, listed_names

_LOGGER = logging.getLogger(__name__)
_PIECE = 3600.0
"""Span of a log that is searched for windows at a time [s]; a window does not reach across."""
_MIN_STEP = 0.01
"""Minimum distance of two rows [s]: faster signals are thinned, so that an hour fits the memory."""
_ROUNDED = 1.0 / np.sqrt(12.0)
"""Standard deviation of rounding, in steps."""
_USUAL_EFFICIENCY = (0.65, 0.97)
"""Median efficiency of a hydromechanical CVT at work; chosen from published benches."""


def import_log(
    log: Log,
    selection: Selection,
    *,
    unchecked: bool = False,
    progress: Report | None = None,
) -> Imported:
    """Make a bench sample of each steady window of a log.

    Args:
        log: to be read.
        selection: channels by quantity, see `select`.
        unchecked: take values that contradict each other or look like another unit.
        progress: called with how much of the log is read.

    Raises:
        InputError: quantities are missing or given twice, values contradict each other, or no
            window is steady and in range.
    """
    missing = what_is_missing(selection)
    if missing:
        raise InputError(_lacking(log, selection, missing))
    chosen = [name for name in selection.quantities if name != "fuel_rate"]
    rows, windows = _windows(log, selection, chosen, unchecked, progress)
    kept = [window for part in windows for window in part.kept]
    note = _note(rows, windows)
    if not kept:
        raise InputError(f"{log.path}: {'; '.join([note, *log.remarks.lines])}")
    columns = bench_columns([sample for _, sample in kept])
    if "output_speed" not in chosen:
        columns.pop("output_speed", None)
    if not unchecked:
        _refuse_unusual(log, selection, columns)
    _add_rounding(columns, selection)
    extra = {}
    if "stage" in chosen:
        extra["stage"] = tuple(stage for stage, _ in kept)
    samples = BenchSamples(**columns, extra=extra, source=str(log.path))
    notes = [*selection.proposal.notes, note, *_unique_notes(windows)]
    notes += log.remarks.lines
    shafts = shafts_note(columns, selection.columns)
    if shafts:
        notes.append(shafts)
    return Imported(samples, (), tuple(notes))


def _windows(
    log: Log,
    selection: Selection,
    chosen: Sequence[str],
    unchecked: bool,
    progress: Report | None,
) -> tuple[int, list[Windows]]:
    """Return the count of joined rows, and the steady windows of every hour."""
    windows = []
    rows = 0
    for values, stages in _hours(log, selection, chosen, progress):
        rows += len(values["stamp"])
        if not _has_row(values):
            continue
        if not unchecked:
            _refuse(log, [*contradictions(_without(values, "stamp"), {})])
        windows.append(windows_of(values, stages, str(log.path)))
    return rows, windows


def _unique_notes(windows: Sequence[Windows]) -> list[str]:
    notes = [note for part in windows for note in part.notes]
    return list(dict.fromkeys(notes))


def read_log(path: str | os.PathLike[str]) -> BenchSamples:
    """Read the steady windows of a log, as `hmcvt import` does without further options.

    Raises:
        InputError: as of `open_log` and `import_log`, or the log leaves something open.
    """
    with open_log(path) as log:
        selection = select(log, Stated())
        if selection.proposal.questions and what_is_missing(selection):
            questions = "; ".join(map(str, selection.proposal.questions))
            raise InputError(f"{path}: {questions} (hmcvt import takes the answers)")
        imported = import_log(log, selection)
    for note in imported.notes:
        _LOGGER.warning("%s: %s", path, note)
    return imported.samples


def what_is_missing(selection: Selection) -> list[str]:
    """Return what bench samples still need."""
    return missing_quantities(selection.quantities)


def _lacking(log: Log, selection: Selection, missing: Sequence[str]) -> str:
    hints = [*map(str, selection.proposal.questions), *selection.proposal.notes]
    text = (
        f"{log.path}: no channel is named for {', '.join(missing)}; there is "
        f"{listed_names(log.channels)}"
    )
    missing_messages = log.missing_messages()
    if missing_messages:
        hints.append(f"not on the bus: {listed_names(missing_messages)}")
    return "; ".join([text, *hints, *log.remarks.lines])


def _hours(
    log: Log, selection: Selection, chosen: Sequence[str], progress: Report | None
) -> Iterator[tuple[dict[str, Any], Any]]:
    """Yield SI values with `stamp`, and the stage of each row, of at most `_PIECE` seconds."""
    parts: list[dict[str, Any]] = []
    start = np.nan
    origin = np.nan
    for joined, values in read_rows(log, selection, _MIN_STEP):
        part = {name: values[name] for name in chosen}
        if np.isnan(origin):
            origin = stamp_origin(joined.time)
            if origin:
                reason = f"stamps begin below zero: times count from {origin:g} s"
                log.remarks.add("file", reason, count=0)
        part["stamp"] = joined.time - origin
        parts.append(part)
        if progress is not None:
            progress(f"{100.0 * log.progress_of():.0f} %")
        if not np.isfinite(start):
            start = joined.time[0]
        if joined.time[-1] - start >= _PIECE:
            yield _concatenated(parts)
            parts = []
            start = np.nan
    if parts:
        yield _concatenated(parts)


def _concatenated(parts: Sequence[Mapping[str, Any]]) -> tuple[dict[str, Any], Any]:
    values = {}
    for name in parts[0]:
        values[name] = np.concatenate([part[name] for part in parts])
    stages = values.pop("stage", np.full(len(values["stamp"]), ""))
    into = [name for name in INPUTS if name in values]
    out = [name for name in OUTPUTS if name in values]
    for same in (into, out):
        for name in same[1:]:
            del values[name]  # compared by `contradictions` in the preview only
    return values, stages


def _has_row(values: Mapping[str, Any]) -> bool:
    """Whether some row holds all quantities."""
    complete = np.ones(len(values["stamp"]), dtype=bool)
    for name, column in values.items():
        if name != "oil_temperature":
            complete &= np.isfinite(column)
    return bool(complete.any())


def _without(values: Mapping[str, Any], name: str) -> dict[str, Any]:
    return {key: column for key, column in values.items() if key != name}


def _add_rounding(columns: dict[str, Any], selection: Selection) -> None:
    """Add to `efficiency_std` what the steps of the torques hide.

    In a steady window a torque of 1 % steps may not move at all, and its mean is no better.
    """
    speed = columns["engine_speed"]
    into = columns["load_torque"] / columns["efficiency"]
    parts = [columns["efficiency_std"] / columns["efficiency"]]
    step = selection.resolution.get("engine_torque", 0.0)
    parts.append(_ROUNDED * step / into)
    if "output_speed" in columns:
        out = columns["load_torque"] * speed / columns["output_speed"]
        step = selection.resolution.get("output_torque", 0.0)
        parts.append(_ROUNDED * step / out)
    relative = np.sqrt(np.sum(np.square(parts), axis=0))
    widened = columns["efficiency"] * relative
    columns["efficiency_std"] = np.minimum(widened, EFFICIENCY_STD.high)


def _note(rows: int, windows: Sequence[Windows]) -> str:
    kept = sum(len(part.kept) for part in windows)
    reasons = [reason for part in windows for reason in part.out_of_range]
    incomplete = sum(part.incomplete for part in windows)
    shortest = 5.0
    if windows:
        shortest = windows[0].limits.min_duration
    return (
        f"{rows} joined rows were cut into {kept} steady windows of {shortest:g} s and more; "
        f"{out_of_range_note(reasons)} and {incomplete} rows without a number left out"
    )


def _refuse(log: Log, problems: Sequence[str]) -> None:
    if problems:
        raise InputError(
            f"{log.path}: {'; '.join(problems)} (name channel and unit, or --unchecked "
            "takes it as it is)"
        )


def _refuse_unusual(log: Log, selection: Selection, columns: Mapping[str, Any]) -> None:
    """Refuse samples whose values look like another unit, or whose efficiency is unusual."""
    problems = implausible(columns, selection.columns)
    problems += changing_strokes(columns["displacement_ratio"])
    if not problems:
        problems = exchanged_shafts(columns, selection.columns)
    middle = float(np.median(columns["efficiency"]))
    low, high = _USUAL_EFFICIENCY
    if not problems and not low <= middle <= high:
        problems.append(
            f"the efficiency is {middle:.2f} in the middle, where {low:g} to {high:g} is "
            "usual: are both torques of the shafts named, the engine's without its "
            "friction, and do the units fit?"
        )
    _refuse(log, problems)
