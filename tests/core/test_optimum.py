# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Optimal displacement ratio against brute force, for both things that may be held."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given

import hmcvt_core as hmcvt
from hmcvt_core.physics.effects.actuator import DisplacementDeadBand
from hmcvt_core.physics.effects.hydraulic import (
    Compressibility,
    OilTemperature,
    PressureFrictionStribeck,
)
from hmcvt_core.physics.effects.mechanical import ChargePump
from hmcvt_core.transmission.ranges import ENGINE_SPEED_LIMITS
from studies.timing.point import SPEEDS, Points, brute_force

from .strategies import engine_speeds, load_torques, moderate, stages, strokes


@pytest.mark.parametrize(
    ("engine_speed", "load_torque"), [(78.54, 292.85), (150.0, 60.0)]
)
def test_held_engine_speed(model, engine_speed, load_torque):
    found = model.optimal_displacement_ratio(engine_speed, load_torque)
    at = (found.displacement_ratio, engine_speed, load_torque)
    assert found.efficiency == model.efficiency(*at)
    assert found.output_speed == model.output_speed(*at)
    assert (found.engine_speed, found.load_torque) == (engine_speed, load_torque)
    assert (found.hold, found.limit) == ("engine_speed", None)
    # docs/theory.md: next to the full-mechanical point, where the motor stands. Eq. (5) with
    # eps = 0 gives 1.19658; under load it takes some stroke to make up for the leakage.
    assert found.output_speed / engine_speed == pytest.approx(1.19658, rel=0.02)


@pytest.mark.parametrize(
    ("output_speed", "limits", "limit", "held"),
    [
        # Far below the full-mechanical ratio at idle, far above it at full speed: the engine limit.
        (75.0, ENGINE_SPEED_LIMITS, "engine_speed low", 78.5398),
        (310.0, ENGINE_SPEED_LIMITS, "engine_speed high", 230.3835),
        (150.0, (140.0, 200.0), "engine_speed low", 140.0),
        (180.0, ENGINE_SPEED_LIMITS, None, 180.0 / 1.19658),
    ],
)
def test_held_output_speed(model, output_speed, limits, limit, held):
    found = model.optimal_displacement_ratio(
        120.0,
        150.0,
        hold="output_speed",
        output_speed=output_speed,
        engine_speed_limits=limits,
    )
    assert found.limit == limit
    assert found.engine_speed == pytest.approx(held, rel=1e-5 if limit else 0.02)
    at = (found.displacement_ratio, found.engine_speed, found.load_torque)
    assert model.output_speed(*at) == pytest.approx(output_speed, rel=1e-9)
    assert found.output_speed == output_speed
    assert found.engine_speed * found.load_torque == pytest.approx(
        120.0 * 150.0, rel=1e-12
    )
    assert found.efficiency == pytest.approx(model.efficiency(*at), rel=1e-9)


EFFECTS = [
    (Compressibility(1.5, 2.0, 1.0, 5.0),),
    (PressureFrictionStribeck(0.06),),
    (DisplacementDeadBand(0.03), ChargePump(4.0)),
]


@pytest.mark.parametrize("effects", EFFECTS, ids=lambda effects: effects[0].name)
def test_optimum_with_effects(model, effects):
    model = replace(model, effects=effects)
    grid = np.linspace(-1.0, 1.0, 2001)
    for speed, torque, stroke in ((100.0, 60.0, 0.5), (180.0, 300.0, -0.3)):
        found = model.optimal_displacement_ratio(speed, torque)
        assert (
            found.efficiency >= np.nanmax(model.efficiency(grid, speed, torque)) - 2e-5
        )
        found = model.optimal_displacement_ratio(
            speed, torque, hold="output_speed", displacement_ratio=stroke
        )
        target = model.output_speed(stroke, speed, torque)
        brute = best_on_the_line(model, target, speed * torque)
        assert (
            found.efficiency
            >= max(brute, model.efficiency(stroke, speed, torque)) - 2e-5
        )
        assert model.output_speed(
            found.displacement_ratio, found.engine_speed, found.load_torque
        ) == pytest.approx(target, rel=1e-6)


def test_stroke_limit_that_binds_is_said(model):
    """A pump without mechanical path worth the name: more stroke is always better."""
    pairs = model.stage.mechanical.gear_pairs
    lossy = hmcvt.Path(tuple(replace(pair, efficiency=0.5) for pair in pairs))
    other = hmcvt.EfficiencyModel(
        replace(model.stage, mechanical=lossy),
        hmcvt.HydraulicParameters(1e-13, 0.0, 0.0),
    )
    grid = np.linspace(-1.0, 1.0, 2001)
    assert np.nanargmax(other.efficiency(grid, 150.0, 150.0)) == 2000
    found = other.optimal_displacement_ratio(150.0, 150.0)
    assert found.displacement_ratio == pytest.approx(1.0, abs=1e-6)
    assert found.limit == "displacement_ratio high"


def test_out_of_reach_or_stalled_everywhere_is_nan(model, hm4):
    far = model.optimal_displacement_ratio(
        120.0, 150.0, hold="output_speed", output_speed=900.0
    )
    leaky = hmcvt.EfficiencyModel(hm4, hmcvt.HydraulicParameters(1e-8, 0.0, 0.0))
    stalled = leaky.optimal_displacement_ratio(20.0, 2000.0)
    assert np.isnan([far.efficiency, far.displacement_ratio, far.engine_speed]).all()
    assert np.isnan(
        [stalled.efficiency, stalled.displacement_ratio, stalled.output_speed]
    ).all()
    assert far.limit is stalled.limit is None


@pytest.mark.parametrize("hold", ["engine_speed", "output_speed"])
def test_published_formulas_have_no_optimum(fitted_published, hold):
    with pytest.raises(hmcvt.InputError, match=r"no optimum: it has a pole, eq"):
        fitted_published.model.optimal_displacement_ratio(
            150.0, 200.0, hold=hold, displacement_ratio=0.3
        )


@pytest.mark.parametrize("hold", ["engine_speed", "output_speed"])
def test_arrays_equal_scalars(model, hold):
    now = (
        {}
        if hold == "engine_speed"
        else {"displacement_ratio": np.array([[-0.3], [0.6]])}
    )
    speeds, torque = np.array([100.0, 150.0, 200.0]), 180.0
    found = model.optimal_displacement_ratio(speeds, torque, hold=hold, **now)
    shape = (3,) if hold == "engine_speed" else (2, 3)
    for name in (
        "displacement_ratio",
        "efficiency",
        "engine_speed",
        "load_torque",
        "output_speed",
        "limit",
    ):
        assert np.shape(getattr(found, name)) == shape, name
    for index in np.ndindex(shape):
        point = (
            {}
            if hold == "engine_speed"
            else {"displacement_ratio": float(now["displacement_ratio"][index[0], 0])}
        )
        one = model.optimal_displacement_ratio(
            speeds[index[-1]], torque, hold=hold, **point
        )
        assert found.displacement_ratio[index] == pytest.approx(
            one.displacement_ratio, abs=1e-6
        )
        assert found.efficiency[index] == pytest.approx(one.efficiency, rel=1e-12)
        assert found.limit[index] == one.limit


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"hold": "nothing"}, "hold = 'nothing'; there is engine_speed, output_speed"),
        ({"hold": "output_speed"}, r"needs displacement_ratio \(now\) or output_speed"),
        (
            {"hold": "output_speed", "output_speed": 5000.0},
            r"output_speed = 5000 .*is it in r/min\?",
        ),
        (
            {"hold": "output_speed", "displacement_ratio": 1.3},
            "displacement_ratio = 1.3 is outside",
        ),
        (
            {
                "hold": "output_speed",
                "output_speed": 100.0,
                "engine_speed_limits": (200.0, 100.0),
            },
            "engine_speed_limits = 200, 100: the first must be lower",
        ),
        (
            {
                "hold": "output_speed",
                "output_speed": 100.0,
                "engine_speed_limits": (750.0, 2200.0),
            },
            r"engine_speed_limits: engine_speed\[0\] = 750 is outside",
        ),
        ({"engine_speed": math.nan}, "engine_speed = nan is not finite"),
        ({"load_torque": 0.0}, "load_torque = 0 is outside 1 to 5000 N m"),
    ],
)
def test_bad_requests(model, options, message):
    with pytest.raises(hmcvt.InputError, match=message):
        model.optimal_displacement_ratio(
            **{"engine_speed": 120.0, "load_torque": 150.0, **options}
        )


@given(stages(), moderate, engine_speeds, load_torques)
def test_no_stroke_is_better_than_the_best(stage, found, engine_speed, load_torque):
    model = hmcvt.EfficiencyModel(stage, found)
    grid = np.linspace(-1.0, 1.0, 4001)
    brute = np.nan_to_num(model.efficiency(grid, engine_speed, load_torque)).max()
    for best in (
        model.optimal_displacement_ratio(engine_speed, load_torque),
        model.optimal_displacement_ratio([engine_speed], load_torque),
    ):
        assert np.nan_to_num(best.efficiency) >= brute - 1e-6


@given(stages(), moderate, engine_speeds, load_torques, strokes)
def test_no_pair_is_better_than_the_best(
    stage, found, engine_speed, load_torque, stroke
):
    model = hmcvt.EfficiencyModel(stage, found)
    target = model.output_speed(stroke, engine_speed, load_torque)
    power = engine_speed * load_torque
    # The line leads to torques at which no lookup would answer.
    if not (0.1 < target < 1000.0 and SPEEDS[1] < power < 5000.0 * SPEEDS[0]):
        return
    best = model.optimal_displacement_ratio(
        engine_speed,
        load_torque,
        hold="output_speed",
        output_speed=target,
        engine_speed_limits=SPEEDS,
    )
    assert (
        np.nan_to_num(best.efficiency) >= best_on_the_line(model, target, power) - 1e-6
    )
    if np.isfinite(best.efficiency):
        assert SPEEDS[0] <= best.engine_speed <= SPEEDS[1]
        reached = model.output_speed(
            best.displacement_ratio, best.engine_speed, best.load_torque
        )
        assert reached == pytest.approx(target, rel=1e-6)


def best_on_the_line(model, target, power):
    """Best efficiency over strokes, each at the engine speed that holds output speed and power."""
    found = brute_force(
        model, Points(*np.array([[np.nan]] * 3 + [[target], [power]])), "output_speed"
    )
    return found[0]


@pytest.mark.parametrize("temperature", [20.0, 100.0])
def test_optimum_follows_the_oil_temperature(model, temperature):
    model = replace(model, effects=(OilTemperature(1.0),))
    strokes = np.linspace(-1.0, 1.0, 401)
    best = model.optimal_displacement_ratio(150.0, 200.0, oil_temperature=temperature)
    at_best = model.efficiency(best.displacement_ratio, 150.0, 200.0, temperature)
    assert best.efficiency == pytest.approx(at_best, rel=1e-9)
    others = model.efficiency(strokes, 150.0, 200.0, temperature)
    assert at_best >= np.nanmax(others) - 1e-6
    unknown = model.optimal_displacement_ratio(150.0, 200.0)
    assert at_best > 5e-4 + model.efficiency(
        unknown.displacement_ratio, 150.0, 200.0, temperature
    )
    drive = model.optimal_drive(100.0, 30_000.0, oil_temperature=temperature)
    assert drive.efficiency == pytest.approx(
        model.efficiency(
            drive.displacement_ratio, drive.engine_speed, drive.load_torque, temperature
        ),
        rel=1e-6,
    )
    with pytest.raises(hmcvt.InputError, match="oil_temperature = 350"):
        model.optimal_displacement_ratio(150.0, 200.0, oil_temperature=350.0)
