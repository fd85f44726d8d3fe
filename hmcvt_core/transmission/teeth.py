# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Ratios written as tooth counts."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

from ..errors import InputError
from .mapping import number

FEWEST_TEETH = 5
"""Teeth of a gear from which a count is plausible; spur gears have at least that many."""
MOST_TEETH = 1000
"""Teeth of a gear up to which a count is plausible."""

_COUNTS = re.compile(r"\s*(\d+)\s*/\s*(\d+)\s*")


@dataclass(frozen=True)
class ToothCounts:
    """Teeth of the two gears of a ratio.

    Attributes:
        over: teeth above the line: of the driven gear of a pair, of the ring of a row.
        under: teeth below the line: of the driving gear of a pair, of the sun of a row.
    """

    over: int
    under: int

    def __post_init__(self) -> None:
        for count in (self.over, self.under):
            if not FEWEST_TEETH <= count <= MOST_TEETH:
                raise InputError(
                    f"{count} is no count of teeth; allowed {FEWEST_TEETH} to {MOST_TEETH}"
                )

    @property
    def ratio(self) -> float:
        """The quotient [-]."""
        return self.over / self.under


def tooth_counts(text: object) -> ToothCounts | None:
    """Return the counts of a text such as `36/45`; None for anything else.

    Raises:
        InputError: a count is implausible.
    """
    if not isinstance(text, str):
        return None
    counts = _COUNTS.fullmatch(text)
    if counts is None:
        return None
    return ToothCounts(int(counts[1]), int(counts[2]))


def gear_ratio(value: object, place: str) -> float:
    """Return driving speed / driven speed of a gear pair as a file states it [-].

    Args:
        value: the ratio; or `DRIVEN/DRIVING` as text or as `{driven: .., driving: ..}` in teeth.
        place: of the value in the file, for errors.

    Raises:
        InputError: the value is neither, or a count is implausible.
    """
    if isinstance(value, Mapping):
        if set(value) != {"driven", "driving"}:
            raise InputError(
                f"{place} = {dict(value)!r} needs the teeth driven and driving"
            )
        value = f"{value['driven']}/{value['driving']}"
    return stated_ratio(value, place)


def stated_ratio(value: object, place: str) -> float:
    """Return a ratio that is stated as a number or as teeth, such as `RING/SUN` [-].

    Raises:
        InputError: the value is neither, or a count is implausible; the place is named.
    """
    try:
        counts = tooth_counts(value)
    except InputError as error:
        raise InputError(f"{place} = {value!r}: {error}") from None
    if counts is not None:
        return counts.ratio
    if isinstance(value, str) and "/" in value:
        raise InputError(f"{place} = {value!r} is not two whole numbers of teeth")
    return number(value, place)
