# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""How much a loss has grown that the sound machine has."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ...diagnosis.results.outcome import Cause
from ...diagnosis.settings import INTERVAL_DEVIATIONS
from ...diagnosis.system import Array


@dataclass(frozen=True)
class Growth:
    """How much a loss has grown that the sound machine has.

    Attributes:
        word: the loss.
        part: growth / loss of the sound machine.
        interval: 95 %, of both.
        sound: loss of the sound machine.
        unit: of `sound`.
        effect: name of the cause that is this growth.
        probability: of that cause.
    """

    word: str
    part: float
    interval: tuple[float, float]
    sound: float
    unit: str
    effect: str
    probability: float

    @classmethod
    def of(
        cls,
        word: str,
        cause: Cause,
        size: Mapping[str, Any],
        sound: float,
        relative_error: float,
    ) -> Growth:
        """Return the growth of a loss.

        Args:
            word: the loss.
            cause: that is the growth.
            size: `value`, `standard_error` and `unit` of what is added.
            sound: the loss of the sound machine, in the same unit.
            relative_error: standard error of `sound`, as a part of it.
        """
        part = size["value"] / sound
        reach = INTERVAL_DEVIATIONS * float(
            np.hypot(size["standard_error"] / sound, part * relative_error)
        )
        interval = (part - reach, part + reach)
        unit = size["unit"]
        return cls(word, part, interval, sound, unit, cause.effect, cause.probability)

    def to_dict(self) -> dict[str, Any]:
        """Return the growth as plain data."""
        return asdict(self)

    def sentence(self, oil_temperature: Array | None) -> str:
        """Return the growth as a sentence, for every report.

        Args:
            oil_temperature: of the samples [deg C], shape (n,), or None.
        """
        low, high = self.interval
        at = ""
        if oil_temperature is not None:
            at = f" at {float(np.mean(oil_temperature)):.0f} deg C"
        return (
            f"{self.word.capitalize()} {100.0 * self.part:+.0f} % against the sound machine{at} "
            f"(95 % interval {100.0 * low:+.0f} to {100.0 * high:+.0f} %)."
        )
