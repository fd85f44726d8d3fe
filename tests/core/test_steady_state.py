# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The scalar solve, the array solve, the balance and the optimum: they say the same."""

import numpy as np
import pytest
from hypothesis import given

from hmcvt_core import EfficiencyModel
from hmcvt_core.physics.balance import BalanceSolver
from hmcvt_core.physics.effects.mechanical import ChargePump
from hmcvt_core.transmission.ranges import OperatingPoints
from studies.benchmarks.point import SPEEDS, Points, brute_force

from .strategies import engine_speeds, load_torques, moderate, parameters, stages, strokes

STROKES = np.linspace(-1.0, 1.0, 201)
NO_DRAG = (ChargePump(0.0),)  # shaft by shaft, and not in closed form


@given(stages(), parameters, engine_speeds, load_torques)
def test_point_array_and_balance_agree(stage, found, engine_speed, load_torque):
    model = EfficiencyModel(stage, found)
    points = OperatingPoints(*np.broadcast_arrays(STROKES, engine_speed, load_torque))
    many, shafts = model.solution_at(points), BalanceSolver(stage, found, NO_DRAG).solve(points)
    for name in ("efficiency", "output_speed"):
        one = [getattr(model, name)(stroke, engine_speed, load_torque)
               for stroke in STROKES.tolist()]
        np.testing.assert_array_equal(getattr(many, name), one)  # to the last digit
        np.testing.assert_allclose(getattr(shafts, name), one, rtol=1e-9)


@pytest.mark.parametrize("count", [0, 1, 8191, 8192, 8193, 20_000])
def test_no_point_is_lost_between_chunks(model, count):
    stroke = np.linspace(-1.0, 1.0, count)
    found = model.efficiency(stroke, 150.0, 150.0)
    assert found.shape == (count,)
    some = slice(None, None, max(count // 50, 1))
    expected = [model.efficiency(value, 150.0, 150.0) for value in stroke[some].tolist()]
    np.testing.assert_array_equal(found[some], expected)


@given(stages(), parameters, engine_speeds, load_torques)
def test_stroke_that_an_output_speed_needs(stage, found, engine_speed, load_torque):
    model = EfficiencyModel(stage, found)
    points = OperatingPoints(*np.broadcast_arrays(STROKES[::8], engine_speed, load_torque))
    speed = model.solution_at(points).output_speed
    turning = np.abs(speed / engine_speed / stage.mechanical_speed_ratio - 1.0) > 1e-6
    for solver in (model._solver, BalanceSolver(stage, found, NO_DRAG)):
        needed, _ = solver.held(points.engine_speed, speed, points.load_torque)
        again = model.solution_at(points._replace(
            displacement_ratio=np.clip(needed, -1.0, 1.0))).output_speed
        np.testing.assert_allclose(again[turning], speed[turning], rtol=1e-9)
        # A motor at rest needs no more than the stroke that keeps it there.
        assert (np.abs(needed) <= np.abs(points.displacement_ratio) + 1e-6)[~turning
                                                                          & (speed > 0.0)].all()


@given(stages(), moderate, engine_speeds, load_torques)
def test_no_stroke_is_better_than_the_best(stage, found, engine_speed, load_torque):
    model = EfficiencyModel(stage, found)
    grid = np.linspace(-1.0, 1.0, 4001)
    brute = np.nan_to_num(model.efficiency(grid, engine_speed, load_torque)).max()
    for best in (model.optimal_displacement_ratio(engine_speed, load_torque),
                 model.optimal_displacement_ratio([engine_speed], load_torque)):
        assert np.nan_to_num(best.efficiency) >= brute - 1e-6


@given(stages(), moderate, engine_speeds, load_torques, strokes)
def test_no_pair_is_better_than_the_best(stage, found, engine_speed, load_torque, stroke):
    model = EfficiencyModel(stage, found)
    target = model.output_speed(stroke, engine_speed, load_torque)
    power = engine_speed * load_torque
    # The line leads to torques at which no lookup would answer.
    if not (0.1 < target < 1000.0 and SPEEDS[1] < power < 5000.0 * SPEEDS[0]):
        return
    best = model.optimal_displacement_ratio(
        engine_speed, load_torque, hold="output_speed", output_speed=target,
        engine_speed_limits=SPEEDS)
    assert np.nan_to_num(best.efficiency) >= best_on_the_line(model, target, power) - 1e-6
    if np.isfinite(best.efficiency):
        assert SPEEDS[0] <= best.engine_speed <= SPEEDS[1]
        reached = model.output_speed(best.displacement_ratio, best.engine_speed, best.load_torque)
        assert reached == pytest.approx(target, rel=1e-6)


def best_on_the_line(model, target, power):
    """Best efficiency over strokes, each at the engine speed that holds output speed and power."""
    found = brute_force(model, Points(*np.array([[np.nan]] * 3 + [[target], [power]])),
                        "output_speed")
    return found[0]
