# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Inner interface: what packages built on the core may import in addition to its public names.

The public names are those of `hmcvt_core` itself. The names below serve programs that process bench
data or run the model for a long time, as `hmcvt_ros` does. They keep their names and meaning within
a minor version; everything else inside the core may change at any time. What packages build on
`hmcvt_tools` is in `hmcvt_tools.__all__`; names that moved there are still found here, with a
warning.

| for | names |
|---|---|
| ranges of quantities | `Range`, `BENCH_COLUMNS`, `POINT_RANGES`, `DISPLACEMENT_RATIO`, ... |
| files that survive a crash | `write_atomically`, `make_folder`, `sync_folder`, `free_name`, ... |
| a model in service | `refit`, `MAX_CHANGE`, `joined`, `HOLDS`, `PAPER_EFFICIENCY_UNCERTAINTY` |
| replies | `plain` |
"""

import typing

from . import moved
from .files import plain
from .files.atomic import (
    free_name,
    make_folder,
    numbered,
    remove_leftovers,
    sync_folder,
    write_atomically,
)
from .files.bench import joined
from .identification.refit import MAX_CHANGE, refit
from .model.optimum import HOLDS
from .transmission.parameters import PAPER_EFFICIENCY_UNCERTAINTY
from .transmission.ranges import (
    BENCH_COLUMNS,
    DISPLACEMENT_RATIO,
    EFFICIENCY_STD,
    ENGINE_SPEED,
    ENGINE_SPEED_LIMITS,
    LOAD_TORQUE,
    OIL_TEMPERATURE,
    OUTPUT_SPEED,
    POINT_RANGES,
    Range,
)

__all__ = [
    "BENCH_COLUMNS",
    "DISPLACEMENT_RATIO",
    "EFFICIENCY_STD",
    "ENGINE_SPEED",
    "ENGINE_SPEED_LIMITS",
    "HOLDS",
    "LOAD_TORQUE",
    "MAX_CHANGE",
    "OIL_TEMPERATURE",
    "OUTPUT_SPEED",
    "PAPER_EFFICIENCY_UNCERTAINTY",
    "POINT_RANGES",
    "Range",
    "free_name",
    "joined",
    "make_folder",
    "numbered",
    "plain",
    "refit",
    "remove_leftovers",
    "sync_folder",
    "write_atomically",
]

_MOVED = frozenset(
    {
        "Controller",
        "Drive",
        "ONE_BLAS_THREAD",
        "Readings",
        "SETTLED",
        "Shafts",
        "Steadiness",
        "SteadyWindow",
        "UNITS",
        "Vehicle",
        "block_statistics",
        "channels",
        "complaint",
        "held",
        "limit",
        "load_vehicle",
        "require_positive",
        "split_at_gaps",
        "steady_tests",
    }
)


def __getattr__(name: str) -> typing.Any:
    """Return a name that moved to `hmcvt_tools`, with a `DeprecationWarning`."""
    return moved.from_tools(__name__, name, _MOVED)


def __dir__() -> list[str]:
    return sorted({*globals(), *_MOVED})
