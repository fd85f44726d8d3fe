# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Physics at its edges: poles, a pump turned backward, standstill; every path answers alike."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hmcvt_core import load_model
from hmcvt_core.physics.balance import HELD_OUTPUT
from hmcvt_core.physics.effects.mechanical import ChargePump
from hmcvt_core.transmission.ranges import OperatingPoints
from hmcvt_core.transmission.stage import LAYOUTS

from .made_up_stages import edge_points, made_up_model
from .reference import steady_states
from .shaft_balance import Balance

STAGES = Path(__file__).parents[1] / "data" / "stages"


def column(*values):
    return [np.array([value]) for value in values]


# --- values of an independent shaft balance -------------------------------------------------------


@pytest.mark.parametrize("load_torque", [20.0, 0.0, -20.0])
def test_no_answer_beyond_the_pole(load_torque):
    model = load_model(STAGES / "pole_in_stroke.yaml").stages["forward"]
    point = (-0.5, 100.0, load_torque)
    assert np.isnan(model.power_loss(*point))
    assert np.isnan(model.power_loss(*column(*point)))
    assert "pole" in model.refusal(*point)
    assert np.isnan(model.breakdown(*point).input_power)


def test_answers_up_to_the_pole():
    model = load_model(STAGES / "pole_in_stroke.yaml").stages["forward"]
    assert model.output_speed(-0.3, 100.0, 0.0) < 0.0
    assert np.isfinite(model.power_loss(-0.3, 100.0, 0.0))


# An own solver of the shaft balance gave these values.
@pytest.mark.parametrize(
    ("file", "point", "loss", "speed"),
    [
        ("backward_pump.yaml", (0.0095, 83.83, -833.68), 67986.0, None),
        (
            "backward_pump_random.yaml",
            (-0.6196361496612559, 146.44723388349195, -468.89250293543756),
            38423.04,
            71.00,
        ),
    ],
)
def test_pump_turned_backward(file, point, loss, speed):
    model = load_model(STAGES / file)
    assert model.power_loss(*point) == pytest.approx(loss, abs=0.5)
    assert model.power_loss(*column(*point))[0] == pytest.approx(loss, abs=0.5)
    assert sum(model.breakdown(*point).losses.values()) == pytest.approx(loss, abs=0.5)
    if speed is not None:
        assert model.output_speed(*point) == pytest.approx(speed, abs=0.005)


@pytest.mark.parametrize(
    ("file", "point"),
    [
        (
            "reversed_pressure.yaml",
            (0.5926936650800787, 162.83517982291824, 13.421280221593406),
        ),
        ("reversed_pressure_idle.yaml", (-0.9866828467670541, 182.5611946737963, 0.0)),
    ],
)
def test_pressure_reversed_at_every_speed(file, point):
    """The quadratic of a driving motor has no root there, and need not have one."""
    model = load_model(STAGES / file)
    state = Balance(model.stage, model.parameters, *column(*point)).solve()
    expected = pytest.approx(state.output_speed[0], rel=1e-9)
    assert model.output_speed(*point) == expected
    assert model.output_speed(*column(*point))[0] == expected
    loss = (state.engine_torque[0] - point[2]) * point[1]
    assert model.power_loss(*point) == pytest.approx(loss, rel=1e-9)


@pytest.mark.parametrize("load_torque", [0.0, 20.0, -20.0])
def test_self_locking_output_stands_without_load(load_torque):
    model = load_model(STAGES / "self_locking.yaml")
    point = (-0.8104355767028117, 38.367672339665475, load_torque)
    loss = model.power_loss(*point)
    np.testing.assert_array_equal(model.power_loss(*column(*point)), [loss])
    watts = sum(model.breakdown(*point).losses.values())
    if load_torque == 0.0:
        assert str(model.output_speed(*point)) == "0.0"
        assert loss == pytest.approx(100.3e3, abs=50.0)
        assert watts == pytest.approx(loss, rel=1e-9)
    else:
        assert np.isnan(loss)
        assert np.isnan(watts)
        assert model.refusal(*point) == HELD_OUTPUT


@pytest.mark.parametrize(
    ("file", "point", "loss"),
    [
        ("../../../params/output_coupled.yaml", (-0.001, 116.57, 0.0), 4484.0),
        ("standing_output.yaml", (-0.00079, 218.0, 0.0), None),
    ],
)
def test_friction_holds_an_output_without_load(file, point, loss):
    model = next(iter(load_model(STAGES / file).stages.values()))
    assert str(model.output_speed(*point)) == "0.0"
    assert str(model.output_speed(*column(*point))[0]) == "0.0"
    with_effect = replace(model, effects=(ChargePump(0.0),))
    assert str(with_effect.output_speed(*point)) == "0.0"
    watts = model.breakdown(*point)
    assert sum(watts.losses.values()) == pytest.approx(
        model.power_loss(*point), rel=1e-9
    )
    if loss is not None:
        assert model.power_loss(*point) == pytest.approx(loss, abs=1.0)


# --- random stages --------------------------------------------------------------------------------


@pytest.mark.parametrize("layout", LAYOUTS)
def test_paths_agree_on_random_stages(layout):
    """One point, an array and the breakdown give the same state; its powers close."""
    rng = np.random.default_rng(LAYOUTS.index(layout))
    answered = 0
    for _ in range(40):
        model = made_up_model(rng, layout)
        points = random_points(rng, 60)
        loss, speed = model.power_loss(*points), model.output_speed(*points)
        single = np.transpose(
            [
                (model.power_loss(*point), model.output_speed(*point))
                for point in zip(*(row.tolist() for row in points), strict=True)
            ]
        )
        np.testing.assert_allclose(single, [loss, speed], rtol=1e-7)
        watts = model.breakdown(*points)
        scale = np.abs(watts.input_power) + np.abs(watts.output_power) + 1.0
        lost = sum(watts.losses.values())
        known = np.isfinite(loss)
        np.testing.assert_array_equal(np.isfinite(lost), known)
        gap = np.abs(watts.input_power - watts.output_power - lost) / scale
        assert np.max(gap[known], initial=0.0) < 1e-9
        assert np.max((np.abs(lost - loss) / scale)[known], initial=0.0) < 1e-9
        answered += known.sum()
    assert answered > 800


@pytest.mark.parametrize("layout", LAYOUTS)
def test_random_stages_agree_with_an_independent_solver(layout):
    rng = np.random.default_rng(10 + LAYOUTS.index(layout))
    compared = 0
    for _ in range(12):
        model = made_up_model(rng, layout)
        for point in zip(*(row.tolist() for row in random_points(rng, 4)), strict=True):
            speed = model.output_speed(*point)
            if not abs(speed) > 0.02 * point[1]:
                continue
            states = steady_states(model.stage, model.parameters, *point, near=[speed])
            if not states:  # friction holds the motor
                continue
            compared += 1
            nearest = min(states, key=lambda state: abs(state.output_speed - speed))
            assert speed == pytest.approx(nearest.output_speed, rel=1e-6), (
                model,
                point,
            )
            loss = nearest.engine_torque * point[1] - point[2] * point[1]
            assert model.power_loss(*point) == pytest.approx(loss, rel=1e-5, abs=0.1)
    assert compared >= 20


@pytest.mark.parametrize("layout", LAYOUTS)
def test_made_up_stages_agree_with_a_shaft_balance(layout):
    """Pull, overrun, no load and neutral; `studies/edges.py` is the long run."""
    rng = np.random.default_rng(20 + LAYOUTS.index(layout))
    compared = 0
    for _ in range(8):
        model = made_up_model(rng, layout)
        points = edge_points(rng, 200)
        with np.errstate(all="ignore"):
            balance = Balance(model.stage, model.parameters, *points)
            state = balance.solve()
        solution = model.solution_at(OperatingPoints(*points))
        is_refused = np.isnan(solution.engine_torque)
        is_refused &= balance.may_be_refused(state.output_speed)
        clear = ~is_refused & ~(state.margin < 1e-6)
        np.testing.assert_allclose(
            solution.engine_torque[clear],
            state.engine_torque[clear],
            rtol=1e-7,
            atol=1e-7,
        )
        np.testing.assert_allclose(
            solution.output_speed[clear],
            state.output_speed[clear],
            rtol=1e-6,
            atol=1e-6,
        )
        compared += np.isfinite(solution.engine_torque[clear]).sum()
    assert compared > 800


def test_effect_of_no_size_changes_nothing():
    """Next to the pole of an output-coupled stage, too."""
    rng = np.random.default_rng(30)
    answered = 0
    for _ in range(40):
        model = made_up_model(rng, "output_coupled")
        points = OperatingPoints(*edge_points(rng, 300))
        plain = model.solution_at(points).engine_torque
        with_effect = replace(model, effects=(ChargePump(0.0),)).solution_at(points)
        np.testing.assert_allclose(
            with_effect.engine_torque, plain, rtol=1e-6, atol=1e-6
        )
        answered += np.isfinite(plain).sum()
    assert answered > 7000


def random_points(rng, count):
    """Pull, overrun, no load; full stroke and close to standstill."""
    stroke = rng.uniform(-1.0, 1.0, count)
    stroke[::10] *= 1e-3
    speed = rng.uniform(40.0, 230.0, count)
    torque = rng.uniform(-500.0, 300.0, count)
    torque[::5] = 0.0
    return [stroke, speed, torque]


def test_replaced_stage_is_solved_anew():
    """A model keeps no constants of the stage it had before."""
    model = load_model(STAGES / "pole_in_stroke.yaml").stages["forward"]
    units = replace(model.stage.pump_motor, pump_displacement=1e-5)
    other = replace(model, stage=replace(model.stage, pump_motor=units))
    assert np.isfinite(other.power_loss(-0.5, 100.0, 0.0))
