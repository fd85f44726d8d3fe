# SPDX-License-Identifier: Apache-2.0
"""What counts as steady, and where to look in a bag."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from hmcvt_core import InputError

LEAST_BLOCKS = 3
"""Fewer block means than this show no drift."""


def _limit(default: float, text: str) -> Any:
    return field(default=default, metadata={"text": text})


@dataclass(frozen=True)
class Steadiness:
    """When a bench counts as steady.

    A window is cut into blocks. Drift is the spread of the block means, largest less smallest;
    scatter is the standard deviation within a block. Both are fractions of the mean, those of the
    displacement ratio plain numbers. Each field tells in its metadata what it limits; a block is
    short against a window and long against the noise.

    Raises:
        InputError: a value is not positive, or a window holds fewer than 3 blocks.
    """

    min_duration: float = _limit(5.0, "Shortest steady window in s.")
    block: float = _limit(1.0, "Blocks of this many s are averaged to judge drift.")
    speed_drift: float = _limit(0.005, "Of engine and output speed over a window, a fraction.")
    speed_scatter: float = _limit(0.01, "Of engine and output speed in a block, a fraction.")
    torque_drift: float = _limit(0.02, "Of engine and load torque over a window, a fraction.")
    torque_scatter: float = _limit(0.05, "Of engine and load torque in a block, a fraction.")
    displacement_drift: float = _limit(
        0.01, "Of the displacement ratio over a window; also its scatter.")

    def __post_init__(self) -> None:
        for item in fields(self):
            _require_positive(item.name, getattr(self, item.name))
        if self.min_duration < LEAST_BLOCKS * self.block:
            raise InputError(f"min_duration = {self.min_duration:g} s holds fewer than "
                             f"{LEAST_BLOCKS} blocks of {self.block:g} s")

    @property
    def least_blocks(self) -> int:
        """Blocks in the shortest window."""
        return int(np.ceil(self.min_duration / self.block - 1e-9))


@dataclass(frozen=True)
class ImportSettings:
    """Where to look in a bag, and how.

    Attributes:
        topic: the topic with the shafts; the end of its name will do, unless it starts with `/`.
        namespace: of all topics; None takes the only one there is.
        steadiness: when a window counts as steady.
        age_limit: how far in time a reading of a slow channel may lie from a message [s].
        gap: a longer pause between messages, or a step back of the clock, ends a window [s].
        averaged: every message is a steady average already; no windows are sought.
        use_oil_temperature: whether to look for the oil temperature.

    Raises:
        InputError: a time is not positive.
    """

    topic: str = "bench_sample"
    namespace: str | None = None
    steadiness: Steadiness = field(default_factory=Steadiness)
    age_limit: float = 5.0
    gap: float = 1.0
    averaged: bool = False
    use_oil_temperature: bool = True

    def __post_init__(self) -> None:
        _require_positive("age_limit", self.age_limit)
        _require_positive("gap", self.gap)


def _require_positive(name: str, value: float) -> None:
    if not (np.isfinite(value) and value > 0.0):
        raise InputError(f"{name} = {value:g}: a positive number is needed")
