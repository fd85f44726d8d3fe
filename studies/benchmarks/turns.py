# SPDX-License-Identifier: Apache-2.0
"""How often each comparison is made, and in which order."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from typing import Any

import pytest

QUICK = os.environ.get("HMCVT_BENCH_QUICK") == "1"


def in_turns(turns: int, **contenders: Sequence[Any]) -> Callable[[Any], Any]:
    """Run a benchmark for every contender, then for every contender again, and so on.

    What else the machine does meanwhile then meets them all.
    """
    (name, values), = contenders.items()

    def mark(function: Any) -> Any:
        by_turn = pytest.mark.parametrize("turn", range(min(turns, 2) if QUICK else turns))
        # The innermost decorator changes slowest.
        return pytest.mark.parametrize(name, values)(by_turn(function))

    return mark
