# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Physics at its edges: made-up stages against an independent solver, point by point.

    python -m studies.edges --stages 2000 --points 500

At every point one call for a point, one for an array, the breakdown and the shafts with effects
must agree with each other, and with the shaft balance of `tests/core/shaft_balance.py`.
"""

import argparse
import sys
from collections import Counter
from dataclasses import replace

import numpy as np

from hmcvt_core.physics.effects.mechanical import ChargePump
from hmcvt_core.transmission.ranges import OperatingPoints
from hmcvt_core.transmission.stage import LAYOUTS
from tests.core.made_up_stages import edge_points, made_up_model
from tests.core.shaft_balance import Balance

CLOSE_POWER = 1e-9
"""Allowed difference of powers, against the power that the engine and the load exchange [-]."""
CLOSE_LIMIT = 1e-6
"""Distance from the most that is carried within which two solvers may decide differently [-]."""


def scale_of(loads, torques):
    """Size of the powers per engine speed at points [N m]."""
    return np.abs(loads) + np.abs(np.nan_to_num(torques)) + 1.0


def differs(first, second, allowed):
    """Whether two answers differ; an answer and none do."""
    is_none = np.isnan(first) & np.isnan(second)
    return ~is_none & ~(np.abs(first - second) <= allowed)


def check(model, points):
    """Return the disagreements by kind, each of shape (n,)."""
    _, engine_speed, load_torque = points
    solution = model.solution_at(OperatingPoints(*points))
    scale = scale_of(load_torque, solution.engine_torque)
    single = []
    for point in zip(*(row.tolist() for row in points), strict=True):
        single.append(model._point_solvers[None](*point))
    disagreements = {}
    rows = np.transpose(single)
    same = (rows == np.array(solution)) | (
        np.isnan(rows) & np.isnan(np.array(solution))
    )
    disagreements["point and array"] = ~same.all(axis=0)
    watts = model.breakdown(*points)
    lost = sum(watts.losses.values())
    loss = (solution.engine_torque - load_torque) * engine_speed
    disagreements["breakdown"] = differs(lost, loss, CLOSE_POWER * scale * engine_speed)
    with_effect = replace(model, effects=(ChargePump(0.0),)).solution_at(
        OperatingPoints(*points)
    )
    disagreements["effects"] = differs(
        with_effect.engine_torque, solution.engine_torque, 1e-6 * scale
    )
    balance = Balance(model.stage, model.parameters, *points)
    state = balance.solve()
    is_refused = np.isnan(solution.engine_torque) & np.isfinite(state.engine_torque)
    is_refused &= balance.may_be_refused(state.output_speed)
    skipped = (state.margin < CLOSE_LIMIT) | is_refused
    disagreements["independent torque"] = ~skipped & differs(
        state.engine_torque, solution.engine_torque, CLOSE_POWER * scale
    )
    disagreements["independent speed"] = ~skipped & differs(
        state.output_speed, solution.output_speed, 1e-6 * engine_speed
    )
    return disagreements, solution, state, skipped


def main(arguments=None):
    """Check made-up stages; return 1 where any point disagrees."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--stages", type=int, default=2000)
    parser.add_argument("--points", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--examples", type=int, default=3)
    options = parser.parse_args(arguments)
    rng = np.random.default_rng(options.seed)
    counts = Counter()
    for number in range(options.stages):
        layout = LAYOUTS[number % len(LAYOUTS)]
        model = made_up_model(rng, layout)
        points = edge_points(rng, options.points)
        with np.errstate(all="ignore"):
            disagreements, solution, state, skipped = check(model, points)
        counts["points", layout] += options.points
        counts["answered", layout] += int(np.isfinite(solution.engine_torque).sum())
        counts["not compared", layout] += int(skipped.sum())
        for kind, wrong in disagreements.items():
            counts[kind, layout] += int(wrong.sum())
            if wrong.any() and counts[kind, layout, "shown"] < options.examples:
                counts[kind, layout, "shown"] += 1
                at = int(np.flatnonzero(wrong)[0])
                print(
                    f"{kind}, {layout}, stage {number}, point "
                    f"{[float(row[at]) for row in points]}: speed {solution.output_speed[at]}, "
                    f"torque {solution.engine_torque[at]}; independent "
                    f"{state.output_speed[at]}, {state.engine_torque[at]}"
                )
    for kind in ("points", "answered", "not compared", *disagreements):
        numbers = ", ".join(f"{layout} {counts[kind, layout]}" for layout in LAYOUTS)
        print(f"{kind}: {numbers}")
    return int(
        any(counts[kind, layout] for kind in disagreements for layout in LAYOUTS)
    )


if __name__ == "__main__":
    sys.exit(main())
