# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""One published thing beside ours, judged by the first of the rules in `rules.txt`."""

import math
from dataclasses import dataclass
from typing import Any

REPRODUCED, BETTER = "reproduced", "better"
DIFFERS, NOT_REPRODUCIBLE = "differs", "not reproducible"
VERDICTS = (REPRODUCED, BETTER, DIFFERS, NOT_REPRODUCIBLE)


@dataclass(frozen=True)
class Item:
    """One line of the comparison.

    Attributes:
        group: heading that it stands under.
        name: what is compared, with its unit; no two items have the same.
        published, ours: numbers in that unit, or words; None where there is none.
        verdict: one of `VERDICTS`.
        why: reason for the verdict, or a remark; may be empty when reproduced.
        form: format of the numbers, such as `.2f`.
    """

    group: str
    name: str
    published: float | str | None
    ours: float | str | None
    verdict: str
    why: str = ""
    form: str = ".2f"

    def to_dict(self) -> dict[str, Any]:
        """Return plain data."""
        return {
            "item": self.name,
            "published": self.published,
            "ours": self.ours,
            "verdict": self.verdict,
            "why": self.why,
        }

    def text(self, value: float | str | None) -> str:
        """Return the published value, or ours, as text."""
        if value is None:
            return "-"
        if isinstance(value, str):
            return value
        return format(value, self.form) if math.isfinite(value) else "no answer"


def printed(
    group: str,
    name: str,
    published: float,
    ours: float,
    form: str,
    *,
    better: bool = False,
    why: str = "",
    remark: str = "",
) -> Item:
    """Judge a printed number.

    Args:
        group, name, published, ours, form: see `Item`.
        better: whether ours is the better one when it is not the same.
        why: told when it is not reproduced.
        remark: told when it is.
    """
    same = math.isfinite(ours) and format(ours, form) == format(published, form)
    verdict = REPRODUCED if same else BETTER if better else DIFFERS
    return Item(group, name, published, ours, verdict, remark if same else why, form)


def printed_error(
    group: str,
    name: str,
    published: float,
    ours: float,
    *,
    form: str = ".2f",
    why: str = "",
) -> Item:
    """Judge a printed error: the smaller one is better."""
    smaller = ours < published
    return printed(
        group, name, published, ours, form, better=smaller, why="" if smaller else why
    )


def claim(
    group: str,
    name: str,
    published: str,
    ours: str,
    holds: bool,
    *,
    why: str = "",
    remark: str = "",
) -> Item:
    """Judge a claim in words by whether its condition holds."""
    return Item(
        group,
        name,
        published,
        ours,
        REPRODUCED if holds else DIFFERS,
        remark if holds else why,
    )
