# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Power balance of random stages: properties, point and array alike, a second solution of it."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given

from hmcvt_core import EfficiencyModel, HydraulicParameters, PumpMotor
from hmcvt_core.physics.balance import STALLED, BalanceSolver
from hmcvt_core.physics.effects.hydraulic import PressureFrictionStribeck
from hmcvt_core.physics.effects.mechanical import ChargePump, GearMesh
from hmcvt_core.transmission.ranges import OperatingPoints
from hmcvt_core.transmission.stage import speed_ratio

from .reference import steady_states
from .strategies import engine_speeds, load_torques, parameters, stages, strokes

STROKES, FINE = np.linspace(-1.0, 1.0, 81), np.linspace(-1.0, 1.0, 201)
TYPICAL = HydraulicParameters(3e-11, 0.2, 0.08)  # about what Table 2 gives
NO_DRAG = (ChargePump(0.0),)  # shaft by shaft, and not in closed form


def flow_along(model, stroke, engine_speed, load_torque):
    points = np.broadcast_arrays(np.atleast_1d(stroke), engine_speed, load_torque)
    return BalanceSolver(model.stage, model.parameters, model.effects).flow(
        OperatingPoints(*points)
    )[1]


@given(stages(), parameters, engine_speeds, load_torques)
def test_between_zero_and_one_or_refused(stage, found, engine_speed, load_torque):
    model = EfficiencyModel(stage, found)
    efficiency = model.efficiency(STROKES, engine_speed, load_torque)
    answered = np.isfinite(efficiency)
    assert ((efficiency[answered] > 0.0) & (efficiency[answered] < 1.0)).all()
    np.testing.assert_array_equal(
        np.isfinite(model.output_speed(STROKES, engine_speed, load_torque)), answered
    )
    for stroke in (STROKES[0], STROKES[-1]):
        said = model.refusal(stroke, engine_speed, load_torque)
        assert said == (
            None
            if np.isfinite(model.efficiency(stroke, engine_speed, load_torque))
            else STALLED
        )


def test_breakdown_names_every_part(hm4):
    watts = EfficiencyModel(hm4, TYPICAL).breakdown(0.5, 150.0, 200.0)
    assert set(watts.losses) == {
        "gear_pair_2",
        "gear_pair_3",
        "gear_pair_4",
        "gear_pair_5",
        "gear_pair_6",
        "gear_pair_11",
        "leakage",
        "pump_damping",
        "pump_friction",
        "motor_damping",
        "motor_friction",
        "planetary_row",
    }
    assert watts.output_power == 150.0 * 200.0
    # Without effects the row itself is ideal.
    assert watts.losses["planetary_row"] == pytest.approx(0.0, abs=1e-8)


def steepest(values_at, low, high, rounds=17):
    """Zoom in on the largest step between neighbours; a jump stays, a slope does not."""
    step = 0.0
    for _ in range(rounds):
        grid = np.linspace(low, high, 65)
        steps = np.abs(np.diff(values_at(grid)))
        if not np.isfinite(steps).any():
            return 0.0
        index = int(np.nanargmax(steps))
        step, low, high = steps[index], grid[index], grid[index + 1]
        if high - low < 1e-12:
            break
    return step


@given(stages(), parameters, engine_speeds, load_torques)
def test_no_jump_in_stroke(stage, found, engine_speed, load_torque):
    model = EfficiencyModel(stage, found)
    assert (
        steepest(
            lambda eps: model.efficiency(eps, engine_speed, load_torque), -1.0, 1.0
        )
        < 1e-5
    )


@given(stages(), parameters, engine_speeds, load_torques)
def test_standing_motor_takes_the_whole_flow_as_leakage(
    stage, found, engine_speed, load_torque
):
    """Eq. (13) with omega_m = 0: pressure = V_p omega_p eps / leakage, whatever the friction."""
    fine = np.linspace(-1.0, 1.0, 801)
    model = EfficiencyModel(stage, found)
    flow = flow_along(model, fine, engine_speed, load_torque)
    held = flow.state.motor_speed == 0.0
    sense = np.sign(stage.motor_speed_ratio)
    pump_speed = engine_speed / stage.pump.ratio
    delivered = stage.pump_motor.pump_displacement * pump_speed * fine[held] * sense
    np.testing.assert_allclose(
        flow.state.pressure[held] * found.leakage, delivered, rtol=1e-6
    )


@given(stages(), parameters, engine_speeds, load_torques)
def test_point_array_and_balance_agree(stage, found, engine_speed, load_torque):
    model = EfficiencyModel(stage, found)
    points = OperatingPoints(*np.broadcast_arrays(FINE, engine_speed, load_torque))
    many, shafts = (
        model.solution_at(points),
        BalanceSolver(stage, found, NO_DRAG).solve(points),
    )
    for name in ("efficiency", "output_speed"):
        one = [
            getattr(model, name)(stroke, engine_speed, load_torque)
            for stroke in FINE.tolist()
        ]
        np.testing.assert_array_equal(getattr(many, name), one)  # to the last digit
        np.testing.assert_allclose(getattr(shafts, name), one, rtol=1e-9)


@pytest.mark.parametrize("count", [0, 1, 8191, 8192, 8193, 20_000])
def test_no_point_is_lost_between_chunks(model, count):
    stroke = np.linspace(-1.0, 1.0, count)
    found = model.efficiency(stroke, 150.0, 150.0)
    assert found.shape == (count,)
    some = slice(None, None, max(count // 50, 1))
    expected = [
        model.efficiency(value, 150.0, 150.0) for value in stroke[some].tolist()
    ]
    np.testing.assert_array_equal(found[some], expected)


@given(stages(), parameters, engine_speeds, load_torques)
def test_stroke_that_an_output_speed_needs(stage, found, engine_speed, load_torque):
    model = EfficiencyModel(stage, found)
    points = OperatingPoints(*np.broadcast_arrays(FINE[::8], engine_speed, load_torque))
    speed = model.solution_at(points).output_speed
    turning = np.abs(speed / engine_speed / stage.mechanical_speed_ratio - 1.0) > 1e-6
    for solver in (model._solver, BalanceSolver(stage, found, NO_DRAG)):
        needed, _ = solver.held(points.engine_speed, speed, points.load_torque)
        again = model.solution_at(
            points._replace(displacement_ratio=np.clip(needed, -1.0, 1.0))
        ).output_speed
        np.testing.assert_allclose(again[turning], speed[turning], rtol=1e-9)
        # A motor at rest needs no more than the stroke that keeps it there.
        assert (np.abs(needed) <= np.abs(points.displacement_ratio) + 1e-6)[
            ~turning & (speed > 0.0)
        ].all()


@given(stages(), parameters, strokes, engine_speeds, load_torques)
def test_agrees_with_scipy_on_random_stages(
    stage, found, stroke, engine_speed, load_torque
):
    model = EfficiencyModel(stage, found)
    flow = flow_along(model, stroke, engine_speed, load_torque)
    assume(np.isfinite(flow.engine_power[0]) and flow.state.motor_speed[0] != 0.0)
    output_speed = model.output_speed(stroke, engine_speed, load_torque)
    tight = engine_speed * float(speed_ratio(stage, np.array(stroke)))
    states = steady_states(
        stage, found, stroke, engine_speed, load_torque, (tight, output_speed)
    )
    # Two steady states may exist next to the stall; the faster output is the stable one.
    state = max(states)
    assert output_speed == pytest.approx(state.output_speed, rel=1e-6)
    assert model.efficiency(stroke, engine_speed, load_torque) == pytest.approx(
        load_torque / state.engine_torque, rel=1e-5
    )


def test_motor_driven_far_back_next_to_the_stall(hm4):
    """No balance with forward friction exists here, but one with a motor that turns back does.

    Found by a scan of the balance for every motor speed; refused by mistake before.
    """
    model = EfficiencyModel(hm4, HydraulicParameters(7.27208e-11, 0.308857, 0.1))
    point = (0.69, 95.5543, 966.4435)
    flow = flow_along(model, *point)
    assert flow.state.motor_speed[0] == pytest.approx(-130.8, abs=0.2)  # from the scan
    state = max(
        steady_states(hm4, model.parameters, *point, [model.output_speed(*point)])
    )
    assert point[2] / model.efficiency(*point) == pytest.approx(
        state.engine_torque, rel=1e-8
    )


@pytest.mark.parametrize(
    "effect", [GearMesh(0.0214, -0.4, 0.5), PressureFrictionStribeck(0.2, 15.0)]
)
def test_the_flow_closes_at_standstill_and_next_to_it(hm4, effect):
    """Friction of an effect holds the motor too; what rises steeply towards rest is solved."""
    model = EfficiencyModel(hm4, TYPICAL, effects=(effect,))
    flow, units = (
        flow_along(model, np.linspace(-1.0, 1.0, 4001), 107.7, 386.4),
        hm4.pump_motor,
    )
    state = flow.state
    delivered = units.pump_displacement * state.pump_speed * state.displacement_ratio
    np.testing.assert_allclose(
        units.motor_displacement * state.motor_speed,
        delivered - flow.leakage_flow,
        atol=1e-12,
    )
    assert np.isfinite(flow.engine_power).all()


def test_small_motor_whose_damping_asks_for_much_pressure(hm4):
    """Leakage of that pressure answers a motor speed a hundredfold; steps without it diverged."""
    small = replace(hm4, pump_motor=PumpMotor(1e-5, 1e-6, 0.0, 0.0625))
    model = EfficiencyModel(small, HydraulicParameters(1e-10, 1.0, 1.0))
    found = BalanceSolver(small, model.parameters, NO_DRAG).solve(
        OperatingPoints(*np.broadcast_arrays(FINE, 46.0, 10.0))
    )
    np.testing.assert_allclose(
        found.efficiency, model.efficiency(FINE, 46.0, 10.0), rtol=1e-9
    )


def test_forward_motor_that_stalls_does_not_jump_to_rest(hm4):
    """With heavy friction a standing motor would balance too, far below; the jump is refused."""
    units = PumpMotor(1e-5, 1e-5, 0.1, 0.1)
    stage = replace(hm4.with_gear_efficiency(0.85), pump_motor=units)
    model = EfficiencyModel(stage, HydraulicParameters(1.5e-11, 0.001, 0.1))
    stroke = np.linspace(-1.0, 1.0, 2001)
    stalled = False
    for load_torque in np.geomspace(300.0, 3000.0, 12):
        efficiency = model.efficiency(stroke, 60.0, load_torque)
        answered = np.isfinite(efficiency)
        stalled |= bool(answered.any() and not answered.all())
        assert (np.diff(answered.astype(int)) >= 0).all()
        assert (
            steepest(
                lambda eps, torque=load_torque: model.efficiency(eps, 60.0, torque),
                -1.0,
                1.0,
            )
            < 1e-5
        )
    assert stalled
