# SPDX-License-Identifier: Apache-2.0
"""What a measured page says of the run that wrote it."""

from __future__ import annotations

import time
from dataclasses import dataclass

from .processes import busy_seconds

_LOOK = 2.0  # s


@dataclass(frozen=True)
class Run:
    """How the command was run: its line, how long it took [s], the load from others before it."""

    command: str
    seconds: float
    others: float


def busy_cores() -> float:
    """Look for a while how many cores other programs use."""
    before = busy_seconds()
    time.sleep(_LOOK)
    return (busy_seconds() - before) / _LOOK
