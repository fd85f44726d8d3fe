# SPDX-License-Identifier: Apache-2.0
"""Swash actuator: the true displacement ratio is not the commanded one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .base import Array, Effect, size


@dataclass(frozen=True)
class DisplacementOffset(Effect):
    """True ratio = commanded + offset."""

    name = "displacement_error"
    form = "offset"
    component = "actuator"
    summary = "the swash plate stands a constant angle off the one commanded"
    source = "feedback zero of swash actuators"
    remedy = "read the swash angle, or the output speed at no load"

    offset: float = size("-", 0.015, -0.1, 0.1, "true minus commanded ratio")

    def true_displacement_ratio(self, displacement_ratio: Array) -> Array:
        """See `Effect`."""
        return displacement_ratio + self.offset


@dataclass(frozen=True)
class DisplacementGain(Effect):
    """True ratio = commanded (1 + gain)."""

    name = "displacement_error"
    form = "gain"
    component = "actuator"
    summary = "the swash plate turns by another angle than commanded, in proportion"
    source = "feedback gain of swash actuators"
    remedy = "read the swash angle, or the output speed at no load"

    gain: float = size("-", 0.02, -0.1, 0.1, "true / commanded ratio - 1")

    def true_displacement_ratio(self, displacement_ratio: Array) -> Array:
        """See `Effect`."""
        return displacement_ratio * (1.0 + self.gain)


@dataclass(frozen=True)
class DisplacementDeadBand(Effect):
    """True ratio = commanded, less a dead band about zero."""

    name = "displacement_error"
    form = "dead band"
    component = "actuator"
    summary = "the swash plate does not answer small commands and lags larger ones"
    source = "overlap of servo valves"
    remedy = "read the swash angle, or the output speed at no load"

    half_width: float = size("-", 0.02, 0.0, 0.15, "half width of the dead band")

    def true_displacement_ratio(self, displacement_ratio: Array) -> Array:
        """See `Effect`."""
        beyond = np.maximum(np.abs(displacement_ratio) - self.half_width, 0.0)
        return np.sign(displacement_ratio) * beyond
