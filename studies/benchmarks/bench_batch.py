# SPDX-License-Identifier: Apache-2.0
"""A million lookups at once: time, memory and arithmetic."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from . import counting
from .rivals import Table, operating_points
from .turns import QUICK, in_turns

COUNT = 1_000_000
TURNS = 11
SIZES = (100_000, 1_000_000) if QUICK else (100_000, 1_000_000, 10_000_000)
THEIR_SIZES = SIZES[:2]  # the largest would take more than a gigabyte


@pytest.fixture(scope="module")
def table(model):
    return Table(model)


@pytest.fixture(scope="module")
def batch():
    return operating_points(COUNT, seed=5)


@pytest.fixture(scope="module")
def rows(batch):
    """The same as the table wants it."""
    return np.stack(batch, axis=-1)


@pytest.fixture(scope="module")
def done(model, batch):
    """The array operations of the batch."""
    return counting.counted(model, batch)


@in_turns(TURNS, contender=("hmcvt", "table", "arithmetic alone"))
def bench_batch(timed, model, table, batch, rows, done, contender, turn):
    run = {"hmcvt": lambda: model.efficiency(*batch), "table": lambda: table.efficiency(rows),
           "arithmetic alone": counting.alone(done)}[contender]
    timed(run, COUNT, rounds=2)
    if contender == "arithmetic alone":
        timed.told["operations"] = counting.per_point(done, COUNT)


@pytest.mark.parametrize(("contender", "count"), [
    *(("hmcvt", count) for count in SIZES), *(("table", count) for count in THEIR_SIZES)])
def bench_memory(timed, model, table, contender, count):
    given = operating_points(count, seed=5)
    rows = np.stack(given, axis=-1)

    def peak():
        tracemalloc.start()
        try:
            answer = model.efficiency(*given) if contender == "hmcvt" else table.efficiency(rows)
            assert len(answer) == count
            return tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()

    timed.told["peak"] = timed(peak, rounds=1, warm=False)
