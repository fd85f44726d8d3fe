# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What the import of a bag is given: which topics, and when a window counts as steady."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from hmcvt_core import InputError
from hmcvt_tools import Shafts, Steadiness, limit, require_positive


@dataclass(frozen=True)
class ImportSettings:
    """Where to look in a bag, and how.

    Attributes:
        topic: topic with the shafts; the end of its name is enough, unless it starts with `/`.
        namespace: namespace of all topics; None takes the only one in the bag.
        steadiness: when a window counts as steady.
        age_limit: largest distance in time between a slow topic and a message [s].
        gap: longest pause within a window [s]; a step back of the clock ends a window too.
        averaged: whether every message is a steady average already; no windows are sought then.
        use_oil_temperature: whether to look for the oil temperature.
        use_stage: whether to read the stage from `header.frame_id` and the topic `stage`.
        signals: topic of numbers and size of their unit in SI, by field of `Shafts`, where no topic
            holds them all.

    Raises:
        InputError: a time is not positive, some signals are missing, or both `topic` and `signals`
            are given.
    """

    topic: str = "bench_sample"
    namespace: str | None = None
    steadiness: Steadiness = field(default_factory=Steadiness)
    age_limit: float = limit(
        5.0, "How far in s a reading of a slow topic may lie from a message."
    )
    gap: float = limit(1.0, "A longer pause between messages in s ends a window.")
    averaged: bool = False
    use_oil_temperature: bool = True
    signals: Mapping[str, tuple[str, float]] = field(default_factory=dict)
    use_stage: bool = True

    def __post_init__(self) -> None:
        require_positive(self)
        missing = [name for name in Shafts._fields if name not in self.signals]
        if self.signals and missing:
            raise InputError(f"no topic is named for {', '.join(missing)}")
        if self.signals and self.topic != ImportSettings.topic:
            raise InputError(
                f"topic = {self.topic!r} holds all signals, or each has a separate "
                "topic: name one or the other"
            )
