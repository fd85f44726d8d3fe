# SPDX-License-Identifier: Apache-2.0
"""One lookup and one optimum at a time, against a table and against SciPy's minimiser."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

from .rivals import (
    Point,
    Table,
    just_enough,
    operating_points,
    ours,
    points,
    scipy_pair,
    scipy_stroke,
)
from .turns import in_turns

TURNS = 15
HOLDS = ("engine_speed", "output_speed")
PIECES = (1, 10)
_SEARCHES = {"engine_speed": scipy_stroke, "output_speed": scipy_pair}


@pytest.fixture(scope="module")
def table(model):
    return Table(model)


@pytest.fixture(scope="module")
def given(model):
    return points(model, 50, seed=1)


@pytest.fixture(scope="module")
def settings(model):
    """Settings of SciPy's minimiser by what is held and by the number of pieces."""
    many = points(model, 100, seed=2)
    found = {}
    for hold in HOLDS:
        best = np.array([ours(model, point, hold).efficiency for point in many])
        for pieces in PIECES:
            found[hold, pieces] = just_enough(partial(_SEARCHES[hold], model), many, best, pieces)
    return found


@in_turns(TURNS, contender=("hmcvt", "table"))
def bench_lookup(timed, model, table, given, contender, turn):
    lookup = model.efficiency if contender == "hmcvt" else table.efficiency
    plain = [point[:3] for point in given]
    if contender == "table":
        def run():
            for point in plain:
                lookup(point)
    else:
        def run():
            for displacement_ratio, engine_speed, load_torque in plain:
                lookup(displacement_ratio, engine_speed, load_torque)
    timed(run, len(plain))


def bench_table_error(timed, model, table):
    """How far the table is off, at 200,000 random points, and its best points."""
    many = operating_points(200_000, seed=3)
    error = timed(lambda: table.efficiency(np.stack(many, axis=-1)) - model.efficiency(*many),
                  rounds=1)
    losses = {hold: [_loss(model, table, point, hold) for point in points(model, 500, seed=4)]
              for hold in HOLDS}
    timed.told.update(
        largest=float(np.abs(error).max()), rms=float(np.sqrt(np.mean(error**2))),
        losses={hold: [float(np.median(loss)), max(loss)] for hold, loss in losses.items()})


def _loss(model, table, point: Point, hold: str) -> float:
    """Efficiency lost by taking the best point of the table."""
    stroke, speed = ((table.best_stroke(*point[1:3]), point.engine_speed)
                     if hold == "engine_speed" else table.best_pair(*point[3:5]))
    return (ours(model, point, hold).efficiency
            - model.efficiency(stroke, speed, point.power / speed))


@in_turns(TURNS, contender=("hmcvt", "table", *(f"SciPy, {count} pieces" for count in PIECES)))
@pytest.mark.parametrize("hold", HOLDS)
def bench_optimum(timed, model, table, given, settings, hold, contender, turn):
    if contender == "hmcvt":
        best = partial(ours, model, hold=hold)
    elif contender == "table":
        def best(point):
            return (table.best_stroke(*point[1:3]) if hold == "engine_speed"
                    else table.best_pair(*point[3:5]))
    else:
        setting = settings[hold, int(contender.split()[1])]
        given = given[:len(given) // setting.pieces]
        timed.told.update(tolerance=setting.tolerance, missed=setting.missed)
        best = partial(_SEARCHES[hold], model, setting)

    def run():
        for point in given:
            best(point)

    timed(run, len(given), rounds=2)
