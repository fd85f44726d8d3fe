# SPDX-License-Identifier: Apache-2.0
"""What a plan can tell apart, as text; nothing is computed here."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterable
from typing import TYPE_CHECKING

from .next_tests import DECISIVE

if TYPE_CHECKING:
    from .isolability import Confusion, Isolability

_WIDTH = 100
_MOST_REPEATS = 20


def isolability_report(found: Isolability, matrix: bool) -> str:
    """Return what is told apart, what is not and what would tell it, and what is not seen."""
    mixed = {item.effect for item in found.confused()}
    seen = [name for i, name in enumerate(found.effects) if found.detectability[i] >= DECISIVE]
    lines = [f"{found.samples} points; read: {', '.join(found.channels)}",
             f"noise of the efficiency: {100 * found.noise:.2g} points, {found.noise_source}", ""]
    lines += _listed("told from all others: ",
                     [name for name in seen if name not in mixed] or ["none"])
    if mixed:
        lines += ["", "seen, but not told from:"]
    for item in found.confused():
        lines += [*_listed(f"  {item.effect}: ", item.twins), *_what_would(item)]
    lines += ["", *_listed("not visible at their typical size (number: runs of the whole plan that "
                           "would show it): ", list(_hidden(found)) or ["none"])]
    return "\n".join([*lines, *(_matrix(found) if matrix else ())])


def _listed(title: str, names: Iterable[str]) -> list[str]:
    return textwrap.wrap(title + ", ".join(names), _WIDTH, subsequent_indent="      ",
                         break_on_hyphens=False)


def _what_would(item: Confusion) -> list[str]:
    lines = []
    if item.by_speed:
        lines += _listed("    reading the output speed too tells it from ", item.by_speed)
    if item.remedies:
        lines += _listed("    to settle it: ", ["; or ".join(item.remedies)])
    return lines


def _hidden(found: Isolability) -> Iterable[str]:
    """Effects not seen, and how many times the plan must be run to see them."""
    for name, level in zip(found.effects, found.detectability, strict=True):
        if level < DECISIVE:
            times = math.ceil(DECISIVE / level) if level > 0.0 else _MOST_REPEATS + 1
            yield name + (f" ({times})" if times <= _MOST_REPEATS else "")


def _matrix(found: Isolability) -> list[str]:
    width = max(len(name) for name in found.effects)
    lines = ["", "squared deviations that the row's effect, at its typical size, leaves after the "
             "refit of the", f"three base parameters when the column's effect may mimic it; "
             f"visible from {DECISIVE:g}:",
             " " * (width + 3) + " ".join(f"{j + 1:>6}" for j in range(len(found.effects)))]
    for i, name in enumerate(found.effects):
        row = " ".join(f"{min(value, 99999.0):6.0f}" for value in found.separation[i])
        lines.append(f"{i + 1:>2} {name:<{width}} {row}")
    return lines
