# SPDX-License-Identifier: Apache-2.0
"""Says how far a log without a steady window is from one, so that the user sees what to change."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .samples import Readings, steady_channels
from .series import Stretches
from .settings import ImportSettings, Steadiness
from .steady import block_statistics


def nothing_steady(readings: Readings, stretches: Stretches, settings: ImportSettings) -> str:
    """Return the sentence for a log in which no steady window was found."""
    least = settings.steadiness.min_duration
    head = f"no steady window of {least:g} s in {stretches.seconds(readings.time):.1f} s"
    spans = [float(readings.time[part[-1]] - readings.time[part[0]]) for part in stretches.parts]
    if max(spans) < least:
        return f"{head}: {_too_short(readings, max(spans), settings.gap)}"
    longest = readings.select(stretches.parts[int(np.argmax(spans))])
    return f"{head}; {_unsettled(longest, settings.steadiness)}"


def _too_short(readings: Readings, longest: float, gap: float) -> str:
    steps = np.abs(np.diff(readings.time))
    apart = f"messages come {np.median(steps):.3g} s apart" if len(steps) else "one message only"
    return (f"the longest stretch without a gap of {gap:g} s lasts {longest:.1f} s, {apart} "
            "(--gap; or --averaged when each message is a steady average)")


def _unsettled(readings: Readings, limits: Steadiness) -> str:
    channels = steady_channels(readings, limits)
    blocks = block_statistics(readings.time, channels, limits.block)
    parts = []
    for channel, means, deviations in zip(channels, blocks.means, blocks.deviations, strict=True):
        scale = np.abs(means) if channel.relative else np.ones_like(means)
        scatter, change = _median(deviations / scale), _median(np.abs(np.diff(means)) / scale[1:])
        parts.append(f"{channel.name} {scatter} (limit {channel.scatter:g}) and {change} "
                     f"({channel.drift:g})")
    return (f"median scatter in blocks of {limits.block:g} s and change from one to the next: "
            f"{', '.join(parts)}")


def _median(values: NDArray[np.float64]) -> str:
    known = values[np.isfinite(values)]
    return f"{np.median(known):.2g}" if len(known) else "unknown"
