# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""How much a loss has grown that the sound machine has."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...diagnosis import Diagnosis
from ...diagnosis.settings import INTERVAL_DEVIATIONS


@dataclass(frozen=True)
class Growth:
    """How much a loss has grown that the sound machine has.

    Attributes:
        word: the loss.
        part: growth / loss of the sound machine.
        interval: 95 %, of both.
    """

    word: str
    part: float
    interval: tuple[float, float]

    @classmethod
    def of(
        cls, word: str, size: Mapping[str, Any], sound: float, relative_error: float
    ) -> Growth:
        """Return the growth of a loss.

        Args:
            word: the loss.
            size: `value` and `standard_error` of what is added.
            sound: the loss of the sound machine, in the same unit.
            relative_error: standard error of `sound`, as a part of it.
        """
        part = size["value"] / sound
        reach = INTERVAL_DEVIATIONS * float(
            np.hypot(size["standard_error"] / sound, part * relative_error)
        )
        return cls(word, part, (part - reach, part + reach))

    def in_words(self, diagnosis: Diagnosis) -> str:
        """Return the growth as a sentence.

        Args:
            diagnosis: of the change; the oil temperature is that of its samples.
        """
        low, high = self.interval
        sentence = (
            f"{self.word} {100.0 * self.part:+.0f} % against the baseline "
            f"(from {100.0 * low:.0f} to {100.0 * high:.0f} %)"
        )
        temperature = diagnosis.samples.oil_temperature
        if temperature is None:
            return sentence
        return f"{sentence} at {float(np.mean(temperature)):.0f} deg C"
